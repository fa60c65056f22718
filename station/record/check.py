"""Reading records back: every CRC, the gapless sequence, and the same bytes as a numpy table."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from controller.image import IMAGE_FIELDS, ORDERS_FIELDS, Field
from station.record.scan_record import BODY_BYTES, CHECK_FIELD, HEADER_FIELDS, RECORD_BYTES

NUMPY_TYPES = {"b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "q": "<i8", "Q": "<u8", "d": "<f8"}


def _columns(fields: tuple[Field, ...]) -> list[tuple[str, str]]:
    return [(field.name, NUMPY_TYPES[field.format]) for field in fields]


RECORD_DTYPE: np.dtype[np.void] = np.dtype(
    [
        *_columns(HEADER_FIELDS),
        ("image", _columns(IMAGE_FIELDS)),
        ("orders", _columns(ORDERS_FIELDS)),
        *_columns((CHECK_FIELD,)),
    ],
)
"""A record as a structured type: `table["image"]["torque_in_nm"]`, `table["orders"]["state"]`."""

Table = npt.NDArray[np.void]


class ReadBack(NamedTuple):
    """What reading the records back showed; `problems` is empty when they are exactly what was written."""

    records: int
    problems: tuple[str, ...]

    @property
    def sound(self) -> bool:
        """Whether every record is there and unchanged."""
        return not self.problems


def read_table(path: Path) -> Table:
    """Return all complete records of a file; a last one that was cut off is left out."""
    return table_of(path.read_bytes())


def table_of(content: bytes) -> Table:
    """Return all complete records in `content`; a last one that was cut off is left out."""
    return np.frombuffer(content, dtype=RECORD_DTYPE, count=len(content) // RECORD_BYTES)


def _broken(data: memoryview) -> list[int]:
    """Return the positions of records whose CRC differs; a loop over zlib beats a vectorised table CRC here."""
    stored = np.frombuffer(data, dtype=RECORD_DTYPE)["crc32"]
    crc32 = zlib.crc32
    computed = np.fromiter(
        (crc32(data[start : start + BODY_BYTES]) for start in range(0, len(data), RECORD_BYTES)),
        dtype=np.uint32,
        count=len(stored),
    )
    return [int(index) for index in np.flatnonzero(stored != computed)]


def check_bytes(content: bytes, expected: int | None = None) -> ReadBack:
    """Check length, CRCs, the gapless sequence and, where given, the expected number of records."""
    problems: list[str] = []
    rest = len(content) % RECORD_BYTES
    if rest:
        problems.append(f"{rest} bytes after the last complete record: it was cut off while being written")
    data = memoryview(content)[: len(content) - rest]
    records = len(data) // RECORD_BYTES
    broken = _broken(data)
    if broken:
        problems.append(f"{len(broken)} of {records} records fail their CRC, the first at position {broken[0]}")
    else:
        sequence = np.frombuffer(data, dtype=RECORD_DTYPE)["sequence"]
        gaps = np.flatnonzero(sequence != np.arange(records, dtype=np.uint64))
        if gaps.size:
            at = int(gaps[0])
            problems.append(f"the sequence has a gap: position {at} holds record {int(sequence[at])}")
    if expected is not None and records != expected:
        problems.append(f"{records} records found, {expected} were written")
    return ReadBack(records, tuple(problems))


def check_file(path: Path, expected: int | None = None) -> ReadBack:
    """Read a file of records back from the disk and check it (see `check_bytes`)."""
    try:
        content = path.read_bytes()
    except OSError as error:
        return ReadBack(0, (f"{path}: {error.strerror}",))
    return check_bytes(content, expected)


def column(table: Table, group: str, name: str) -> npt.NDArray[Any]:
    """Return one field of all records as a contiguous array."""
    return np.ascontiguousarray(table[group][name])
