"""The real drivers and the real controller against a simulated bench whose every byte a fuzzer may change.

The drive's frames come from a bus in memory, the Modbus replies through socket pairs, both made from the plant of the
virtual bench. So a run gets as deep as a real one before and while bytes are bent. No thread, no time: a scan takes as
long as it computes.
"""

from __future__ import annotations

import dataclasses
import math
import random
import struct
from collections import deque
from collections.abc import Callable
from typing import Any

import can
from device_end import BendReply, DeviceEnd
from orders_watch import OrdersWatch

from controller.controller import Controller
from definitions.image import AGE_NEVER, Command, DriveCommand, Image, Orders, State
from definitions.number_formats import LETTERS, SIZES
from drivers.can.bus import CanLink
from drivers.servo_drive.data_types import to_integer
from drivers.servo_drive.drive import SILENT_AFTER_SCANS, CanDrive
from drivers.servo_drive.pdo import EMCY_BASE, HEARTBEAT_BASE, rpdo_cob_id, tpdo_cob_id
from drivers.wire_bench import WireBench, in_scans
from station.bench.assemble import wire_config
from station.bench.bench_spec import Address, Ports
from station.bench.request import Job
from station.records.samples.scan_record import BODY_STRUCT
from virtual_bench.in_process import VirtualTimeBench

Frame = can.Message
Bend = Callable[[list[Frame]], list[Frame]]
PORTS = Ports(
    Address("127.0.0.1", 1, "vcan0"),
    {name: Address("127.0.0.1", port) for port, name in enumerate(("amplifier", "brake", "remote_io"), 2)},
    None,
)
GREETING_SCANS = 60
TPDO_SOURCES = {
    "statusword": ("drive_statusword", None),
    "mode_display": ("drive_mode", None),
    "actual_torque": ("drive_torque_nm", "torque_nm_per_count"),
    "actual_position": ("drive_angle_rad", "angle_rad_per_count"),
    "actual_velocity": ("drive_velocity_rad_s", "velocity_rad_s_per_count"),
    "error_register": ("drive_error_register", None),
}


class MemoryBus(can.BusABC):
    """A CAN bus without wires: what is put into `incoming` is received, what is sent is kept in `sent`."""

    def __init__(self) -> None:
        super().__init__(channel="memory")
        self.incoming: deque[Frame] = deque()
        self.sent: list[tuple[int, bytes]] = []

    def send(self, msg: Frame, timeout: float | None = None) -> None:
        del timeout
        self.sent.append((msg.arbitration_id, bytes(msg.data)))

    def _recv_internal(self, timeout: float | None) -> tuple[Frame | None, bool]:
        del timeout
        return (self.incoming.popleft(), True) if self.incoming else (None, False)


@dataclasses.dataclass
class Snapshot:
    """A bench in the middle of an honest run, ready to be copied."""

    state: str
    plant: VirtualTimeBench
    controller: Controller
    scan: int
    image: Image
    orders: Orders


class WireRig:
    """One bench with bent wires. `bend_frames` and `bend_reply` see every frame and reply before the drivers do."""

    def __init__(self, job: Job, snapshot: Snapshot, bend_frames: Bend, bend_reply: BendReply, *, rtu: bool) -> None:
        self.plant, self.controller, self.scan = snapshot.plant, snapshot.controller, snapshot.scan
        self.orders = snapshot.orders
        period_ns = job.recipe.sampling.period_ns
        config = wire_config(job.bench, job.profile_sources, period_ns, PORTS)
        if rtu:
            line = dataclasses.replace(config.brake, transport="rtu", serial_port="pair")
            config = dataclasses.replace(config, brake=line)
        self.bus = MemoryBus()
        self.bend_frames = bend_frames
        self.bench = WireBench(config)
        link = CanLink(self.bus, config.can)
        self.bench._link = link
        beat_scans = in_scans(config.drive.controller_heartbeat_s, period_ns)
        self.drive = self.bench._drive = CanDrive(link, config.drive, beat_scans)
        self.ends = {}
        (amplifier,) = self.bench.amplifiers
        for name, device in (
            ("amplifier", amplifier),
            ("brake", self.bench.brake),
            ("remote_io", self.bench.remote_io),
        ):
            end = self.ends[name] = DeviceEnd(device.config, lambda reply, _end: [reply])
            device.line.attach(end.ours)
        brake = self.ends["brake"]
        brake.written = {"brake_on": self.orders.brake_on, "brake_current_a": self.orders.brake_current_a}
        self.bend_reply = bend_reply
        node = config.drive.node_id
        self._tpdos = [(tpdo_cob_id(p, node), p.objects) for p in config.drive.profile.transmit_pdos]
        self._rpdo = next(p for p in config.drive.profile.receive_pdos if p.timeout)
        self._rpdo_id = rpdo_cob_id(self._rpdo, node)
        self._node = node
        self._emcy = 0
        self._command = int(Command.NONE)
        self.torque_unit_nm = self.drive.units.torque_nm_per_count
        self.watch = OrdersWatch(job.program, self.orders, self.controller.state)
        self.buffer = bytearray(BODY_STRUCT.size)
        self._greet(snapshot.image)

    def _greet(self, truth: Image) -> None:
        """Let every device say once more what it said last: these drivers are new, the run is not."""
        truth = truth._replace(drive_age_scans=0, drive_heartbeat_age_scans=0)
        for scan in range(self.scan - GREETING_SCANS, self.scan + 1):
            self._answer(truth)
            self.bus.incoming.extend(self._frames(truth))
            image = self.bench.read(scan, 0, 0)
            self.bench.write(self.orders, scan)
            truth = truth._replace(sample_counter=truth.sample_counter - 1 & 0xFFFF_FFFF)
        ages = (image.sample_age_scans, image.brake_age_scans, image.io_age_scans, image.drive_age_scans)
        assert max(ages) < GREETING_SCANS, image
        for end in self.ends.values():
            end.bend = self.bend_reply

    def order(self, command: int) -> None:
        """Give a command to the next scan."""
        self._command = int(command)

    def step(self, missed: int = 0) -> tuple[Image, Orders]:
        """One scan; raises what the drivers or the controller raise, and `AssertionError` for a forbidden order."""
        self.scan += 1 + missed
        truth = self.plant.read(self.scan, missed, 0)
        self._answer(truth)
        self.bus.incoming.extend(self.bend_frames(self._frames(truth)))
        command, self._command = self._command, int(Command.NONE)
        image = self.bench.read(self.scan, missed, command)
        orders = self.controller.step(image, self.scan)
        self.controller.events.clear()
        self.bus.sent.clear()
        self.bench.write(orders, self.scan)
        self._look_at_the_wire(image, orders)
        # what is not fit for the record ends a real scan process
        BODY_STRUCT.pack_into(self.buffer, 0, self.scan, self.scan, 0, 0, *image, *orders)
        self.watch.look(image, orders)
        self.orders = orders
        written = self.ends["brake"].written
        told = orders._replace(brake_on=int(written["brake_on"]), brake_current_a=written["brake_current_a"])
        self.plant.write(told, self.scan)
        return image, orders

    @property
    def state(self) -> State:
        return self.controller.state

    def close(self) -> None:
        for end in self.ends.values():
            end.close()
            end.ours.close()
        self.bus.shutdown()

    # --- what the devices say

    @staticmethod
    def _frame(cob_id: int, data: bytes) -> Frame:
        return can.Message(arbitration_id=cob_id, is_extended_id=False, data=data)

    def _frames(self, truth: Image) -> list[Frame]:
        frames = []
        if truth.drive_age_scans == 0:
            for cob_id, objects in self._tpdos:
                data = b""
                for item in objects:
                    name, unit = TPDO_SOURCES[item.name]
                    value = getattr(truth, name) / (getattr(self.drive.units, unit) if unit else 1)
                    data += struct.pack("<" + LETTERS[item.type], to_integer(value, item.type)[0])
                frames.append(self._frame(cob_id, data))
        if truth.drive_heartbeat_age_scans == 0:
            frames.append(self._frame(HEARTBEAT_BASE + self._node, bytes((truth.drive_nmt_state,))))
        if truth.drive_emcy_code != self._emcy:
            self._emcy = truth.drive_emcy_code
            data = struct.pack("<HB5x", truth.drive_emcy_code, truth.drive_error_register)
            frames.append(self._frame(EMCY_BASE + self._node, data))
        return frames

    def _answer(self, truth: Image) -> None:
        values: dict[str, Any] = dataclasses.asdict(truth)
        for end in self.ends.values():
            end.serve(values)

    def _look_at_the_wire(self, image: Image, orders: Orders) -> None:
        """The set-point frame says what was ordered, to the nearest count, and nothing beyond the limit.

        There is one in every scan, but for a drive that is to be off and has been silent: that one gets none.
        """
        frames = [data for cob_id, data in self.bus.sent if cob_id == self._rpdo_id]
        unseen = SILENT_AFTER_SCANS <= image.drive_age_scans < AGE_NEVER
        silent = unseen and orders.drive_command == DriveCommand.DISABLE_VOLTAGE
        assert len(frames) == (0 if silent else 1), f"{len(frames)} set-point frames in one scan"
        if silent:
            return
        at, torque = 0, None
        for item in self._rpdo.objects:
            size = SIZES[item.type]
            if item.name == "target_torque":
                torque = int.from_bytes(frames[0][at : at + size], "little", signed=True)
            at += size
        assert torque is not None
        sent_nm = torque * self.torque_unit_nm
        error_nm = abs(sent_nm - orders.drive_target_torque_nm)
        assert error_nm <= 0.51 * self.torque_unit_nm, (
            f"{orders.drive_target_torque_nm} N·m ordered, {sent_nm} N·m sent"
        )
        assert math.isfinite(sent_nm)


def honest(frames: list[Frame]) -> list[Frame]:
    """Leave frames as they are."""
    return frames


def shuffled(chance: random.Random, items: list[Any]) -> list[Any]:
    """A copy in another order."""
    copy = list(items)
    chance.shuffle(copy)
    return copy
