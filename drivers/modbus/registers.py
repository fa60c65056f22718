"""Values in registers and coils: what a read block says, and what a write block must hold."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from operator import add, mul

from definitions.number_formats import BIT, LETTERS, SIZES
from definitions.profiles.modbus import COIL_TABLES, IdentityRegister, ModbusProfile
from drivers.servo_drive.data_types import picker, to_integer


class CoilReader:
    """Turns the bits of one read block into values, in the order of the profile's fields."""

    def __init__(self, profile: ModbusProfile) -> None:
        self.names = tuple(field.name for field in profile.read.fields)
        self._places = tuple(field.offset for field in profile.read.fields)

    def values(self, data: bytes) -> list[float] | None:
        """Values of the fields in a reply: the first coil is the lowest bit of the first byte (Modbus 1.1b3, 6.1)."""
        bits = int.from_bytes(data, "little")
        return [bits >> place & 1 for place in self._places]


class RegisterReader:
    """Turns the registers of one read block into values, in the order of the profile's fields."""

    def __init__(self, profile: ModbusProfile) -> None:
        self.names = tuple(field.name for field in profile.read.fields)
        slots = sorted({(field.offset, field.type) for field in profile.read.fields})
        order: list[int] = []
        for offset, type_name in slots:
            words = range(offset, offset + SIZES[type_name] // 2)
            for word in reversed(words) if profile.word_order == "little" else words:
                order += (2 * word + 1, 2 * word) if profile.byte_order == "little" else (2 * word, 2 * word + 1)
        self._order = None if order == list(range(2 * profile.read.count)) else tuple(order)
        self._slots = struct.Struct(">" + "".join(LETTERS[type_name] for _, type_name in slots))
        fields = profile.read.fields
        self._picked = picker([slots.index((field.offset, field.type)) for field in fields])
        self._scales = tuple(1 if field.scale is None or field.bit is not None else field.scale for field in fields)
        zeros = [field.zero or 0.0 for field in fields]
        self._zeros = tuple(zeros) if any(zeros) else None
        self._bits = tuple((place, field.bit) for place, field in enumerate(fields) if field.bit is not None)

    def values(self, registers: bytes) -> list[float] | None:
        """Values of the fields in the registers of the block, as they were sent; None when one is not a number."""
        order = self._order
        slots = self._slots.unpack(registers if order is None else bytes([registers[at] for at in order]))
        values = list(map(mul, self._picked(slots), self._scales))
        if self._zeros is not None:
            values = list(map(add, values, self._zeros))
        for place, bit in self._bits:
            values[place] = int(values[place]) >> bit & 1
        return values if all(map(math.isfinite, values)) else None


def identity_registers(identity: IdentityRegister, byte_order: str, word_order: str) -> bytes:
    """Return the registers of an identity as the device sends them."""
    if identity.type == "text":
        data = (identity.text or "").encode("ascii").ljust(2 * identity.count, b"\0")
        words = [data[at : at + 2] for at in range(0, len(data), 2)]
    else:
        data = (identity.value or 0).to_bytes(2 * identity.count, "big")
        words = [data[at : at + 2] for at in range(0, len(data), 2)]
        words = words[::-1] if word_order == "little" else words
    return b"".join(word[::-1] if byte_order == "little" else word for word in words)


class RegisterWriter:
    """Turns orders into the registers of the write block; counts orders that did not fit."""

    def __init__(self, profile: ModbusProfile) -> None:
        self.clamped = 0
        block = profile.write
        self._fields = block.fields if block else ()
        self._little_words = profile.word_order == "little"
        self._swap_bytes = profile.byte_order == "little" and block is not None and block.table not in COIL_TABLES

    def registers(self, orders: Mapping[str, float]) -> list[int]:
        """Encode these orders, all fields of the write block by name; a coil is 1 or 0."""
        words: list[int] = []
        for field in self._fields:
            if field.type == BIT:
                words.append(1 if orders[field.name] else 0)
                continue
            number, clamped = to_integer(orders[field.name] / (field.scale or 1.0), field.type)
            self.clamped += clamped
            data = number.to_bytes(SIZES[field.type], "big", signed=field.type.startswith("i"))
            parts = [int.from_bytes(data[at : at + 2], "big") for at in range(0, len(data), 2)]
            words += reversed(parts) if self._little_words else parts
        return [(word >> 8 | word << 8) & 0xFFFF for word in words] if self._swap_bytes else words


def reader_of(profile: ModbusProfile) -> RegisterReader | CoilReader:
    """Return what reads the block of a profile: registers, or coils and discrete inputs."""
    return CoilReader(profile) if profile.read.table in COIL_TABLES else RegisterReader(profile)
