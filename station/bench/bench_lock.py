"""One controller at a time on a real bench: a lock that the process holds which scans it.

The kernel lets go of it when that process ends, however it ends; the file itself stays and means nothing.
"""

from __future__ import annotations

import fcntl
import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from recipes import Bench
from station.errors import StationError
from station.record.ring import SHARED_MEMORY

FILE_PREFIX = "lostmotion-bench-"


class BenchBusyError(StationError):
    """Another process controls this bench."""


def lock_path(bench: Bench) -> Path:
    """Return the lock's file: named by the wires, so that two files that describe one bench share it."""
    can = bench.can
    place = SHARED_MEMORY if SHARED_MEMORY.is_dir() else Path(tempfile.gettempdir())
    name = f"{can.interface}-{can.channel}-{can.host}-{can.port}"
    return place / (FILE_PREFIX + re.sub(r"[^A-Za-z0-9._-]", "_", name))


@contextmanager
def alone_on(bench: Bench) -> Iterator[None]:
    """Hold a bench for this process; nothing has been sent to it before.

    Raises:
        BenchBusyError: another process holds it, or the lock cannot be had.

    """
    path = lock_path(bench)
    try:
        handle = _open(path)
    except OSError as error:
        raise BenchBusyError(f"{path}: the lock of the bench cannot be opened: {error.strerror}") from error
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            holder = os.pread(handle, 32, 0).decode("ascii", "replace").strip()
            can = bench.can
            raise BenchBusyError(
                f"the bench '{bench.bench.name}' ({can.interface}, channel {can.channel}, {can.host}:{can.port}) is in "
                f"use by process {holder or 'unknown'}; nothing was sent to it. Wait for that run to end, or stop it"
            ) from error
        _leave_name(handle)
        yield
    finally:
        os.close(handle)


def _open(path: Path) -> int:
    try:
        return os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
    except PermissionError:  # made by another user: to lock it, reading is enough
        return os.open(path, os.O_RDONLY | os.O_NOFOLLOW)


def _leave_name(handle: int) -> None:
    if fcntl.fcntl(handle, fcntl.F_GETFL) & os.O_ACCMODE == os.O_RDWR:
        os.ftruncate(handle, 0)
        os.pwrite(handle, f"{os.getpid()}\n".encode(), 0)
