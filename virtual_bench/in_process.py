"""The virtual bench without wires: the same plant and drive machine, stepped by the scan itself.

Latency is that of the wires: orders of scan n act from n on, what the devices say at n arrives at n + 1, slow devices
are asked at their own periods and their values age in between. Numbers pass through the same integers as over the
bus, so a controller sees the same steps.
"""

from __future__ import annotations

import struct
from math import pi

from definitions.first_image import first_image
from definitions.image import (
    AGE_NEVER,
    DriveCommand,
    DriveMode,
    DriveState,
    Image,
    Link,
    NmtState,
    Orders,
)
from drivers.servo_drive.drive import SILENT_AFTER_SCANS
from drivers.servo_drive.position_count import PositionCount
from virtual_bench.config import BenchConfig, sign, torque_unit_nm
from virtual_bench.drive import cia402_tables as tables
from virtual_bench.drive.axis import DriveAxis
from virtual_bench.drive.cia402_tables import PowerState
from virtual_bench.faults.frame_faults import TPDO1_BASE
from virtual_bench.faults.injector import FaultInjector
from virtual_bench.faults.scenario import Scenario
from virtual_bench.faults.schedule import LOST
from virtual_bench.physics.plant import Plant
from virtual_bench.slow_devices import SlowDevices

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
INT32 = 0x7FFFFFFF
STATUS = struct.Struct("<HbhB")  # transmit PDO 1 of the shipped drive profile, for faults that change its bytes
POWER_ON_NS = 100_000_000  # the devices have been on for a while when the first scan comes


class VirtualTimeBench:
    """A bench whose time is the scan number; `read` then `write` once per scan, `period_ns` apart."""

    def __init__(self, config: BenchConfig, period_ns: int, scenario: Scenario | None = None) -> None:
        self.plant = Plant(config)
        self.plant.advance(POWER_ON_NS)
        self.axis = DriveAxis(self.plant, config.drive)
        drive = config.drive
        self.axis.protect(drive)
        self.faults = FaultInjector(scenario, self.plant, self.axis, (drive.node_id, drive.controller_node_id))
        self._machine, self._motion = self.axis.machine, self.axis.machine.motion
        self._image = first_image()
        self.slow = SlowDevices(config, self.plant, self.faults, period_ns, self._image)
        self._tpdo1_cob = TPDO1_BASE + drive.node_id
        self._period_ns = period_ns
        self._torque_unit_nm = sign(drive) * torque_unit_nm(drive) * drive.gear_ratio
        self._rad_per_count = (
            sign(drive) * 2.0 * pi / drive.profile.scaling.position_counts_per_motor_rev / drive.gear_ratio
        )
        self._rad_s_per_count = sign(drive) / drive.profile.scaling.velocity_counts_per_rad_s / drive.gear_ratio
        self._node = drive.controller_node_id
        self._beat_every = max(round(drive.controller_heartbeat_s * 1e9 / period_ns), 1)
        self._drive_beat_every = max(round(drive.drive_heartbeat_s * 1e9 / period_ns), 1)
        self._position = PositionCount()
        self._late_status: list[tuple[int, bytes]] = []  # arrival [ns] and data of delayed frames
        # The scans at which what the devices last sent arrives.
        self._status_scan = self._motion_scan = -AGE_NEVER
        self._beat_scan = 0

    def read(self, scan: int, missed_periods: int, command: int) -> Image:
        """Let the time since the last scan pass and return what has arrived.

        It is the bench's one image: `write` lets the devices answer into it, and the next read ages it.
        """
        plant, faults, slow, image = self.plant, self.faults, self.slow, self._image
        if scan:
            plant.advance(self._period_ns * (1 + missed_periods))
        now_ns = plant.now_ns
        self.axis.tick(now_ns)
        if faults.armed:
            faults.step(now_ns)
        image.missed_periods = missed_periods
        image.command = command
        older_scan = self._status_scan
        older_scan = min(older_scan, self._motion_scan)
        image.drive_age_scans = age if (age := scan - older_scan) < AGE_NEVER else AGE_NEVER
        image.drive_heartbeat_age_scans = age if (age := scan - self._beat_scan) < AGE_NEVER else AGE_NEVER
        image.sample_age_scans = age if (age := scan - slow.sample_scan) < AGE_NEVER else AGE_NEVER
        image.brake_age_scans = age if (age := scan - slow.brake_scan) < AGE_NEVER else AGE_NEVER
        image.io_age_scans = age if (age := scan - slow.io_scan) < AGE_NEVER else AGE_NEVER
        image.links_lost = self._links_lost() if faults.active else 0
        return image

    def write(self, orders: Orders, scan: int) -> None:
        """Take the orders of a scan, and let the devices answer: their values arrive at the next scan."""
        now_ns, machine = self.plant.now_ns, self._machine
        disturbed = bool(self.faults.active)  # nobody else is asked about faults
        beats = scan % self._beat_every == 0
        arrived = synced = True
        if disturbed:
            fate = self.faults.frames.fate
            beats = beats and fate("can.controller.heartbeat") != LOST
            age_scans = scan - min(self._status_scan, self._motion_scan)
            unseen = SILENT_AFTER_SCANS <= age_scans < AGE_NEVER
            silent = unseen and orders.drive_command == DriveCommand.DISABLE_VOLTAGE
            arrived = not silent and fate("can.setpoint") != LOST
            synced = fate("can.sync") != LOST
        if beats:
            machine.heartbeat(self._node, now_ns)
        if arrived:
            machine.setpoint_received(now_ns)
            if synced:  # what is not followed by SYNC waits, and the next set-point takes its place
                self._write_drive(orders, now_ns, disturbed=disturbed)
        self.axis.apply()
        self.slow.write_brake(orders)
        if disturbed or self._late_status:
            self._answer_disturbed(scan, synced=synced)
        else:
            self._send_status(scan)
            self._send_motion(scan)
            self._image.drive_emcy_code = machine.error_code
            if scan % self._drive_beat_every == 0:
                self._beat_scan = scan + 1
        self.slow.answer(scan)

    def close(self) -> None:
        """Release nothing: there are no wires."""

    def _write_drive(self, orders: Orders, now_ns: int, *, disturbed: bool) -> None:
        machine, motion = self._machine, self._motion
        mode = orders.drive_mode
        if mode != motion.mode:
            motion.write_mode(mode)
        torque = round(orders.drive_target_torque_nm / self._torque_unit_nm)
        if not -0x8000 <= torque <= 0x7FFF:
            torque = _clip16(torque)
        if disturbed:
            torque = self.faults.setpoint(torque, motion.target_torque)
        if torque != motion.target_torque:
            motion.write_target_torque(torque)
        if mode == VELOCITY_MODE:
            velocity = round(orders.drive_target_velocity_rad_s / self._rad_s_per_count)
            if disturbed:
                velocity = self.faults.setpoint(velocity, motion.target_velocity)
            motion.write_target_velocity(velocity)
        word = CONTROLWORDS[orders.drive_command]
        if not disturbed or self.faults.takes_controlword(word, machine.controlword):
            machine.write_controlword(word, now_ns)

    def _answer_disturbed(self, scan: int, *, synced: bool) -> None:
        """Let the drive answer while faults may lose, change or delay what it sends."""
        image, faults = self._image, self.faults
        fate, answers = faults.frames.fate, synced
        if faults.node_is_reset:
            image.drive_nmt_state = NmtState.PRE_OPERATIONAL.value
            answers = False
        if answers:
            self._send_disturbed_status(scan)
            if fate("can.drive.tpdo2") != LOST:
                self._send_motion(scan)
        code = faults.emergency(self._machine.error_code)
        if code != image.drive_emcy_code and fate("can.drive.emcy") == LOST:
            code = image.drive_emcy_code
        image.drive_emcy_code = code
        if scan % self._drive_beat_every == 0 and fate("can.drive.heartbeat") != LOST:
            self._beat_scan = scan + 1

    def _send_motion(self, scan: int) -> None:
        """Send TPDO 2."""
        machine, image = self._machine, self._image
        position = (machine.position_counts + INT32 + 1 & 0xFFFFFFFF) - INT32 - 1
        image.drive_angle_rad = self._position.follow(position) * self._rad_per_count
        image.drive_velocity_rad_s = machine.motor.velocity_counts_s * self._rad_s_per_count
        self._motion_scan = scan + 1

    def _send_status(self, scan: int) -> None:
        """Send TPDO 1."""
        machine = self._machine
        mode, torque = self._motion.mode_display, machine.motor.torque_permille
        self._take_status(machine.state, machine.statusword, mode, torque, machine.error_register)
        self._status_scan = scan + 1

    def _send_disturbed_status(self, scan: int) -> None:
        """Send a TPDO 1 that faults may lose, change or delay; a frame that comes late brings an old status."""
        machine, faults = self._machine, self.faults
        mode, torque = self._motion.mode_display, machine.motor.torque_permille
        shown = faults.status(machine.statusword, int(mode), torque)
        word, shown_mode, torque = shown
        data = STATUS.pack(word, shown_mode, _clip16(torque), machine.error_register)
        for frame in faults.frames.pass_on(self._tpdo1_cob, data):
            self._late_status.append((self.plant.now_ns + frame.delay_ns, frame.data))
        self._late_status.sort(key=_arrival)
        while self._late_status and self._late_status[0][0] <= self.plant.now_ns:
            data = self._late_status.pop(0)[1]
            if len(data) == STATUS.size:
                word, shown_mode, torque, register = STATUS.unpack(data)
                self._take_status(tables.state_of(word), word, shown_mode, torque, register)
                self._status_scan = scan + 1

    def _take_status(self, state: PowerState, word: int, mode: int, torque: int, register: int) -> None:
        """Put what TPDO 1 says into the next image."""
        image = self._image
        image.drive_torque_nm = torque * self._torque_unit_nm
        if word != image.drive_statusword or mode != image.drive_mode:
            cyclic, homing = mode in CYCLIC, mode == HOMING
            image.drive_state = DRIVE_STATES[state]
            image.drive_statusword = word
            image.drive_mode = int(mode)
            image.drive_internal_limit = 1 if word & tables.INTERNAL_LIMIT else 0
            image.drive_follows_command = 1 if cyclic and word & tables.FOLLOWS_COMMAND else 0
            image.drive_homing_attained = 1 if homing and word & tables.HOMING_ATTAINED else 0
            image.drive_homing_error = 1 if homing and word & tables.HOMING_ERROR else 0
        image.drive_error_register = register

    def _links_lost(self) -> int:
        lost = self.slow.links_lost()
        if ("can.bus", "cut") in self.faults.active:
            lost |= int(Link.CAN)
        if ("can.bus", "command") in self.faults.active:
            self.faults.seen("can.bus")
            lost |= int(Link.CAN_SHARED)
        return lost


def _arrival(late: tuple[int, bytes]) -> int:
    return late[0]


def _clip16(value: int) -> int:
    return value if -0x8000 <= value <= 0x7FFF else min(max(value, -0x8000), 0x7FFF)
