"""What the newest record of a scan says of a bench, for people: inputs by device with their age, outputs, interlocks.

All of it is made from the tables: the fields of the process image, and the faults with their limits. A field or a fault
that is added there is shown without a line here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import partial
from typing import Any, NamedTuple

from controller.aftermath import FaultReaction
from controller.conditions import Measured
from controller.context import Context
from controller.sample import shown_torque_nm
from definitions.faults import FAULT_BY_NUMBER, FAULTS, Beyond, Fault
from definitions.image import (
    AGE_NEVER,
    IMAGE_FIELDS,
    ORDERS_FIELDS,
    REMOTE_IO_FIELDS,
    Command,
    DriveCommand,
    DriveMode,
    DriveState,
    Field,
    Image,
    Link,
    NmtState,
    Orders,
    Reaction,
    SampleStatus,
    State,
)
from definitions.program import Program
from definitions.states import row_of
from definitions.units import ANGLE, ARCMIN_PER_RAD, SPEED, TRAVEL, Kind
from drivers.servo_drive.emcy import drive_said
from station.records.samples.scan_record import unpack

NEAR = 0.8
"""Share of a limit from which a value is near to it."""

RPM_PER_RAD_S = 30.0 / math.pi
MS_PER_S = 1000.0


class Reading(NamedTuple):
    """One value of the process image: its field, its short name, what it means, the value in words with its unit."""

    field: str
    name: str
    meaning: str
    value: str
    unit: str = ""


class Device(NamedTuple):
    """A device with what it delivers. age: of its values, in words; stale: they are too old, or never came."""

    title: str
    age: str
    stale: bool
    lost: bool
    readings: tuple[Reading, ...]


class LimitRow(NamedTuple):
    """An interlock with a limit. share: of the limit, 1 at it; watched: in the state that the bench is in."""

    fault: str
    text: str
    actual: str
    limit: str
    unit: str
    share: float
    watched: bool

    @property
    def near(self) -> bool:
        """Whether the value is near its limit, or beyond it, while it is watched."""
        return self.watched and self.share >= NEAR


class AlarmRow(NamedTuple):
    """An alarm: its number and id, what happened, why, and what to do. first: it came before the others."""

    number: int
    id: str
    text: str
    cause: str
    next_action: str
    reaction: str
    first: bool
    detail: str = ""


@dataclass(frozen=True)
class Sight:
    """A bench as a record shows it. torque_nm: at the output, None while no fresh sample says it.

    settled: the reaction to a fault has ended, and the bench waits for a person. resetting: the drive is being reset.
    """

    state: State
    words: str
    torque_nm: float | None
    release_nm: float
    lock_closed: bool
    lock: str
    drive: str
    estop_released: bool
    guard_closed: bool
    settled: bool
    resetting: bool
    devices: tuple[Device, ...]
    outputs: tuple[Reading, ...]
    limits: tuple[LimitRow, ...]
    alarms: tuple[AlarmRow, ...]


def sight_of(record: bytes, program: Program) -> Sight:
    """Return what a record says; program: the one that the record was made by."""
    _, image, orders = unpack(record)
    state = State(orders.state)
    fault = state == State.FAULT
    torque_nm = shown_torque_nm(image, orders, program)
    return Sight(
        state=state,
        words=row_of(state).words,
        torque_nm=torque_nm if torque_nm is not None and math.isfinite(torque_nm) else None,
        release_nm=program.release_torque_nm,
        lock_closed=bool(image.brake_on),
        lock=f"closed, {image.brake_current_a:.2f} A" if image.brake_on else "open",
        drive=DriveState(image.drive_state).name.lower().replace("_", " "),
        estop_released=bool(image.estop_released),
        guard_closed=bool(image.guard_closed),
        settled=fault and orders.phase == FaultReaction.SETTLED,
        resetting=fault and orders.phase == FaultReaction.DRIVE_RESET,
        devices=_devices(image, program),
        outputs=tuple(_reading(field, getattr(orders, field.name), program) for field in ORDERS_FIELDS),
        limits=_limits(image, orders, program),
        alarms=_alarms(image, orders),
    )


# --- inputs by device


class _DeviceRow(NamedTuple):
    """A device: which fields of the image it delivers, the age of its values, when they are too old, its link."""

    title: str
    delivers: Callable[[str], bool]
    age: str = ""
    oldest: str = ""
    link: int = 0


_REMOTE_IO = frozenset(field.name for field in REMOTE_IO_FIELDS) | {"io_age_scans"}

DEVICES: tuple[_DeviceRow, ...] = (
    _DeviceRow("Servo drive", lambda name: name.startswith("drive_"), "drive_age_scans", "drive_stale_scans", Link.CAN),
    _DeviceRow("Measuring amplifier", lambda name: name.startswith(("torque_", "angle_", "sample_")),
               "sample_age_scans", "sample_stale_scans", Link.AMPLIFIER),
    _DeviceRow("Lock brake", lambda name: name.startswith("brake_"), "brake_age_scans", "brake_stale_scans",
               Link.BRAKE),
    _DeviceRow("Remote I/O", lambda name: name in _REMOTE_IO, "io_age_scans", "io_stale_scans", Link.REMOTE_IO),
    _DeviceRow("Controller", lambda _: True),
)  # fmt: skip
"""The devices in their order on the page; a field belongs to the first that delivers it."""


def device_of(name: str) -> str:
    """Return which device delivers a field of the image."""
    return next(row.title for row in DEVICES if row.delivers(name))


def _devices(image: Image, program: Program) -> tuple[Device, ...]:
    found = []
    for row in DEVICES:
        fields = [field for field in IMAGE_FIELDS if device_of(field.name) == row.title and field.name != row.age]
        age = getattr(image, row.age) if row.age else 0
        never = age == AGE_NEVER
        readings = tuple(_named(field, "never came") if never else _input(field, image, program) for field in fields)
        text = "never heard" if never else f"{age * program.period_s * MS_PER_S:.0f} ms" if row.age else ""
        stale = bool(row.age) and (never or age > getattr(program.limits, row.oldest))
        found.append(Device(row.title, text, stale, bool(image.links_lost & row.link), readings))
    return tuple(found)


def _input(field: Field, image: Image, program: Program) -> Reading:
    absent = (field.name == "torque_in_nm" and not program.has_torque_in) or (
        field.name == "torque_out_nm" and not program.has_torque_out
    )
    if absent:
        return _named(field, "no sensor")
    return _reading(field, getattr(image, field.name), program)


# --- values in words

_UNIT_ENDINGS = ("_rad_s", "_rad", "_nm", "_us", "_scans", "_a", "_c")


def _name_of(kind: type[IntEnum], value: int) -> str:
    try:
        return kind(value).name.lower().replace("_", " ")
    except ValueError:
        return f"{value}, unknown"


def _bits_of(kind: type[IntEnum], value: int) -> str:
    return ", ".join(one.name.lower().replace("_", " ") for one in kind if value & one) or "none"


def _yes_no(value: int) -> str:
    return "yes" if value else "no"


def _count_alarms(value: int) -> str:
    return f"{value.bit_count()}, listed as alarms" if value else "none"


_WORDS: Mapping[str, Callable[[int], str]] = {
    "command": partial(_name_of, Command),
    "drive_state": partial(_name_of, DriveState),
    "drive_mode": partial(_name_of, DriveMode),
    "drive_nmt_state": partial(_name_of, NmtState),
    "drive_command": partial(_name_of, DriveCommand),
    "state": partial(_name_of, State),
    "reaction": partial(_name_of, Reaction),
    "links_lost": partial(_bits_of, Link),
    "sample_status": partial(_bits_of, SampleStatus),
    "drive_statusword": "0x{:04X}".format,
    "drive_emcy_code": "0x{:04X}".format,
    "drive_error_register": "0x{:02X}".format,
    "drive_internal_limit": _yes_no,
    "drive_follows_command": _yes_no,
    "drive_homing_attained": _yes_no,
    "drive_homing_error": _yes_no,
    "brake_on": _yes_no,
    "estop_released": _yes_no,
    "guard_closed": _yes_no,
    "alarms": _count_alarms,
}
"""Fields whose number means something, and how that is said; all others are shown as a number with its unit."""

_SHOWN: Mapping[str, tuple[float, str, int]] = {
    "rad": (180.0 / math.pi, "°", 4),
    "rad/s": (RPM_PER_RAD_S, "rpm", 3),
    "N·m": (1.0, "N·m", 3),
    "A": (1.0, "A", 3),
    "°C": (1.0, "°C", 1),
}
"""How a value is shown, by its unit in the process image: factor, unit, decimals."""


def _reading(field: Field, value: Any, program: Program) -> Reading:
    return _named(field, *_worded(field, value, program))


def _named(field: Field, value: str, unit: str = "") -> Reading:
    """Return a reading by the name of its field, without the unit that stands at the end of that."""
    ending = next((one for one in _UNIT_ENDINGS if field.name.endswith(one)), "")
    name = field.name.removesuffix(ending).replace("_", " ")
    return Reading(field.name, name, field.meaning, value, unit)


def _worded(field: Field, value: Any, program: Program) -> tuple[str, str]:
    if field.name in _WORDS:
        return _WORDS[field.name](int(value)), ""
    if isinstance(value, float) and not math.isfinite(value):
        return "not a number", ""
    if field.unit == "scans":
        ms = f"{value * program.period_s * MS_PER_S:.0f}"
        return ("never", "") if value == AGE_NEVER else (ms, "ms")
    factor, unit, decimals = _SHOWN.get(field.unit, (1.0, field.unit, 0))
    return _number(float(value) * factor, decimals), unit


def _number(value: float, decimals: int) -> str:
    text = f"{value:.{decimals}f}"
    return (text.removeprefix("-") if float(text) == 0.0 else text).replace("-", "−")


# --- interlocks and alarms


def _limits(image: Image, orders: Orders, program: Program) -> tuple[LimitRow, ...]:
    """Return every fault that holds a channel against a limit, nearest first."""
    measured = _measured(image, orders, program)
    rows = [_limit(fault, image, orders, measured, program) for fault in FAULTS if fault.limit and fault.limit.channel]
    return tuple(sorted((row for row in rows if row is not None), key=lambda row: (not row.watched, -row.share)))


def _measured(image: Image, orders: Orders, program: Program) -> Measured:
    """Return what the controller has measured in this scan, by its own computation, from the zeroes in its orders."""
    context = Context(program)
    context.torque_in_tare_nm, context.torque_out_tare_nm = orders.torque_in_tare_nm, orders.torque_out_tare_nm
    context.angle_in_zero_rad, context.angle_out_zero_rad = orders.angle_in_zero_rad, orders.angle_out_zero_rad
    context.measure(image)
    return context.measured


def _limit(fault: Fault, image: Image, orders: Orders, measured: Measured, program: Program) -> LimitRow | None:
    limit = fault.limit
    assert limit is not None  # noqa: S101 - chosen by that
    most = float(getattr(program.limits, limit.in_program))
    if not math.isfinite(most):
        return None  # there is no such sensor
    of_measured = limit.channel in Measured.__slots__
    value = float(getattr(measured if of_measured else image, limit.channel))
    never = (limit.age and getattr(image, limit.age) == AGE_NEVER) or (
        limit.beyond is Beyond.AGE and value == AGE_NEVER
    )
    if limit.beyond is Beyond.AGE:
        value -= image.missed_periods
    elif limit.beyond is Beyond.MAGNITUDE:
        value = abs(value)
    factor, unit = _people(limit.kind)
    if limit.in_scans:
        factor, unit = program.period_s * MS_PER_S, "ms"
    known = not never and math.isfinite(value)
    return LimitRow(
        fault=fault.id,
        text=fault.text,
        actual="not known" if not known else _figure(value * factor),
        limit=_figure(most * factor),
        unit=unit,
        share=max(0.0, value / most) if known and most > 0.0 else 0.0,
        watched=State(orders.state) in fault.live_in,
    )


def _people(kind: Kind) -> tuple[float, str]:
    """Return factor and unit in which people see a limit of this kind."""
    if kind is SPEED:
        return RPM_PER_RAD_S, "rpm"
    if kind is TRAVEL:
        return 180.0 / math.pi, "°"
    if kind is ANGLE:
        return ARCMIN_PER_RAD, "arcmin"
    return 1.0, {"degC": "°C", "1": ""}.get(kind.shown, kind.shown)


def _figure(value: float) -> str:
    return f"{value:.4g}".replace("-", "−")


def _alarms(image: Image, orders: Orders) -> tuple[AlarmRow, ...]:
    """Return what is active or latched: the first-out fault first, then the strongest reactions."""
    found = [FAULT_BY_NUMBER[n] for n in range(1, orders.alarms.bit_length()) if orders.alarms >> n & 1]
    found.sort(key=lambda fault: (fault.number != orders.fault, -fault.reaction, fault.number))
    return tuple(
        AlarmRow(
            fault.number, fault.id, fault.text, fault.cause, fault.next_action,
            fault.reaction.name.lower().replace("_", " "), fault.number == orders.fault, _detail(fault, image),
        )
        for fault in found
    )  # fmt: skip


def _detail(fault: Fault, image: Image) -> str:
    said = drive_said(fault.id, image.drive_emcy_code)
    return said[:1].upper() + said[1:]
