"""Replay: the recorded images through the controller again, its orders compared with the recorded ones byte for byte.

The controller is a pure function of the program and of every image that came before, so a record that was made by the
same controller replays identically on any machine. The first scan that does not is shown with both sides.

A record may have been made by a version with other channels. Orders are compared where both have them. An input that
the record does not have is absent: the replay goes on as long as the controller does not look at it.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import isfinite
from operator import itemgetter
from typing import Any, NamedTuple, NoReturn, Protocol

from definitions.image import ORDERS_FIELDS, Image, Orders
from station.records.samples.event_log import state_name
from station.records.samples.layout import CURRENT, Channel, Layout
from station.records.samples.table import AbsentChannelError


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


class Absent:
    """Stands for an input that the record does not have: AbsentChannelError for whoever asks for its value."""

    def __init__(self, name: str) -> None:
        self._name = name

    def _refuse(self, *_: object) -> NoReturn:
        raise AbsentChannelError("image", self._name)

    __bool__ = __int__ = __float__ = __index__ = __abs__ = __neg__ = __hash__ = _refuse
    __eq__ = __ne__ = __lt__ = __le__ = __gt__ = __ge__ = _refuse
    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __truediv__ = __rtruediv__ = _refuse
    __and__ = __rand__ = __or__ = __ror__ = __xor__ = __rxor__ = __mod__ = __rmod__ = _refuse
    __floordiv__ = __rfloordiv__ = __lshift__ = __rlshift__ = __rshift__ = __rrshift__ = _refuse


Values = tuple[Any, ...]
Take = Callable[[Values], Values]


def _taking(places: Sequence[int]) -> Take:
    """Return what takes the values at these places of a tuple, as a tuple; where they follow each other, as a whole."""
    first = places[0]
    if list(places) == list(range(first, first + len(places))):
        return itemgetter(slice(first, first + len(places)))
    return itemgetter(*places)


class Reading:
    """How a record of this layout is fed to today's controller, and its orders compared."""

    def __init__(self, layout: Layout) -> None:
        places = {(one.group, one.name): place for place, one in enumerate(layout.channels)}
        self.sequence, self.scan = places["record", "sequence"], places["record", "scan"]
        absent = [name for name in Image._fields if ("image", name) not in places]
        self._absent: Values = tuple(Absent(name) for name in absent)
        behind = {("image", name): len(places) + number for number, name in enumerate(absent)}
        self._inputs = _taking([(places | behind)["image", name] for name in Image._fields])
        made = {field.name: place for place, field in enumerate(ORDERS_FIELDS)}
        self.compared = [one for one in layout.group("orders") if one.name in made]
        if "state" not in [one.name for one in self.compared]:
            raise AbsentChannelError("orders", "state")
        self.recorded = _taking([places["orders", one.name] for one in self.compared])
        self.replayed = _taking([made[one.name] for one in self.compared])
        self._pack = struct.Struct("<" + "".join(one.format for one in self.compared)).pack

    def image(self, values: Values) -> Image:
        """Return the inputs of a scan."""
        return Image(*self._inputs(values + self._absent if self._absent else values))

    def same(self, values: Values, orders: Orders) -> bool:
        """Whether the recorded orders and those of the replay are the same bytes."""
        try:
            return self._pack(*self.replayed(orders)) == self._pack(*self.recorded(values))
        except struct.error:  # of a value that the format of the record cannot hold
            return False


def not_compared(layout: Layout) -> list[str]:
    """Return what of the orders only the record has, or only this version, one text each."""
    made, kept = [field.name for field in ORDERS_FIELDS], [one.name for one in layout.group("orders")]
    only_kept = [f"{name}: recorded, and not made by this version" for name in kept if name not in made]
    return only_kept + [f"{name}: made by this version, and not recorded" for name in made if name not in kept]


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderPair:
    """One order on both sides; None for one that is no number."""

    name: str
    unit: str
    recorded: float | None
    replayed: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstDiffering:
    """The first scan whose orders differ, and only those that do."""

    scan: int
    sequence: int
    fields: tuple[OrderPair, ...]


def _finite(value: float) -> float | None:
    """JSON has no other way to say that there is no number."""
    return value if isfinite(value) else None


class Difference(NamedTuple):
    """The first scan whose orders differ: values of the orders that were compared, on both sides."""

    sequence: int
    scan: int
    fields: Sequence[Channel]
    recorded: Values
    replayed: Values
    image: Image

    def pairs(self) -> Iterator[FieldPair]:
        """Yield every field that was compared, in the order of the record."""
        for field, before, now in zip(self.fields, self.recorded, self.replayed, strict=True):
            yield FieldPair(field.name, field.unit, before, _held(field.format, now))

    def lines(self, period_ns: int) -> list[str]:
        """Return the difference for a person: a head line and a row per field, `*` before those that differ."""
        values = {field.name: value for field, value in zip(self.fields, self.recorded, strict=True)}
        state = state_name(int(values["state"]))
        head = f"first difference at scan {self.scan} (record {self.sequence}, {self.scan * period_ns * 1e-9:.3f} s)"
        rows = [f"{head}, recorded state {state}:", f"  {'':2}{'field':30}{'recorded':>24}{'replayed':>24}"]
        for pair in self.pairs():
            mark = "* " if pair.differs else "  "
            unit = f" {pair.unit}" if pair.unit else ""
            rows.append(f"  {mark}{pair.name:30}{_text(pair.recorded):>24}{_text(pair.replayed):>24}{unit}")
        return rows

    def document(self) -> FirstDiffering:
        """Return the difference as it is printed for programs."""
        pairs = [pair for pair in self.pairs() if pair.differs]
        fields = tuple(
            OrderPair(name=one.name, unit=one.unit, recorded=_finite(one.recorded), replayed=_finite(one.replayed))
            for one in pairs
        )
        return FirstDiffering(scan=self.scan, sequence=self.sequence, fields=fields)


def _held(letter: str, value: float) -> float:
    """Return a value as the record's format holds it: what it cannot hold is shown as it is."""
    try:
        held: float = struct.unpack("<" + letter, struct.pack("<" + letter, value))[0]
    except struct.error:
        return value
    return held


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


def _disorder(expected: int, found: int, rest: list[int]) -> str:
    """Return what it means that one record stands where another belongs.

    Args:
        expected: number of the record that belongs there; all before it were in their places.
        found: number of the record that stands there.
        rest: the numbers of the records from there on.

    """
    if found < expected:
        return f"record {found} is repeated in the place of record {expected}: the file was changed"
    if any(expected <= number < found for number in rest):
        return f"record {found} is in the place of record {expected}, which comes later: the file was changed"
    last = found - 1
    missing = f"record {expected} is" if last == expected else f"records {expected} to {last} are"
    return f"{missing} missing: the record buffer was full, or the file was changed"


def replay(content: bytes, controller: Steps, layout: Layout = CURRENT) -> Replayed:
    """Step a fresh controller through the records in `content` until they end, differ, or are damaged.

    Raises:
        AbsentChannelError: the controller looks at an input that the record does not have.

    """
    size, body = layout.record_bytes, layout.body_bytes
    cut = len(content) % size
    view = memoryview(content)[: len(content) - cut]
    reading, unpacked = Reading(layout), layout.struct.iter_unpack
    crc32, step, image_of, same = zlib.crc32, controller.step, reading.image, reading.same
    number, scan = reading.sequence, reading.scan
    sequence = 0
    at = 0
    for values in unpacked(view):
        if crc32(view[at : at + body]) != values[-1]:
            return Replayed(sequence, damage=f"record {sequence} fails its CRC", cut_bytes=cut)
        if values[number] != sequence:
            damage = _disorder(sequence, values[number], [one[number] for one in unpacked(view[at:])])
            return Replayed(sequence, damage=damage, cut_bytes=cut)
        image = image_of(values)
        orders = step(image, values[scan])
        if not same(values, orders):
            sides = (reading.recorded(values), reading.replayed(orders))
            difference = Difference(sequence, values[scan], reading.compared, *sides, image)
            return Replayed(sequence, difference, cut_bytes=cut)
        sequence += 1
        at += size
    return Replayed(sequence, cut_bytes=cut)
