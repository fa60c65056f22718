"""The object mapping of a CiA 402 drive, as its profile says it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

from definitions.number_formats import IGNORED, SIZES, IntegerType, Limits, check_range

PDO_BYTES = 8

RECEIVE_OBJECTS: Mapping[str, str] = {
    "controlword": "u16",
    "mode": "i8",
    "target_torque": "i16",
    "target_velocity": "i32",
    "digital_outputs": "u32",
}
"""Objects the controller writes, with their types; all but the last are needed."""

TRANSMIT_OBJECTS: Mapping[str, str] = {
    "statusword": "u16",
    "mode_display": "i8",
    "actual_torque": "i16",
    "actual_position": "i32",
    "actual_velocity": "i32",
    "error_register": "u8",
    "digital_inputs": "u32",
}
"""Objects the drive sends, with their types; all but the last two are needed."""

OPTIONAL_OBJECTS = frozenset({"error_register", "digital_outputs", "digital_inputs"})
"""The digital ones: 0x60FE:1 and 0x60FD, where a brake is connected to the drive."""

PREDEFINED_PDOS = 4
"""PDOs of each direction that have a COB-ID in the predefined connection set (CiA 301)."""

Index = Annotated[int, Limits(ge=0x1000, le=0xFFFF)]
Subindex = Annotated[int, Limits(ge=0, le=0xFF)]
U32 = Annotated[int, Limits(ge=0, le=0xFFFF_FFFF)]
Counts = Annotated[float, Limits(gt=0)]


@dataclass(frozen=True)
class DriveProfileHeader:
    """Which drive this is: its name and its identity object 0x1018."""

    name: str
    kind: Literal["cia402-drive"]
    vendor_id: U32
    product_code: U32


@dataclass(frozen=True)
class DriveScaling:
    """The vendor's units. By CiA 402 torque counts 0.1 % of the rated torque, and 0x6076 counts mN·m.

    torque_counts_per_rated: counts of 0x6071, 0x6072, 0x6077 and 0x6087 per rated torque. rated_torque_counts_per_nm:
    counts of 0x6076 per N·m, 1000000 for a drive that counts µN·m.
    """

    position_counts_per_motor_rev: Counts
    velocity_counts_per_rad_s: Counts
    torque_counts_per_rated: Counts = 1000.0
    rated_torque_counts_per_nm: Counts = 1000.0


@dataclass(frozen=True)
class DriveProtections:
    """In which way the drive has each protection (docs/safety.md); `none` for one that it lacks.

    Every result says what is lacking. The time-out of set-points is that of the receive PDO that carries the torque.
    """

    controller_heartbeat: Literal["consumer_heartbeat", "none"] = "consumer_heartbeat"
    abort_connection: Literal["option_code", "none"] = "option_code"
    quick_stop: Literal["option_code", "none"] = "option_code"
    fault_reaction: Literal["option_code", "none"] = "option_code"
    torque_limit: Literal["max_torque", "torque_limits", "max_current", "none"] = "max_torque"
    speed_limit: Literal["max_motor_speed", "none"] = "max_motor_speed"
    torque_slope: Literal["torque_slope", "none"] = "torque_slope"
    follows_command: Literal["status_bit_12", "none"] = "status_bit_12"


@dataclass(frozen=True)
class StartupObject:
    """An object that this device needs written before it is used, and what it means."""

    index: Index
    subindex: Subindex
    type: IntegerType
    value: int
    meaning: Annotated[str, Limits(min_length=1)]

    def __post_init__(self) -> None:
        check_range(self.value, self.type, f"startup {self.index:#06x}:{self.subindex}")


@dataclass(frozen=True)
class MappedObject:
    """One object in a PDO; `ignored` is the name of one that nobody looks at. The controller sends `value` in it."""

    index: Index
    subindex: Subindex
    type: IntegerType
    name: str
    value: int = 0

    def __post_init__(self) -> None:
        if self.value and self.name != IGNORED:
            raise ValueError(
                f"object {self.name}: found a fixed value; allowed only with the name {IGNORED!r}. Delete 'value'"
            )
        check_range(self.value, self.type, f"{self.index:#06x}:{self.subindex}")

    @property
    def mapping(self) -> int:
        """Value of the mapping entry: index, subindex and length in bits (CiA 301, 0x1600 and 0x1A00)."""
        return self.index << 16 | self.subindex << 8 | SIZES[self.type] * 8


@dataclass(frozen=True, kw_only=True)
class _Pdo:
    """`fixed_mapping`: the drive's own, which is checked and never written. `cob_id`: by default the predefined one."""

    number: Annotated[int, Limits(ge=1, le=8)]
    transmission_type: Annotated[int, Limits(ge=0, le=255)]
    objects: Annotated[tuple[MappedObject, ...], Limits(min_length=1, max_length=8)]
    fixed_mapping: bool = False
    cob_id: Annotated[int, Limits(ge=0x180, le=0x57F)] | None = None

    def __post_init__(self) -> None:
        if self.number > PREDEFINED_PDOS and self.cob_id is None:
            raise ValueError(
                f"PDO {self.number}: no default CAN identifier. Add 'cob_id' with one that no other device uses"
            )
        size = sum(SIZES[mapped.type] for mapped in self.objects)
        if size > PDO_BYTES:
            raise ValueError(
                f"PDO {self.number}: its objects have {size} bytes; a CAN message holds {PDO_BYTES}. List fewer objects"
            )


@dataclass(frozen=True, kw_only=True)
class ReceivePdo(_Pdo):
    """A PDO from the controller; `timeout`: the drive supervises its arrival (0x1400:5)."""

    timeout: bool


@dataclass(frozen=True, kw_only=True)
class TransmitPdo(_Pdo):
    """A PDO from the drive."""


@dataclass(frozen=True)
class DriveProfile:
    """Profile of a CiA 402 drive.

    homing_method: 37 or 35, by which the drive takes the position where it stands as its reference; 0 for a drive that
    does not home, whose position is then counted from where it stands. write_sync_period: it needs the period of SYNC
    in 0x1006. startup: objects that it needs written first. tried_on_hardware: a drive of this kind has run by this
    profile, which somebody has to state; where nobody has, every result says so.
    """

    profile: DriveProfileHeader
    scaling: DriveScaling
    receive_pdos: tuple[ReceivePdo, ...]
    transmit_pdos: tuple[TransmitPdo, ...]
    write_sync_period: bool = False
    protections: DriveProtections = DriveProtections()
    homing_method: Literal[0, 35, 37] = 37
    startup: tuple[StartupObject, ...] = ()
    tried_on_hardware: bool = False

    def __post_init__(self) -> None:
        _check_pdos("receive_pdos", self.receive_pdos, RECEIVE_OBJECTS, repeated={"controlword", "mode"})
        _check_pdos("transmit_pdos", self.transmit_pdos, TRANSMIT_OBJECTS, repeated={"statusword", "mode_display"})
        if self.protections.controller_heartbeat == "none" and not self.torque_pdo.timeout:
            raise ValueError(
                "the drive would not stop when the controller program fails. Add 'controller_heartbeat' to the "
                "protections, or 'timeout: true' to the receive PDO with target_torque"
            )

    @property
    def torque_pdo(self) -> ReceivePdo:
        """The receive PDO that carries the torque; its absence is what the drive's time-out is about."""
        return next(pdo for pdo in self.receive_pdos if any(item.name == "target_torque" for item in pdo.objects))


def _check_pdos(key: str, pdos: tuple[_Pdo, ...], known: Mapping[str, str], *, repeated: set[str]) -> None:
    numbers = [pdo.number for pdo in pdos]
    if len(set(numbers)) != len(numbers):
        raise ValueError(f"{key}: a PDO number is used twice: {numbers}. Give each PDO its own number")
    mapped = [item for pdo in pdos for item in pdo.objects if item.name != IGNORED]
    for item in mapped:
        if item.name not in known:
            raise ValueError(f"{key}: found an object with the unknown name {item.name!r}; allowed: {', '.join(known)}")
        if item.type != known[item.name]:
            raise ValueError(
                f"{key}: object {item.name} has type {item.type}; CiA 402 requires {known[item.name]}. Correct the type"
            )
    names = [item.name for item in mapped]
    once = [name for name in names if name not in repeated]
    if len(set(once)) != len(once):
        raise ValueError(f"{key}: an object is listed twice: {', '.join(once)}. List each object once")
    missing = set(known) - OPTIONAL_OBJECTS - set(names)
    if missing:
        raise ValueError(
            f"{key}: required objects are missing: {', '.join(sorted(missing))}. Add each of them to a PDO"
        )
