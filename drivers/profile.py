"""Device profiles: the object mapping of a CiA 402 drive, the register map of a Modbus device, frames of CAN sensors.

Plain data, with the names that profile files use: those files are checked where they are read
(`recipes.schema.profile_schema`, `modbus_profile_schema`), and what they may hold is said there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from definitions.number_formats import SIZES, FieldType, IntegerType

Table = Literal["input", "holding", "discrete", "coil"]
RegisterTable = Literal["input", "holding"]
COIL_TABLES = frozenset({"discrete", "coil"})
"""Tables of single bits."""

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
    """The vendor's units. By CiA 402 torque counts 0.1 % of the rated torque, and 0x6076 counts mN·m."""

    position_counts_per_motor_rev: float
    velocity_counts_per_rad_s: float
    torque_counts_per_rated: float = 1000.0
    rated_torque_counts_per_nm: float = 1000.0


@dataclass(frozen=True)
class DriveProtections:
    """In which way the drive has each protection of `definitions.protections`, or none.

    The time-out of set-points is that of the receive PDO that carries the torque.
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
    """An object that this drive needs written before it is used, and what it means."""

    index: int
    subindex: int
    type: IntegerType
    value: int
    meaning: str


@dataclass(frozen=True)
class MappedObject:
    """One object in a PDO; one called `IGNORED` is there, and nobody looks at it. `value` is sent in it."""

    index: int
    subindex: int
    type: IntegerType
    name: str
    value: int = 0

    @property
    def mapping(self) -> int:
        """Value of the mapping entry: index, subindex and length in bits (CiA 301, 0x1600 and 0x1A00)."""
        return self.index << 16 | self.subindex << 8 | SIZES[self.type] * 8


@dataclass(frozen=True)
class ReceivePdo:
    """A PDO from the controller; `timeout`: the drive supervises its arrival (0x1400:5).

    `fixed_mapping`: the mapping is checked, and never written. `cob_id`: None for that of the predefined connection
    set, which PDOs 1 to 4 have.
    """

    number: int
    transmission_type: int
    objects: tuple[MappedObject, ...]
    timeout: bool
    fixed_mapping: bool = False
    cob_id: int | None = None


@dataclass(frozen=True)
class TransmitPdo:
    """A PDO from the drive; `fixed_mapping` and `cob_id` as of a `ReceivePdo`."""

    number: int
    transmission_type: int
    objects: tuple[MappedObject, ...]
    fixed_mapping: bool = False
    cob_id: int | None = None


@dataclass(frozen=True)
class DriveProfile:
    """Profile of a CiA 402 drive.

    `homing_method`: 37 or 35, by which the drive takes the position where it stands as its reference; 0 for a drive
    that does not home, whose position is then counted from where it stands. `write_sync_period`: the drive needs the
    period of SYNC in 0x1006. `tried_on_hardware`: a drive of this kind has run by this profile.
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

    @property
    def torque_pdo(self) -> ReceivePdo:
        """The receive PDO that carries the torque; its absence is what the drive's time-out is about."""
        return next(pdo for pdo in self.receive_pdos if any(item.name == "target_torque" for item in pdo.objects))


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

    table: RegisterTable
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

    The scale is negative where the device counts the other way round. Of coils and discrete inputs the type is `bit`.
    """

    name: str
    offset: int
    type: FieldType
    scale: float | None
    bit: int | None
    zero: float | None = None


@dataclass(frozen=True)
class WriteField:
    """A value in the block that is written: register number = order / scale."""

    name: str
    offset: int
    type: Literal["u16", "i16", "u32", "i32", "bit"]
    scale: float | None


@dataclass(frozen=True)
class ReadBlock:
    """The registers or coils read at every poll, in one request."""

    table: Table
    address: int
    count: int
    fields: tuple[ReadField, ...]


@dataclass(frozen=True)
class WriteBlock:
    """The registers or coils written, without gaps, in one request.

    `single`: by the request for a single one (function code 5 or 6) instead of that for several (15 or 16).
    """

    table: Literal["holding", "coil"]
    address: int
    fields: tuple[WriteField, ...]
    single: bool = False


@dataclass(frozen=True)
class ModbusProfile:
    """Profile of a Modbus device; `byte_order` inside a register, `word_order` of the registers of a 32-bit value.

    A device without an identity is taken for what the bench file says that it is. `read_also`: further blocks, each
    read by a request of its own.
    """

    profile: ModbusProfileHeader
    byte_order: Order
    word_order: Order
    identity: IdentityRegister | None
    read: ReadBlock
    write: WriteBlock | None
    read_also: tuple[ReadBlock, ...] = ()


@dataclass(frozen=True)
class CanField:
    """A value in a frame: `bits` bits, `shift` of them above the lowest; number × scale + zero.

    `order`: little counts from the lowest bit of the first byte on, big from the lowest of the last one.
    """

    name: str
    shift: int
    bits: int
    kind: Literal["unsigned", "signed", "float"]
    order: Order
    scale: float = 1.0
    zero: float = 0.0


@dataclass(frozen=True)
class CanFrame:
    """A frame of a sensor: its identifier of 11 bits, its length in bytes, and what is in it."""

    identifier: int
    size: int
    fields: tuple[CanField, ...]
