"""Files of Modbus profiles: the registers and coils of a device, what they mean and what is written.

A profile is the data that makes another amplifier, brake or I/O work without other code. The models are strict, as
those of drives; what they accept reaches the drivers as the dataclasses of `drivers.profile`.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from definitions.number_formats import BIT, RANGES, SIZES, FieldType
from recipes.schema.profile_schema import ProfileSection

MOST_READ = {"input": 125, "holding": 125, "discrete": 2000, "coil": 2000}
"""Registers or bits of one read request (Modbus application protocol 1.1b3)."""
MOST_WRITTEN = {"holding": 123, "coil": 1968}
"""Registers or bits of one write request, likewise."""
BIT_TABLES = frozenset({"discrete", "coil"})
IDENTITY_REGISTERS = 32
"""Longest identity that is a text, in registers."""

COUNTED = frozenset({"sample_counter", "life_counter"})
"""Fields that are taken as they are counted."""


class ModbusProfileHeader(ProfileSection):
    """Which Modbus device this is."""

    name: str
    kind: Literal["modbus"]


Address = Annotated[int, Field(ge=0, le=0xFFFF)]


class IdentityRegister(ProfileSection):
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


class ReadField(ProfileSection):
    """A value in the block that is read: register number × scale + zero, or one bit (0 = least significant).

    The scale is negative where the device counts the other way round. Of coils and discrete inputs the type is `bit`.
    """

    name: str
    offset: int = Field(ge=0)
    type: FieldType
    scale: float | None = Field(default=None, allow_inf_nan=False)
    bit: int | None = Field(default=None, ge=0, le=15)
    zero: float | None = Field(default=None, allow_inf_nan=False)

    @model_validator(mode="after")
    def _bit_of_a_register(self) -> Self:
        if self.bit is not None and (self.type != "u16" or self.scale is not None or self.zero is not None):
            raise ValueError(f"{self.name}: a bit is taken from a u16 without scale and zero")
        if self.type == BIT and (self.scale is not None or self.zero is not None):
            raise ValueError(f"{self.name}: a coil or discrete input has neither scale nor zero")
        if self.scale == 0:
            raise ValueError(f"{self.name}: the scale is 0; allowed is any other number, negative to turn the sign")
        if self.name in COUNTED and (self.scale is not None or self.zero is not None):
            raise ValueError(f"{self.name}: a counter has neither scale nor zero")
        return self


class WriteField(ProfileSection):
    """A value in the block that is written: register number = order / scale."""

    name: str
    offset: int = Field(ge=0)
    type: Literal["u16", "i16", "u32", "i32", "bit"]
    scale: float | None = Field(default=None, gt=0)


class ReadBlock(ProfileSection):
    """The registers or bits read at every poll, in one request."""

    table: Literal["input", "holding", "discrete", "coil"]
    address: Address
    count: int = Field(ge=1)
    fields: tuple[ReadField, ...] = Field(min_length=1, strict=False)

    @model_validator(mode="after")
    def _fields_inside(self) -> Self:
        if self.count > MOST_READ[self.table]:
            raise ValueError(f"{self.count} read from table {self.table}; one request reads {MOST_READ[self.table]}")
        for field in self.fields:
            _check_table(field.name, field.type, self.table)
            if field.offset + _places(field.type) > self.count:
                what = "bits" if self.table in BIT_TABLES else "registers"
                raise ValueError(f"{field.name} at offset {field.offset} lies outside the {self.count} {what} read")
        return self


class WriteBlock(ProfileSection):
    """The registers or coils written, without gaps, in one request.

    single: written by the request for a single register or coil (function code 6 or 5); else by that for several (16
    or 15), which not every device knows.
    """

    table: Literal["holding", "coil"]
    address: Address
    fields: tuple[WriteField, ...] = Field(min_length=1, strict=False)
    single: bool = False

    @model_validator(mode="after")
    def _fields_adjoin(self) -> Self:
        _check_names([field.name for field in self.fields])
        offset = 0
        for field in self.fields:
            _check_table(field.name, field.type, self.table)
            if field.offset != offset:
                raise ValueError(f"{field.name} stands at offset {field.offset}; without gaps it is {offset}")
            offset += _places(field.type)
        if offset > MOST_WRITTEN[self.table]:
            raise ValueError(f"{offset} written at once; Modbus allows {MOST_WRITTEN[self.table]}")
        if self.single and offset > 1:
            raise ValueError(f"single: true, though {offset} registers or coils are written; only one can be")
        return self


class ModbusProfileFile(ProfileSection):
    """Profile of a Modbus device; `byte_order` inside a register, `word_order` of the registers of a 32-bit value.

    A device without an identity is taken for what the bench file says that it is. read_also: further blocks, each read
    by a request of its own; their fields have names of their own.
    """

    profile: ModbusProfileHeader
    byte_order: Literal["big", "little"] = "big"
    word_order: Literal["big", "little"] = "big"
    identity: IdentityRegister | None = None
    read: ReadBlock
    write: WriteBlock | None = None
    read_also: tuple[ReadBlock, ...] = Field(default=(), strict=False)

    @model_validator(mode="after")
    def _names_once(self) -> Self:
        _check_names([field.name for block in (self.read, *self.read_also) for field in block.fields])
        return self


def _check_names(names: list[str]) -> None:
    if len(set(names)) != len(names):
        raise ValueError(f"a field name is used twice: {', '.join(names)}")


def _check_table(name: str, type_name: FieldType, table: str) -> None:
    if (type_name == BIT) != (table in BIT_TABLES):
        allowed = "bit" if table in BIT_TABLES else "a register's"
        raise ValueError(f"{name}: found type {type_name} in table {table}; allowed is {allowed}")


def _places(type_name: FieldType) -> int:
    """Registers, or bits, that a value of this type takes."""
    return 1 if type_name == BIT else SIZES[type_name] // 2
