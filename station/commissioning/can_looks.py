"""The sensors on CAN looked at by hand: their frames as they come, without a scan and without anything written.

A CANopen node is started by NMT, and SYNC is sent, for it says nothing otherwise; its objects stay as they are.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Literal

import can

from definitions.profiles.can import CanField, CanFrame
from drivers.can.bus import CanLink, open_can
from drivers.can.other_controller import refuse_other_controller
from drivers.can.sensor_setup import SYNC_EVERY_S
from drivers.can.sensors import SensorFrame
from drivers.config import CanSensorConfig, WireBenchConfig
from drivers.errors import DriverError, Problem
from drivers.servo_drive.pdo import SYNC_COB_ID
from drivers.servo_drive.sdo import NMT_START

Order = Literal["big", "little"]


class CanLooks:
    """The frames of all sensors on CAN, by a name for each; without such sensors nothing is opened."""

    def __init__(self, wires: WireBenchConfig) -> None:
        """Prepare a place for each frame."""
        self._wires = wires
        self.frames: dict[str, CanFrame] = {}
        self.sensor_of: dict[str, CanSensorConfig] = {}
        for sensor in wires.can_sensors:
            for frame in sensor.frames:
                name = sensor.name if len(sensor.frames) == 1 else f"{sensor.name} 0x{frame.identifier:03X}"
                self.frames[name], self.sensor_of[name] = frame, sensor
        self._name_of = {frame.identifier: name for name, frame in self.frames.items()}
        self.newest: dict[str, bytes] = {}
        """The last frame of each, as it came."""
        self.came_s: dict[str, float] = {}
        """When it came, of `time.monotonic`."""
        self.counts = dict.fromkeys(self.frames, 0)
        self.wrong_size: dict[str, int] = {}
        """Bytes of frames that have another length than their profile says."""
        self._link: CanLink | None = None
        self._next_sync_s = 0.0

    def keep(self, name: str) -> None:
        """Look at one frame alone, or at none where the name is that of another device."""
        self.frames = {one: frame for one, frame in self.frames.items() if one == name}

    @contextmanager
    def opened(self) -> Iterator[CanLooks]:
        """Open the bus and start the nodes.

        Raises:
            DriverError: the bus cannot be opened, or another controller is on it.

        """
        if not self.frames:
            yield self
            return
        link = self._link = open_can(self._wires.can)
        try:
            refuse_other_controller(link, self._wires.drive)
            for sensor in self._wires.can_sensors:
                if sensor.node_id is not None:
                    link.send(_message(0, bytes((NMT_START, sensor.node_id))))
            yield self
        finally:
            link.close()
            self._link = None

    def step(self) -> None:
        """Take what has come, and send SYNC when it is due; called once in every millisecond or so."""
        link = self._link
        if link is None:
            return
        now_s = time.monotonic()
        if now_s >= self._next_sync_s:
            link.send(_message(SYNC_COB_ID, b""))
            self._next_sync_s = now_s + SYNC_EVERY_S
        while (message := link.receive()) is not None:
            name = self._name_of.get(message.arbitration_id)
            if name not in self.frames or message.is_error_frame or message.is_extended_id:
                continue
            if len(message.data) == self.frames[name].size:
                self.newest[name], self.came_s[name] = bytes(message.data), now_s
                self.counts[name] += 1
            else:
                self.wrong_size[name] = len(message.data)

    def wait_for_all(self) -> None:
        """Wait, bounded, until a frame of each has come.

        Raises:
            DriverError: one sends nothing, or frames of another length.

        """
        until = time.monotonic() + max((one.first_frame_timeout_s for one in self._wires.can_sensors), default=0.0)
        while len(self.newest) < len(self.frames) and time.monotonic() < until:
            self.step()
            time.sleep(1e-3)
        if problems := list(self.problems()):
            raise DriverError(*problems)

    def problems(self) -> Iterator[Problem]:
        """Yield what is wrong with the frames that came, and those that did not."""
        for name, frame in self.frames.items():
            where = f"{self.sensor_of[name].where}, identifier 0x{frame.identifier:03X}"
            if name in self.wrong_size:
                hint = "correct the profile, or map the sensor's PDO as it says"
                found, expected = f"{self.wrong_size[name]} bytes", f"{frame.size} bytes"
                yield Problem("sends frames of another length", where, found, expected, hint)
            elif name not in self.newest:
                hint = "check power, identifier, bit rate and that the sensor sends by itself or with SYNC"
                yield Problem("sends nothing", where, "silence", "a frame", hint)


def _message(cob_id: int, data: bytes) -> can.Message:
    return can.Message(arbitration_id=cob_id, is_extended_id=False, data=data)


def values_of(frame: CanFrame, data: bytes) -> Mapping[str, float]:
    """Return what a frame says, by field; nothing when its length is another, or one of them is not a number."""
    seen = SensorFrame(frame, synchronous=False)
    seen.take(data, 0)
    return dict(zip(seen.names, seen.values, strict=False)) if seen.frames else {}


def decoded(frame: CanFrame, field: CanField, data: bytes, order: Order) -> float | None:
    """Return a field of a frame in a byte order; None when that is not a number."""
    turned = field if order == field.order else replace(field, order=order, shift=_other_shift(frame, field))
    return values_of(replace(frame, fields=(turned,)), data).get(field.name)


def bytes_of(frame: CanFrame, field: CanField, data: bytes) -> bytes:
    """Return the bytes that a field fills, as they came; empty for one that does not fill whole bytes."""
    if field.shift % 8 or field.bits % 8:
        return b""
    first = field.shift // 8 if field.order == "little" else (8 * frame.size - field.shift - field.bits) // 8
    return data[first : first + field.bits // 8]


def _other_shift(frame: CanFrame, field: CanField) -> int:
    """Return where a field of whole bytes stands when its bytes are counted from the other end."""
    return 8 * frame.size - field.shift - field.bits
