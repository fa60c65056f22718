"""Files that are there after a power failure, or not at all: written beside, flushed to the disk, then renamed."""

from __future__ import annotations

import contextlib
import json
import os
from errno import EACCES, EDQUOT, EINVAL, EIO, ENOENT, ENOSPC, ENOTDIR, EOPNOTSUPP, EPERM, EROFS
from pathlib import Path
from typing import Any

from station.errors import RecordError

PART = ".part"
CANNOT_RESERVE = (EINVAL, EOPNOTSUPP)
"""What a file system answers that takes no room ahead of time."""

_LET_IN = "Give this user the right to it"
_PUT_BACK = "Put back what is missing there"
NEXT_ACTIONS: dict[int, str] = {
    ENOSPC: "Free the disk",
    EDQUOT: "Free what this user has on the disk, or raise the quota",
    EROFS: "Mount the disk for writing. If it was, it failed and was then taken out of use: see dmesg, and check it",
    EIO: "The disk fails, or is not connected any more: see dmesg, check its cable, and replace it before the next run",
    EACCES: _LET_IN,
    EPERM: _LET_IN,
    ENOENT: _PUT_BACK,
    ENOTDIR: _PUT_BACK,
}
"""What a person does about a disk, by what it answered."""

OTHERWISE = "Check the disk"


def refused(path: Path, error: OSError, deed: str = "written") -> RecordError:
    """Return the error of a disk that refused a deed (written, flushed, read): place, its answer, and what to do."""
    action = NEXT_ACTIONS.get(error.errno or 0, OTHERWISE)
    return RecordError(f"{path}: cannot be {deed}: {error.strerror or error}. {action}")


def sync_folder(folder: Path) -> None:
    """Flush a folder, so that a rename in it survives a power failure."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_durable(path: Path, content: bytes, *, flush: bool = True) -> None:
    """Replace `path` by `content`, completely or not at all.

    Without `flush` that holds for killed processes only, not for a power failure; nobody waits for the disk then.

    Raises:
        RecordError: the disk is full, read-only, or gone.

    """
    beside = _beside(path)
    try:
        # Not emptied first: the room that was taken for it is there still, and no longer once it has been given back.
        with os.fdopen(os.open(beside, os.O_WRONLY | os.O_CREAT, 0o666), "wb") as file:
            file.write(content)
            file.truncate()
            file.flush()
            if flush:
                os.fsync(file.fileno())
        beside.replace(path)
        if flush:
            sync_folder(path.parent)
    except OSError as error:
        with contextlib.suppress(OSError):
            beside.unlink(missing_ok=True)
        raise refused(path, error) from error


def reserve(path: Path, size: int) -> None:
    """Take room on the disk, in bytes, for the next `write_durable` of this path, which a full disk then takes.

    Raises:
        RecordError: the disk has no such room.

    """
    beside = _beside(path)
    try:
        with beside.open("wb") as file:
            os.posix_fallocate(file.fileno(), 0, size)
    except OSError as error:
        with contextlib.suppress(OSError):
            beside.unlink(missing_ok=True)
        if error.errno not in CANNOT_RESERVE:
            raise refused(path, error) from error


def remove_parts(folder: Path) -> None:
    """Remove what a process that was killed left half written, or reserved, in a folder that it owned."""
    for beside in folder.glob(f".*{PART}"):
        with contextlib.suppress(OSError):
            beside.unlink(missing_ok=True)


def _beside(path: Path) -> Path:
    return path.with_name(f".{path.name}{PART}")


def as_json(content: Any) -> bytes:
    """Return JSON as it is stored: readable, with the field's own signs, numbers in full."""
    return (json.dumps(content, ensure_ascii=False, indent=1, allow_nan=False) + "\n").encode()


def read_from_disk(path: Path) -> bytes:
    """Read a file from the disk rather than from the kernel's cache of what was just written.

    Raises:
        RecordError: the file cannot be read.

    """
    try:
        with path.open("rb") as file:
            if hasattr(os, "posix_fadvise"):
                os.fsync(file.fileno())
                os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
            return file.read()
    except OSError as error:
        raise refused(path, error, "read") from error


class Appender:
    """A file that only grows by whole writes; flushed by `sync`, which the owner calls about once a second."""

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._file = path.open("ab", buffering=0)
            self._size = self._file.seek(0, os.SEEK_END)
            sync_folder(path.parent)
        except OSError as error:
            raise refused(path, error) from error

    def write(self, data: bytes | memoryview) -> None:
        """Append all of `data`, or nothing: then RecordError, because the disk is full or refuses."""
        view = memoryview(data)
        try:
            while view:
                view = view[self._file.write(view) :]
        except OSError as error:
            with contextlib.suppress(OSError):
                self._file.truncate(self._size)
            raise refused(self._path, error) from error
        self._size += len(data)

    def sync(self) -> None:
        """Flush to the disk."""
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            raise refused(self._path, error, "flushed") from error

    def close(self) -> None:
        """Flush and close; closed also when flushing raises RecordError."""
        if not self._file.closed:
            try:
                self.sync()
            finally:
                self._file.close()
