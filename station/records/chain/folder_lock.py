"""The lock of a data folder: one process at a time adds to its chain, and nobody waits for another without an end.

Who can open the file can hold the lock. So it is for the owner alone, or for the group where the folder is for the
group to write to.
"""

from __future__ import annotations

import fcntl
import os
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from station.atomic_file import refused
from station.errors import RecordError

LOCK = ".lock"
OF_OWNER, OF_GROUP = 0o600, 0o660

LONGEST_WAIT_S = 30.0
"""A process holds the lock for as long as it takes to lay out a run: some flushes of a disk that may be busy."""

TRY_EVERY_S = 0.01


@contextmanager
def held(data: Path) -> Iterator[None]:
    """Hold the lock of a data folder.

    Raises:
        RecordError: the folder cannot be used, or another process did not let go of the lock.

    """
    path = data / LOCK
    handle = _opened(path)
    try:
        _close_to_others(handle, data)
        _take(handle, path)
        while not _is_that_of(path, handle):  # removed or replaced meanwhile: others hold the new one
            os.close(handle)
            handle = _opened(path)
            _close_to_others(handle, data)
            _take(handle, path)
        yield
    finally:
        os.close(handle)


def _opened(path: Path) -> int:
    try:
        return os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, OF_OWNER)
    except OSError as error:
        raise RecordError(
            f"the data folder cannot be used: {refused(path, error)}. Or choose another data folder with --data"
        ) from error


def _is_that_of(path: Path, handle: int) -> bool:
    """Whether the file by this name is the one that was opened."""
    try:
        return os.path.samestat(path.stat(follow_symlinks=False), os.fstat(handle))
    except OSError:
        return False


def _close_to_others(handle: int, data: Path) -> None:
    """Take the rights of others from a lock that this user owns; that of another user is left as it is."""
    found, folder = os.fstat(handle), data.stat()
    if found.st_uid != os.geteuid():
        return
    rights = OF_OWNER
    with suppress(OSError):  # a file system without owners and rights, or a group that this user is not in
        if folder.st_mode & stat.S_IWGRP:
            if found.st_gid != folder.st_gid:
                os.fchown(handle, -1, folder.st_gid)
            rights = OF_GROUP
    with suppress(OSError):
        if stat.S_IMODE(found.st_mode) != rights:
            os.fchmod(handle, rights)


def _take(handle: int, path: Path) -> None:
    end = time.monotonic() + LONGEST_WAIT_S
    while True:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() >= end:
                raise RecordError(
                    f"{path}: another process keeps this file locked for more than {LONGEST_WAIT_S:g} s. Find the "
                    f"process with 'fuser {path}', end it, and run the command again. A run that is recorded "
                    "already gets its result from 'lostmotion conclude'"
                ) from None
            time.sleep(TRY_EVERY_S)
        except OSError as error:
            raise refused(path, error, "locked") from error
        else:
            return
