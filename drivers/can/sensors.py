"""Sensors on CAN: frames of other nodes, decoded in the scan by tables that were made before it.

A frame is one block of values, as a read block of a Modbus device is. That it came is what is known of it; whether its
values are new ones is the business of `drivers.sample`. Nothing is written into a sensor: what it sends, how often and
with which identifiers is set there, once, and proven here by what comes.
"""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Iterable, Sequence

import can

from definitions.image import AGE_NEVER
from definitions.profiles.can import CanFrame
from definitions.profiles.drive import DriveProfile
from drivers.can.bus import CanLink
from drivers.config import CanSensorConfig
from drivers.errors import Problem
from drivers.servo_drive.pdo import EMCY_BASE, HEARTBEAT_BASE, SYNC_COB_ID, rpdo_cob_id, tpdo_cob_id

NO_FIELD = -1
NMT_START = 0x01
SYNC_EVERY_S = 0.01
"""While the first frames are waited for: some sensors send with SYNC only."""

_FLOATS = {32: struct.Struct("<f"), 64: struct.Struct("<d")}


class SensorFrame:
    """One frame in the scan; `values` holds the last one, with a zero at the end for fields that it does not have."""

    lost = False
    """The bus itself is what may be lost, and that is known of its link."""

    def __init__(self, frame: CanFrame) -> None:
        """Prepare the table of a frame."""
        self.identifier, self.size = frame.identifier, frame.size
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


def start_sensors(link: CanLink, sensors: Sequence[CanSensorConfig], log: list[str]) -> list[Problem]:
    """Start the CANopen nodes among the sensors and wait for a frame of each identifier (blocking, bounded).

    SYNC is sent meanwhile. Returns what does not come or has another length; `log` gets a line for each frame that did.
    """
    for sensor in sensors:
        if sensor.node_id is not None:
            link.send(can.Message(arbitration_id=0, is_extended_id=False, data=bytes((NMT_START, sensor.node_id))))
    missing = {frame.identifier: (sensor, frame) for sensor in sensors for frame in sensor.frames}
    until = time.monotonic() + max((sensor.first_frame_timeout_s for sensor in sensors), default=0.0)
    wrong: dict[int, Problem] = {}
    next_sync = 0.0
    while missing and not link.lost and (now := time.monotonic()) < until:
        if now >= next_sync:
            link.send(can.Message(arbitration_id=SYNC_COB_ID, is_extended_id=False, data=b""))
            next_sync = now + SYNC_EVERY_S
        message = link.receive()
        if message is None:
            time.sleep(1e-3)
        elif message.arbitration_id in missing and not (message.is_error_frame or message.is_extended_id):
            sensor, frame = missing.pop(message.arbitration_id)
            where = f"{sensor.where}, identifier 0x{frame.identifier:03X}"
            if len(message.data) == frame.size:
                log.append(f"{where}: {frame.size} bytes come. That they are this sensor's is not proven")
            else:
                what, expected = "sends frames of another length", f"{frame.size} bytes"
                hint = "correct the profile, or map the sensor's PDO as it says"
                wrong[frame.identifier] = Problem(what, where, f"{len(message.data)} bytes", expected, hint)
    hint = "check power, identifier, bit rate and that the sensor sends by itself or with SYNC"
    silent = [
        Problem("sends nothing", f"{sensor.where}, identifier 0x{frame.identifier:03X}", "silence", "a frame", hint)
        for sensor, frame in missing.values()
    ]
    return [*wrong.values(), *silent]


def identifier_problems(
    sensors: Iterable[CanSensorConfig], profile: DriveProfile, node_id: int, controller_node_id: int
) -> list[Problem]:
    """Return the identifiers of sensors that somebody else on the bus has: two senders of one destroy each other."""
    taken = {
        0x000: "NMT",
        SYNC_COB_ID: "SYNC",
        EMCY_BASE + node_id: "emergencies of the drive",
        HEARTBEAT_BASE + node_id: "heartbeat of the drive",
        HEARTBEAT_BASE + controller_node_id: "heartbeat of the controller",
        0x580 + node_id: "SDO of the drive",
        0x600 + node_id: "SDO of the drive",
    }
    taken |= {tpdo_cob_id(pdo, node_id): f"TPDO {pdo.number} of the drive" for pdo in profile.transmit_pdos}
    taken |= {rpdo_cob_id(pdo, node_id): f"RPDO {pdo.number} of the drive" for pdo in profile.receive_pdos}
    problems = []
    for sensor in sensors:
        for frame in sensor.frames:
            if frame.identifier in taken:
                where = f"{sensor.where}, identifier 0x{frame.identifier:03X}"
                hint = "give the sensor another identifier, or another node id"
                owner = taken[frame.identifier]
                problems.append(Problem("uses an identifier that is taken", where, owner, "a free one", hint))
            taken.setdefault(frame.identifier, sensor.where)
    return problems
