"""Device profiles: the object mapping of a CiA 402 drive, the register map of a Modbus device.

Plain data, with the names that profile files use: those files are checked where they are read
(`recipes.schema.profile_schema`), and what they may hold is said there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from definitions.number_formats import SIZES, IntegerType, RegisterType

Table = Literal["input", "holding"]
Order = Literal["big", "little"]
IdentityType = Literal["u16", "u32", "text"]


@dataclass(frozen=True)
class DriveProfileHeader:
    """Which drive this is: its name and its identity object 0x1018."""

    name: str
    kind: Literal["cia402-drive"]
    vendor_id: int
    product_code: int


@dataclass(frozen=True)
class DriveScaling:
    """The vendor's units of position and velocity; torque is 0.1 % of rated torque by CiA 402."""

    position_counts_per_motor_rev: float
    velocity_counts_per_rad_s: float


@dataclass(frozen=True)
class MappedObject:
    """One object in a PDO."""

    index: int
    subindex: int
    type: IntegerType
    name: str

    @property
    def mapping(self) -> int:
        """Value of the mapping entry: index, subindex and length in bits (CiA 301, 0x1600 and 0x1A00)."""
        return self.index << 16 | self.subindex << 8 | SIZES[self.type] * 8


@dataclass(frozen=True)
class ReceivePdo:
    """A PDO from the controller; `timeout`: the drive supervises its arrival (0x1400:5)."""

    number: int
    transmission_type: int
    objects: tuple[MappedObject, ...]
    timeout: bool


@dataclass(frozen=True)
class TransmitPdo:
    """A PDO from the drive."""

    number: int
    transmission_type: int
    objects: tuple[MappedObject, ...]


@dataclass(frozen=True)
class DriveProfile:
    """Profile of a CiA 402 drive; write_sync_period: it needs the period of SYNC in 0x1006."""

    profile: DriveProfileHeader
    scaling: DriveScaling
    receive_pdos: tuple[ReceivePdo, ...]
    transmit_pdos: tuple[TransmitPdo, ...]
    write_sync_period: bool = False


@dataclass(frozen=True)
class ModbusProfileHeader:
    """Which Modbus device this is."""

    name: str
    kind: Literal["modbus"]


@dataclass(frozen=True)
class IdentityRegister:
    """Registers whose value proves that this is the device, and that a reply belongs to its request.

    `value` of a number, `text` of a text: two characters a register, filled up with zeros.
    """

    table: Table
    address: int
    type: IdentityType
    value: int | None = None
    text: str | None = None

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

    The scale is negative where the device counts the other way round.
    """

    name: str
    offset: int
    type: RegisterType
    scale: float | None
    bit: int | None
    zero: float | None = None


@dataclass(frozen=True)
class WriteField:
    """A value in the block that is written: register number = order / scale."""

    name: str
    offset: int
    type: Literal["u16", "i16", "u32", "i32"]
    scale: float | None


@dataclass(frozen=True)
class ReadBlock:
    """The registers read at every poll, in one request."""

    table: Table
    address: int
    count: int
    fields: tuple[ReadField, ...]


@dataclass(frozen=True)
class WriteBlock:
    """The registers written, without gaps, in one request."""

    table: Literal["holding"]
    address: int
    fields: tuple[WriteField, ...]


@dataclass(frozen=True)
class ModbusProfile:
    """Profile of a Modbus device; `byte_order` inside a register, `word_order` of the registers of a 32-bit value.

    A device without an identity is taken for what the bench file says that it is.
    """

    profile: ModbusProfileHeader
    byte_order: Order
    word_order: Order
    identity: IdentityRegister | None
    read: ReadBlock
    write: WriteBlock | None
