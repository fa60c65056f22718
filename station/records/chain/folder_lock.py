"""The lock of a data folder: one process at a time adds to its chain."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from station.atomic_file import refused
from station.errors import RecordError

LOCK = ".lock"


@contextmanager
def held(data: Path) -> Iterator[None]:
    """Hold the lock of a data folder; RecordError where the folder cannot be used."""
    try:
        handle = os.open(data / LOCK, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
    except OSError as error:
        raise RecordError(
            f"the data folder cannot be used: {refused(data / LOCK, error)}. Or choose another data folder with --data"
        ) from error
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)
