"""What may become of a Modbus reply on its way: a table of ways to bend it, and who applies them."""

from __future__ import annotations

import random
import struct
from collections import Counter
from collections.abc import Callable

from device_end import DeviceEnd

INTERESTING_WORDS = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0x7FC0, 0x7F80, 0xFF80, 0xFFFF)

Reply = Callable[[random.Random, bytes, DeviceEnd], list[bytes]]


def _head(end: DeviceEnd) -> int:
    return 0 if end.rtu else 6


def _sealed(reply: bytes, pdu: bytes, end: DeviceEnd) -> bytes:
    """A PDU in the frame of a reply, with the length or the check sum that fits."""
    return end.frame(reply[:2], reply[_head(end)], pdu)


def _pdu(reply: bytes, end: DeviceEnd) -> bytes:
    return reply[1:-2] if end.rtu else reply[7:]


def _register_bits(chance: random.Random, reply: bytes, end: DeviceEnd) -> list[bytes]:
    pdu = bytearray(_pdu(reply, end))
    for _ in range(chance.randint(1, 3)):
        pdu[chance.randrange(min(2, len(pdu) - 1), len(pdu))] ^= 1 << chance.randrange(8)
    return [_sealed(reply, bytes(pdu), end)]


def _registers(chance: random.Random, reply: bytes, end: DeviceEnd) -> list[bytes]:
    pdu = _pdu(reply, end)
    return [_sealed(reply, pdu[:2] + chance.randbytes(len(pdu) - 2), end)]


def _one_register(chance: random.Random, reply: bytes, end: DeviceEnd) -> list[bytes]:
    pdu = bytearray(_pdu(reply, end))
    at = 2 + 2 * chance.randrange(max((len(pdu) - 2) // 2, 1))
    pdu[at : at + 2] = struct.pack(">H", chance.choice(INTERESTING_WORDS))
    return [_sealed(reply, bytes(pdu), end)]


def _low_bits(chance: random.Random, reply: bytes, end: DeviceEnd) -> list[bytes]:
    """Change values by little: low bits of registers behind identity, status, counter and time."""
    pdu = bytearray(_pdu(reply, end))
    for at in range(17, len(pdu), 4):
        pdu[at] ^= chance.randrange(8)
    return [_sealed(reply, bytes(pdu), end)]


def _exception(chance: random.Random, reply: bytes, end: DeviceEnd) -> list[bytes]:
    code = chance.choice((1, 2, 3, 4, 5, 6, 8, 10, 11, 0, 255))
    return [_sealed(reply, bytes((_pdu(reply, end)[0] | 0x80, code)), end)]


def _function(chance: random.Random, reply: bytes, end: DeviceEnd) -> list[bytes]:
    return [_sealed(reply, bytes((chance.randrange(256),)) + _pdu(reply, end)[1:], end)]


def _count(chance: random.Random, reply: bytes, end: DeviceEnd) -> list[bytes]:
    words = chance.randrange(0, 126)
    pdu = bytes((_pdu(reply, end)[0], chance.choice((2 * words & 0xFF, chance.randrange(256))))) + bytes(2 * words)
    return [_sealed(reply, pdu, end)]


def _unit(chance: random.Random, reply: bytes, end: DeviceEnd) -> list[bytes]:
    return [end.frame(reply[:2], chance.randrange(256), _pdu(reply, end))]


def _header(chance: random.Random, reply: bytes, end: DeviceEnd) -> list[bytes]:
    data = bytearray(reply)
    data[chance.randrange(len(data) if end.rtu else 7)] = chance.randrange(256)
    return [bytes(data)]


def _cut(chance: random.Random, reply: bytes, _end: DeviceEnd) -> list[bytes]:
    return [reply[: chance.randrange(1, len(reply))]]


def _longer(chance: random.Random, reply: bytes, _end: DeviceEnd) -> list[bytes]:
    return [reply, chance.randbytes(chance.randint(1, 300))]


def _noise(chance: random.Random, _reply: bytes, _end: DeviceEnd) -> list[bytes]:
    return [chance.randbytes(chance.randint(1, 300))]


def _again(_chance: random.Random, reply: bytes, _end: DeviceEnd) -> list[bytes]:
    return [reply, reply]


def _silence(_chance: random.Random, _reply: bytes, _end: DeviceEnd) -> list[bytes]:
    return []


def _in_pieces(_chance: random.Random, reply: bytes, _end: DeviceEnd) -> list[bytes]:
    return [reply[at : at + 1] for at in range(len(reply))]


def _hang_up(_chance: random.Random, reply: bytes, end: DeviceEnd) -> list[bytes]:
    end.theirs.send(reply[:4])
    end.close()
    return []


MODBUS_WAYS: dict[str, Reply] = {
    "register bits": _register_bits, "registers": _registers, "one register": _one_register,
    "low bits": _low_bits, "exception": _exception,
    "function": _function, "count": _count, "unit": _unit, "header": _header, "cut": _cut, "longer": _longer,
    "noise": _noise, "again": _again, "silence": _silence, "in pieces": _in_pieces, "hang up": _hang_up,
}  # fmt: skip
MODBUS_HARMLESS = ("in pieces", "again", "low bits")


class ReplyBender:
    """Bends Modbus replies with a chance of `share` each; a late one comes with the next reply of its device."""

    def __init__(self, chance: random.Random, ways: tuple[str, ...], share: float) -> None:
        self._chance, self._ways, self._share = chance, ways, share
        self._late: dict[int, bytes] = {}
        self.bent: Counter[str] = Counter()
        self.on = True

    def __call__(self, reply: bytes, end: DeviceEnd) -> list[bytes]:
        """Return the pieces that are sent for a reply."""
        chance = self._chance
        late = self._late.pop(id(end), None)
        if not self.on or chance.random() >= self._share:
            return [reply] if late is None else [late, reply]
        if "silence" in self._ways and chance.random() < 0.1:
            self._late[id(end)] = reply
            self.bent["late"] += 1
            return []
        way = chance.choice(self._ways)
        self.bent[way] += 1
        pieces = MODBUS_WAYS[way](chance, reply, end)
        return pieces if late is None else [late, *pieces]
