"""Files that are there after a power failure, or not at all: written beside, flushed to the disk, then renamed."""

from __future__ import annotations

import contextlib
import json
import os
import stat
from errno import (
    EACCES,
    EDQUOT,
    EINVAL,
    EIO,
    EMLINK,
    ENOENT,
    ENOSPC,
    ENOSYS,
    ENOTDIR,
    EOPNOTSUPP,
    EOVERFLOW,
    EPERM,
    EROFS,
)
from pathlib import Path
from typing import Any, BinaryIO

from station.errors import RecordError

PART = ".part"
CANNOT_RESERVE = (EINVAL, EOPNOTSUPP)
"""What a file system answers that takes no room ahead of time."""

CANNOT_LINK = (EPERM, EOPNOTSUPP, ENOSYS, EMLINK)
"""What a file system answers that has no hard links."""

LARGEST_DOCUMENT = 256 << 20
"""Bytes of a document that are read: beyond any that this program writes, and no computer runs out of memory by it."""

LARGEST_SMALL_FILE = 1 << 20
"""Bytes that are read of a file that is small by nature: a key, a list of keys, the head of a chain."""

_LET_IN = "Give this user write permission"
_LET_READ = "Give this user read permission for this file and its folders"
_PUT_BACK = "Restore what is missing of this path, from a backup"
NEXT_ACTIONS: dict[int, str] = {
    ENOSPC: "Free space on this disk",
    EDQUOT: "Free disk space of this user, or raise the disk quota",
    EROFS: "Mount the disk for writing. If it already is, the disk failed: see dmesg and check the disk",
    EIO: "The disk failed or is disconnected: see dmesg, check its cable, and replace it before the next run",
    EOVERFLOW: "Restore the file from a backup, or move its folder out of the data folder",
    EACCES: _LET_IN,
    EPERM: _LET_IN,
    ENOENT: _PUT_BACK,
    ENOTDIR: _PUT_BACK,
    EINVAL: "Move away what lies in the place of a file. Where nothing else lies there, check the disk",
}
"""What a person does about a disk, by what it answered."""

OTHERWISE = "Check the disk"
VANISHED = "this file was deleted, moved or replaced while the program was writing it. Put the file back in its place"
"""What is said of a file that its path does not lead to any more."""


def refused(path: Path, error: OSError, deed: str = "written") -> RecordError:
    """Return the error of a disk that refused a deed (written, flushed, read): place, its answer, and what to do."""
    action = NEXT_ACTIONS.get(error.errno or 0, OTHERWISE)
    if action == _LET_IN and deed == "read":
        action = _LET_READ
    return RecordError(f"{path}: cannot be {deed}: {error.strerror or error}. {action}")


def open_file(path: Path) -> BinaryIO:
    """Open a file to read it. A pipe or a device in its place is refused at once, and nobody waits for it.

    Raises:
        OSError: it cannot be opened, or is no file.

    """
    return os.fdopen(open_handle(path, os.O_RDONLY), "rb")


def open_handle(path: Path, flags: int, rights: int = 0o666) -> int:
    """Return the handle of a file that is opened with these flags, and made where they say so; OSError as above."""
    handle = os.open(path, flags | os.O_NONBLOCK | os.O_CLOEXEC, rights)
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise OSError(EINVAL, "this is a folder, a pipe or a device, not a file", str(path))
    return handle


def document_bytes(file: BinaryIO, most: int = LARGEST_DOCUMENT) -> bytes:
    """Return the bytes of an open file that holds a document; OSError where it is larger than `most`, or unreadable."""
    if os.fstat(file.fileno()).st_size > most:
        raise OSError(EOVERFLOW, f"this file is larger than {most >> 20} MB")
    return file.read()


def read_file(path: Path, most: int | None = LARGEST_DOCUMENT) -> bytes:
    """Return the bytes of a file; RecordError where it cannot be read, or something else is in its place.

    most: bytes of the largest that is read; None for one that is copied whole, however large.
    """
    try:
        with open_file(path) as file:
            return file.read() if most is None else document_bytes(file, most)
    except OSError as error:
        raise refused(path, error, "read") from error


def seen_text(found: os.stat_result) -> str:
    """Return size, times and inode of a file, by which a change of it shows.

    The time of the last change of the file itself (ctime) is among them: to set it takes setting the computer's clock.
    """
    return f"{found.st_size}:{found.st_mtime_ns}:{found.st_ctime_ns}:{found.st_ino}"


def sync_folder(folder: Path) -> None:
    """Flush a folder, so that a rename in it survives a power failure."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_atomic(path: Path, content: bytes, *, flush: bool = True) -> None:
    """Replace `path` by `content`, completely or not at all.

    Without `flush` that holds for killed processes only, not for a power failure; nobody waits for the disk then.

    Raises:
        RecordError: the disk is full, read-only, or gone.

    """
    beside = _beside(path)
    try:
        _write_beside(beside, content, flush=flush)
        beside.replace(path)
        if flush:
            sync_folder(path.parent)
    except OSError as error:
        with contextlib.suppress(OSError):
            beside.unlink(missing_ok=True)
        raise refused(path, error) from error


def _write_beside(beside: Path, content: bytes, *, flush: bool) -> None:
    # Not emptied first: the room that was taken for it is there still, and no longer once it has been given back.
    with os.fdopen(open_handle(beside, os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW), "wb") as file:
        file.write(content)
        file.truncate()
        file.flush()
        if flush:
            os.fsync(file.fileno())


def write_new(path: Path, content: bytes) -> bool:
    """Write a file that is not there yet, completely or not at all; False where one of another content is there.

    One of this content is taken for the one that was written before. The folder may be a share.

    Raises:
        RecordError: the disk or the share is full, read-only, or gone.

    """
    beside = _beside(path)
    try:
        if not os.path.lexists(path):
            _write_beside(beside, content, flush=True)
            _name_new(beside, path)
        same = stat.S_ISREG(path.lstat().st_mode)
        if same:
            with open_file(path) as file:
                same = file.read(len(content) + 1) == content
        if same:
            beside.unlink(missing_ok=True)  # of a writer that was killed as it named the file
            _sync_share(path.parent)
    except OSError as error:
        with contextlib.suppress(OSError):
            beside.unlink(missing_ok=True)
        raise refused(path, error) from error
    return same


def _name_new(beside: Path, path: Path) -> None:
    """Give a file its name, unless another has it by now."""
    try:
        os.link(beside, path)
    except FileExistsError:
        beside.unlink()
    except OSError as error:
        if error.errno not in CANNOT_LINK:
            raise
        beside.rename(path)  # a share without hard links


def _sync_share(folder: Path) -> None:
    try:
        sync_folder(folder)
    except OSError as error:
        if error.errno not in CANNOT_RESERVE:  # shares answer so that flush no folder
            raise


def append_line(path: Path, line: bytes) -> None:
    """Add a line to a file durably, which is made if it is not there; a torn line before it stays one of its own.

    Raises:
        RecordError: the disk refuses it.

    """
    new = not path.exists()
    try:
        handle = open_handle(path, os.O_RDWR | os.O_APPEND | os.O_CREAT)
        try:
            size = os.fstat(handle).st_size
            torn = size > 0 and os.pread(handle, 1, size - 1) != b"\n"
            os.write(handle, (b"\n" if torn else b"") + line + b"\n")
            os.fsync(handle)
        finally:
            os.close(handle)
        if new:
            sync_folder(path.parent)
    except OSError as error:
        raise refused(path, error) from error


def reserve(path: Path, size: int) -> None:
    """Take room on the disk, in bytes, for the next `write_atomic` of this path, which a full disk then takes.

    Raises:
        RecordError: the disk has no such room.

    """
    beside = _beside(path)
    try:
        with os.fdopen(open_handle(beside, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW), "wb") as file:
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


def read_from_disk(path: Path, most: int | None = LARGEST_DOCUMENT) -> bytes:
    """Read a file from the disk rather than from the kernel's cache of what was just written.

    most: as in `read_file`.

    Raises:
        RecordError: the file cannot be read.

    """
    try:
        with open_file(path) as file:
            leave_to_disk(file)
            return file.read() if most is None else document_bytes(file, most)
    except OSError as error:
        raise refused(path, error, "read") from error


def leave_to_disk(file: BinaryIO) -> None:
    """Flush an open file and drop what the kernel's cache has of it, so that it is read from the disk; or OSError."""
    if hasattr(os, "posix_fadvise"):
        os.fsync(file.fileno())
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


class Appender:
    """A file that only grows by whole writes; flushed by `sync`, which the owner calls about once a second.

    A file that was deleted, moved or replaced under it takes nothing more: what goes on there, nobody would find.
    """

    def __init__(self, path: Path, *, must_exist: bool = False) -> None:
        """Open a file to append to it; with `must_exist` one that is not there is refused and not made."""
        self._path = path
        try:
            made = 0 if must_exist else os.O_CREAT
            flags = os.O_WRONLY | os.O_APPEND | os.O_NONBLOCK | os.O_CLOEXEC | made  # a pipe is refused at once
            self._file = os.fdopen(os.open(path, flags, 0o666), "ab", buffering=0)
            self._size = self._file.seek(0, os.SEEK_END)
            sync_folder(path.parent)
        except OSError as error:
            raise refused(path, error) from error

    def write(self, data: bytes | memoryview) -> None:
        """Append all of `data`, or nothing: then RecordError, because the disk is full or refuses."""
        view = memoryview(data)
        self._refuse_vanished()
        try:
            while view:
                view = view[self._file.write(view) :]
        except OSError as error:
            with contextlib.suppress(OSError):
                self._file.truncate(self._size)
            raise refused(self._path, error) from error
        self._size += len(data)

    def sync(self) -> None:
        """Flush to the disk; RecordError when it refuses, or when the file is no longer in its place."""
        self._refuse_vanished()
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            raise refused(self._path, error, "flushed") from error

    def _refuse_vanished(self) -> None:
        """Refuse to go on in a file that its path does not lead to any more."""
        try:
            own, there = os.fstat(self._file.fileno()), self._path.stat()
        except OSError as error:
            if error.errno in (ENOENT, ENOTDIR):
                raise RecordError(f"{self._path}: {VANISHED}") from error
            raise refused(self._path, error) from error
        if own.st_nlink == 0 or not os.path.samestat(own, there):
            raise RecordError(f"{self._path}: {VANISHED}")

    def close(self) -> None:
        """Flush and close; closed also when flushing raises RecordError."""
        if not self._file.closed:
            try:
                self.sync()
            finally:
                self._file.close()
