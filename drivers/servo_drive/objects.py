"""What is written to the drive before it may be armed, as tables: protections, option codes, synchronisation.

A protection is a limit that the drive enforces by itself, also when this program is dead. Vendors' defaults differ
(0x6007 is 0, "do nothing", on one drive and 1 on another; limits may mean "none"), so nothing is taken as given: every
row is read, written where it holds something else, and read back.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum

from definitions.number_formats import RANGES, IntegerType
from definitions.profiles.drive import DriveProfile, StartupObject
from definitions.protections import BY_NAME, DRIVE_PROTECTIONS, NONE
from definitions.protections import Protection as DefinedProtection
from drivers.config import DriveBrakeConfig, DriveConfig
from drivers.errors import Problem
from drivers.servo_drive.pdo import SYNC_COB_ID

OUTPUTS, INPUTS = "digital_outputs", "digital_inputs"
"""Objects of a brake at an output of the drive, by their names in a profile."""

ALL_BITS = 0xFFFF_FFFF
SYNC_BITS = ALL_BITS & ~(1 << 31)
"""Bit 31 of 0x1005 has no meaning, and drives set it or not; bit 30 would make the drive send SYNC."""
HOMING_MODE, CYCLIC_MODES = 1 << 5, (1 << 8) | (1 << 9)
"""Bits of 0x6502: homing; cyclic synchronous velocity and cyclic synchronous torque (CiA 402-2)."""

CURRENT_PER_RATED = 1000
"""0x6073 counts 0.1 % of the rated current (CiA 402-2), at which the motor has its rated torque."""

_PROFILE_NEXT = "check that the drive profile belongs to this drive"
_BENCH_NEXT = "set this value with the drive's own tool, or correct the bench file"
_HOMING_NEXT = "use a drive that can home without moving, or set its home position with the drive's own tool"


class Treatment(Enum):
    """How a row is treated."""

    CHECK = "check"  # read only, must equal
    CHECK_BITS = "check bits"  # read only, must have at least these bits
    WRITE = "write"  # write, and read back at the end
    STEP = "step"  # write only: a step on the way, such as switching a PDO off before it is mapped
    WRITE_IF_THERE = "write if there"  # as WRITE, but drives may lack the object


@dataclass(frozen=True)
class SetupRow:
    """One object of the set-up: where it is, what it must hold, what that means, what to do when it does not."""

    index: int
    subindex: int
    type: IntegerType
    value: int
    meaning: str
    treatment: Treatment = Treatment.WRITE
    next_step: str = _BENCH_NEXT
    compare_mask: int = ALL_BITS

    @property
    def fits(self) -> bool:
        """True when the value is inside the object's type."""
        low, high = RANGES[self.type]
        return low <= self.value <= high

    def written_over(self, found: int) -> int:
        """Return what is written where `found` is: bits that are not compared are the drive's own, and stay."""
        return found & ALL_BITS & ~self.compare_mask | self.value & self.compare_mask if self.value >= 0 else self.value

    def matches(self, found: int) -> bool:
        """Tell whether the value read is the one wanted."""
        if self.treatment is Treatment.CHECK_BITS:
            return found & self.value == self.value
        return (found ^ self.value) & self.compare_mask == 0


@dataclass(frozen=True)
class Protection:
    """One object of a protection: of which, in which way, where, its value from the bench's data, what it means.

    `zero_is_off`: 0 would switch it off. `per_rated`: it counts parts of the rated torque, which its meaning says.
    """

    name: str
    way: str
    index: int
    subindex: int
    type: IntegerType
    value: Callable[[DriveConfig], float]
    meaning: str
    zero_is_off: bool = True
    per_rated: bool = False


def milliseconds(seconds: float) -> int:
    """Return a time as objects in milliseconds hold it."""
    return round(seconds * 1000)


def _of_rated(torque_nm: float, config: DriveConfig) -> float:
    return config.profile.scaling.torque_counts_per_rated * torque_nm / config.rated_torque_nm


def _largest_torque(config: DriveConfig) -> float:
    return _of_rated(config.max_torque_nm, config)


PROTECTIONS: tuple[Protection, ...] = (
    Protection(
        "controller_heartbeat",
        "consumer_heartbeat",
        0x1016,
        1,
        "u32",
        lambda c: c.controller_node_id << 16 | milliseconds(c.controller_heartbeat_timeout_s),
        "heartbeat of the controller that the drive supervises (node << 16 | ms)",
    ),
    Protection(
        "drive_heartbeat",
        "producer_heartbeat",
        0x1017,
        0,
        "u16",
        lambda c: milliseconds(c.drive_heartbeat_s),
        "heartbeat of the drive (ms)",
    ),
    Protection(
        "abort_connection",
        "option_code",
        0x6007,
        0,
        "i16",
        lambda c: c.abort_connection_option,
        "reaction to a lost controller (abort connection option)",
    ),
    Protection(
        "quick_stop",
        "option_code",
        0x605A,
        0,
        "i16",
        lambda c: c.quick_stop_option,
        "quick stop option code",
        zero_is_off=False,
    ),
    Protection(
        "fault_reaction",
        "option_code",
        0x605E,
        0,
        "i16",
        lambda c: c.fault_reaction_option,
        "fault reaction option code",
        zero_is_off=False,
    ),
    Protection("torque_limit", "max_torque", 0x6072, 0, "u16", _largest_torque, "largest torque", per_rated=True),
    Protection(
        "torque_limit", "torque_limits", 0x60E0, 0, "u16", _largest_torque, "largest positive torque", per_rated=True
    ),
    Protection(
        "torque_limit", "torque_limits", 0x60E1, 0, "u16", _largest_torque, "largest negative torque", per_rated=True
    ),
    Protection(
        "torque_limit",
        "max_current",
        0x6073,
        0,
        "u16",
        lambda c: CURRENT_PER_RATED * c.max_torque_nm / c.rated_torque_nm,
        "largest current (0.1 % of rated current)",
    ),
    Protection(
        "speed_limit",
        "max_motor_speed",
        0x6080,
        0,
        "u32",
        lambda c: c.max_speed_rad_s * 60 / (2 * math.pi),
        "largest motor speed (rpm)",
    ),
    Protection(
        "torque_slope",
        "torque_slope",
        0x6087,
        0,
        "u32",
        lambda c: _of_rated(c.torque_slope_nm_s, c),
        "largest change of torque, per second",
        per_rated=True,
    ),
)
"""What the drive itself enforces, in each way that a drive may have it. Limits are rounded down."""


def _way(profile: DriveProfile, name: str) -> str:
    """Return the way in which a drive has a protection; those that no profile leaves out have one."""
    if name == "setpoint_timeout":
        return "rpdo_timeout" if profile.torque_pdo.timeout else NONE
    (first, _), *_ = BY_NAME[name].ways
    return str(getattr(profile.protections, name, first))


def protections_of(profile: DriveProfile) -> list[Protection]:
    """Return the objects of the protections that a drive has."""
    return [row for row in PROTECTIONS if row.way == _way(profile, row.name)]


def missing_protections(profile: DriveProfile) -> list[DefinedProtection]:
    """Return the protections that a drive does not have."""
    return [row for row in DRIVE_PROTECTIONS if _way(profile, row.name) == NONE]


def identity_rows(config: DriveConfig) -> list[SetupRow]:
    """Rows that tell whether this is the drive of the profile; nothing is written before they fit."""
    header = config.profile.profile
    return [
        SetupRow(0x1018, 1, "u32", header.vendor_id, "vendor id", Treatment.CHECK, _PROFILE_NEXT),
        SetupRow(0x1018, 2, "u32", header.product_code, "product code", Treatment.CHECK, _PROFILE_NEXT),
    ]


def rating_rows(config: DriveConfig) -> list[SetupRow]:
    """Rows that are read only: whose SYNC it follows, its abilities, the base of its torque numbers."""
    scaling = config.profile.scaling
    rated = round(config.rated_torque_nm * scaling.rated_torque_counts_per_nm)
    unit = {1e3: "mN·m", 1e6: "µN·m"}.get(scaling.rated_torque_counts_per_nm, "the drive's unit")
    modes = CYCLIC_MODES | (HOMING_MODE if config.profile.homing_method else 0)
    return [
        SetupRow(
            0x1005,
            0,
            "u32",
            SYNC_COB_ID,
            "COB-ID of SYNC, which the drive receives and does not send",
            Treatment.CHECK,
            "set 0x1005 to 0x80 with the drive's own tool",
            SYNC_BITS,
        ),
        SetupRow(0x6502, 0, "u32", modes, "supported modes", Treatment.CHECK_BITS, _PROFILE_NEXT),
        SetupRow(0x6076, 0, "u32", rated, f"rated torque of the motor ({unit})", Treatment.CHECK),
    ]


def protection_rows(config: DriveConfig) -> list[SetupRow]:
    """Rows of all protections with their values for this bench."""
    # The small addend keeps 1100.0 from becoming 1099 by the rounding of binary fractions.
    return [
        SetupRow(row.index, row.subindex, row.type, math.floor(row.value(config) + 1e-6), _meaning(row, config.profile))
        for row in protections_of(config.profile)
    ]


def _meaning(row: Protection, profile: DriveProfile) -> str:
    if not row.per_rated:
        return row.meaning
    return f"{row.meaning} ({100 / profile.scaling.torque_counts_per_rated:g} % of rated torque)"


def startup_rows(config: DriveConfig) -> list[SetupRow]:
    """Rows of what this drive needs written before it is used."""
    return rows_to_start(config.profile.startup)


def rows_to_start(objects: Iterable[StartupObject]) -> list[SetupRow]:
    """Rows of what a profile wants written before its device is used."""
    next_step = "check that the profile belongs to this device"
    return [SetupRow(one.index, one.subindex, one.type, one.value, one.meaning, next_step=next_step) for one in objects]


def protections_switched_off(config: DriveConfig) -> list[Protection]:
    """Protections that this bench's values would switch off: 0; for 0x1016 it is the time alone that counts."""
    off = []
    for row in protections_of(config.profile):
        value = math.floor(row.value(config) + 1e-6)
        if row.zero_is_off and (value & 0xFFFF if row.index == 0x1016 else value) == 0:
            off.append(row)
    return off


def output_rows(config: DriveConfig) -> list[SetupRow]:
    """Rows that let our digital outputs through; the others stay as they are. Drives may have no such mask."""
    mask, meaning = config.output_mask, "mask of the digital outputs"
    if not mask:
        return []
    return [SetupRow(0x60FE, 2, "u32", mask, meaning, Treatment.WRITE_IF_THERE, compare_mask=mask)]


def homing_rows(config: DriveConfig) -> list[SetupRow]:
    """Rows that make homing set a reference without motion: any other method would turn a shaft whose lock is open.

    Methods 37 and, in older drives, 35 take the present position (CiA 402-2). A drive that does not home has no row.
    """
    method = config.profile.homing_method
    if not method:
        return []
    return [
        SetupRow(0x6098, 0, "i8", method, "homing method (current position, no motion)", next_step=_HOMING_NEXT),
    ]


def polarity_rows() -> list[SetupRow]:
    """Rows that leave the direction to the bench file: the drive turns no sign by itself."""
    return [SetupRow(0x607E, 0, "u8", 0, "polarity (the drive turns no sign)", Treatment.WRITE_IF_THERE)]


def synchronisation_rows(config: DriveConfig, period_ns: int) -> list[SetupRow]:
    """Rows that tie the drive to our SYNC; all are objects that drives may lack.

    The period of SYNC is told only where the profile asks for it: there are drives that supervise it, and end in a
    quick stop after a few scans that came late.
    """
    optional = Treatment.WRITE_IF_THERE
    rows = [SetupRow(0x1019, 0, "u8", 0, "SYNC carries no counter", optional)]
    if config.profile.write_sync_period:
        rows.append(SetupRow(0x1006, 0, "u32", period_ns // 1000, "period of SYNC (µs)", optional))
    if power := _interpolation_power(period_ns):
        units = period_ns // 10 ** (9 + power)
        rows += [
            SetupRow(0x60C2, 1, "u8", units, "interpolation period", optional),
            SetupRow(0x60C2, 2, "i8", power, "interpolation period, power of ten seconds", optional),
        ]
    return rows


def _interpolation_power(period_ns: int) -> int:
    """Coarsest power of ten seconds that divides the period into 1 to 255 units; 0 when none does."""
    for power in range(-1, -7, -1):
        if period_ns % 10 ** (9 + power) == 0 and 1 <= period_ns // 10 ** (9 + power) <= 0xFF:
            return power
    return 0


def number_text(row: SetupRow, value: int) -> str:
    """Write ids and bit fields in hexadecimal, quantities in decimal."""
    return f"0x{value:08X}" if row.type == "u32" and (row.index < 0x2000 or row.index == 0x6502) else str(value)


def output_brake_problems(brake: DriveBrakeConfig, profile: DriveProfile) -> list[Problem]:
    """Return what a drive's profile lacks for a brake at its output."""
    mapped = {item.name for pdo in profile.receive_pdos for item in pdo.objects}
    mapped |= {item.name for pdo in profile.transmit_pdos for item in pdo.objects}
    needed = ((OUTPUTS, "60FE:01", True), (INPUTS, "60FD:00", brake.input_bit is not None))
    hint = "map it in a PDO of the profile, or connect the brake to the remote I/O"
    where = f"drive profile {profile.profile.name}"
    return [
        Problem(f"does not map {name}", where, ", ".join(sorted(mapped)), f"{name} ({object_})", hint)
        for name, object_, wanted in needed
        if wanted and name not in mapped
    ]
