"""A file of lines that grows for years, read a block at a time: what is looked for is a few lines of it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from station.atomic_file import leave_to_disk, open_file, refused
from station.errors import RecordError

BLOCK_BYTES = 1 << 18
"""As fast as larger blocks, whose memory stays with each thread of a server that once looked."""

LARGEST_LINES = 1 << 30
"""Bytes of such a file that are read: a chain of half a million runs. No computer runs out of memory by it."""

ROOM_TO_CONCLUDE = 1 << 20
"""Bytes before that end which are for the conclusions of runs: none is begun or removed there."""


def lines_bytes(file: BinaryIO, path: Path) -> int:
    """Return how large an open file of lines is; RecordError as `refuse_larger`."""
    size = os.fstat(file.fileno()).st_size
    refuse_larger(size, path)
    return size


def refuse_larger(size: int, path: Path, most: int = LARGEST_LINES) -> None:
    """Raise RecordError where a file of lines is larger than the largest that is read, or than `most`."""
    if size > most:
        raise RecordError(
            f"{path}: this file is too large: {size} bytes; allowed are {most >> 20} MiB. Restore it from a "
            "backup if others wrote to it, or choose another data folder with --data"
        )


def read_back(path: Path) -> None:
    """Flush a file of lines and read it from the disk, however little of it is looked for behind this.

    Raises:
        RecordError: as `refuse_larger`; or the disk cannot keep it or give it back.

    """
    try:
        with open_file(path) as file:
            lines_bytes(file, path)
            leave_to_disk(file)
            while file.read(BLOCK_BYTES):
                pass
    except OSError as error:
        raise refused(path, error, "read") from error


def lines_with(path: Path, token: bytes) -> Iterator[bytes]:
    """Yield the whole lines of a file that hold a token, in their order; RecordError where it cannot be read."""
    for block, length in blocks(path):
        yield from lines_in(block, token, length)


def lines_in(block: bytes | bytearray, token: bytes, length: int) -> Iterator[bytes]:
    """Yield the lines that hold a token, of a block whose last whole line ends at a length."""
    at = block.find(token, 0, length)
    while at >= 0:
        yield line_at(block, at)
        at = block.find(token, block.find(b"\n", at), length)


def line_at(block: bytes | bytearray, at: int) -> bytes:
    """Return the whole line in a block that a place is in."""
    return bytes(block[block.rfind(b"\n", 0, at) + 1 : block.find(b"\n", at)])


def blocks(path: Path) -> Iterator[tuple[bytearray, int]]:
    """Yield a file as whole lines in a buffer that is used again, and their length; a line without its end is none."""
    block, kept = bytearray(BLOCK_BYTES), 0
    try:
        with open_file(path) as file:
            lines_bytes(file, path)
            while count := file.readinto(memoryview(block)[kept:]):  # type: ignore[attr-defined]
                length = block.rfind(b"\n", 0, kept + count) + 1
                if length:
                    yield block, length
                kept += count - length
                block[:kept] = block[length : length + kept]
                if kept == len(block):
                    block.extend(bytes(len(block)))  # a line that is longer than that
    except FileNotFoundError:
        return
    except OSError as error:
        raise refused(path, error, "read") from error
