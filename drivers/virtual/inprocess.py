"""The virtual bench without wires: the same plant and drive machine, stepped by the scan itself.

Latency is that of the wires: orders of scan n act from n on, what the devices say at n arrives at n + 1, slow devices
are asked at their own periods and their values age in between. Numbers pass through the same integers as over the
bus, so a controller sees the same steps.
"""

from __future__ import annotations

import struct
from functools import partial
from math import pi

from controller.image import (
    AGE_NEVER,
    DriveCommand,
    DriveMode,
    DriveState,
    Image,
    Link,
    NmtState,
    Orders,
)
from drivers.can_drive import SILENT_AFTER_SCANS
from drivers.position_count import PositionCount
from drivers.virtual import cia402_tables as tables
from drivers.virtual.cia402_tables import PowerState
from drivers.virtual.config import BenchConfig
from drivers.virtual.drive_axis import DriveAxis
from drivers.virtual.fault_injector import FaultInjector
from drivers.virtual.fault_schedule import LOST
from drivers.virtual.frame_faults import TPDO1_BASE
from drivers.virtual.plant import Plant
from drivers.virtual.scenario import Scenario
from drivers.virtual.slow_devices import SlowDevices

CONTROLWORDS: dict[int, int] = {
    DriveCommand.DISABLE_VOLTAGE: 0x0000,
    DriveCommand.SHUTDOWN: 0x0006,
    DriveCommand.SWITCH_ON: 0x0007,
    DriveCommand.ENABLE_OPERATION: 0x000F,
    DriveCommand.QUICK_STOP: 0x0002,
    DriveCommand.FAULT_RESET: 0x0080,
    DriveCommand.START_HOMING: 0x001F,
}
DRIVE_STATES: dict[PowerState, int] = {
    PowerState.NOT_READY_TO_SWITCH_ON: int(DriveState.NOT_READY_TO_SWITCH_ON),
    PowerState.SWITCH_ON_DISABLED: int(DriveState.SWITCH_ON_DISABLED),
    PowerState.READY_TO_SWITCH_ON: int(DriveState.READY_TO_SWITCH_ON),
    PowerState.SWITCHED_ON: int(DriveState.SWITCHED_ON),
    PowerState.OPERATION_ENABLED: int(DriveState.OPERATION_ENABLED),
    PowerState.QUICK_STOP_ACTIVE: int(DriveState.QUICK_STOP_ACTIVE),
    PowerState.FAULT_REACTION_ACTIVE: int(DriveState.FAULT_REACTION_ACTIVE),
    PowerState.FAULT: int(DriveState.FAULT),
}
# Asked in every scan: a member looked up by its class costs twenty times as much.
HOMING, VELOCITY_MODE = DriveMode.HOMING, DriveMode.CYCLIC_SYNC_VELOCITY
CYCLIC = (VELOCITY_MODE, DriveMode.CYCLIC_SYNC_TORQUE)
# Of a tuple of all fields: a quarter of the time of a call with as many arguments.
_image_of = partial(tuple.__new__, Image)
INT32 = 0x7FFFFFFF
STATUS = struct.Struct("<HbhB")  # transmit PDO 1 of the shipped drive profile, for faults that change its bytes
POWER_ON_NS = 100_000_000  # the devices have been on for a while when the first scan comes


class VirtualTimeBench:
    """A bench whose time is the scan number; `read` then `write` once per scan, `period_ns` apart."""

    def __init__(self, config: BenchConfig, period_ns: int, scenario: Scenario | None = None) -> None:
        self.plant = Plant(config)
        self.plant.advance(POWER_ON_NS)
        self.axis = DriveAxis(self.plant, config.drive)
        self.axis.protect(config.drive.protections, config.drive.controller_node_id)
        drive = config.drive
        self.faults = FaultInjector(scenario, self.plant, self.axis, (drive.node_id, drive.controller_node_id))
        self.slow = SlowDevices(config, self.plant, self.faults, period_ns)
        self._tpdo1_cob = TPDO1_BASE + drive.node_id
        self._period_ns = period_ns
        self._torque_unit_nm = drive.rated_torque_nm / 1000.0 * drive.gear_ratio
        self._rad_per_count = 2.0 * pi / drive.profile.position_counts_per_motor_rev / drive.gear_ratio
        self._rad_s_per_count = 1.0 / drive.profile.velocity_counts_per_rad_s / drive.gear_ratio
        self._node = drive.controller_node_id
        self._beat_every = max(round(drive.controller_heartbeat_s * 1e9 / period_ns), 1)
        self._drive_beat_every = max(round(drive.protections.drive_heartbeat_s * 1e9 / period_ns), 1)
        # Values as the devices last sent them, and the scans at which they arrive.
        self._status = (0, 0, 0, 0, 0)  # state, word, mode, torque, error register
        self._motion = (0, 0)
        self._position = PositionCount()
        self._late_status: list[tuple[int, bytes]] = []  # arrival [ns] and data of delayed frames
        self._emcy = 0
        self._status_scan = self._motion_scan = -AGE_NEVER
        self._beat_scan = 0
        self._nmt_state = NmtState.OPERATIONAL.value

    def read(self, scan: int, missed_periods: int, command: int) -> Image:
        """Let the time since the last scan pass and return what has arrived from the devices."""
        if scan:
            self.plant.advance(self._period_ns * (1 + missed_periods))
        axis = self.axis
        now_ns = self.plant.now_ns
        axis.tick(now_ns)
        self.faults.step(now_ns)
        state, word, mode, torque, register = self._status
        position, velocity = self._motion
        slow = self.slow
        sample = slow.sample
        current, brake_on = slow.brake_values
        estop, guard, housing, ambient = slow.io_values
        cyclic = mode in CYCLIC
        homing = mode == HOMING
        image: Image = _image_of(
            (
                missed_periods,
                command,
                state,
                word,
                mode,
                1 if word & tables.INTERNAL_LIMIT else 0,
                1 if cyclic and word & tables.FOLLOWS_COMMAND else 0,
                1 if homing and word & tables.HOMING_ATTAINED else 0,
                1 if homing and word & tables.HOMING_ERROR else 0,
                torque * self._torque_unit_nm,
                self._position.follow(position) * self._rad_per_count,
                velocity * self._rad_s_per_count,
                age if (age := scan - min(self._status_scan, self._motion_scan)) < AGE_NEVER else AGE_NEVER,
                self._nmt_state,
                age if (age := scan - self._beat_scan) < AGE_NEVER else AGE_NEVER,
                self._emcy,
                register,
                sample.torque_in_nm,
                sample.torque_out_nm,
                sample.angle_in_rad,
                sample.angle_out_rad,
                sample.counter,
                sample.time_us,
                sample.status,
                age if (age := scan - slow.sample_scan) < AGE_NEVER else AGE_NEVER,
                current,
                brake_on,
                age if (age := scan - slow.brake_scan) < AGE_NEVER else AGE_NEVER,
                estop,
                guard,
                housing,
                ambient,
                age if (age := scan - slow.io_scan) < AGE_NEVER else AGE_NEVER,
                self._links_lost() if self.faults.active else 0,
            )
        )
        return image

    def write(self, orders: Orders, scan: int) -> None:
        """Take the orders of a scan, and let the devices answer: their values arrive at the next scan."""
        now_ns = self.plant.now_ns
        faults, axis = self.faults, self.axis
        arrived = synced = True
        if faults.active:
            fate = faults.frames.fate
            if scan % self._beat_every == 0 and fate("can.controller.heartbeat") != LOST:
                axis.machine.heartbeat(self._node, now_ns)
            age_scans = scan - min(self._status_scan, self._motion_scan)
            unseen = SILENT_AFTER_SCANS <= age_scans < AGE_NEVER
            silent = unseen and orders.drive_command == DriveCommand.DISABLE_VOLTAGE
            arrived = not silent and fate("can.setpoint") != LOST
            synced = fate("can.sync") != LOST
        elif scan % self._beat_every == 0:
            axis.machine.heartbeat(self._node, now_ns)
        if arrived:
            axis.machine.setpoint_received(now_ns)
        if arrived and synced:  # what is not followed by SYNC waits, and the next set-point takes its place
            self._write_drive(orders, now_ns)
        axis.apply()
        self.slow.write_brake(orders)
        self._answer_drive(scan, synced=synced)
        self.slow.answer(scan)

    def close(self) -> None:
        """Release nothing: there are no wires."""

    def _write_drive(self, orders: Orders, now_ns: int) -> None:
        machine, faults = self.axis.machine, self.faults
        motion = machine.motion
        motion.write_mode(orders.drive_mode)
        torque = _clip16(round(orders.drive_target_torque_nm / self._torque_unit_nm))
        motion.write_target_torque(faults.setpoint(torque, motion.target_torque))
        if orders.drive_mode == VELOCITY_MODE:
            velocity = round(orders.drive_target_velocity_rad_s / self._rad_s_per_count)
            motion.write_target_velocity(faults.setpoint(velocity, motion.target_velocity))
        word = CONTROLWORDS[orders.drive_command]
        if faults.takes_controlword(word, machine.controlword):
            machine.write_controlword(word, now_ns)

    def _answer_drive(self, scan: int, *, synced: bool) -> None:
        machine, faults = self.axis.machine, self.faults
        motor = machine.motor
        if faults.node_is_reset:
            self._nmt_state = NmtState.PRE_OPERATIONAL.value
        elif synced:
            self._send_status(scan)
            if faults.frames.fate("can.drive.tpdo2") != LOST:
                position = machine.position_counts
                self._motion = ((position + INT32 + 1 & 0xFFFFFFFF) - INT32 - 1, motor.velocity_counts_s)
                self._motion_scan = scan + 1
        code = faults.emergency(machine.error_code)
        if code != self._emcy and faults.frames.fate("can.drive.emcy") != LOST:
            self._emcy = code
        if scan % self._drive_beat_every == 0 and faults.frames.fate("can.drive.heartbeat") != LOST:
            self._beat_scan = scan + 1

    def _send_status(self, scan: int) -> None:
        """Send TPDO 1, which faults may lose, change or delay; a frame that comes late brings an old status."""
        machine, faults = self.axis.machine, self.faults
        word, mode, torque = machine.statusword, int(machine.motion.mode_display), machine.motor.torque_permille
        if not (faults.active or self._late_status):
            self._status = (DRIVE_STATES[machine.state], word, mode, torque, machine.error_register)
            self._status_scan = scan + 1
            return
        word, mode, torque = faults.status(word, mode, torque)
        data = STATUS.pack(word, mode, _clip16(torque), machine.error_register)
        for frame in faults.frames.pass_on(self._tpdo1_cob, data):
            self._late_status.append((self.plant.now_ns + frame.delay_ns, frame.data))
        self._late_status.sort(key=_arrival)
        while self._late_status and self._late_status[0][0] <= self.plant.now_ns:
            data = self._late_status.pop(0)[1]
            if len(data) == STATUS.size:
                values = STATUS.unpack(data)
                self._take_status(DRIVE_STATES[tables.state_of(values[0])], values, scan)

    def _take_status(self, state: int, values: tuple[int, ...], scan: int) -> None:
        word, mode, torque, register = values
        self._status = (state, word, mode, torque, register)
        self._status_scan = scan + 1

    def _links_lost(self) -> int:
        cut = int(Link.CAN) if ("can.bus", "cut") in self.faults.active else 0
        return cut + self.slow.links_lost()


def _arrival(late: tuple[int, bytes]) -> int:
    return late[0]


def _clip16(value: int) -> int:
    return value if -0x8000 <= value <= 0x7FFF else min(max(value, -0x8000), 0x7FFF)
