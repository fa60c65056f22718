"""Files that are there after a power failure, or not at all: written beside, flushed to the disk, then renamed."""

from __future__ import annotations

import contextlib
import json
import os
from pathlib import Path
from typing import Any

from station.errors import RecordError


def sync_folder(folder: Path) -> None:
    """Flush a folder, so that a rename in it survives a power failure."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_durable(path: Path, content: bytes) -> None:
    """Replace `path` by `content`, completely or not at all.

    Raises:
        RecordError: the disk is full, read-only, or gone.

    """
    beside = path.with_name(f".{path.name}.part")
    try:
        with beside.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
        sync_folder(path.parent)
    except OSError as error:
        with contextlib.suppress(OSError):  # where nothing can be written, nothing can be taken away either
            beside.unlink(missing_ok=True)
        raise RecordError(f"{path}: cannot be written: {error.strerror}. Free the disk, then run again") from error


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
        raise RecordError(f"{path}: cannot be read: {error.strerror}") from error


class Appender:
    """A file that only grows by whole writes; flushed by `sync`, which the owner calls about once a second."""

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._file = path.open("ab", buffering=0)
            self._size = self._file.seek(0, os.SEEK_END)
            sync_folder(path.parent)
        except OSError as error:
            raise RecordError(f"{path}: cannot be written: {error.strerror}") from error

    def write(self, data: bytes | memoryview) -> None:
        """Append all of `data`, or nothing: then RecordError, because the disk is full or refuses."""
        view = memoryview(data)
        try:
            while view:
                view = view[self._file.write(view) :]
        except OSError as error:
            with contextlib.suppress(OSError):
                self._file.truncate(self._size)
            raise RecordError(f"{self._path}: cannot be written: {error.strerror}. Free the disk") from error
        self._size += len(data)

    def sync(self) -> None:
        """Flush to the disk."""
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            raise RecordError(f"{self._path}: cannot be flushed: {error.strerror}") from error

    def close(self) -> None:
        """Flush and close; closed also when flushing raises RecordError."""
        if not self._file.closed:
            try:
                self.sync()
            finally:
                self._file.close()
