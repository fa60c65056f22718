"""Sensors on the CAN bus of the virtual bench: they send frames in their own time, or with every SYNC.

A CANopen node among them is silent until NMT has started it. What its frames hold is told by data: fields, and the
channel that each shows.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from functools import partial

from definitions.profiles.can import CanField, CanFrame
from virtual_bench.bench_time import BenchTime
from virtual_bench.config import CanSensorPort

SYNC_COB, NMT_COB = 0x080, 0x000
NMT_START, NMT_STOP, NMT_PRE_OPERATIONAL, NMT_RESETS = 0x01, 0x02, 0x80, (0x81, 0x82)
ALL_NODES = 0


class CanSensor:
    """One sensor. Advance the plant before every call."""

    def __init__(
        self,
        config: CanSensorPort,
        read: Callable[[], Mapping[str, float]],
        send: Callable[[int, bytes], None],
        time: BenchTime,
    ) -> None:
        self._config, self._read, self._send, self._time = config, read, send, time
        self._operational = config.node_id is None
        self._begun = 0

    def receive(self, cob_id: int, data: bytes) -> None:
        """Take a frame from the bus: SYNC and NMT mean something to it."""
        if cob_id == SYNC_COB and self._config.every_s is None:
            self._send_frames()
        elif cob_id == NMT_COB and self._config.node_id is not None and len(data) == 2:
            command, node_id = data
            if node_id in (ALL_NODES, self._config.node_id):
                if command == NMT_START:
                    self._operational = True
                elif command in (NMT_STOP, NMT_PRE_OPERATIONAL, *NMT_RESETS):
                    self._operational = False

    def begin(self) -> None:
        """Send from now on, the first time with the next piece of time that passes."""
        self._begun += 1
        if self._config.every_s is not None:
            self._time.after(0.0, partial(self._tick, self._begun, self._config.every_s))

    def _tick(self, begun: int, every_s: float) -> None:
        if begun == self._begun:  # otherwise it was begun anew
            self._send_frames()
            self._time.after(every_s, partial(self._tick, begun, every_s))

    def _send_frames(self) -> None:
        if self._operational:
            values = self._read()
            for frame in self._config.frames:
                self._send(frame.identifier, encode_frame(frame, values))


def encode_frame(frame: CanFrame, values: Mapping[str, float]) -> bytes:
    """Return the bytes of a frame; a signed number beyond its bits stops at their end, a counter begins anew."""
    little = big = 0
    for field in frame.fields:
        number = _number(field, (values[field.name] - field.zero) / field.scale) << field.shift
        if field.order == "big":
            big |= number
        else:
            little |= number
    both = little | int.from_bytes(big.to_bytes(frame.size, "big"), "little")
    return both.to_bytes(frame.size, "little")


def _number(field: CanField, value: float) -> int:
    if field.kind == "float":
        return int.from_bytes(struct.pack("<f" if field.bits == 32 else "<d", value), "little")
    if field.kind == "unsigned":
        return round(value) & (1 << field.bits) - 1
    low, high = -(1 << field.bits - 1), (1 << field.bits - 1) - 1
    # not a number becomes the lowest count, as measuring amplifiers show it
    count = low if value != value else min(max(round(value), low), high)  # noqa: PLR0124
    return count & (1 << field.bits) - 1
