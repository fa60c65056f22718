"""Step `registers`: the blocks of Modbus devices and the frames of sensors on CAN, while somebody presses.

Each value is shown raw and decoded in both orders, of the words of a register map, or of the bytes of a frame.

The word order shows in what changes: of the two registers of a value, the more significant one moves in small steps and
the other all over its range. That holds for integers and for float32, whatever the value is, so nothing has to be known
of it. A channel that does not move when its sensor is pressed is another channel, or not connected.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Literal, NamedTuple

from definitions.number_formats import BIT, SIZES, FieldType
from definitions.profiles.can import CanField, CanFrame
from definitions.profiles.modbus import COIL_TABLES, ModbusProfile, ReadField
from drivers.modbus.device import COUNTERS
from drivers.modbus.registers import reader_of
from recipes import Bench
from recipes.schema.sensor_schema import TorqueSensor
from station.commissioning import can_looks
from station.commissioning.can_looks import CanLooks
from station.commissioning.on_wires import ByHand, OnWires, pause
from station.documents.commissioning import Figure, Finding
from station.errors import StationError

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
    """A field of a block or frame: where it is, raw as it came, decoded in both orders, and what was seen of it.

    `changes`: looks at which it was another than before. `shows`: the order that the changes show; None where they show
    nothing.
    """

    part: str
    field: str
    kind: str
    address: str
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
    part: str | None,
    seconds: float,
    begun: Callable[[Mapping[str, float]], None],
    told: Callable[[Row, float], None],
    without: Sequence[str] = (),
) -> Browsed:
    """Read the blocks of all devices that measure again and again for at most `seconds`, or that of one device.

    begun: called after the first look with what to press on, and by how much at least [N·m]. told: called for each
    torque that has moved by 1 % of its full scale more.
    Ends early when every torque was pressed on; `without`: channels that nobody can press on.

    Raises:
        StationError: there is no such device.
        DriverError: a device does not answer, or is another one.

    """
    by_hand, frames = ByHand(bench.wires), CanLooks(bench.wires)
    known = (*by_hand.devices, *frames.frames)
    if part is not None:
        if part not in known:
            raise StationError(f"--device: found '{part}'; allowed: {', '.join(known)}")
        frames.keep(part)
    on_modbus = [name for name in by_hand.devices if (name in by_hand.measuring if part is None else name == part)]
    pressed = _Pressed([*_channels(bench.bench, by_hand), *_can_channels(bench.bench, frames)], without)
    looks: dict[str, list[bytes]] = {name: [] for name in (*on_modbus, *frames.frames)}
    count = 0
    with by_hand.opened(*on_modbus or ("remote_io",)), frames.opened():
        frames.wait_for_all()
        until = time.monotonic() + seconds
        while time.monotonic() < until and not (part is None and pressed.all_moved and count >= LEAST_LOOKS):
            frames.step()
            for name, seen in looks.items():
                seen.append(frames.newest[name] if name in frames.frames else by_hand.block(name))
            count += 1
            for one, value in pressed.look({name: seen[-1] for name, seen in looks.items()}) if part is None else ():
                told(one.row(looks[one.part]), value)
            if count == 1:
                begun({one.channel: one.step_nm for one in pressed.channels})
            pause(LOOK_EVERY_S)
    rows, findings = _judged(by_hand, frames, looks)
    if part is None and not findings:
        findings += pressed.findings()
    moved = pressed.moved if part is None else ()
    figures = (
        Figure(name="looks", value=count),
        *(Figure(name=f"{channel} moved by", value=round(by, 6), unit="N·m") for channel, by in moved),
    )
    return Browsed(rows, tuple(channel for channel, _ in moved), tuple(findings), figures)


def _judged(by_hand: ByHand, frames: CanLooks, looks: Mapping[str, Sequence[bytes]]) -> tuple[list[Row], list[Finding]]:
    """Return the rows of all fields, and what their changes say against the orders of the profiles."""
    rows: list[Row] = []
    findings: list[Finding] = []
    for name, seen in looks.items():
        if name in frames.frames:
            frame = frames.frames[name]
            of_this = [_can_row(name, frame, field, seen) for field in frame.fields]
            findings += _byte_orders(name, frame, of_this)
        else:
            profile = by_hand.devices[name].config.profile
            of_this = [_row(name, profile, field, seen) for field in profile.read.fields]
            findings += _word_orders(profile, of_this)
        rows += of_this
    return rows, findings


class _Channel(NamedTuple):
    """A torque that somebody presses on: the block or frame that it is in, how it is read there, and its sensor.

    `decode` makes the value of the channel of a block, None of one that says no number; `row` shows the looks.
    """

    channel: str
    part: str
    field: str
    place: str
    decode: Callable[[bytes], float | None]
    row: Callable[[Sequence[bytes]], Row]
    sensor: TorqueSensor

    @property
    def step_nm(self) -> float:
        """Change by which it counts as pressed [N·m]."""
        return MOVED * self.sensor.full_scale_nm


class _Pressed:
    """Which torque channels have moved since the first look, in the word orders of the profiles."""

    def __init__(self, channels: Sequence[_Channel], without: Sequence[str]) -> None:
        self.channels = [one for one in channels if one.channel not in without]
        self._first: dict[str, float] = {}
        self._said: dict[str, float] = {}
        self._most: dict[str, float] = {}
        self._beyond: dict[str, float] = {}

    @property
    def all_moved(self) -> bool:
        """Whether every channel that can be pressed on was."""
        return len(self.moved) == len(self.channels)

    @property
    def moved(self) -> tuple[tuple[str, float], ...]:
        """The channels that have moved, and by how much at most [N·m]."""
        most = ((one, self._most.get(one.channel, 0.0)) for one in self.channels)
        return tuple((one.channel, by) for one, by in most if by >= one.step_nm)

    def look(self, blocks: Mapping[str, bytes]) -> Iterator[tuple[_Channel, float]]:
        """Take a look; yield each channel that has moved by one step more than was said of it last."""
        for one in self.channels:
            name, value = one.channel, one.decode(blocks[one.part])
            if value is None:
                continue
            first = self._first.setdefault(name, value)
            if abs(value) > BEYOND * one.sensor.usable_nm:
                self._beyond[name] = value
            self._most[name] = max(self._most.get(name, 0.0), abs(value - first))
            if abs(value - self._said.setdefault(name, value)) >= one.step_nm:
                self._said[name] = value
                yield one, value

    def findings(self) -> Iterator[Finding]:
        """Say what is beyond its sensor's range, and what never moved."""
        for one in self.channels:
            by = self._most.get(one.channel, 0.0)
            if one.channel in self._beyond:
                value, usable = self._beyond[one.channel], one.sensor.usable_nm
                what = f"{one.channel}: {value:.4g} N·m, sensor usable to {usable:g} N·m."
                yield Finding(what=what, cure=f"Correct offset, type or scale of {one.field} in {one.place}.")
            if by < one.step_nm:
                what = f"{one.channel} moved by {by:.3g} N·m, at least {one.step_nm:g} expected."
                cure = f"Press on that sensor. If you did, another field of {one.place} may be this channel."
                yield Finding(what=what, cure=cure)


def _channels(bench: Bench, by_hand: ByHand) -> Iterator[_Channel]:
    """Yield the torques that come from a device on Modbus."""
    for channel, sensor_name in SENSORS.items():
        sensor: TorqueSensor | None = getattr(bench.sensors, sensor_name)
        source = None if bench.channels is None else bench.channels.by_name.get(sensor_name)
        device, wanted = ("amplifier", channel) if source is None else (source.device, source.field)
        scale, zero = (1.0, 0.0) if source is None else (source.scale, source.offset)
        for part, name in by_hand.measuring.items():
            profile = by_hand.devices[part].config.profile
            field = next((one for one in profile.read.fields if one.name == wanted), None)
            if sensor is not None and field is not None and name == device:
                decode = partial(_channel_of_block, profile, field, scale, zero)
                row = partial(_row, part, profile, field)
                yield _Channel(channel, part, field.name, f"profile {profile.profile.name}", decode, row, sensor)


def _channel_of_block(
    profile: ModbusProfile, field: ReadField, scale: float, zero: float, block: bytes
) -> float | None:
    number = decoded(profile, field, block, profile.word_order)
    return None if number is None else number * scale + zero


def _can_channels(bench: Bench, frames: CanLooks) -> Iterator[_Channel]:
    """Yield the torques that come from a sensor on CAN."""
    for channel, sensor_name in SENSORS.items():
        sensor: TorqueSensor | None = getattr(bench.sensors, sensor_name)
        source = None if bench.channels is None else bench.channels.by_name.get(sensor_name)
        if sensor is None or source is None:
            continue
        for part, frame in frames.frames.items():
            field = next((one for one in frame.fields if one.name == source.field), None)
            if field is not None and frames.sensor_of[part].name == source.device:
                decode = partial(_channel_of_frame, frame, field, source.scale, source.offset)
                row = partial(_can_row, part, frame, field)
                yield _Channel(channel, part, field.name, f"the profile of {source.device}", decode, row, sensor)


def _channel_of_frame(frame: CanFrame, field: CanField, scale: float, zero: float, data: bytes) -> float | None:
    number = can_looks.decoded(frame, field, data, field.order)
    return None if number is None else number * scale + zero


def decoded(profile: ModbusProfile, field: ReadField, block: bytes, order: Order) -> float | None:
    """Return a field of a block in a word order; None when that is not a number."""
    alone = replace(profile, word_order=order, read=replace(profile.read, fields=(field,)))
    values = reader_of(alone).values(block)
    return None if values is None else float(values[0])


def words_in(profile: ModbusProfile, block: bytes) -> list[int]:
    """Return the registers of a block as numbers; of coils and discrete inputs each one, as 1 or 0."""
    if profile.read.table in COIL_TABLES:
        return [block[place // 8] >> place % 8 & 1 for place in range(profile.read.count)]
    order = profile.byte_order
    return [int.from_bytes(block[at : at + 2], order) for at in range(0, 2 * profile.read.count, 2)]


def places_of(field: ReadField) -> range:
    """Return the places in the block that a field fills."""
    return range(field.offset, field.offset + (1 if field.type == BIT else SIZES[field.type] // 2))


def shown_order(kind: FieldType, seen: Sequence[tuple[int, ...]]) -> Order | None:
    """Return the word order that the changes of a 32-bit value show, None where they show nothing.

    `seen` are its two registers, look by look.
    """
    if SIZES.get(kind) != 4 or len(seen) < 2:
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


def _row(part: str, profile: ModbusProfile, field: ReadField, looks: Sequence[bytes]) -> Row:
    places = places_of(field)
    seen = [tuple(words_in(profile, block)[place] for place in places) for block in looks]
    last = looks[-1] if looks else b""
    changes = sum(earlier != later for earlier, later in pairwise(seen))
    raw = " ".join(f"{word:04X}" for word in seen[-1]) if seen else ""
    big, little = (decoded(profile, field, last, order) if last else None for order in ORDERS)
    shows = shown_order(field.type, seen) if len(looks) >= LEAST_LOOKS else None
    address = str(profile.read.address + field.offset)
    return Row(part, field.name, field.type, address, raw, big, little, changes, shows)


def _can_row(part: str, frame: CanFrame, field: CanField, looks: Sequence[bytes]) -> Row:
    seen = [can_looks.bytes_of(frame, field, data) for data in looks]
    changes = sum(earlier != later for earlier, later in pairwise(looks if not seen[-1] else seen))
    big, little = (can_looks.decoded(frame, field, looks[-1], order) for order in ORDERS)
    raw = (seen[-1] or looks[-1]).hex(" ").upper()
    shows = shown_byte_order(seen) if len(looks) >= LEAST_LOOKS and field.kind != "float" else None
    kind = {"unsigned": "u", "signed": "i", "float": "f"}[field.kind] + str(field.bits)
    return Row(part, field.name, kind, f"0x{frame.identifier:03X}", raw, big, little, changes, shows)


def shown_byte_order(seen: Sequence[bytes]) -> Order | None:
    """Return the byte order that the changes of a whole number show, None where they show nothing.

    `seen` are its bytes, look by look: the lowest one moves all over its range, the highest hardly at all.
    """
    if len(seen[0]) < 2:
        return None
    first, last = (_mean_step([data[place] for data in seen], 1 << 8) for place in (0, -1))
    if min(first, last) * CLEAR >= max(first, last):
        return None
    return "big" if first < last else "little"


def _byte_orders(part: str, frame: CanFrame, rows: Sequence[Row]) -> Iterator[Finding]:
    """Say which byte order a frame has, where it is not the profile's and no field speaks for that."""
    orders = {field.name: field.order for field in frame.fields}
    against = [row for row in rows if row.shows not in (None, orders[row.field])]
    if against and not any(row.shows == orders[row.field] for row in rows):
        names, right = ", ".join(row.field for row in against), against[0].shows
        yield Finding(
            what=f"Byte order (CAN): values of {names} of {part} fit byte order {right}; the profile has the other.",
            cure=f"Write 'byte_order: {right}' into the profile of {part}.",
        )


def _word_orders(profile: ModbusProfile, rows: Sequence[Row]) -> Iterator[Finding]:
    """Say which word order the device has, where it is not the profile's; a counter alone is proof enough."""
    against = [row for row in rows if row.shows not in (None, profile.word_order)]
    in_favour = [row for row in rows if row.shows == profile.word_order]
    if not against or (in_favour and not any(row.field in COUNTERS for row in against)):
        return
    names = ", ".join(row.field for row in against)
    right = "little" if profile.word_order == "big" else "big"
    yield Finding(
        what=f"Word order (Modbus): values of {names} fit word order {right}; the profile says {profile.word_order}.",
        cure=f"Write 'word_order: {right}' into profile {profile.profile.name}.",
    )
