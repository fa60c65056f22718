"""The register map of a Modbus device, as its profile says it: what is read, what it means, what is written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

from definitions.number_formats import BIT, RANGES, SIZES, FieldType, Limits

Table = Literal["input", "holding", "discrete", "coil"]
COIL_TABLES = frozenset({"discrete", "coil"})
"""Tables of single bits."""

Order = Literal["big", "little"]

MOST_READ: Mapping[str, int] = {"input": 125, "holding": 125, "discrete": 2000, "coil": 2000}
"""Registers or bits of one read request (Modbus application protocol 1.1b3)."""
MOST_WRITTEN: Mapping[str, int] = {"holding": 123, "coil": 1968}
"""Registers or bits of one write request, likewise."""
IDENTITY_REGISTERS = 32
"""Longest identity that is a text, in registers."""

COUNTED = frozenset({"sample_counter", "life_counter"})
"""Fields that are taken as they are counted."""

Address = Annotated[int, Limits(ge=0, le=0xFFFF)]
Offset = Annotated[int, Limits(ge=0)]
IdentityText = Annotated[str, Limits(min_length=1, max_length=2 * IDENTITY_REGISTERS, pattern=r"^[ -~]*$")]


@dataclass(frozen=True)
class ModbusProfileHeader:
    """Which Modbus device this is."""

    name: str
    kind: Literal["modbus"]


@dataclass(frozen=True)
class IdentityRegister:
    """Registers whose value proves that this is the device, and that a reply belongs to its request.

    `value` of a number, `text` of a text: ASCII, two characters a register, filled up with zeros.
    """

    table: Literal["input", "holding"]
    address: Address
    type: Literal["u16", "u32", "text"]
    value: Annotated[int, Limits(ge=0)] | None = None
    text: IdentityText | None = None

    def __post_init__(self) -> None:
        key, other = ("text", "value") if self.type == "text" else ("value", "text")
        if getattr(self, key) is None or getattr(self, other) is not None:
            raise ValueError(
                f"identity of type {self.type}: '{key}' is needed, and '{other}' is not allowed. Add or delete them"
            )
        if self.type != "text" and self.value is not None and self.value > RANGES[self.type][1]:
            raise ValueError(
                f"identity: found value {self.value}; allowed for type {self.type}: at most {RANGES[self.type][1]}"
            )

    @property
    def count(self) -> int:
        """How many registers the identity fills."""
        return (len(self.text or "") + 1) // 2 if self.type == "text" else SIZES[self.type] // 2

    @property
    def shown(self) -> str:
        """The identity as a person reads it."""
        return repr(self.text) if self.type == "text" else f"0x{self.value:0{4 * self.count}X}"


@dataclass(frozen=True)
class ReadField:
    """A value in the block that is read: register number × scale + zero, or one bit (0 = least significant).

    The scale is negative where the device counts the other way round. Of coils and discrete inputs the type is `bit`.
    """

    name: str
    offset: Offset
    type: FieldType
    scale: float | None = None
    bit: Annotated[int, Limits(ge=0, le=15)] | None = None
    zero: float | None = None

    def __post_init__(self) -> None:
        as_it_is = self.scale is None and self.zero is None
        if self.bit is not None and not (self.type == "u16" and as_it_is):
            raise ValueError(
                f"field {self.name}: found 'bit' with scale, zero or another type; allowed: 'bit' with type u16, "
                "without scale and zero"
            )
        if self.type == BIT and not as_it_is:
            raise ValueError(
                f"field {self.name}: a coil or discrete input has no scale and no zero. Delete 'scale' and 'zero'"
            )
        if self.scale == 0:
            raise ValueError(
                f"field {self.name}: found scale 0; allowed: any other number. A negative scale reverses the sign"
            )
        if self.name in COUNTED and not as_it_is:
            raise ValueError(f"field {self.name}: a counter has no scale and no zero. Delete 'scale' and 'zero'")


@dataclass(frozen=True)
class WriteField:
    """A value in the block that is written: register number = order / scale."""

    name: str
    offset: Offset
    type: Literal["u16", "i16", "u32", "i32", "bit"]
    scale: Annotated[float, Limits(gt=0)] | None = None


@dataclass(frozen=True)
class ReadBlock:
    """The registers or bits read at every poll, in one request."""

    table: Table
    address: Address
    count: Annotated[int, Limits(ge=1)]
    fields: Annotated[tuple[ReadField, ...], Limits(min_length=1)]

    def __post_init__(self) -> None:
        if self.count > MOST_READ[self.table]:
            raise ValueError(
                f"found count {self.count} for table {self.table}; one Modbus request reads at most "
                f"{MOST_READ[self.table]}. Lower the count"
            )
        for field in self.fields:
            _check_table(field.name, field.type, self.table)
            twin = next((one for one in self.fields if one is not field and _same_bit(one, field)), None)
            if twin is not None:
                raise ValueError(
                    f"fields {field.name} and {twin.name} read the same bit. Give each contact the bit of its own input"
                )
            if field.offset + _places(field.type) > self.count:
                what = "bits" if self.table in COIL_TABLES else "registers"
                raise ValueError(
                    f"field {field.name} at offset {field.offset} lies outside the {self.count} {what} that are read. "
                    "Correct offset or count"
                )


@dataclass(frozen=True)
class WriteBlock:
    """The registers or coils written, without gaps, in one request.

    single: written by the request for a single register or coil (function code 6 or 5); else by that for several (16
    or 15), which not every device knows.
    """

    table: Literal["holding", "coil"]
    address: Address
    fields: Annotated[tuple[WriteField, ...], Limits(min_length=1)]
    single: bool = False

    def __post_init__(self) -> None:
        _check_names([field.name for field in self.fields])
        offset = 0
        for field in self.fields:
            _check_table(field.name, field.type, self.table)
            if field.offset != offset:
                raise ValueError(
                    f"field {field.name}: found offset {field.offset}; expected {offset}: written fields have no gaps"
                )
            offset += _places(field.type)
        if offset > MOST_WRITTEN[self.table]:
            raise ValueError(
                f"found {offset} registers or coils to write; one Modbus request writes at most "
                f"{MOST_WRITTEN[self.table]}. Delete fields"
            )
        if self.single and offset > 1:
            raise ValueError(
                f"found 'single: true' with {offset} registers or coils; 'single' writes exactly one. Delete 'single'"
            )


@dataclass(frozen=True)
class ModbusProfile:
    """Profile of a Modbus device; `byte_order` inside a register, `word_order` of the registers of a 32-bit value.

    A device without an identity is taken for what the bench file says that it is. read_also: further blocks, each read
    by a request of its own; their fields have names of their own.
    """

    profile: ModbusProfileHeader
    read: ReadBlock
    byte_order: Order = "big"
    word_order: Order = "big"
    identity: IdentityRegister | None = None
    write: WriteBlock | None = None
    read_also: tuple[ReadBlock, ...] = ()

    def __post_init__(self) -> None:
        _check_names([field.name for block in (self.read, *self.read_also) for field in block.fields])


def _same_bit(one: ReadField, other: ReadField) -> bool:
    """Tell whether two fields are one and the same bit of a register, or the same coil or discrete input."""
    is_bit = one.bit is not None or one.type == BIT
    return is_bit and (one.offset, one.bit, one.type) == (other.offset, other.bit, other.type)


def _check_names(names: list[str]) -> None:
    if len(set(names)) != len(names):
        raise ValueError(f"a field name is used twice in the profile: {', '.join(names)}. Give each field its own name")


def _check_table(name: str, type_name: FieldType, table: str) -> None:
    if (type_name == BIT) != (table in COIL_TABLES):
        allowed = "type bit" if table in COIL_TABLES else "a type of registers, such as u16"
        raise ValueError(f"field {name}: found type {type_name} in table {table}; allowed: {allowed}")


def _places(type_name: FieldType) -> int:
    """Registers, or bits, that a value of this type takes."""
    return 1 if type_name == BIT else SIZES[type_name] // 2
