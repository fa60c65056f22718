"""The bench on real wires: opened before the scan, then read and written once per scan.

`open` connects everything, proves every device's identity and sets the drive up; it may block and may raise. `read` and
`write` never wait and never raise: they use what has arrived, and trouble is a state in the image. A lost link stays
lost until the bench is opened anew. There is no thread.
"""

from __future__ import annotations

import can

from controller.image import AGE_NEVER, DriveCommand, DriveMode, DriveState, Image, Link, Orders
from drivers.can_bus import CanLink, open_can
from drivers.can_drive import CanDrive
from drivers.cia402 import decode_state, follows_command, homing_attained, homing_error, internal_limit
from drivers.config import ModbusConfig, WireBenchConfig
from drivers.drive_setup import set_up_drive
from drivers.errors import DriverError, ModbusError, Problem
from drivers.modbus_device import ModbusDevice
from drivers.modbus_frames import Outcome
from drivers.modbus_line import ModbusLine
from drivers.other_controller import refuse_other_controller
from drivers.part_fields import PART_FIELDS, check_parts
from drivers.position_count import PositionCount
from drivers.sdo import NMT_ENTER_PRE_OPERATIONAL, NMT_RESET_COMMUNICATION

WORST_REPLY_TIMEOUTS = 3
"""RTU: a reply later than this many time-outs is taken for impossible, unless the bench file says otherwise."""

_NO_ORDERS = Orders(*[0] * len(Orders._fields))


def in_scans(seconds: float, period_ns: int) -> int:
    """Duration as a number of scans, at least one, to the nearest."""
    return max(1, round(seconds * 1e9 / period_ns))


class WireBench:
    """The bench on wires; see the module's text for when each method may be called."""

    def __init__(self, config: WireBenchConfig) -> None:
        """Prepare everything that the scan needs; raises ProfileError when a profile does not fit its part."""
        self.config = config
        check_parts(config)
        self._lines: dict[str, ModbusLine] = {}
        self._link: CanLink | None = None
        self._drive: CanDrive | None = None
        self._position = PositionCount()
        self.amplifier = self._device(config.amplifier)
        self.brake = self._device(config.brake)
        self.remote_io = self._device(config.remote_io)
        devices = (self.amplifier, self.brake, self.remote_io)
        self._devices = devices
        self._sharing = tuple(
            (line, tuple(device for device in devices if device.line is line)) for line in self._lines.values()
        )
        self._torque_in = self.amplifier.place("torque_in_nm")
        self._torque_out = self.amplifier.place("torque_out_nm")
        self._angle_in = self.amplifier.place("angle_in_rad")
        self._angle_out = self.amplifier.place("angle_out_rad")
        self._sample_counter = self.amplifier.place("sample_counter")
        self._sample_time = self.amplifier.place("sample_time_us")
        self._sample_status = self.amplifier.place("sample_status")
        self._brake_on = self.brake.place("brake_on")
        self._brake_current = self.brake.place("brake_current_a")
        self._estop = self.remote_io.place("estop_released")
        self._guard = self.remote_io.place("guard_closed")
        self._housing = self.remote_io.place("housing_temp_c")
        self._ambient = self.remote_io.place("ambient_temp_c")

    def _device(self, config: ModbusConfig) -> ModbusDevice:
        period_ns = self.config.period_ns
        line = self._lines.get(config.line)
        timeout_scans = in_scans(config.timeout_s, period_ns)
        worst_s = WORST_REPLY_TIMEOUTS * config.timeout_s if config.worst_reply_s is None else config.worst_reply_s
        drain_scans = in_scans(worst_s, period_ns)
        if line is None:
            line = self._lines[config.line] = ModbusLine(config, timeout_scans, drain_scans)
        # devices that share a line share its patience
        line.timeout_scans = max(line.timeout_scans, timeout_scans)
        line.drain_scans = max(line.drain_scans, drain_scans)
        return ModbusDevice(
            config, line, in_scans(config.poll_every_s, period_ns), in_scans(config.reassert_s, period_ns)
        )

    @property
    def drive(self) -> CanDrive:
        """The drive, once the bench has been opened."""
        if self._drive is None:
            raise RuntimeError("the bench was never opened: call open() before read() and write()")
        return self._drive

    def open(self) -> list[str]:
        """Connect, identify and set up everything (blocking); returns what was verified, one line each.

        Raises DriverError with the findings of all devices at once; the bench is then closed again.
        """
        log: list[str] = []
        problems: list[Problem] = []
        self._drive = None
        for line in self._lines.values():
            try:
                line.open()
            except ModbusError as error:
                problems += error.problems
        for device in self._devices:
            if not device.line.lost:
                problems += _identify(device, log)
        try:
            log += self._open_drive()
        except DriverError as error:
            problems += error.problems
        if problems:
            self.close()
            raise DriverError(*problems)
        return log

    def _open_drive(self) -> list[str]:
        link = open_can(self.config.can)
        try:
            refuse_other_controller(link, self.config.drive)
        except DriverError:
            link.close()  # here, because `close` would reset a drive that is not ours
            raise
        self._link = link
        verified = set_up_drive(link, self.config.drive, self.config.period_ns)
        heartbeat_scans = in_scans(self.config.drive.controller_heartbeat_s, self.config.period_ns)
        self._drive = CanDrive(link, self.config.drive, heartbeat_scans)
        self._position = PositionCount()
        return [f"{self.config.can.where}: open", *verified]

    def read(self, scan: int, missed_periods: int, command: int) -> Image:
        """Take what has arrived and return the image of this scan."""
        drive = self.drive
        drive.poll(scan, missed_periods)
        amplifier, brake, remote_io = self._devices
        amplifier.poll(scan)
        brake.poll(scan)
        remote_io.poll(scan)
        statusword = drive.value("statusword")
        drive_age_scans = drive.age_scans(scan)
        mode = drive.value("mode_display")
        units = drive.units
        sample = amplifier.values
        lock = brake.values
        contacts = remote_io.values
        links_lost = (
            (Link.CAN if drive.link.lost else 0)
            | (Link.AMPLIFIER if amplifier.lost else 0)
            | (Link.BRAKE if brake.lost else 0)
            | (Link.REMOTE_IO if remote_io.lost else 0)
        )
        return Image(
            missed_periods=missed_periods,
            command=command,
            drive_state=decode_state(statusword) if drive_age_scans != AGE_NEVER else DriveState.UNKNOWN,
            drive_statusword=statusword,
            drive_mode=mode,
            drive_internal_limit=internal_limit(statusword) | drive.setpoint_is_clamped,
            drive_follows_command=follows_command(statusword, mode),
            drive_homing_attained=homing_attained(statusword, mode),
            drive_homing_error=homing_error(statusword, mode),
            drive_torque_nm=drive.value("actual_torque") * units.torque_nm_per_count,
            drive_angle_rad=self._position.follow(drive.value("actual_position")) * units.angle_rad_per_count,
            drive_velocity_rad_s=drive.value("actual_velocity") * units.velocity_rad_s_per_count,
            drive_age_scans=drive_age_scans,
            drive_nmt_state=drive.nmt_state,
            drive_heartbeat_age_scans=drive.heartbeat_age_scans(scan),
            drive_emcy_code=drive.emcy_code,
            drive_error_register=drive.error_register,
            torque_in_nm=float(sample[self._torque_in]),
            torque_out_nm=float(sample[self._torque_out]),
            angle_in_rad=float(sample[self._angle_in]),
            angle_out_rad=float(sample[self._angle_out]),
            sample_counter=int(sample[self._sample_counter]) & 0xFFFF_FFFF,
            sample_time_us=int(sample[self._sample_time]) & 0xFFFF_FFFF,
            sample_status=int(sample[self._sample_status]) & 0xFF,
            sample_age_scans=amplifier.age_scans(scan),
            brake_current_a=float(lock[self._brake_current]),
            brake_on=1 if lock[self._brake_on] else 0,
            brake_age_scans=brake.age_scans(scan),
            estop_released=1 if contacts[self._estop] else 0,
            guard_closed=1 if contacts[self._guard] else 0,
            housing_temp_c=float(contacts[self._housing]),
            ambient_temp_c=float(contacts[self._ambient]),
            io_age_scans=remote_io.age_scans(scan),
            links_lost=int(links_lost),
        )

    def write(self, orders: Orders, scan: int) -> None:
        """Send the orders of this scan and the Modbus requests that are due."""
        self.drive.send(orders, scan)
        if self.brake.age_scans(scan) != AGE_NEVER:
            # a lock is ordered to nothing before it is known whether it is closed: it may hold a wound-up unit
            self.brake.order({"brake_on": orders.brake_on, "brake_current_a": orders.brake_current_a})
        for line, devices in self._sharing:
            if line.ready(scan):
                device = devices[0] if len(devices) == 1 else max(devices, key=lambda one: one.urgency(scan))
                device.send(scan)

    def close(self) -> None:
        """Take the drive's power away, stop its process data, close everything; safe to call twice."""
        if self._link is not None:
            if self._drive is not None:
                off = _NO_ORDERS._replace(
                    drive_command=DriveCommand.DISABLE_VOLTAGE, drive_mode=DriveMode.CYCLIC_SYNC_TORQUE
                )
                self._drive.send(off, 0)
            # the reset ends the supervision of our heartbeat too: a regular end is not an emergency
            for nmt_command in (NMT_ENTER_PRE_OPERATIONAL, NMT_RESET_COMMUNICATION):
                data = bytes((nmt_command, self.config.drive.node_id))
                self._link.send(can.Message(arbitration_id=0, is_extended_id=False, data=data))
            self._link.close()
        self._link = None
        for line in self._lines.values():
            line.close()

    def counters(self) -> dict[str, int]:
        """Trouble on the wires since the start, by part, for the record and for diagnosis."""
        drive = self.drive
        counts = {
            "can.sends_failed": drive.link.sends_failed,
            "can.frames_malformed": drive.frames_malformed,
            "can.frames_foreign": drive.frames_foreign,
            "drive.setpoints_clamped": drive.setpoints_clamped,
        }
        for name, device in zip(PART_FIELDS, self._devices, strict=True):
            counts |= {
                f"{name}.replies": device.replies,
                f"{name}.timeouts": device.line.timeouts,
                f"{name}.garbage": device.line.garbage,
                f"{name}.strangers": device.line.strangers,
                f"{name}.exceptions": device.exceptions,
                f"{name}.identity_mismatches": device.identity_mismatches,
                f"{name}.malformed": device.malformed,
                f"{name}.orders_clamped": device.writer.clamped,
            }
        return counts


def _identify(device: ModbusDevice, log: list[str]) -> list[Problem]:
    config = device.config
    identity = config.profile.identity
    reply = device.verify()
    where = f"{config.where} {identity.table} register {identity.address}"
    expected = f"0x{identity.value:04X}"
    if reply.outcome is not Outcome.DATA:
        found = f"{reply.outcome.name.lower()} {reply.exception_code or ''}".strip()
        return [Problem("identity cannot be read", where, found, expected, "check power, address, unit id, baud rate")]
    found = f"0x{reply.registers[0]:04X}"
    if not device.trusted:
        return [Problem("another device answers", where, found, expected, "check address, unit id and profile")]
    log.append(f"{where} identity = {found}: checked")
    return []
