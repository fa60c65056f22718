"""A drive on a virtual bus, with the frames that its tests put there and look at."""

from __future__ import annotations

import struct
from typing import Any

import can
from drivers_support import drive_config, drive_profile, raw_profile

from definitions.image import DriveCommand, DriveMode, Orders
from drivers.can.bus import CanLink, open_can
from drivers.config import CanConfig
from drivers.servo_drive.drive import FRAMES_PER_POLL, CanDrive

HEARTBEAT_SCANS = 20
SENSOR_NODE = 10
TPDO1, TPDO2, HEARTBEAT, EMCY = 0x185, 0x285, 0x705, 0x085
ENABLED, FAULT = 0x1637, 0x0218
CST, CSV = int(DriveMode.CYCLIC_SYNC_TORQUE), int(DriveMode.CYCLIC_SYNC_VELOCITY)


class DriveOnBus:
    """A drive on a virtual bus and the other end of the bus."""

    def __init__(self, channel: str = "can-drive", most_frames: int = FRAMES_PER_POLL, **profile: Any) -> None:
        self.link: CanLink = open_can(CanConfig("virtual", channel))
        self.other = can.Bus(interface="virtual", channel=channel)
        raw = dict(raw_profile("virtual-drive")) | profile
        config = drive_config(profile=drive_profile(raw))
        self.drive = CanDrive(self.link, config, HEARTBEAT_SCANS, sensor_nodes=(SENSOR_NODE,), most_frames=most_frames)

    def put(self, cob_id: int, data: bytes, **kind: bool) -> None:
        self.other.send(can.Message(arbitration_id=cob_id, data=data, **({"is_extended_id": False} | kind)))

    def answer(self, statusword: int = ENABLED, mode: int = CST, torque: int = 0) -> None:
        self.put(TPDO1, struct.pack("<HbhB", statusword, mode, torque, 0))
        self.put(TPDO2, struct.pack("<ii", 0, 0))

    def sent(self) -> list[tuple[int, bytes]]:
        frames = []
        while (message := self.other.recv(0)) is not None:
            frames.append((message.arbitration_id, bytes(message.data)))
        return frames

    def close(self) -> None:
        self.link.close()
        self.other.shutdown()


def orders(
    command: int = DriveCommand.ENABLE_OPERATION, mode: int = CST, torque: float = 0.0, speed: float = 0.0
) -> Orders:
    return Orders(*[0] * len(Orders._fields))._replace(
        drive_command=command, drive_mode=mode, drive_target_torque_nm=torque, drive_target_velocity_rad_s=speed
    )


def emergency(code: int, register: int = 1) -> bytes:
    return struct.pack("<HB5s", code, register, b"abcde")
