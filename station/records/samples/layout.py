"""The layout of a run's records, as its own samples.json says it: which channel stands where, and in which format.

A reader obeys the record's description and not the field tables of today. A channel that today's code does not know is
read like any other; one that the record does not have is absent, and never zero (see `station.records.samples.table`).
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from station.atomic_file import as_json
from station.documents.entries import Plain
from station.documents.reading import NEXT_STEP
from station.errors import RecordError
from station.records.samples.scan_record import CHECK_FIELD, FIELDS_IN_ORDER, HEADER_FIELDS
from station.records.samples.value_names import CODED, Coded

if TYPE_CHECKING:
    import numpy as np

LAYOUT = "samples.json"

FORMATS: dict[int, str] = {
    1: "fixed-size records, little-endian, a CRC-32 at the end of each; the description has no entry 'format'",
    2: "as format 1; the entries 'values' and 'bits' give the meaning of a channel's numbers",
}
"""Formats of samples.json that this code reads; it writes the last one."""

FORMAT = max(FORMATS)
NUMPY_TYPES = {"b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "q": "<i8", "Q": "<u8", "d": "<f8"}
GROUPS = ("record", "image", "orders")
NEEDED = {field.name: field.format for field in (*HEADER_FIELDS[:2], CHECK_FIELD)}
"""Channels of the group `record` without which nothing can be checked, and their formats."""

MOST_BYTES = 1 << 16
"""More than any record has: a damaged description must not ask for gigabytes."""


class Channel(NamedTuple):
    """One row of a description: where a value stands, its `struct` letter, unit, meaning, and names of its numbers."""

    group: str
    offset: int
    name: str
    format: str
    unit: str
    meaning: str
    coded: Coded = Coded()

    @property
    def end(self) -> int:
        """Offset behind the value."""
        return self.offset + struct.calcsize("<" + self.format)

    @property
    def dtype(self) -> str:
        """Type of the value for numpy."""
        return NUMPY_TYPES[self.format]

    def as_json(self) -> Plain:
        """Return the row as it is stored; numbers that have no names have no entry for them."""
        plain = {key: value for key, value in self._asdict().items() if key != "coded"}
        return plain | self.coded.as_json()


@dataclass(frozen=True)
class Layout:
    """All channels of a record in the order of their offsets, and the record's size."""

    channels: tuple[Channel, ...]
    record_bytes: int

    def group(self, group: str) -> tuple[Channel, ...]:
        """Return the channels of a group, in their order."""
        return tuple(one for one in self.channels if one.group == group)

    @property
    def body_bytes(self) -> int:
        """Bytes that the CRC at the end of each record is taken of."""
        return self.channels[-1].offset

    @cached_property
    def dtype(self) -> np.dtype[np.void]:
        """A record as a structured type: header fields, then `image` and `orders`, which are structured themselves."""
        fields: dict[str, tuple[Any, int]] = {one.name: (one.dtype, one.offset) for one in self.group("record")}
        fields |= {group: self._part(group) for group in GROUPS[1:]}
        # In the order of their offsets: numpy packs a type anew, in the order of its names, where it joins arrays.
        return _structured(dict(sorted(fields.items(), key=lambda one: one[1][1])), self.record_bytes)

    def _part(self, group: str) -> tuple[np.dtype[np.void], int]:
        """Return the type of a group and where it begins."""
        channels = self.group(group)
        start, end = (channels[0].offset, channels[-1].end) if channels else (0, 0)
        inside = {one.name: (one.dtype, one.offset - start) for one in channels}
        return _structured(inside, end - start), start

    @cached_property
    def struct(self) -> struct.Struct:
        """Unpacks a record into the values of `channels`, in their order."""
        parts, at = ["<"], 0
        for one in self.channels:
            parts += ["x" * (one.offset - at), one.format]
            at = one.end
        return struct.Struct("".join(parts))

    def as_json(self) -> Plain:
        """Return the description as it is stored."""
        rows = [one.as_json() for one in self.channels]
        return {"format": FORMAT, "record_bytes": self.record_bytes, "byte_order": "little", "fields": rows}

    @cached_property
    def described(self) -> bytes:
        """The description as the file that every new run gets."""
        return as_json(self.as_json())


def _structured(fields: Mapping[str, tuple[Any, int]], size: int) -> np.dtype[np.void]:
    import numpy as np  # noqa: PLC0415 - the scan process, and a new supervisor in a hurry, look at no samples

    formats, offsets = [one for one, _ in fields.values()], [offset for _, offset in fields.values()]
    return np.dtype({"names": [*fields], "formats": formats, "offsets": offsets, "itemsize": size})


def _current() -> Layout:
    channels: list[Channel] = []
    for group, fields in FIELDS_IN_ORDER:
        for name, letter, unit, meaning in fields:
            offset = channels[-1].end if channels else 0
            channels.append(Channel(group, offset, name, letter, unit, meaning, CODED.get((group, name), Coded())))
    return Layout(tuple(channels), channels[-1].end)


CURRENT = _current()
"""The layout that this code records by."""


def layout_in(said: Any, where: Path) -> Layout:
    """Return the layout that a description says.

    Raises:
        RecordError: it is of a newer format, or damaged; place, what was found and what is allowed.

    """
    if not isinstance(said, dict):
        raise RecordError(f"{where}: is damaged: this file does not describe the channels of a record. {NEXT_STEP}")
    number = said.get("format", 1)
    if not isinstance(number, int) or number not in FORMATS:
        raise RecordError(
            f"{where}: format: found {number!r}; this version reads {', '.join(map(str, FORMATS))}. "
            "Read the run with the version of lostmotion that run.json names, or a newer one"
        )
    order, size, rows = said.get("byte_order"), said.get("record_bytes"), said.get("fields")
    if order != "little":
        raise RecordError(f"{where}: is damaged: byte_order: found {order!r}; allowed: 'little'. {NEXT_STEP}")
    if not isinstance(size, int) or not 0 < size <= MOST_BYTES:
        raise RecordError(f"{where}: is damaged: record_bytes: found {size!r}; allowed: 1 to {MOST_BYTES}. {NEXT_STEP}")
    if not isinstance(rows, list):
        raise RecordError(f"{where}: is damaged: fields: found no list of channels. {NEXT_STEP}")
    channels = tuple(_channel(row, f"{where}: is damaged: fields[{number}]") for number, row in enumerate(rows))
    problem = _disorder(channels, size)
    if problem:
        raise RecordError(f"{where}: is damaged: {problem}. {NEXT_STEP}")
    return Layout(channels, size)


def _channel(row: Any, place: str) -> Channel:
    if not isinstance(row, dict):
        raise RecordError(f"{place}: found {row!r}; expected the description of a channel. {NEXT_STEP}")
    texts = [row.get(key) for key in ("group", "name", "format", "unit", "meaning")]
    if not all(isinstance(text, str) for text in texts):
        raise RecordError(
            f"{place}: group, name, format, unit and meaning: found {texts}; expected a text for each of them. "
            f"{NEXT_STEP}"
        )
    group, name, letter, unit, meaning = map(str, texts)
    offset = row.get("offset")
    if group not in GROUPS or letter not in NUMPY_TYPES or not name.isidentifier():
        raise RecordError(
            f"{place}: found {group}.{name} with format {letter!r}; allowed: groups {', '.join(GROUPS)}, "
            f"formats {' '.join(NUMPY_TYPES)}. {NEXT_STEP}"
        )
    if not isinstance(offset, int) or isinstance(offset, bool) or offset < 0:
        raise RecordError(f"{place}: offset: found {offset!r}; expected a number of bytes, 0 or more. {NEXT_STEP}")
    try:
        coded = Coded(*({int(n): str(text) for n, text in (row.get(key) or {}).items()} for key in ("values", "bits")))
    except (AttributeError, TypeError, ValueError) as error:
        raise RecordError(
            f"{place}: values and bits must be names by number, such as '1': 'ready': {error}. {NEXT_STEP}"
        ) from error
    return Channel(group, offset, name, letter, unit, meaning, coded)


def _disorder(channels: tuple[Channel, ...], size: int) -> str:
    """Return what is wrong with the channels together; '' when they are a record."""
    at = 0
    for one in channels:
        if one.offset < at:
            return (
                f"the channel {one.group}.{one.name} overlaps the channel before it: found offset {one.offset}; "
                f"allowed: {at} or more"
            )
        at = one.end
    if at != size:
        return f"record_bytes: found {size}; allowed: {at}, where the channels end"
    names = [(one.group, one.name) for one in channels]
    if len(set(names)) != len(names):
        return f"the channel {next('.'.join(name) for name in names if names.count(name) > 1)} is listed twice"
    header = {one.name: one.format for one in channels if one.group == "record"}
    missing = [name for name, letter in NEEDED.items() if header.get(name) != letter]
    if missing or channels[-1].name != CHECK_FIELD.name or channels[-1].group != "record":
        return f"fields: every record must have {', '.join(NEEDED)}, and end with {CHECK_FIELD.name}"
    return ""
