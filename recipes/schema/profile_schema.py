"""Files of drive profiles: the object mapping of a CiA 402 drive.

A profile is the data that makes another drive work without other code. The models are strict: unknown keys, wrong
types and mappings longer than a frame are all refused. What they accept reaches the drivers as the dataclasses of
`drivers.profile`, field by field under the same names.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from definitions.number_formats import IGNORED, RANGES, SIZES, IntegerType

PDO_BYTES = 8

RECEIVE_OBJECTS = MappingProxyType(
    {"controlword": "u16", "mode": "i8", "target_torque": "i16", "target_velocity": "i32"}
)
"""Objects the controller writes, all needed, with their types."""

TRANSMIT_OBJECTS = MappingProxyType(
    {
        "statusword": "u16",
        "mode_display": "i8",
        "actual_torque": "i16",
        "actual_position": "i32",
        "actual_velocity": "i32",
        "error_register": "u8",
    }
)
"""Objects the drive sends, with their types; all but the last are needed."""

OPTIONAL_OBJECTS = frozenset({"error_register"})

PREDEFINED_PDOS = 4
"""PDOs of each direction that have a COB-ID in the predefined connection set (CiA 301)."""


class ProfileSection(BaseModel):
    """A section of a profile: strict and frozen, and it refuses what it does not know."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class DriveProfileHeader(ProfileSection):
    """Which drive this is: its name and its identity object 0x1018."""

    name: str
    kind: Literal["cia402-drive"]
    vendor_id: int = Field(ge=0, le=0xFFFF_FFFF)
    product_code: int = Field(ge=0, le=0xFFFF_FFFF)


class DriveScaling(ProfileSection):
    """The vendor's units. By CiA 402 torque counts 0.1 % of the rated torque, and 0x6076 counts mN·m.

    torque_counts_per_rated: counts of 0x6071, 0x6072, 0x6077 and 0x6087 per rated torque. rated_torque_counts_per_nm:
    counts of 0x6076 per N·m, 1000000 for a drive that counts µN·m.
    """

    position_counts_per_motor_rev: float = Field(gt=0)
    velocity_counts_per_rad_s: float = Field(gt=0)
    torque_counts_per_rated: float = Field(default=1000.0, gt=0)
    rated_torque_counts_per_nm: float = Field(default=1000.0, gt=0)


class DriveProtections(ProfileSection):
    """In which way the drive has each protection; `none` for one that it lacks, which every result then says."""

    controller_heartbeat: Literal["consumer_heartbeat", "none"] = "consumer_heartbeat"
    abort_connection: Literal["option_code", "none"] = "option_code"
    quick_stop: Literal["option_code", "none"] = "option_code"
    fault_reaction: Literal["option_code", "none"] = "option_code"
    torque_limit: Literal["max_torque", "torque_limits", "max_current", "none"] = "max_torque"
    speed_limit: Literal["max_motor_speed", "none"] = "max_motor_speed"
    torque_slope: Literal["torque_slope", "none"] = "torque_slope"
    follows_command: Literal["status_bit_12", "none"] = "status_bit_12"


class StartupObject(ProfileSection):
    """An object that this drive needs written before it is used, and what it means."""

    index: int = Field(ge=0x1000, le=0xFFFF)
    subindex: int = Field(ge=0, le=0xFF)
    type: IntegerType
    value: int
    meaning: str = Field(min_length=1)

    @model_validator(mode="after")
    def _fits_its_type(self) -> Self:
        _check_range(self.value, self.type, f"startup {self.index:#06x}:{self.subindex}")
        return self


class MappedObject(ProfileSection):
    """One object in a PDO; `ignored` is the name of one that nobody looks at. The controller sends `value` in it."""

    index: int = Field(ge=0x1000, le=0xFFFF)
    subindex: int = Field(ge=0, le=0xFF)
    type: IntegerType
    name: str
    value: int = 0

    @model_validator(mode="after")
    def _value_of_an_ignored_one(self) -> Self:
        if self.value and self.name != IGNORED:
            raise ValueError(f"{self.name}: only an object called {IGNORED!r} has a fixed value")
        _check_range(self.value, self.type, f"{self.index:#06x}:{self.subindex}")
        return self


class _Pdo(ProfileSection):
    number: int = Field(ge=1, le=8)
    transmission_type: int = Field(ge=0, le=255)
    objects: tuple[MappedObject, ...] = Field(min_length=1, max_length=8, strict=False)
    fixed_mapping: bool = False
    """The drive's own mapping, which is checked and never written."""
    cob_id: int | None = Field(default=None, ge=0x180, le=0x57F)
    """COB-ID; by default that of the predefined connection set, which PDOs 1 to 4 have."""

    @model_validator(mode="after")
    def _has_a_cob_id(self) -> Self:
        if self.number > PREDEFINED_PDOS and self.cob_id is None:
            raise ValueError(f"PDO {self.number} has no predefined COB-ID; give it a cob_id that no other device uses")
        return self

    @model_validator(mode="after")
    def _fits_a_frame(self) -> Self:
        size = sum(SIZES[mapped.type] for mapped in self.objects)
        if size > PDO_BYTES:
            raise ValueError(f"PDO {self.number} maps {size} bytes; a frame holds {PDO_BYTES}")
        return self


class ReceivePdo(_Pdo):
    """A PDO from the controller; `timeout`: the drive supervises its arrival (0x1400:5)."""

    timeout: bool


class TransmitPdo(_Pdo):
    """A PDO from the drive."""


class DriveProfileFile(ProfileSection):
    """Profile of a CiA 402 drive.

    homing_method: 37 or 35, by which the drive takes the position where it stands as its reference; 0 for a drive that
    does not home. write_sync_period: it needs the period of SYNC in 0x1006. startup: objects that this drive needs
    written first. tried_on_hardware: a drive of this kind has run by this profile, which somebody has to state; where
    nobody has, every result says so.
    """

    profile: DriveProfileHeader
    scaling: DriveScaling
    receive_pdos: tuple[ReceivePdo, ...] = Field(strict=False)
    transmit_pdos: tuple[TransmitPdo, ...] = Field(strict=False)
    write_sync_period: bool = False
    protections: DriveProtections = DriveProtections()
    homing_method: Literal[0, 35, 37] = 37
    startup: tuple[StartupObject, ...] = Field(default=(), strict=False)
    tried_on_hardware: bool = False

    @model_validator(mode="after")
    def _maps_what_is_needed(self) -> Self:
        _check_pdos("receive_pdos", self.receive_pdos, RECEIVE_OBJECTS, repeated={"controlword", "mode"})
        _check_pdos("transmit_pdos", self.transmit_pdos, TRANSMIT_OBJECTS, repeated={"statusword", "mode_display"})
        return self

    @model_validator(mode="after")
    def _a_lost_controller_is_noticed(self) -> Self:
        carriers = [pdo for pdo in self.receive_pdos if any(item.name == "target_torque" for item in pdo.objects)]
        if self.protections.controller_heartbeat == "none" and not any(pdo.timeout for pdo in carriers):
            raise ValueError(
                "the drive would go on when the controller is dead: give it controller_heartbeat (0x1016), or 'timeout:"
                " true' on the receive PDO that carries target_torque"
            )
        return self


def _check_range(value: int, type_name: IntegerType, where: str) -> None:
    low, high = RANGES[type_name]
    if not low <= value <= high:
        raise ValueError(f"{where}: found {value}; a number of type {type_name} is {low} to {high}")


def _check_pdos(key: str, pdos: tuple[_Pdo, ...], known: MappingProxyType[str, str], *, repeated: set[str]) -> None:
    numbers = [pdo.number for pdo in pdos]
    if len(set(numbers)) != len(numbers):
        raise ValueError(f"{key}: a PDO number is used twice: {numbers}")
    mapped = [item for pdo in pdos for item in pdo.objects if item.name != IGNORED]
    for item in mapped:
        if item.name not in known:
            raise ValueError(f"{key}: unknown name {item.name!r}; allowed: {', '.join(known)}")
        if item.type != known[item.name]:
            raise ValueError(f"{key}: {item.name} has type {item.type}; CiA 402 gives it {known[item.name]}")
    names = [item.name for item in mapped]
    once = [name for name in names if name not in repeated]
    if len(set(once)) != len(once):
        raise ValueError(f"{key}: an object is mapped twice: {', '.join(once)}")
    missing = set(known) - OPTIONAL_OBJECTS - set(names)
    if missing:
        raise ValueError(f"{key}: not mapped: {', '.join(sorted(missing))}")
