"""What a sensor on CAN sends: the frames of a profile file, and the same with their places in bits, as both ends want.

A sensor with a DBC file needs no profile file: of that the second form is made.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from definitions.number_formats import SIZES, ByteType, Limits
from definitions.profiles.drive import U32, StartupObject
from definitions.profiles.modbus import Order

CAN_BYTES = 8
"""Longest classical frame."""

LAST_IDENTIFIER = 0x7FF
"""Largest identifier of 11 bits."""


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


@dataclass(frozen=True)
class CanProfileHeader:
    """Which sensor this is."""

    name: str
    kind: Literal["can"]


@dataclass(frozen=True)
class CanFieldFile:
    """A value in a frame: number × scale + zero. offset: of its first byte."""

    name: str
    offset: Annotated[int, Limits(ge=0, lt=CAN_BYTES)]
    type: ByteType
    scale: float = 1.0
    zero: float = 0.0

    def __post_init__(self) -> None:
        if self.scale == 0:
            raise ValueError(
                f"field {self.name}: found scale 0; allowed: any other number. A negative scale reverses the sign"
            )


@dataclass(frozen=True)
class CanFrameFile:
    """A frame. add_node_id: the bench file's node id is added to the identifier, as to 0x180 of TPDO 1 (CiA 301)."""

    identifier: Annotated[int, Limits(ge=1, le=LAST_IDENTIFIER)]
    bytes: Annotated[int, Limits(ge=1, le=CAN_BYTES)]
    fields: Annotated[tuple[CanFieldFile, ...], Limits(min_length=1)]
    add_node_id: bool = False
    byte_order: Order = "little"

    def __post_init__(self) -> None:
        for field in self.fields:
            if field.offset + SIZES[field.type] > self.bytes:
                where = f"the {self.bytes} bytes of the frame"
                raise ValueError(
                    f"field {field.name} at byte {field.offset} is outside {where}. Correct offset, type or bytes"
                )


@dataclass(frozen=True)
class CanIdentity:
    """Identity object 0x1018 of a CANopen node."""

    vendor_id: U32
    product_code: U32


@dataclass(frozen=True)
class CanProfile:
    """Profile of a sensor on CAN.

    Of a CANopen node: identity, which is compared, and objects that it needs written before it is started. A node
    without an identity is taken for what the bench file says that it is.
    """

    profile: CanProfileHeader
    frames: Annotated[tuple[CanFrameFile, ...], Limits(min_length=1)]
    identity: CanIdentity | None = None
    startup: tuple[StartupObject, ...] = ()

    def __post_init__(self) -> None:
        names = [field.name for frame in self.frames for field in frame.fields]
        if len(set(names)) != len(names):
            raise ValueError(
                f"a field name is used twice in the profile: {', '.join(names)}. Give each field its own name"
            )
