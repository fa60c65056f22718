"""The image of a bench on wires, in the making: each part is taken anew when its device has said something new."""

from __future__ import annotations

from definitions.first_image import first_image
from definitions.image import AGE_NEVER, REMOTE_IO_FIELDS, DriveMode, DriveState, Image, Link
from drivers.modbus.device import NO_FIELD, ModbusDevice
from drivers.modbus.part_fields import READ_FIELDS
from drivers.sample import DELAY_FIELDS, Feed
from drivers.servo_drive.cia402 import decode_state, follows_command, homing_attained, homing_error, internal_limit
from drivers.servo_drive.data_types import picker
from drivers.servo_drive.drive import CanDrive
from drivers.servo_drive.output_brake import OutputBrake
from drivers.servo_drive.position_count import PositionCount

# Asked in every scan: a member looked up by its class costs twenty times as much.
_CAN, _AMPLIFIER, _BRAKE, _REMOTE_IO = int(Link.CAN), int(Link.AMPLIFIER), int(Link.BRAKE), int(Link.REMOTE_IO)
_CAN_SHARED = int(Link.CAN_SHARED)
_UNKNOWN = DriveState.UNKNOWN
_HOMING_MODE, _TORQUE_MODE = int(DriveMode.HOMING), int(DriveMode.CYCLIC_SYNC_TORQUE)


class WireImage:
    """The one image of a bench: `take` writes in it what has changed, and returns it. Take a copy to keep it."""

    __slots__ = (
        "_amplifier",
        "_brake",
        "_contacts",
        "_contacts_of",
        "_fixed_current_a",
        "_image",
        "_limited",
        "_lock",
        "_lock_of",
        "_position",
        "_reference_count",
        "_remote_io",
        "_sample",
        "_sample_of",
        "_state",
        "_tells_current",
        "_tells_on",
    )

    def __init__(
        self, amplifier: Feed, brake: ModbusDevice | OutputBrake, remote_io: ModbusDevice, fixed_current_a: float = 0.0
    ) -> None:
        """`amplifier`: what the sample comes from. `fixed_current_a`: of a brake that was never ordered a current."""
        self._amplifier, self._brake, self._remote_io = amplifier, brake, remote_io
        self._tells_on = brake.place("brake_on") != NO_FIELD
        self._tells_current = brake.place("brake_current_a") != NO_FIELD
        self._fixed_current_a = fixed_current_a
        self._sample_of = picker([amplifier.place(name) for name in (*READ_FIELDS["amplifier"], *DELAY_FIELDS)])
        self._lock_of = picker([brake.place(name) for name in READ_FIELDS["brake"]])
        self._contacts_of = picker([remote_io.place(name) for name in READ_FIELDS["remote_io"]])
        # What was taken last of each device, and at first nothing: then the first values are new ones.
        self._sample: list[float] | None = None
        self._lock: list[float] | None = None
        self._contacts: list[float] | None = None
        self._image = first_image()
        self._image.drive_statusword = self._image.drive_mode = -1
        self._position = PositionCount()
        self._reference_count = 0
        """Where a drive that does not home stood when its reference was taken; 0 for one that homes."""

    def opened(self) -> None:
        """Count the drive's position anew: it was opened."""
        self._position = PositionCount()
        self._reference_count = 0

    def take(self, drive: CanDrive, scan: int, missed_periods: int, command: int) -> Image:
        """Return the image of scan number `scan`, in which everything that had arrived was taken."""
        image = self._image
        image.missed_periods = missed_periods
        image.command = command
        self._take_drive(drive, scan)
        amplifier, brake, remote_io = self._amplifier, self._brake, self._remote_io
        image.sample_age_scans = amplifier.age_scans(scan)
        image.brake_age_scans = brake.age_scans(scan)
        image.io_age_scans = remote_io.age_scans(scan)
        if amplifier.values is not self._sample:
            self._take_sample(amplifier.values)
        if brake.values is not self._lock:
            self._take_lock(brake.values)
        if remote_io.values is not self._contacts:
            self._take_contacts(remote_io.values)
        image.links_lost = (
            (_CAN if drive.link.lost else 0)
            | (_AMPLIFIER if amplifier.lost else 0)
            | (_BRAKE if brake.lost else 0)
            | (_REMOTE_IO if remote_io.lost else 0)
            | (_CAN_SHARED if drive.other_commands(scan) else 0)
        )
        return image

    def _take_drive(self, drive: CanDrive, scan: int) -> None:
        image, units = self._image, drive.units
        statusword, mode, torque, position, velocity, image.drive_error_register = drive.scan_values()
        if statusword != image.drive_statusword or mode != image.drive_mode:
            image.drive_statusword = statusword
            image.drive_mode = mode
            self._state = decode_state(statusword)
            self._limited = internal_limit(statusword)
            image.drive_follows_command = follows_command(statusword, mode, has_bit=drive.says_it_follows)
            image.drive_homing_attained = homing_attained(statusword, mode)
            image.drive_homing_error = homing_error(statusword, mode)
        image.drive_age_scans = age_scans = drive.age_scans(scan)
        image.drive_state = self._state if age_scans != AGE_NEVER else _UNKNOWN
        image.drive_internal_limit = self._limited | drive.setpoint_is_clamped
        image.drive_torque_nm = torque * units.torque_nm_per_count
        count = self._position.follow(position)
        if not drive.homes:
            self._home_without_the_drive(drive, mode, count)
        image.drive_angle_rad = (count - self._reference_count) * units.angle_rad_per_count
        image.drive_velocity_rad_s = velocity * units.velocity_rad_s_per_count
        image.drive_nmt_state = drive.nmt_state
        image.drive_heartbeat_age_scans = drive.heartbeat_age_scans(scan)
        image.drive_emcy_code = drive.emcy_code

    def _home_without_the_drive(self, drive: CanDrive, mode: int, count: int) -> None:
        """Be the homing mode of a drive that has none: it stays in torque mode, and is counted from where it stands."""
        image = self._image
        homing = drive.homing_ordered and mode == _TORQUE_MODE
        if homing and drive.reference_ordered:
            self._reference_count = count
        image.drive_mode = _HOMING_MODE if homing else mode
        image.drive_homing_attained = 1 if homing and drive.reference_ordered else 0
        image.drive_homing_error = 0

    def _take_sample(self, values: list[float]) -> None:
        image, self._sample = self._image, values
        torque_in, torque_out, angle_in, angle_out, counter, time_us, status, *delays = self._sample_of(values)
        image.torque_in_nm = float(torque_in)
        image.torque_out_nm = float(torque_out)
        image.angle_in_rad = float(angle_in)
        image.angle_out_rad = float(angle_out)
        image.sample_counter = int(counter) & 0xFFFF_FFFF
        image.sample_time_us = int(time_us) & 0xFFFF_FFFF
        image.sample_status = int(status) & 0xFF
        (
            image.torque_in_delay_scans,
            image.torque_out_delay_scans,
            image.angle_in_delay_scans,
            image.angle_out_delay_scans,
        ) = map(int, delays)

    def _take_lock(self, values: list[float]) -> None:
        image, self._lock = self._image, values
        brake_on, current_a = self._lock_of(values)
        if not self._tells_on:
            brake_on = current_a > 0.0
        if not self._tells_current:  # what was ordered, where the brake is on: see `definitions.device_proofs`
            current_a = (self._brake.ordered("brake_current_a") or self._fixed_current_a) if brake_on else 0.0
        image.brake_on = 1 if brake_on else 0
        image.brake_current_a = float(current_a)

    def _take_contacts(self, values: list[float]) -> None:
        image, self._contacts = self._image, values
        for field, value in zip(REMOTE_IO_FIELDS, self._contacts_of(values), strict=True):
            setattr(image, field.name, float(value) if field.format == "d" else 1 if value else 0)
