"""A bench of a few lines for the controller's timelines: an obedient drive, a reducer with friction, a lock that holds.

No physics worth measuring: it answers the controller's orders one scan later so that sequences run to their end.
"""

from __future__ import annotations

from dataclasses import replace

from definitions.image import IMAGE_FIELDS, Command, DriveCommand, DriveMode, DriveState, Image, NmtState, Orders
from definitions.program import Program

AT_REST = Image(*(0.0 if field.format == "d" else 0 for field in IMAGE_FIELDS))
READY = AT_REST._replace(
    command=Command.NONE, drive_state=DriveState.SWITCH_ON_DISABLED, drive_statusword=0x40, drive_follows_command=1,
    drive_age_scans=1, drive_nmt_state=NmtState.OPERATIONAL, drive_heartbeat_age_scans=5, sample_age_scans=1,
    brake_age_scans=3, estop_released=1, guard_closed=1, housing_temp_c=23.0, ambient_temp_c=21.0, io_age_scans=4,
)  # fmt: skip

NEXT_STATE = {
    (DriveState.SWITCH_ON_DISABLED, DriveCommand.SHUTDOWN): DriveState.READY_TO_SWITCH_ON,
    (DriveState.READY_TO_SWITCH_ON, DriveCommand.SWITCH_ON): DriveState.SWITCHED_ON,
    (DriveState.SWITCHED_ON, DriveCommand.ENABLE_OPERATION): DriveState.OPERATION_ENABLED,
    (DriveState.OPERATION_ENABLED, DriveCommand.QUICK_STOP): DriveState.QUICK_STOP_ACTIVE,
    (DriveState.QUICK_STOP_ACTIVE, DriveCommand.QUICK_STOP): DriveState.SWITCH_ON_DISABLED,
    (DriveState.FAULT, DriveCommand.FAULT_RESET): DriveState.SWITCH_ON_DISABLED,
}


class BenchModel:
    """Input-loading bench: output torque is a play (friction) of the drive torque, angles are torque over stiffness."""

    SLOPE_LOADING, SLOPE_UNLOADING, FRICTION_NM = 95.0, 168.0, 0.147

    def __init__(self, program: Program) -> None:
        self.program = program
        self.image = READY
        self.command = Command.NONE
        self.zero_in_nm = 0.01
        self.drive_zero_rad, self.drive_gear_error = 40.0, 1.0
        self.lock_holds = self.shaft_follows = True
        self.homing_scans = 0
        self.frozen: dict[str, float] = {}

    def read(self) -> Image:
        image = self.image._replace(**{"command": self.command, **self.frozen})
        self.command = Command.NONE
        return image

    def write(self, orders: Orders) -> None:
        image = self.image
        state = DriveState(image.drive_state)
        if orders.drive_command == DriveCommand.DISABLE_VOLTAGE and state != DriveState.FAULT:
            state = DriveState.SWITCH_ON_DISABLED
        state = NEXT_STATE.get((state, DriveCommand(orders.drive_command)), state)
        enabled = state == DriveState.OPERATION_ENABLED
        homing = enabled and orders.drive_command == DriveCommand.START_HOMING
        self.homing_scans = self.homing_scans + 1 if homing else 0
        torque_in = image.torque_in_nm - self.zero_in_nm
        angle, speed = image.angle_in_rad, 0.0
        stiffness = self.program.control.stiffness_nm_per_rad
        torque_out = image.torque_out_nm
        if enabled and orders.drive_mode == DriveMode.CYCLIC_SYNC_TORQUE:
            torque_in = orders.drive_target_torque_nm
            torque_out = self.friction(torque_in, torque_out)
            angle = torque_out / stiffness
        elif enabled and orders.drive_mode == DriveMode.CYCLIC_SYNC_VELOCITY:
            speed = orders.drive_target_velocity_rad_s if self.shaft_follows else image.drive_velocity_rad_s
            angle += speed * self.program.period_s
            torque_out = angle * stiffness if orders.brake_on else 0.0  # with the lock open the unit turns
            torque_in = self.input_torque(torque_out, 1.0 if speed >= 0 else -1.0)
        elif not enabled:
            torque_in = torque_out = 0.0
        if not self.lock_holds and abs(torque_out) > 20.0:
            torque_out = 20.0 if torque_out > 0 else -20.0
        slip = 0.0 if self.lock_holds else torque_out * 1e-4
        self.image = image._replace(
            drive_state=state, drive_mode=orders.drive_mode, drive_homing_attained=int(self.homing_scans > 3),
            drive_torque_nm=torque_in, drive_velocity_rad_s=0.0 if orders.brake_on else speed,
            drive_angle_rad=self.drive_zero_rad + self.drive_gear_error * angle,
            torque_in_nm=torque_in + self.zero_in_nm,
            torque_out_nm=torque_out, angle_in_rad=angle, angle_out_rad=slip + torque_out * 3e-8,
            sample_counter=image.sample_counter + 1, sample_time_us=image.sample_time_us + 1000,
            brake_on=orders.brake_on, brake_current_a=orders.brake_current_a * 0.999,
        )  # fmt: skip

    def input_torque(self, torque_out: float, moving: float) -> float:
        """Input torque on the loading or the unloading line of a reducer with friction."""
        loading = torque_out * moving >= 0.0
        slope = self.SLOPE_LOADING if loading else self.SLOPE_UNLOADING
        return torque_out / slope + moving * self.FRICTION_NM

    def friction(self, torque_in: float, torque_out: float) -> float:
        """Play: the output torque moves only when the input has crossed the friction."""
        for moving in (1.0, -1.0):
            pushed = torque_in - moving * self.FRICTION_NM
            slope = self.SLOPE_LOADING if pushed * moving >= 0.0 else self.SLOPE_UNLOADING
            if (pushed * slope - torque_out) * moving > 0.0:
                return pushed * slope
        return torque_out


def freeze_limits(program: Program, **changes: float) -> Program:
    """The same program with other interlock limits."""
    return replace(program, limits=replace(program.limits, **changes))
