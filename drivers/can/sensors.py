"""Sensors on CAN: frames of other nodes, decoded in the scan by tables that were made before it.

A frame is one block of values, as a read block of a Modbus device is. That it came is what is known of it; whether its
values are new ones is the business of `drivers.sample`. A CANopen node with a heartbeat is believed while it says that
it is operational: one that started anew may have lost what was set in it.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

from definitions.image import AGE_NEVER, NmtState
from definitions.profiles.can import CanFrame

NO_FIELD = -1

HEARTBEATS = 2
"""Heartbeats that may be missing in a row: one is lost on the bus, two are silence."""

_FLOATS = {32: struct.Struct("<f"), 64: struct.Struct("<d")}


class SensorFrame:
    """One frame in the scan; `values` holds the last one, with a zero at the end for fields that it does not have."""

    lost = False
    """Whether its node is gone, or started anew; of the bus itself its link knows."""

    def __init__(self, frame: CanFrame, *, synchronous: bool) -> None:
        """Prepare the table of a frame; synchronous: it answers SYNC, and its values are of that moment."""
        self.identifier, self.size, self._synchronous = frame.identifier, frame.size, synchronous
        self.names = tuple(field.name for field in frame.fields)
        self.values: list[float] = [0.0] * (len(self.names) + 1)
        self.malformed = self.frames = 0
        self._arrived_scan = -1
        self._fields = tuple(
            (
                field.order == "big",
                field.shift,
                (1 << field.bits) - 1,
                1 << (field.bits - 1) if field.kind == "signed" else 0,
                _FLOATS[field.bits] if field.kind == "float" else None,
                field.scale,
                field.zero,
            )
            for field in frame.fields
        )

    def place(self, name: str) -> int:
        """Index of a field in `values`; NO_FIELD when there is none."""
        return self.names.index(name) if name in self.names else NO_FIELD

    def age_scans(self, scan: int) -> int:
        """Age of the frame that came last."""
        came = self._arrived_scan
        return scan - came if came >= 0 and scan - came < AGE_NEVER else AGE_NEVER

    def measured_scan(self, scan: int, synced_scan: int) -> int:
        """Scan in which the values of a frame that came in `scan` were measured, for all that is known of it."""
        return synced_scan if self._synchronous else scan

    def take(self, data: bytes, scan: int) -> None:
        """Take a frame; one of another length, or with what is not a number, is counted and not believed."""
        if len(data) != self.size:
            self.malformed += 1
            return
        little, big = int.from_bytes(data, "little"), int.from_bytes(data, "big")
        values: list[float] = []
        for is_big, shift, mask, sign, real, scale, zero in self._fields:
            number: float = (big if is_big else little) >> shift & mask
            if real is not None:
                (number,) = real.unpack(int(number).to_bytes(real.size, "little"))
            elif sign:
                number = (int(number) ^ sign) - sign
            values.append(number * scale + zero)
        if not all(map(math.isfinite, values)):
            self.malformed += 1
            return
        values.append(0.0)
        self.values = values
        self.frames += 1
        self._arrived_scan = scan


class SensorNode:
    """The node of a sensor in the scan: its frames are lost, and stay so, when it is silent or not operational."""

    def __init__(self, frames: Sequence[SensorFrame], heartbeat_scans: int) -> None:
        """`heartbeat_scans`: scans between two of its heartbeats."""
        self._frames = tuple(frames)
        self._longest_scans = HEARTBEATS * heartbeat_scans + heartbeat_scans // 2
        self._heard_scan = 0
        self.heartbeats = 0
        self.state = int(NmtState.OPERATIONAL)
        """State that it said last; it was operational before the scan."""

    def take(self, data: bytes, scan: int) -> None:
        """Take a heartbeat; one of another length says nothing."""
        if len(data) == 1:
            self.state = data[0] & 0x7F
            self._heard_scan = scan
            self.heartbeats += 1
            if self.state != NmtState.OPERATIONAL:
                self._lose()

    def look(self, scan: int) -> None:
        """Look in a scan whether the node is there; called after everything has been taken."""
        if scan - self._heard_scan > self._longest_scans:
            self._lose()

    def _lose(self) -> None:
        for frame in self._frames:
            frame.lost = True
