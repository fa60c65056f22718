"""Files of CAN sensors: identifiers, lengths and fields of the frames that another node than the drive sends.

A sensor with a DBC file needs none: that file is its profile.
"""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from definitions.number_formats import SIZES, ByteType
from recipes.schema.profile_schema import ProfileSection

CAN_BYTES = 8
"""Longest classical frame."""


class CanProfileHeader(ProfileSection):
    """Which sensor this is."""

    name: str
    kind: Literal["can"]


class CanFieldFile(ProfileSection):
    """A value in a frame: number × scale + zero. offset: of its first byte."""

    name: str
    offset: int = Field(ge=0, lt=CAN_BYTES)
    type: ByteType
    scale: float = Field(default=1.0, allow_inf_nan=False)
    zero: float = Field(default=0.0, allow_inf_nan=False)

    @model_validator(mode="after")
    def _not_nothing(self) -> Self:
        if self.scale == 0:
            raise ValueError(f"{self.name}: the scale is 0; allowed is any other number, negative to turn the sign")
        return self


class CanFrameFile(ProfileSection):
    """A frame. add_node_id: the bench file's node id is added to the identifier, as to 0x180 of TPDO 1 (CiA 301)."""

    identifier: int = Field(ge=1, le=0x7FF)
    add_node_id: bool = False
    bytes: int = Field(ge=1, le=CAN_BYTES)
    byte_order: Literal["little", "big"] = "little"
    fields: tuple[CanFieldFile, ...] = Field(min_length=1, strict=False)

    @model_validator(mode="after")
    def _fields_inside(self) -> Self:
        for field in self.fields:
            if field.offset + SIZES[field.type] > self.bytes:
                where = f"the {self.bytes} bytes of the frame"
                raise ValueError(f"{field.name} at byte {field.offset} lies outside {where}")
        return self


class CanProfileFile(ProfileSection):
    """Profile of a sensor on CAN."""

    profile: CanProfileHeader
    frames: tuple[CanFrameFile, ...] = Field(min_length=1, strict=False)

    @model_validator(mode="after")
    def _names_once(self) -> Self:
        names = [field.name for frame in self.frames for field in frame.fields]
        if len(set(names)) != len(names):
            raise ValueError(f"a field name is used twice: {', '.join(names)}")
        return self
