"""The device's end of a Modbus line: real bytes through a socket pair, made from the values of a bench."""

from __future__ import annotations

import socket
import struct
from collections.abc import Callable

from definitions.number_formats import LETTERS, SIZES
from definitions.profiles.modbus import ModbusProfile
from drivers.config import ModbusConfig
from drivers.servo_drive.data_types import to_integer

BendReply = Callable[[bytes, "DeviceEnd"], list[bytes]]
"""What becomes of a reply on its way: the pieces that are sent for it."""


def crc16(data: bytes) -> bytes:
    """Check sum of Modbus RTU, low byte first."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0xA001 if crc & 1 else crc >> 1
    return crc.to_bytes(2, "little")


def registers_of(profile: ModbusProfile, values: dict[str, float]) -> list[int]:
    """Registers of the read block that say these values; fields that are missing are 0."""
    words = [0] * profile.read.count
    identity = profile.identity
    if identity is not None and identity.value is not None and identity.table == profile.read.table:
        inside = identity.address - profile.read.address
        if 0 <= inside < profile.read.count:
            words[inside] = identity.value
    for field in profile.read.fields:
        value = values.get(field.name)
        if value is None:
            continue
        if field.bit is not None:
            words[field.offset] |= int(value) << field.bit
            continue
        number = to_integer(value / (field.scale or 1.0), field.type)[0]
        data = struct.pack(">" + LETTERS[field.type], number)
        words[field.offset : field.offset + SIZES[field.type] // 2] = struct.unpack(f">{len(data) // 2}H", data)
    return words


class DeviceEnd:
    """The device's end of a Modbus line: answers requests from the values that the bench has at that moment."""

    def __init__(self, config: ModbusConfig, bend: BendReply) -> None:
        self.config, self.bend = config, bend
        self.rtu = config.transport == "rtu"
        self.ours, self.theirs = socket.socketpair()
        self.ours.setblocking(False)  # noqa: FBT003 - the name is the standard library's
        self.theirs.setblocking(False)  # noqa: FBT003
        self.written: dict[str, float] = {}
        self.requests = 0
        self.closed = False

    def serve(self, values: dict[str, float]) -> None:
        """Answer what has arrived."""
        if self.closed:
            return
        try:
            request = self.theirs.recv(4096)
        except BlockingIOError:
            return
        except OSError:
            self.close()
            return
        if not request:
            return
        self.requests += 1
        reply = self._answer(request, {**values, "life_counter": self.requests & 0xFFFF})
        try:
            for chunk in self.bend(reply, self):
                self.theirs.send(chunk)
        except OSError:
            self.close()

    def close(self) -> None:
        """Cut the line."""
        self.closed = True
        self.theirs.close()

    def _answer(self, request: bytes, values: dict[str, float]) -> bytes:
        profile = self.config.profile
        unit, function = (request[0], request[1]) if self.rtu else (request[6], request[7])
        body = request[2:] if self.rtu else request[8:]
        address, count = struct.unpack(">HH", body[:4])
        if function == 16:
            self._take(body[5:])
            pdu = bytes((function,)) + body[:4]
        else:
            identity = profile.identity
            if identity is not None and identity.value is not None and (address, count) == (identity.address, 1):
                words = [identity.value]
            else:
                words = registers_of(profile, values)
            pdu = bytes((function, 2 * len(words))) + struct.pack(f">{len(words)}H", *words)
        return self.frame(request[:2], unit, pdu)

    def frame(self, transaction: bytes, unit: int, pdu: bytes) -> bytes:
        """A PDU as it goes over this line."""
        if self.rtu:
            return bytes((unit,)) + pdu + crc16(bytes((unit,)) + pdu)
        return transaction + b"\0\0" + (len(pdu) + 1).to_bytes(2, "big") + bytes((unit,)) + pdu

    def _take(self, data: bytes) -> None:
        at = 0
        for field in self.config.profile.write.fields if self.config.profile.write else ():
            size = SIZES[field.type]
            number = int.from_bytes(data[at : at + size], "big", signed=field.type.startswith("i"))
            self.written[field.name] = number * (field.scale or 1.0)
            at += size
