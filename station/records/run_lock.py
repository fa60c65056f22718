"""Who owns a run: the process that holds the lock in its folder, its supervisor or the one that took it over.

A process id says that only on the computer, and in the container, that it belongs to; the lock holds across both, and
the kernel lets go of it when its process ends, however it ends. The file stays and means nothing.
"""

from __future__ import annotations

import errno
import fcntl
import os
import time
from pathlib import Path

from station.atomic_file import open_handle
from station.errors import RecordError

LOCK = ".owner"
NO_LOCKS_HERE = frozenset({errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS, errno.EINVAL})
"""A file system without locks: the process id alone has to do."""

TRIES, TRY_EVERY_S = 5, 0.01


class RunLock:
    """The lock of one run's folder."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / LOCK
        self._handle = -1

    def take(self) -> bool:
        """Become the owner; False when another process is, or when the folder cannot be written.

        Somebody who only looks (`taken`) is waited for.

        Raises:
            RecordError: a pipe or a device is in place of the lock, so that nobody can own the run.

        """
        try:
            handle = open_handle(self._path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW)
        except OSError as error:
            if error.errno == errno.EINVAL:
                raise RecordError(
                    f"{self._path}: {error.strerror}. Move it out of the folder of the run, and try again"
                ) from error
            return False
        for _ in range(TRIES):
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                if error.errno not in NO_LOCKS_HERE:
                    time.sleep(TRY_EVERY_S)
                    continue
            self._handle = handle
            return True
        os.close(handle)
        return False

    def close(self) -> None:
        """Stop being the owner; safe to call twice."""
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1

    def taken(self) -> bool:
        """Whether some process owns the run now, this one too."""
        if self._handle >= 0:
            return True
        try:
            handle = open_handle(self._path, os.O_RDONLY | os.O_NOFOLLOW)
        except OSError:
            return False
        try:
            fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError as error:
            return error.errno not in NO_LOCKS_HERE
        else:
            return False
        finally:
            os.close(handle)
