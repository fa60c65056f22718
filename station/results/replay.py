"""Replay: the recorded images through the controller again, its orders compared with the recorded ones byte for byte.

The controller is a pure function of the program and of every image that came before, so a record that was made by the
same controller replays identically on any machine. The first scan that does not is shown with both sides.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from typing import Any, NamedTuple, Protocol

from controller.image import ORDERS_FIELDS, ORDERS_STRUCT, Image, Orders, State
from station.record.scan_record import BODY_BYTES, BODY_STRUCT, CHECK_FIELD, IMAGE_FIRST, ORDERS_FIRST, RECORD_BYTES

RECORD_STRUCT = struct.Struct(BODY_STRUCT.format + CHECK_FIELD.format)
ORDERS_OFFSET = BODY_BYTES - ORDERS_STRUCT.size


class Steps(Protocol):
    """What a replay needs of a controller."""

    def step(self, image: Image, scan: int) -> Orders:
        """Decide one scan."""


class FieldPair(NamedTuple):
    """One field of the orders on both sides."""

    name: str
    unit: str
    recorded: float
    replayed: float

    @property
    def differs(self) -> bool:
        """Whether the bytes differ (so -0.0 differs from 0.0, and a NaN does not from itself)."""
        return struct.pack("<d", self.recorded) != struct.pack("<d", self.replayed)


class Difference(NamedTuple):
    """The first scan whose orders differ."""

    sequence: int
    scan: int
    recorded: Orders
    replayed: Orders
    image: Image

    def pairs(self) -> Iterator[FieldPair]:
        """Yield every field of the orders, in the order of the record."""
        # Through the binary format: what the record cannot hold must not be shown as a difference.
        replayed = ORDERS_STRUCT.unpack(ORDERS_STRUCT.pack(*self.replayed))
        for field, before, now in zip(ORDERS_FIELDS, self.recorded, replayed, strict=True):
            yield FieldPair(field.name, field.unit, before, now)

    def lines(self, period_ns: int) -> list[str]:
        """Return the difference for a person: a head line and a row per field, `*` before those that differ."""
        state = State(int(self.recorded.state)).name.lower()
        head = f"first difference at scan {self.scan} (record {self.sequence}, {self.scan * period_ns * 1e-9:.3f} s)"
        rows = [f"{head}, recorded state {state}:", f"  {'':2}{'field':30}{'recorded':>24}{'replayed':>24}"]
        for pair in self.pairs():
            mark = "* " if pair.differs else "  "
            unit = f" {pair.unit}" if pair.unit else ""
            rows.append(f"  {mark}{pair.name:30}{_text(pair.recorded):>24}{_text(pair.replayed):>24}{unit}")
        return rows

    def to_dict(self) -> dict[str, Any]:
        """Return the difference as plain data; only the fields that differ."""
        fields = [pair._asdict() for pair in self.pairs() if pair.differs]
        return {"scan": self.scan, "sequence": self.sequence, "fields": fields}


def _text(value: float) -> str:
    return repr(value) if isinstance(value, float) else str(value)


class Replayed(NamedTuple):
    """What a replay found: scans that were identical, the first difference, and what is wrong with the record itself.

    `cut_bytes`: rest of a last record that was cut off while being written, as a power failure leaves it.
    """

    identical: int
    difference: Difference | None = None
    damage: str = ""
    cut_bytes: int = 0

    @property
    def same(self) -> bool:
        """Whether every complete record was identical and the record is sound."""
        return self.difference is None and not self.damage


def _disorder(expected: int, found: int, rest: memoryview) -> str:
    """Return what it means that one record stands where another belongs.

    Args:
        expected: number of the record that belongs there; all before it were in their places.
        found: number of the record that stands there.
        rest: the records from there on.

    """
    if found < expected:
        return f"record {found} stands a second time, where record {expected} belongs: the file was changed"
    if any(expected <= values[0] < found for values in RECORD_STRUCT.iter_unpack(rest)):
        return (
            f"record {found} stands where record {expected} belongs: they are not in their order, the file was changed"
        )
    last = found - 1
    missing = f"record {expected} is" if last == expected else f"records {expected} to {last} are"
    return f"{missing} missing: the ring was full, or the file was changed"


def replay(content: bytes, controller: Steps) -> Replayed:
    """Step a fresh controller through the records in `content` until they end, differ, or are damaged."""
    cut = len(content) % RECORD_BYTES
    view = memoryview(content)[: len(content) - cut]
    crc32, pack, step, image_of = zlib.crc32, ORDERS_STRUCT.pack, controller.step, Image._make
    sequence = 0
    at = 0
    for values in RECORD_STRUCT.iter_unpack(view):
        end = at + BODY_BYTES
        if crc32(view[at:end]) != values[-1]:
            return Replayed(sequence, damage=f"record {sequence} fails its CRC", cut_bytes=cut)
        if values[0] != sequence:
            damage = _disorder(sequence, values[0], view[at:])
            return Replayed(sequence, damage=damage, cut_bytes=cut)
        image = image_of(values[IMAGE_FIRST:ORDERS_FIRST])
        orders = step(image, values[1])
        if pack(*orders) != view[at + ORDERS_OFFSET : end]:
            recorded = Orders._make(values[ORDERS_FIRST:-1])
            return Replayed(sequence, Difference(sequence, values[1], recorded, orders, image), cut_bytes=cut)
        sequence += 1
        at += RECORD_BYTES
    return Replayed(sequence, cut_bytes=cut)
