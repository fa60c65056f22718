"""One controller at a time on a real bench: a lock that the process holds which scans it.

The kernel lets go of it when that process ends, however it ends; the file itself stays and means nothing. It stands in
the service's own place with mode 0600: elsewhere any local user could hold it, and keep the bench from measuring.
"""

from __future__ import annotations

import fcntl
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from drivers.config import CanConfig
from station.errors import StationError
from station.own_place import own_folder

FOLDER = "benches"
FILE_PREFIX = "lostmotion-bench-"


class BenchBusyError(StationError):
    """Another process controls this bench."""


def lock_path(can: CanConfig) -> Path:
    """Return the lock's file: named by the wires, so that two files that describe one bench share it.

    Raises:
        StationError: the service's own place cannot be had; a lock anywhere else could be held by any local user.

    """
    name = f"{can.interface}-{can.channel}-{can.host}-{can.port}"
    return own_folder(FOLDER) / (FILE_PREFIX + re.sub(r"[^A-Za-z0-9._-]", "_", name))


@contextmanager
def alone_on(bench: str, can: CanConfig) -> Iterator[None]:
    """Hold a bench, told by its name and its bus, for this process; nothing has been sent to it before.

    Raises:
        BenchBusyError: another process holds it, or the lock cannot be had.

    """
    try:
        path = lock_path(can)
    except StationError as error:
        raise BenchBusyError(f"the bench cannot be reserved for this program: {error}") from error
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    except OSError as error:
        raise BenchBusyError(
            f"{path}: the lock file of the bench cannot be opened: {error.strerror}. Give this user write permission"
        ) from error
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            holder = os.pread(handle, 32, 0).decode("ascii", "replace").strip()
            raise BenchBusyError(
                f"the bench '{bench}' ({can.interface}, channel {can.channel}, {can.host}:{can.port}) is in "
                f"use by process {holder or 'unknown'}; nothing was sent to it. Wait for that run to end, or stop it"
            ) from error
        os.ftruncate(handle, 0)
        os.pwrite(handle, f"{os.getpid()}\n".encode(), 0)
        yield
    finally:
        os.close(handle)
