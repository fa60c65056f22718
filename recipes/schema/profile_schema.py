"""Files of device profiles: the object mapping of a CiA 402 drive, the register map of a Modbus device.

A profile is the data that makes another drive or amplifier work without other code. The models are strict: unknown
keys, wrong types, mappings longer than a frame and fields outside the block that is read are all refused. What they
accept reaches the drivers as the dataclasses of `drivers.profile`, field by field under the same names.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from definitions.number_formats import IGNORED, RANGES, SIZES, IntegerType, RegisterType

PDO_BYTES = 8
MODBUS_READ_REGISTERS = 125
MODBUS_WRITE_REGISTERS = 123
IDENTITY_REGISTERS = 32
"""Longest identity that is a text, in registers."""

COUNTED = frozenset({"sample_counter", "life_counter"})
"""Fields that are taken as they are counted."""

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


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class DriveProfileHeader(_Model):
    """Which drive this is: its name and its identity object 0x1018."""

    name: str
    kind: Literal["cia402-drive"]
    vendor_id: int = Field(ge=0, le=0xFFFF_FFFF)
    product_code: int = Field(ge=0, le=0xFFFF_FFFF)


class DriveScaling(_Model):
    """The vendor's units. By CiA 402 torque counts 0.1 % of the rated torque, and 0x6076 counts mN·m.

    torque_counts_per_rated: counts of 0x6071, 0x6072, 0x6077 and 0x6087 per rated torque. rated_torque_counts_per_nm:
    counts of 0x6076 per N·m, 1000000 for a drive that counts µN·m.
    """

    position_counts_per_motor_rev: float = Field(gt=0)
    velocity_counts_per_rad_s: float = Field(gt=0)
    torque_counts_per_rated: float = Field(default=1000.0, gt=0)
    rated_torque_counts_per_nm: float = Field(default=1000.0, gt=0)


class DriveProtections(_Model):
    """In which way the drive has each protection; `none` for one that it lacks, which every result then says."""

    controller_heartbeat: Literal["consumer_heartbeat", "none"] = "consumer_heartbeat"
    abort_connection: Literal["option_code", "none"] = "option_code"
    quick_stop: Literal["option_code", "none"] = "option_code"
    fault_reaction: Literal["option_code", "none"] = "option_code"
    torque_limit: Literal["max_torque", "torque_limits", "max_current", "none"] = "max_torque"
    speed_limit: Literal["max_motor_speed", "none"] = "max_motor_speed"
    torque_slope: Literal["torque_slope", "none"] = "torque_slope"
    follows_command: Literal["status_bit_12", "none"] = "status_bit_12"


class StartupObject(_Model):
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


class MappedObject(_Model):
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


class _Pdo(_Model):
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


class DriveProfileFile(_Model):
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


class ModbusProfileHeader(_Model):
    """Which Modbus device this is."""

    name: str
    kind: Literal["modbus"]


Address = Annotated[int, Field(ge=0, le=0xFFFF)]


class IdentityRegister(_Model):
    """Registers whose value proves that this is the device, and that a reply belongs to its request.

    `value` of a number, `text` of a text: ASCII, two characters a register, filled up with zeros.
    """

    table: Literal["input", "holding"]
    address: Address
    type: Literal["u16", "u32", "text"]
    value: int | None = Field(default=None, ge=0)
    text: str | None = Field(default=None, min_length=1, max_length=2 * IDENTITY_REGISTERS, pattern=r"^[ -~]*$")

    @model_validator(mode="after")
    def _value_of_the_type(self) -> Self:
        key, other = ("text", "value") if self.type == "text" else ("value", "text")
        if getattr(self, key) is None or getattr(self, other) is not None:
            raise ValueError(f"an identity of type {self.type} has the key {key}, and no {other}")
        if self.type != "text" and self.value is not None and self.value > RANGES[self.type][1]:
            raise ValueError(f"the identity {self.value} is beyond {self.type}: at most {RANGES[self.type][1]}")
        return self


class ReadField(_Model):
    """A value in the block that is read: register number × scale + zero, or one bit (0 = least significant).

    The scale is negative where the device counts the other way round.
    """

    name: str
    offset: int = Field(ge=0)
    type: RegisterType
    scale: float | None = Field(default=None, allow_inf_nan=False)
    bit: int | None = Field(default=None, ge=0, le=15)
    zero: float | None = Field(default=None, allow_inf_nan=False)

    @model_validator(mode="after")
    def _bit_of_a_register(self) -> Self:
        if self.bit is not None and (self.type != "u16" or self.scale is not None or self.zero is not None):
            raise ValueError(f"{self.name}: a bit is taken from a u16 without scale and zero")
        if self.scale == 0:
            raise ValueError(f"{self.name}: the scale is 0; allowed is any other number, negative to turn the sign")
        if self.name in COUNTED and (self.scale is not None or self.zero is not None):
            raise ValueError(f"{self.name}: a counter has neither scale nor zero")
        return self


class WriteField(_Model):
    """A value in the block that is written: register number = order / scale."""

    name: str
    offset: int = Field(ge=0)
    type: Literal["u16", "i16", "u32", "i32"]
    scale: float | None = Field(default=None, gt=0)


class ReadBlock(_Model):
    """The registers read at every poll, in one request."""

    table: Literal["input", "holding"]
    address: Address
    count: int = Field(ge=1, le=MODBUS_READ_REGISTERS)
    fields: tuple[ReadField, ...] = Field(min_length=1, strict=False)

    @model_validator(mode="after")
    def _fields_inside(self) -> Self:
        _check_names([field.name for field in self.fields])
        for field in self.fields:
            if field.offset + SIZES[field.type] // 2 > self.count:
                raise ValueError(f"{field.name} at offset {field.offset} lies outside the {self.count} registers read")
        return self


class WriteBlock(_Model):
    """The registers written, without gaps, in one request."""

    table: Literal["holding"]
    address: Address
    fields: tuple[WriteField, ...] = Field(min_length=1, strict=False)

    @model_validator(mode="after")
    def _fields_adjoin(self) -> Self:
        _check_names([field.name for field in self.fields])
        offset = 0
        for field in self.fields:
            if field.offset != offset:
                raise ValueError(f"{field.name} stands at offset {field.offset}; without gaps it is {offset}")
            offset += SIZES[field.type] // 2
        if offset > MODBUS_WRITE_REGISTERS:
            raise ValueError(f"{offset} registers written at once; Modbus allows {MODBUS_WRITE_REGISTERS}")
        return self


class ModbusProfileFile(_Model):
    """Profile of a Modbus device; `byte_order` inside a register, `word_order` of the registers of a 32-bit value.

    A device without an identity is taken for what the bench file says that it is.
    """

    profile: ModbusProfileHeader
    byte_order: Literal["big", "little"] = "big"
    word_order: Literal["big", "little"] = "big"
    identity: IdentityRegister | None = None
    read: ReadBlock
    write: WriteBlock | None = None


def _check_names(names: list[str]) -> None:
    if len(set(names)) != len(names):
        raise ValueError(f"a field name is used twice: {', '.join(names)}")
