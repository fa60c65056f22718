"""The process image: everything that enters a scan, everything that leaves it, and the numbers both are written in.

This file owns the process image. A field is one row of `Image` or `Orders` here, one row of `IMAGE_FIELDS` or
`ORDERS_FIELDS` (binary format, unit, meaning), and nothing else: the record, the replay and the drivers read these
tables. SI units throughout, the unit in the name. Ages count scans since the value was taken from its device; 0 means
it arrived for this scan, `AGE_NEVER` that it never came.

Sign convention: positive torque and positive angle turn the same way on both shafts, and a positive torque at the
loaded shaft winds the reducer up positively, whichever side the servo drives.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import NamedTuple

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
    """Bits of `links_lost`: a connection that its peer closed, that refused, or that answers with exceptions."""

    CAN = 1
    AMPLIFIER = 2
    BRAKE = 4
    REMOTE_IO = 8


class SampleStatus(IntEnum):
    """Bits of `sample_status`, as the measuring amplifier reports them."""

    TORQUE_IN_SATURATED = 1
    TORQUE_OUT_SATURATED = 2
    NOT_READY = 4


class Image(NamedTuple):
    """Inputs of one scan, as read from the devices before anything is decided."""

    missed_periods: int
    command: int
    drive_state: int
    drive_statusword: int
    drive_mode: int
    drive_internal_limit: int
    drive_follows_command: int
    drive_homing_attained: int
    drive_homing_error: int
    drive_torque_nm: float
    drive_angle_rad: float
    drive_velocity_rad_s: float
    drive_age_scans: int
    drive_nmt_state: int
    drive_heartbeat_age_scans: int
    drive_emcy_code: int
    drive_error_register: int
    torque_in_nm: float
    torque_out_nm: float
    angle_in_rad: float
    angle_out_rad: float
    sample_counter: int
    sample_time_us: int
    sample_status: int
    sample_age_scans: int
    brake_current_a: float
    brake_on: int
    brake_age_scans: int
    estop_released: int
    guard_closed: int
    housing_temp_c: float
    ambient_temp_c: float
    io_age_scans: int
    links_lost: int


class Orders(NamedTuple):
    """Outputs of one scan: orders to the devices first, then what the controller says of itself for the record."""

    drive_command: int
    drive_mode: int
    drive_target_torque_nm: float
    drive_target_velocity_rad_s: float
    brake_on: int
    brake_current_a: float
    state: int
    phase: int
    segment: int
    cycle: int
    reaction: int
    fault: int
    alarms: int
    reference_torque_nm: float
    controlled_torque_nm: float
    torque_in_tare_nm: float
    torque_out_tare_nm: float
    angle_in_zero_rad: float
    angle_out_zero_rad: float


class Field(NamedTuple):
    """Row of a field table: name, binary format (`struct` letter), unit ('' for numbers and bits) and meaning."""

    name: str
    format: str
    unit: str
    meaning: str


IMAGE_FIELDS: tuple[Field, ...] = (
    Field("missed_periods", "I", "", "whole periods that were skipped before this scan"),
    Field("command", "B", "", "Command from the mailbox, seen by this scan only"),
    Field("drive_state", "B", "", "DriveState decoded from the status word"),
    Field("drive_statusword", "H", "", "status word 0x6041 as received"),
    Field("drive_mode", "b", "", "mode of operation display 0x6061"),
    Field("drive_internal_limit", "B", "", "status word bit 11: an internal limit is active"),
    Field("drive_follows_command", "B", "", "status word bit 12 in the cyclic modes: the drive follows the set-point"),
    Field("drive_homing_attained", "B", "", "status word bit 12 in homing mode: reference found"),
    Field("drive_homing_error", "B", "", "status word bit 13 in homing mode: homing failed"),
    Field("drive_torque_nm", "d", "N·m", "actual torque 0x6077, at the loaded shaft; coarse, never a measurement"),
    Field("drive_angle_rad", "d", "rad", "actual position 0x6064, at the loaded shaft"),
    Field("drive_velocity_rad_s", "d", "rad/s", "actual velocity 0x606C, at the loaded shaft"),
    Field("drive_age_scans", "H", "scans", "age of the drive's process data"),
    Field("drive_nmt_state", "B", "", "NmtState in the drive's last heartbeat"),
    Field("drive_heartbeat_age_scans", "H", "scans", "age of the drive's last heartbeat"),
    Field("drive_emcy_code", "H", "", "error code of the last emergency message, 0 when none or when reset"),
    Field("drive_error_register", "B", "", "error register 0x1001"),
    Field("torque_in_nm", "d", "N·m", "torque at the input shaft, before tare"),
    Field("torque_out_nm", "d", "N·m", "torque at the output (reaction or shaft sensor), before tare"),
    Field("angle_in_rad", "d", "rad", "angle of the input shaft"),
    Field("angle_out_rad", "d", "rad", "angle of the output shaft"),
    Field("sample_counter", "I", "", "the amplifier's own counter of samples (wraps at 2^32)"),
    Field("sample_time_us", "I", "µs", "the amplifier's time stamp of the sample (wraps at 2^32)"),
    Field("sample_status", "B", "", "SampleStatus bits"),
    Field("sample_age_scans", "H", "scans", "age of the sample"),
    Field("brake_current_a", "d", "A", "measured current of the lock brake"),
    Field("brake_on", "B", "", "the brake supply's output is on"),
    Field("brake_age_scans", "H", "scans", "age of the brake's values"),
    Field("estop_released", "B", "", "1 while the emergency stop chain is closed"),
    Field("guard_closed", "B", "", "1 while the guard is closed"),
    Field("housing_temp_c", "d", "°C", "temperature of the unit's housing"),
    Field("ambient_temp_c", "d", "°C", "temperature of the room"),
    Field("io_age_scans", "H", "scans", "age of the remote I/O's values"),
    Field("links_lost", "B", "", "Link bits of connections that are down"),
)

ORDERS_FIELDS: tuple[Field, ...] = (
    Field("drive_command", "B", "", "DriveCommand"),
    Field("drive_mode", "b", "", "mode of operation 0x6060"),
    Field("drive_target_torque_nm", "d", "N·m", "target torque, at the loaded shaft"),
    Field("drive_target_velocity_rad_s", "d", "rad/s", "target velocity, at the loaded shaft"),
    Field("brake_on", "B", "", "brake supply output on"),
    Field("brake_current_a", "d", "A", "brake current set-point"),
    Field("state", "B", "", "State after this scan"),
    Field("phase", "B", "", "step inside the state"),
    Field("segment", "H", "", "index into the program's segments; the segment table is in the record"),
    Field("cycle", "H", "", "cycle number inside its block, from 1; 0 outside cycles"),
    Field("reaction", "B", "", "Reaction in force"),
    Field("fault", "H", "", "number of the first-out fault, 0 when none"),
    Field("alarms", "Q", "", "bit n set: fault number n is active or latched"),
    Field("reference_torque_nm", "d", "N·m", "set-point of the controlled torque"),
    Field("controlled_torque_nm", "d", "N·m", "the torque that the ramp controls, tared"),
    Field("torque_in_tare_nm", "d", "N·m", "zero of the input torque, to be subtracted"),
    Field("torque_out_tare_nm", "d", "N·m", "zero of the output torque, to be subtracted"),
    Field("angle_in_zero_rad", "d", "rad", "input angle at the reference, to be subtracted"),
    Field("angle_out_zero_rad", "d", "rad", "output angle at the reference, to be subtracted"),
)

IMAGE_STRUCT = struct.Struct("<" + "".join(field.format for field in IMAGE_FIELDS))
"""Packs an `Image` for the record, little-endian without padding."""

ORDERS_STRUCT = struct.Struct("<" + "".join(field.format for field in ORDERS_FIELDS))
"""Packs an `Orders` for the record, little-endian without padding."""
