"""Objects of the virtual drive beside PDO and the services: one row each, applied by `drive_dictionary`.

Settings are written into the drive machine's `DriveObjects`; values are read from the machine when somebody asks.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from durand.datatypes import DatatypeEnum

from virtual_bench.drive import cia402_tables as tables
from virtual_bench.drive.cia402_machine import Cia402Machine

I8, I16, I32 = DatatypeEnum.INTEGER8, DatatypeEnum.INTEGER16, DatatypeEnum.INTEGER32
U8, U16, U32 = DatatypeEnum.UNSIGNED8, DatatypeEnum.UNSIGNED16, DatatypeEnum.UNSIGNED32

STRUCT_LETTERS: dict[DatatypeEnum, str] = {I8: "b", I16: "h", I32: "i", U8: "B", U16: "H", U32: "I"}


class Setting(NamedTuple):
    """A read-write object that sets the drive up; `allowed` None takes every value from `low` to the type's end."""

    object_index: int
    datatype: DatatypeEnum
    attribute: str  # of DriveObjects
    name: str
    allowed: tuple[int, ...] | None = None
    low: int = 0


class Value(NamedTuple):
    """An object that the drive shows, and that a controller may write where `write` is given."""

    object_index: int
    datatype: DatatypeEnum
    name: str
    read: Callable[[Cia402Machine], int]
    write: Callable[[Cia402Machine, int, int], None] | None = None  # machine, value, time in ns
    subindex: int = 0


SETTINGS: tuple[Setting, ...] = (
    Setting(0x6007, I16, "abort_connection", "Abort connection option code", tuple(tables.AbortConnection)),
    Setting(0x605A, I16, "quick_stop_option", "Quick stop option code", tuple(tables.QUICK_STOP_OPTIONS)),
    Setting(0x605B, I16, "shutdown_option", "Shutdown option code", tuple(tables.SHUTDOWN_OPTIONS)),
    Setting(0x605C, I16, "disable_option", "Disable operation option code", tuple(tables.DISABLE_OPTIONS)),
    Setting(0x605D, I16, "halt_option", "Halt option code", tuple(tables.HALT_OPTIONS)),
    Setting(0x605E, I16, "fault_reaction_option", "Fault reaction option code", tuple(tables.FAULT_REACTION_OPTIONS)),
    Setting(0x6072, U16, "max_torque_permille", "Max torque"),
    Setting(0x607C, I32, "home_offset_counts", "Home offset", low=-0x80000000),
    Setting(0x6080, U32, "max_speed_rpm", "Max motor speed"),
    Setting(0x6084, U32, "slow_down_counts_s2", "Profile deceleration", low=1),
    Setting(0x6085, U32, "quick_stop_counts_s2", "Quick stop deceleration", low=1),
    Setting(0x6087, U32, "torque_slope_permille_s", "Torque slope", low=1),
    Setting(0x6098, I8, "homing_method", "Homing method", tables.HOMING_METHODS),
)


def _write_mode(machine: Cia402Machine, value: int, _now_ns: int) -> None:
    machine.motion.write_mode(value)


def _write_torque(machine: Cia402Machine, value: int, _now_ns: int) -> None:
    machine.motion.write_target_torque(value)


def _write_velocity(machine: Cia402Machine, value: int, _now_ns: int) -> None:
    machine.motion.write_target_velocity(value)


def _write_outputs(machine: Cia402Machine, value: int, _now_ns: int) -> None:
    machine.objects.digital_outputs = value


def _write_output_mask(machine: Cia402Machine, value: int, _now_ns: int) -> None:
    machine.objects.output_mask = value


def _int32(value: int) -> int:
    return ((value + 0x80000000) & 0xFFFFFFFF) - 0x80000000


def _int16(value: int) -> int:
    return min(max(value, -0x8000), 0x7FFF)


VALUES: tuple[Value, ...] = (
    Value(0x1001, U8, "Error register", lambda machine: machine.error_register),
    Value(0x603F, U16, "Error code", lambda machine: machine.error_code),
    Value(0x6040, U16, "Controlword", lambda machine: machine.controlword, Cia402Machine.write_controlword),
    Value(0x6041, U16, "Statusword", lambda machine: machine.statusword),
    Value(0x6060, I8, "Modes of operation", lambda machine: machine.motion.mode, _write_mode),
    Value(0x6061, I8, "Modes of operation display", lambda machine: int(machine.motion.mode_display)),
    Value(0x6064, I32, "Position actual value", lambda machine: _int32(machine.position_counts)),
    Value(0x606C, I32, "Velocity actual value", lambda machine: _int32(machine.motor.velocity_counts_s)),
    Value(0x6071, I16, "Target torque", lambda machine: machine.motion.target_torque, _write_torque),
    Value(0x6077, I16, "Torque actual value", lambda machine: _int16(machine.motor.torque_permille)),
    Value(0x60FF, I32, "Target velocity", lambda machine: machine.motion.target_velocity, _write_velocity),
    Value(0x60FD, U32, "Digital inputs", lambda machine: machine.digital_inputs),
    Value(0x60FE, U32, "Physical outputs", lambda machine: machine.objects.digital_outputs, _write_outputs, 1),
    Value(0x60FE, U32, "Output mask", lambda machine: machine.objects.output_mask, _write_output_mask, 2),
    Value(0x6502, U32, "Supported drive modes", lambda _machine: tables.SUPPORTED_MODES),
)
"""All of these may be mapped into PDOs: into receive PDOs where they can be written."""
