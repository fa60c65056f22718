"""Reading records back: every CRC and the gapless sequence, by the record's own layout."""

from __future__ import annotations

import struct
import zlib
from itertools import starmap
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from station.records.samples.layout import CURRENT, Layout
from station.records.samples.table import Table, table_of


class ReadBack(NamedTuple):
    """What reading the records back showed; `problems` is empty when they are exactly what was written."""

    records: int
    problems: tuple[str, ...]

    @property
    def sound(self) -> bool:
        """Whether every record is there and unchanged."""
        return not self.problems


def checksums(data: memoryview, layout: Layout = CURRENT) -> npt.NDArray[np.uint32]:
    """Return the CRC-32 of each complete record; a loop over zlib beats a vectorised table CRC here."""
    size, body = layout.record_bytes, layout.body_bytes
    count = len(data) // size
    bodies = struct.iter_unpack(f"{body}s{size - body}x", data[: count * size])
    return np.fromiter(starmap(zlib.crc32, bodies), np.uint32, count)


def sound_table(content: bytes, layout: Layout = CURRENT) -> Table:
    """Return the records that may be decoded: their CRC fits and their sequence grows; what follows is left out.

    A gap in the sequence, as lost records leave it, is none of its ends: `check_bytes` tells it.
    """
    rows = table_of(content, layout).rows
    kept = rows[rows["crc32"] == checksums(memoryview(content), layout)]
    sequence = kept["sequence"]
    back = np.flatnonzero(sequence[1:] <= sequence[:-1])
    return Table(kept[: int(back[0]) + 1] if back.size else kept, layout)


def check_bytes(
    content: bytes, expected: int | None = None, layout: Layout = CURRENT, *, unpacked: bool = False
) -> ReadBack:
    """Check length, CRCs, the gapless sequence and, where given, the expected number of records.

    unpacked: the records have just been given the CRCs that they have, so that these tell nothing.
    """
    problems: list[str] = []
    rest = len(content) % layout.record_bytes
    if rest:
        problems.append(f"{rest} bytes after the last complete record: it was cut off while being written")
    data = memoryview(content)[: len(content) - rest]
    rows = np.frombuffer(data, dtype=layout.dtype)
    records = len(rows)
    fitting = rows["crc32"] if unpacked else checksums(data, layout)
    broken = np.flatnonzero(rows["crc32"] != fitting)
    if broken.size:
        problems.append(f"{broken.size} of {records} records fail their CRC, the first at position {broken[0]}")
    else:
        sequence = rows["sequence"]
        gaps = np.flatnonzero(sequence != np.arange(records, dtype=np.uint64))
        if gaps.size:
            at = int(gaps[0])
            problems.append(f"the sequence has a gap: position {at} holds record {int(sequence[at])}")
    if expected is not None and records != expected:
        problems.append(f"{records} records found, {expected} were written")
    return ReadBack(records, tuple(problems))
