"""The file of a golden run: records without CRC and timing, packed small enough to live beside the tests.

Each field is a column of 8-byte words, every word XORed with the one before it, the bytes of equal weight side by side:
what stands still or moves slowly becomes zeroes, and xz takes those away. Nothing is rounded here. A run that begins
as another one does is stored from where it leaves it.

The columns stand by name, so a golden run goes on proving what it proved when the image gets one more channel: that one
shows what it shows before anything has come. A channel that is gone, and any change of the orders, asks for new runs.
"""

from __future__ import annotations

import json
import lzma
import struct
from pathlib import Path

import numpy as np

from definitions.first_image import first_image
from station.records.samples.layout import CURRENT
from station.records.samples.scan_record import RECORD_BYTES, pack, unpack
from station.records.samples.table import table_of

SHARED = struct.Struct("<I")
MAKE_ANEW = "if this is meant: make golden"


def _words(column: np.ndarray) -> np.ndarray:
    if column.dtype.kind == "f":
        return np.ascontiguousarray(column).view(np.uint64)
    return column.astype(np.int64).view(np.uint64)


def _leaves() -> list[tuple[tuple[str, ...], np.dtype]]:
    found = [(("scan",), CURRENT.dtype["scan"])]
    for group in ("image", "orders"):
        found += [((group, name), CURRENT.dtype[group][name]) for name in CURRENT.dtype[group].names]
    return found


def shared_records(content: bytes, base: bytes) -> int:
    """Return how many records two runs have in common at their beginning."""
    ours, theirs = (np.frombuffer(one, np.dtype((np.void, RECORD_BYTES))) for one in (content, base))
    count = min(len(ours), len(theirs))
    differing = np.flatnonzero(ours[:count] != theirs[:count])
    return int(differing[0]) if differing.size else count


def write_golden(path: Path, content: bytes, base: bytes = b"") -> None:
    """Write the records in `content` as a golden file; `base` is the run that it shares its beginning with."""
    shared = shared_records(content, base)
    table = table_of(content[shared * RECORD_BYTES :]).rows
    parts = []
    for names, _ in _leaves():
        column = table[names[0]] if len(names) == 1 else table[names[0]][names[1]]
        words = _words(column)
        words = words ^ np.concatenate((np.zeros(1, np.uint64), words[:-1]))
        parts.append(words.view(np.uint8).reshape(len(table), 8).T.tobytes())
    names = json.dumps([".".join(names) for names, _ in _leaves()]).encode() + b"\n"
    packed = lzma.compress(names + b"".join(parts), preset=9 | lzma.PRESET_EXTREME)
    path.write_bytes(SHARED.pack(shared) + packed)


def read_golden(path: Path, base: bytes = b"") -> bytes:
    """Return the records of a golden file as they stand in a run, with wake-up latency and work 0."""
    stored = path.read_bytes()
    (shared,) = SHARED.unpack_from(stored)
    head, _, data = lzma.decompress(stored[SHARED.size :]).partition(b"\n")
    kept: list[str] = json.loads(head)
    count = len(data) // 8 // len(kept)
    table = np.zeros(count, CURRENT.dtype)
    leaves = {".".join(names): (names, dtype) for names, dtype in _leaves()}
    new, gone = [name for name in leaves if name not in kept], [name for name in kept if name not in leaves]
    assert not gone, f"{path.name}: has {gone}, which a record has no more; {MAKE_ANEW}"
    for name in new:
        group, _, channel = name.partition(".")
        assert group == "image", f"{path.name}: does not have {name}; {MAKE_ANEW}"
        table[group][channel] = getattr(first_image(), channel)
    for index, name in enumerate(kept):
        names, dtype = leaves[name]
        block = np.frombuffer(data, np.uint8, 8 * count, 8 * count * index).reshape(8, count)
        words = np.bitwise_xor.accumulate(np.ascontiguousarray(block.T).view(np.uint64)[:, 0])
        values = words.view(np.float64) if dtype.kind == "f" else words.view(np.int64)
        target = table if len(names) == 1 else table[names[0]]
        target[names[-1]] = values.astype(dtype)
    rows = (unpack(memoryview(table[n : n + 1].tobytes())) for n in range(count))
    packed = (pack((n, scan, 0, 0), image, orders) for n, (scan, image, orders) in enumerate(rows, start=shared))
    return base[: shared * RECORD_BYTES] + b"".join(packed)
