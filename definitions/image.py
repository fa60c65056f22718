"""The process image: everything that enters a scan, everything that leaves it, and the numbers both are written in.

This file owns the process image. A field is one row of `Image` or of `Orders`: name, format, unit and meaning. The
tables of fields and the layout of a record are made from these rows; record, replay and drivers read those. Values are
given by name only, to `Image(...)` or to a draft of which `taker` makes `Orders`: no list in their order that may be
wrong.

An `Image` has slots: the controller reads some eighty values a scan, and from a named tuple each takes six times as
long. So it can be written in place; of one that a bench goes on writing, take a copy to keep it (`_replace()`).

SI units throughout, the unit in the name. Ages count scans since the value was taken from its device; 0 means it
arrived for this scan, `AGE_NEVER` that it never came.

A sample is what the analysis takes. Its delays say how long before it each channel was asked for, by a request or by
SYNC; of a sensor that sends in its own time, how long before it the value came. They are 0 where one amplifier measures
all channels at once: then nothing lies between them.

Sign convention: positive torque and positive angle turn the same way on both shafts, and a positive torque at the
loaded shaft winds the reducer up positively, whichever side the servo drives.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import IntEnum
from operator import attrgetter
from typing import Annotated, Any, ClassVar, NamedTuple, get_type_hints

AGE_NEVER = 0xFFFF
"""Age of a value that has not arrived since the start; ages saturate here."""


class State(IntEnum):
    """States of the main sequence (see `controller.states` for the transitions)."""

    IDLE = 0
    HOME = 1
    LOCK = 2
    CALIBRATE = 3
    RAMP_POS = 4
    REVERSE = 5
    RAMP_NEG = 6
    UNLOAD = 7
    RELEASE = 8
    COMPLETE = 9
    STOPPED = 10
    FAULT = 11
    JOG = 12


class Reaction(IntEnum):
    """Reactions to an alarm, by severity: the strongest of all active ones wins."""

    NONE = 0
    WARN = 1
    HOLD = 2
    UNLOAD = 3
    QUICK_STOP = 4
    POWER_OFF = 5


class Command(IntEnum):
    """What a person asks for, taken from the mailbox at the start of a scan; each is seen by exactly one scan."""

    NONE = 0
    START = 1
    STOP = 2
    QUICK_STOP = 3
    ACKNOWLEDGE = 4
    RESET = 5
    JOG_POSITIVE = 6
    """Token of a jog: somebody holds the key for this direction now. Given anew every 50 ms, it counts for 100 ms."""
    JOG_NEGATIVE = 7
    """The same for the other direction."""


class DriveState(IntEnum):
    """CiA 402 states; UNKNOWN until a status word has arrived or when its bits fit no state."""

    UNKNOWN = 0
    NOT_READY_TO_SWITCH_ON = 1
    SWITCH_ON_DISABLED = 2
    READY_TO_SWITCH_ON = 3
    SWITCHED_ON = 4
    OPERATION_ENABLED = 5
    QUICK_STOP_ACTIVE = 6
    FAULT_REACTION_ACTIVE = 7
    FAULT = 8


class DriveCommand(IntEnum):
    """CiA 402 commands by name; the driver turns each into its control word."""

    DISABLE_VOLTAGE = 0
    SHUTDOWN = 1
    SWITCH_ON = 2
    ENABLE_OPERATION = 3
    QUICK_STOP = 4
    FAULT_RESET = 5
    START_HOMING = 6


class DriveMode(IntEnum):
    """Modes of operation, object 0x6060."""

    NONE = 0
    HOMING = 6
    CYCLIC_SYNC_VELOCITY = 9
    CYCLIC_SYNC_TORQUE = 10


class NmtState(IntEnum):
    """States in a CANopen heartbeat; NEVER_HEARD is ours."""

    BOOT_UP = 0
    STOPPED = 4
    OPERATIONAL = 5
    PRE_OPERATIONAL = 127
    NEVER_HEARD = 255


class Link(IntEnum):
    """Bits of `links_lost`: a connection that its peer closed, that refused, or that answers with exceptions.

    `CAN_SHARED`: the bus stands, but it is not ours alone. Somebody else sends on it what only the controller may.
    """

    CAN = 1
    AMPLIFIER = 2
    BRAKE = 4
    REMOTE_IO = 8
    CAN_SHARED = 16


class SampleStatus(IntEnum):
    """Bits of `sample_status`, as the measuring amplifier reports them."""

    TORQUE_IN_SATURATED = 1
    TORQUE_OUT_SATURATED = 2
    NOT_READY = 4


class Field(NamedTuple):
    """Row of a field table: name, binary format (`struct` letter), unit ('' for numbers and bits) and meaning."""

    name: str
    format: str
    unit: str
    meaning: str


# Formats of the fields: the type in Python, and the letter of `struct`.
U8 = Annotated[int, "B"]
I8 = Annotated[int, "b"]
U16 = Annotated[int, "H"]
U32 = Annotated[int, "I"]
U64 = Annotated[int, "Q"]
F64 = Annotated[float, "d"]


@dataclass(slots=True)
class Image:
    """Inputs of one scan, as read from the devices before anything is decided. Values in their order by iteration."""

    _fields: ClassVar[tuple[str, ...]]
    missed_periods: Annotated[U32, "", "whole periods that were skipped before this scan"]
    command: Annotated[U8, "", "Command from the mailbox, seen by this scan only"]
    drive_state: Annotated[U8, "", "DriveState decoded from the status word"]
    drive_statusword: Annotated[U16, "", "status word 0x6041 as received"]
    drive_mode: Annotated[I8, "", "mode of operation display 0x6061"]
    drive_internal_limit: Annotated[U8, "", "status word bit 11: an internal limit is active"]
    drive_follows_command: Annotated[U8, "", "status word bit 12 in the cyclic modes: the drive follows the set-point"]
    drive_homing_attained: Annotated[U8, "", "status word bit 12 in homing mode: reference found"]
    drive_homing_error: Annotated[U8, "", "status word bit 13 in homing mode: homing failed"]
    drive_torque_nm: Annotated[F64, "N·m", "actual torque 0x6077, at the loaded shaft; coarse, never a measurement"]
    drive_angle_rad: Annotated[F64, "rad", "actual position 0x6064, at the loaded shaft"]
    drive_velocity_rad_s: Annotated[F64, "rad/s", "actual velocity 0x606C, at the loaded shaft"]
    drive_age_scans: Annotated[U16, "scans", "age of the drive's process data"]
    drive_nmt_state: Annotated[U8, "", "NmtState in the drive's last heartbeat"]
    drive_heartbeat_age_scans: Annotated[U16, "scans", "age of the drive's last heartbeat"]
    drive_emcy_code: Annotated[U16, "", "error code of the last emergency message, 0 when none or when reset"]
    drive_error_register: Annotated[U8, "", "error register 0x1001"]
    torque_in_nm: Annotated[F64, "N·m", "torque at the input shaft, before tare"]
    torque_out_nm: Annotated[F64, "N·m", "torque at the output (reaction or shaft sensor), before tare"]
    angle_in_rad: Annotated[F64, "rad", "angle of the input shaft"]
    angle_out_rad: Annotated[F64, "rad", "angle of the output shaft"]
    sample_counter: Annotated[U32, "", "the amplifier's own counter of samples (wraps at 2^32)"]
    sample_time_us: Annotated[U32, "µs", "the amplifier's time stamp of the sample (wraps at 2^32)"]
    sample_status: Annotated[U8, "", "SampleStatus bits"]
    sample_age_scans: Annotated[U16, "scans", "age of the sample"]
    torque_in_delay_scans: Annotated[U16, "scans", "input torque: from its request or SYNC to the sample"]
    torque_out_delay_scans: Annotated[U16, "scans", "output torque: from its request or SYNC to the sample"]
    angle_in_delay_scans: Annotated[U16, "scans", "input angle: from its request or SYNC to the sample"]
    angle_out_delay_scans: Annotated[U16, "scans", "output angle: from its request or SYNC to the sample"]
    brake_current_a: Annotated[F64, "A", "measured current of the lock brake"]
    brake_on: Annotated[U8, "", "the brake supply's output is on"]
    brake_age_scans: Annotated[U16, "scans", "age of the brake's values"]
    estop_released: Annotated[U8, "", "1 while the emergency stop chain is closed", "remote_io"]
    guard_closed: Annotated[U8, "", "1 while the guard is closed", "remote_io"]
    enabling_device: Annotated[
        U8, "", "1 while the three-position enabling device is in its middle position", "remote_io"
    ]
    housing_temp_c: Annotated[F64, "°C", "temperature of the unit's housing", "remote_io"]
    ambient_temp_c: Annotated[F64, "°C", "temperature of the room", "remote_io"]
    io_age_scans: Annotated[U16, "scans", "age of the remote I/O's values"]
    links_lost: Annotated[U8, "", "Link bits of connections that are down, or that somebody else uses"]

    def __iter__(self) -> Iterator[Any]:
        return iter(image_values(self))

    def _replace(self, **changes: Any) -> Image:
        """Return a copy with other values, as of a named tuple."""
        image = Image(*self)
        for name, value in changes.items():
            setattr(image, name, value)
        return image


class Orders(NamedTuple):
    """Outputs of one scan: orders to the devices first, then what the controller says of itself for the record."""

    drive_command: Annotated[U8, "", "DriveCommand"]
    drive_mode: Annotated[I8, "", "mode of operation 0x6060"]
    drive_target_torque_nm: Annotated[F64, "N·m", "target torque, at the loaded shaft"]
    drive_target_velocity_rad_s: Annotated[F64, "rad/s", "target velocity, at the loaded shaft"]
    brake_on: Annotated[U8, "", "brake supply output on"]
    brake_current_a: Annotated[F64, "A", "brake current set-point"]
    state: Annotated[U8, "", "State after this scan"]
    phase: Annotated[U8, "", "step inside the state"]
    segment: Annotated[U16, "", "index into the program's segments; the segment table is in the record"]
    cycle: Annotated[U16, "", "cycle number inside its block, from 1; 0 outside cycles"]
    reaction: Annotated[U8, "", "Reaction in force"]
    fault: Annotated[U16, "", "number of the first-out fault, 0 when none"]
    alarms: Annotated[U64, "", "bit n set: fault number n is active or latched"]
    reference_torque_nm: Annotated[F64, "N·m", "set-point of the controlled torque"]
    controlled_torque_nm: Annotated[F64, "N·m", "the torque that the ramp controls, tared"]
    torque_in_tare_nm: Annotated[F64, "N·m", "zero of the input torque, to be subtracted"]
    torque_out_tare_nm: Annotated[F64, "N·m", "zero of the output torque, to be subtracted"]
    angle_in_zero_rad: Annotated[F64, "rad", "input angle at the reference, to be subtracted"]
    angle_out_zero_rad: Annotated[F64, "rad", "output angle at the reference, to be subtracted"]


def _fields_of(kind: type, device: str = "") -> tuple[Field, ...]:
    """Return the rows of a class, or those only that a device delivers: a row may name it behind its meaning."""
    hints = get_type_hints(kind, include_extras=True).items()
    rows = ((name, hint.__metadata__) for name, hint in hints if name != "_fields")
    return tuple(Field(name, *told[:3]) for name, told in rows if not device or device in told[3:])


IMAGE_FIELDS = _fields_of(Image)
REMOTE_IO_FIELDS = _fields_of(Image, "remote_io")
"""What the remote I/O delivers: drivers and virtual bench carry these fields by their names."""

ORDERS_FIELDS = _fields_of(Orders)

Image._fields = tuple(field.name for field in IMAGE_FIELDS)
image_values: Callable[[Image], tuple[Any, ...]] = attrgetter(*Image._fields)
"""The values of an `Image` in the order of its fields, for the record."""

IMAGE_STRUCT = struct.Struct("<" + "".join(field.format for field in IMAGE_FIELDS))
"""Packs an `Image` for the record, little-endian without padding."""

ORDERS_STRUCT = struct.Struct("<" + "".join(field.format for field in ORDERS_FIELDS))
"""Packs an `Orders` for the record, little-endian without padding."""


def taker() -> Callable[[object], Orders]:
    """Return a function that makes `Orders` of a draft: of the attributes of any object that have its fields' names.

    For whoever makes them in every scan: values are given by name as in `Orders(...)`, in a third of its time, and what
    has not changed since the scan before is not given again.
    """
    values_of, make = attrgetter(*Orders._fields), tuple.__new__

    def take(draft: object) -> Orders:
        return make(Orders, values_of(draft))

    return take
