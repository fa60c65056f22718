"""Step `registers`: the block of a Modbus device, raw and decoded in both word orders, while somebody presses.

The word order shows in what changes: of the two registers of a value, the more significant one moves in small steps and
the other all over its range. That holds for integers and for float32, whatever the value is, so nothing has to be known
of it. A channel that does not move when its sensor is pressed is another channel, or not connected.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Literal, NamedTuple

from definitions.number_formats import BIT, SIZES, FieldType
from drivers.modbus.device import COUNTERS
from drivers.modbus.registers import RegisterReader
from drivers.profile import ModbusProfile, ReadField
from recipes import Bench
from recipes.schema.bench_schema import TorqueSensor
from station.bench.measuring import sources
from station.commissioning.on_wires import ByHand, OnWires, pause
from station.documents.commissioning import Figure, Finding

Order = Literal["big", "little"]
ORDERS: tuple[Order, Order] = ("big", "little")
LOOK_EVERY_S = 0.02
LEAST_LOOKS = 25
"""Looks that word orders are judged by, at least: half a second."""

CLEAR = 4.0
"""Ratio of the mean steps of two registers from which on one is taken for the more significant."""

MOVED = 0.01
"""Change of a torque, of full scale, by which a sensor counts as pressed."""

BEYOND = 1.2
"""Of the usable range: no sensor shows more."""

SENSORS = {"torque_in_nm": "torque_in", "torque_out_nm": "torque_out"}
"""Channels that somebody presses on, and their sensors in the bench file."""


class Row(NamedTuple):
    """A field of the block: its registers as they came, decoded in both orders, and what was seen of it.

    `changes`: looks at which it was another than before. `shows`: the word order that the changes show; None where they
    show nothing.
    """

    field: ReadField
    address: int
    raw: str
    big: float | None
    little: float | None
    changes: int
    shows: Order | None


class Browsed(NamedTuple):
    """What was seen: the rows, which channels were seen to move, and findings."""

    rows: list[Row]
    moved: tuple[str, ...]
    findings: tuple[Finding, ...]
    figures: tuple[Figure, ...]


def browse(  # noqa: PLR0917 - what is looked at, and who is told
    bench: OnWires,
    part: str,
    seconds: float,
    begun: Callable[[], None],
    told: Callable[[Row, float | None], None],
    without: Sequence[str] = (),
) -> Browsed:
    """Read the block of a device again and again for at most `seconds`.

    begun: called after the first look. told: called for each torque that has moved by 1 % of its full scale more.
    Ends early when every torque was pressed on; `without`: channels that nobody can press on.

    Raises:
        DriverError: the device does not answer, or is another one.

    """
    by_hand = ByHand(bench.wires)
    profile = by_hand.devices[part].config.profile
    channels = torques_of(bench.bench, part)
    pressed = _Pressed(bench.bench, profile, channels, without) if channels else None
    looks: list[bytes] = []
    with by_hand.opened(part):
        until = time.monotonic() + seconds
        while time.monotonic() < until and not (pressed and pressed.all_moved and len(looks) >= LEAST_LOOKS):
            looks.append(by_hand.block(part))
            for field, value in pressed.look(looks[-1]) if pressed else ():
                told(_row(profile, field, looks), value)
            if len(looks) == 1:
                begun()
            pause(LOOK_EVERY_S)
    rows = [_row(profile, field, looks) for field in profile.read.fields]
    findings = list(_word_orders(profile, rows))
    moved = pressed.moved if pressed else ()
    if pressed and not findings:
        findings += pressed.findings()
    figures = (
        Figure(name="looks", value=len(looks)),
        *(Figure(name=f"{channel} moved by", value=round(by, 6), unit="N·m") for channel, by in moved),
    )
    return Browsed(rows, tuple(channel for channel, _ in moved), tuple(findings), figures)


def torques_of(bench: Bench, part: str) -> dict[str, str]:
    """Return the channels of a device, or of its blocks, that are torques to press on, by their fields."""
    device = part.partition(" block ")[0]
    if bench.channels is None:
        return {channel: channel for channel in SENSORS} if device == "amplifier" else {}
    return {one.field: one.channel for one in sources(bench) if one.device == device and one.channel in SENSORS}


class _Pressed:
    """Which torque fields have moved since the first looks, in the word order of the profile."""

    def __init__(
        self, bench: Bench, profile: ModbusProfile, channels: Mapping[str, str], without: Sequence[str]
    ) -> None:
        sensors = {field: getattr(bench.sensors, SENSORS[channel]) for field, channel in channels.items()}
        self._sensors = {field: one for field, one in sensors.items() if one is not None}
        self._fields = [field for field in profile.read.fields if field.name in self._sensors]
        self._profile = profile
        self._without = [field for field, channel in channels.items() if channel in without]
        self._first: dict[str, float] = {}
        self._said: dict[str, float] = {}
        self._most: dict[str, float] = {}
        self._beyond: dict[str, float] = {}

    @property
    def all_moved(self) -> bool:
        """Whether every channel that can be pressed on was."""
        return all(self._has_moved(field.name) for field in self._fields if field.name not in self._without)

    def _has_moved(self, channel: str) -> bool:
        return self._most.get(channel, 0.0) >= self._step_nm(channel)

    def _step_nm(self, channel: str) -> float:
        sensor: TorqueSensor = self._sensors[channel]
        return MOVED * sensor.full_scale_nm

    @property
    def moved(self) -> tuple[tuple[str, float], ...]:
        """The channels that have moved, and by how much at most [N·m]."""
        return tuple((field.name, self._most[field.name]) for field in self._fields if self._has_moved(field.name))

    def look(self, block: bytes) -> Iterator[tuple[ReadField, float]]:
        """Take a look; yield each channel that has moved by one step more than was said of it last."""
        for field in self._fields:
            value = decoded(self._profile, field, block, self._profile.word_order)
            if value is None:
                continue
            sensor, name = self._sensors[field.name], field.name
            first = self._first.setdefault(name, value)
            if abs(value) > BEYOND * sensor.usable_nm:
                self._beyond[name] = value
            self._most[name] = max(self._most.get(name, 0.0), abs(value - first))
            if abs(value - self._said.setdefault(name, value)) >= self._step_nm(name):
                self._said[name] = value
                yield field, value

    def findings(self) -> Iterator[Finding]:
        """Say what is beyond its sensor's range, and what never moved."""
        name = self._profile.profile.name
        for channel, value in self._beyond.items():
            what = f"{channel}: {value:.4g} N·m, sensor usable to {self._sensors[channel].usable_nm:g} N·m."
            yield Finding(what=what, cure=f"Correct offset, type or scale of {channel} in profile {name}.")
        for field in self._fields:
            if field.name not in self._without and not self._has_moved(field.name):
                least = self._step_nm(field.name)
                what = f"{field.name} moved by {self._most.get(field.name, 0.0):.3g} N·m, at least {least:g} expected."
                cure = f"Press on that sensor. If you did, another field of profile {name} may be this channel."
                yield Finding(what=what, cure=cure)


def decoded(profile: ModbusProfile, field: ReadField, block: bytes, order: Order) -> float | None:
    """Return a field of a block in a word order; None when that is not a number."""
    alone = replace(profile, word_order=order, read=replace(profile.read, fields=(field,)))
    values = RegisterReader(alone).values(block)
    return None if values is None else float(values[0])


def words_of(profile: ModbusProfile, field: ReadField, block: bytes) -> tuple[int, ...]:
    """Return the registers of a field as numbers, in the order of their addresses."""
    words = SIZES[field.type] // 2
    data = block[2 * field.offset : 2 * (field.offset + words)]
    byte_order: Order = profile.byte_order
    return tuple(int.from_bytes(data[at : at + 2], byte_order) for at in range(0, 2 * words, 2))


def shown_order(kind: FieldType, seen: Sequence[tuple[int, ...]]) -> Order | None:
    """Return the word order that the changes of a 32-bit value show, None where they show nothing.

    `seen` are its two registers, look by look.
    """
    if kind == BIT or SIZES[kind] != 4 or len(seen) < 2:
        return None
    span = 1 << 15 if kind == "f32" else 1 << 16  # the sign of a float flips at zero, wherever it stands
    first, second = ([words[place] % span for words in seen] for place in (0, 1))
    steps = [_mean_step(words, span) for words in (first, second)]
    if not any(steps):
        return None
    if kind == "f32" and not all(steps):
        # a register that never moves is the lower half of a coarse value when it is zero, and says nothing otherwise
        still = first if not steps[0] else second
        return None if any(still) else "little" if still is first else "big"
    if min(steps) * CLEAR > max(steps):
        return None
    return "big" if steps[0] < steps[1] else "little"


def _mean_step(words: Sequence[int], span: int) -> float:
    steps = [min((later - earlier) % span, (earlier - later) % span) for earlier, later in pairwise(words)]
    return sum(steps) / len(steps)


def _row(profile: ModbusProfile, field: ReadField, looks: Sequence[bytes]) -> Row:
    seen = [words_of(profile, field, block) for block in looks]
    last = looks[-1] if looks else b""
    changes = sum(earlier != later for earlier, later in pairwise(seen))
    raw = " ".join(f"{word:04X}" for word in seen[-1]) if seen else ""
    big, little = (decoded(profile, field, last, order) if last else None for order in ORDERS)
    shows = shown_order(field.type, seen) if len(looks) >= LEAST_LOOKS else None
    return Row(field, profile.read.address + field.offset, raw, big, little, changes, shows)


def _word_orders(profile: ModbusProfile, rows: Sequence[Row]) -> Iterator[Finding]:
    """Say which word order the device has, where it is not the profile's; a counter alone is proof enough."""
    against = [row for row in rows if row.shows not in (None, profile.word_order)]
    in_favour = [row for row in rows if row.shows == profile.word_order]
    if not against or (in_favour and not any(row.field.name in COUNTERS for row in against)):
        return
    names = ", ".join(row.field.name for row in against)
    right = "little" if profile.word_order == "big" else "big"
    yield Finding(
        what=f"Word order: {names} change as in word order {right}; profile says {profile.word_order}.",
        cure=f"Write 'word_order: {right}' into profile {profile.profile.name}, then do this step again.",
    )
