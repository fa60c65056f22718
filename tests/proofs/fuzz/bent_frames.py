"""What may become of a CAN frame on its way: a table of ways to bend it, and who applies them."""

from __future__ import annotations

import random
import struct
from collections import Counter, deque
from collections.abc import Callable

import can
from wire_rig import Frame

STATUS_WORDS = (0x0000, 0x0040, 0x0021, 0x0023, 0x0027, 0x0007, 0x000F, 0x0008, 0x1637, 0x0E37, 0x3637, 0xFFFF)
EMCY_CODES = (0x0000, 0x2310, 0x8130, 0x8250, 0x8611, 0x1000, 0xFF01, 0xFFFF)
OLD_FRAMES = 64


class Bent:
    """What a way of bending gets: chance, the frame it starts from, older frames, and the drive's node."""

    def __init__(self, chance: random.Random, node: int) -> None:
        self.chance, self.node = chance, node
        self.old: deque[Frame] = deque(maxlen=OLD_FRAMES)


def _frame(cob_id: int, data: bytes, **flags: bool) -> Frame:
    return can.Message(arbitration_id=cob_id, data=data, **({"is_extended_id": False} | flags))


def _bits(bent: Bent, frame: Frame) -> list[Frame]:
    data = bytearray(frame.data)
    for _ in range(bent.chance.randint(1, 3) if data else 0):
        data[bent.chance.randrange(len(data))] ^= 1 << bent.chance.randrange(8)
    return [_frame(frame.arbitration_id, bytes(data))]


def _payload(bent: Bent, frame: Frame) -> list[Frame]:
    return [_frame(frame.arbitration_id, bent.chance.randbytes(len(frame.data)))]


def _length(bent: Bent, frame: Frame) -> list[Frame]:
    sizes = [size for size in range(9) if size != len(frame.data)]
    return [frame, _frame(frame.arbitration_id, bent.chance.randbytes(bent.chance.choice(sizes)))]


def _status(bent: Bent, frame: Frame) -> list[Frame]:
    word = struct.pack("<H", bent.chance.choice(STATUS_WORDS))
    return [_frame(0x180 + bent.node, word + bytes(frame.data[2:6]).ljust(4, b"\0"))]


def _emergency(bent: Bent, frame: Frame) -> list[Frame]:
    code = bent.chance.choice(EMCY_CODES)
    return [frame, _frame(0x080 + bent.node, struct.pack("<HB", code, bent.chance.randrange(256)) + bytes(5))]


def _heartbeat(bent: Bent, frame: Frame) -> list[Frame]:
    return [frame, _frame(0x700 + bent.node, bytes((bent.chance.choice((0, 4, 5, 127, 133, 255)),)))]


def _commands(node: int) -> tuple[int, ...]:
    """Identifiers of what only the controller may send: NMT, SYNC, its heartbeat, set-points and SDO of the drive."""
    return (0x000, 0x080, 0x77E, 0x200 + node, 0x300 + node, 0x600 + node)


def _foreign(bent: Bent, frame: Frame) -> list[Frame]:
    chance = bent.chance
    others = [_frame(chance.randrange(0x800), chance.randbytes(chance.randrange(9))) for _ in range(3)]
    own = {*(base + bent.node for base in (0x080, 0x180, 0x280, 0x700)), *_commands(bent.node)}
    return [frame, *(other for other in others if other.arbitration_id not in own)]


def _services(bent: Bent, frame: Frame) -> list[Frame]:
    """Services of other nodes: process data, parameters, time."""
    chance = bent.chance
    cob_id = chance.choice((0x100, 0x200, 0x300, 0x580, 0x600)) + chance.randrange(128)
    return [frame] if cob_id in _commands(bent.node) else [frame, _frame(cob_id, chance.randbytes(8))]


def _controller(bent: Bent, frame: Frame) -> list[Frame]:
    """Another controller's frame, now and then."""
    if bent.chance.random() < 0.9:
        return [frame]
    return [frame, _frame(bent.chance.choice(_commands(bent.node)), bent.chance.randbytes(5))]


def _extended(bent: Bent, frame: Frame) -> list[Frame]:
    high = bent.chance.randrange(1 << 18) << 11
    return [frame, _frame(high | frame.arbitration_id, bent.chance.randbytes(8), is_extended_id=True)]


def _remote(_bent: Bent, frame: Frame) -> list[Frame]:
    return [frame, can.Message(arbitration_id=frame.arbitration_id, is_extended_id=False, is_remote_frame=True, dlc=8)]


def _error(bent: Bent, frame: Frame) -> list[Frame]:
    return [
        _frame(bent.chance.randrange(1 << 29), bent.chance.randbytes(8), is_extended_id=True, is_error_frame=True),
        frame,
    ]


def _drop(*_: object) -> list[Frame]:
    return []


def _twice(bent: Bent, frame: Frame) -> list[Frame]:
    return [frame] * bent.chance.randint(2, 6)


def _stale(bent: Bent, frame: Frame) -> list[Frame]:
    return [bent.chance.choice(bent.old)] if bent.old else [frame]


def _babble(bent: Bent, frame: Frame) -> list[Frame]:
    if bent.chance.random() < 0.9:
        return [frame]
    return [frame, *(_frame(0x500 + bent.chance.randrange(128), bent.chance.randbytes(8)) for _ in range(100))]


def _nudge(bent: Bent, frame: Frame) -> list[Frame]:
    """Change a value by little: the lowest bits of one byte, but not of the status word and the mode."""
    data = bytearray(frame.data)
    places = range(3, len(data)) if frame.arbitration_id == 0x180 + bent.node else range(len(data))
    if places:
        data[bent.chance.choice(places)] ^= bent.chance.randrange(4)
    return [_frame(frame.arbitration_id, bytes(data))]


CAN_WAYS: dict[str, Callable[[Bent, Frame], list[Frame]]] = {
    "bits": _bits, "payload": _payload, "length": _length, "status": _status, "emergency": _emergency,
    "heartbeat": _heartbeat, "foreign": _foreign, "services": _services, "extended": _extended, "remote": _remote,
    "error": _error, "drop": _drop, "twice": _twice, "stale": _stale, "babble": _babble, "nudge": _nudge,
    "controller": _controller,
}  # fmt: skip
CAN_HARMLESS = ("length", "foreign", "services", "extended", "remote", "error", "twice")
"""Ways that a run goes on under: what others have to do with each other on a bus must not stop a test."""


class FrameBender:
    """Bends the frames of a scan; `bent` counts the frames that an honest drive would not have sent so."""

    def __init__(self, chance: random.Random, node: int, ways: tuple[str, ...], per_scan: float) -> None:
        self._bent, self._ways, self._per_scan = Bent(chance, node), ways, per_scan
        self.bent: Counter[str] = Counter()
        self.on = True

    def __call__(self, frames: list[Frame]) -> list[Frame]:
        """Return the frames of a scan, some of them bent or in another order."""
        bent, chance = self._bent, self._bent.chance
        out: list[Frame] = list(frames)
        wanted = self._per_scan if self.on else 0.0
        count = int(wanted) + (chance.random() < wanted % 1.0)
        for _ in range(count):
            way = chance.choice(self._ways)
            # always from what the drive has sent: a bent copy of a bent frame could look like an honest one
            victim = chance.choice(frames) if frames else _frame(0x180 + bent.node, chance.randbytes(6))
            at = next((place for place, frame in enumerate(out) if frame is victim), len(out))
            made = CAN_WAYS[way](bent, victim)
            self.bent[way] += sum(1 for frame in made if frame is not victim) or 1
            out[at : at + 1] = made
        if count and "stale" in self._ways and chance.random() < 0.1:
            chance.shuffle(out)
        bent.old.extend(frames)
        return out
