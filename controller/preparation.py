"""Steps before any torque: devices ready, zeroes taken, drive enabled and referenced, lock closed."""

from __future__ import annotations

from controller.context import RUNNING, Context, Outcome
from definitions.image import DriveCommand, DriveMode, DriveState, Image, NmtState

ENABLE_PATH: dict[int, DriveCommand] = {
    DriveState.SWITCH_ON_DISABLED: DriveCommand.SHUTDOWN,
    DriveState.READY_TO_SWITCH_ON: DriveCommand.SWITCH_ON,
    DriveState.SWITCHED_ON: DriveCommand.ENABLE_OPERATION,
    DriveState.OPERATION_ENABLED: DriveCommand.ENABLE_OPERATION,
}
"""CiA 402 command that leads one step on towards OPERATION_ENABLED; any other state gets DISABLE_VOLTAGE."""


class Readiness:
    """Waits, in IDLE and after the start command, until every device has delivered fresh data."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._waited = 0

    def enter(self) -> None:
        """Begin to wait."""
        self._waited = 0

    def scan(self, image: Image, elapsed: int) -> Outcome:
        """`start` when all devices are fresh, `devices_not_ready` after the time allowed."""
        limits = self._context.program.limits
        missing = [
            name
            for name, age, limit in (
                ("servo drive heartbeat", image.drive_heartbeat_age_scans, limits.heartbeat_scans),
                ("servo drive process data", image.drive_age_scans, limits.drive_stale_scans),
                ("measuring amplifier", image.sample_age_scans, limits.sample_stale_scans),
                ("brake supply", image.brake_age_scans, limits.brake_stale_scans),
                ("remote I/O", image.io_age_scans, limits.io_stale_scans),
            )
            if age > limit
        ]
        if image.sample_status:
            missing.append("measuring amplifier without sensor fault")
        if image.drive_nmt_state != NmtState.OPERATIONAL:
            missing.append("servo drive in the operational state")
        if not missing:
            return Outcome(trigger="start")
        self._waited += elapsed
        if self._waited > self._context.program.ready_scans:
            self._context.notes.append(f"no fresh data from: {', '.join(missing)}")
            return Outcome(fault="devices_not_ready")
        return RUNNING


class Home:
    """Zeroes at rest with the drive off, then the drive step by step to operation enabled, then the reference.

    The lock is still open here, so homing must not move the shaft: the drive takes the position where it stands as its
    reference.
    """

    TARE, ENABLE, HOMING, TORQUE_MODE = 1, 2, 3, 4

    def __init__(self, context: Context) -> None:
        self._context = context
        self._forget()

    def enter(self, image: Image) -> None:
        """Begin with the zeroes; the drive is off."""
        context = self._context
        context.take_references(image)
        context.disable_drive()
        context.phase = self.TARE
        self._forget()

    def _forget(self) -> None:
        self._waited = 0
        self._counter = -1
        self._n = 0
        self._sums = [0.0, 0.0]
        self._low = [float("inf")] * 2
        self._high = [float("-inf")] * 2

    def scan(self, image: Image, elapsed: int) -> Outcome:
        """One scan of the phase that is on."""
        self._waited += elapsed
        phase = self._context.phase
        if phase == self.TARE:
            return self._tare(image)
        if phase == self.ENABLE:
            return self._enable(image)
        if phase == self.HOMING:
            return self._homing(image)
        return self._torque_mode(image)

    def _next(self, phase: int) -> Outcome:
        self._context.phase = phase
        self._waited = 0
        return RUNNING

    def _tare(self, image: Image) -> Outcome:
        context, tare = self._context, self._context.program.tare
        if image.sample_counter == self._counter:
            return RUNNING  # each sample counts once; `sample_frozen` watches a counter that stands
        self._counter = image.sample_counter
        for channel, value in enumerate((image.torque_in_nm, image.torque_out_nm)):
            self._sums[channel] += value
            self._low[channel] = min(self._low[channel], value)
            self._high[channel] = max(self._high[channel], value)
        self._n += 1
        if self._n < tare.samples:
            return RUNNING
        zeroes = [total / self._n for total in self._sums]
        zero_limits = (tare.torque_in_zero_nm, tare.torque_out_zero_nm)
        spread_limits = (tare.torque_in_spread_nm, tare.torque_out_spread_nm)
        for channel, name in enumerate(("input torque", "output torque")):
            spread_nm = self._high[channel] - self._low[channel]
            if abs(zeroes[channel]) > zero_limits[channel]:
                allowed_nm = zero_limits[channel]
                context.notes.append(f"zero of {name}: {zeroes[channel]:.4g} N·m, allowed ±{allowed_nm:.4g} N·m")
                return Outcome(fault="tare_out_of_range")
            if spread_nm > spread_limits[channel]:
                context.notes.append(f"spread of {name}: {spread_nm:.4g} N·m, allowed {spread_limits[channel]:.4g} N·m")
                return Outcome(fault="tare_unsteady")
        context.torque_in_tare_nm, context.torque_out_tare_nm = zeroes
        return self._next(self.ENABLE)

    def _enable(self, image: Image) -> Outcome:
        context = self._context
        context.drive_mode = DriveMode.HOMING
        context.drive_command = ENABLE_PATH.get(image.drive_state, DriveCommand.DISABLE_VOLTAGE)
        if image.drive_state == DriveState.OPERATION_ENABLED and image.drive_mode == DriveMode.HOMING:
            context.measured.drive_enabled_expected = True
            return self._next(self.HOMING)
        if self._waited > context.program.enable_scans:
            return Outcome(fault="drive_enable_timeout")
        return RUNNING

    def _homing(self, image: Image) -> Outcome:
        context = self._context
        context.drive_command = DriveCommand.START_HOMING
        if image.drive_homing_error:
            return Outcome(fault="homing_failed")
        if image.drive_homing_attained:
            return self._next(self.TORQUE_MODE)
        if self._waited > context.program.homing_scans:
            return Outcome(fault="homing_failed")
        return RUNNING

    def _torque_mode(self, image: Image) -> Outcome:
        context = self._context
        context.drive_command = DriveCommand.ENABLE_OPERATION
        context.drive_mode = DriveMode.CYCLIC_SYNC_TORQUE
        context.drive_torque_nm = 0.0
        if image.drive_mode == DriveMode.CYCLIC_SYNC_TORQUE:
            context.measured.mode_expected = DriveMode.CYCLIC_SYNC_TORQUE
            context.take_references(image)
            return Outcome(trigger="close_lock")
        if self._waited > context.program.mode_scans:
            return Outcome(fault="drive_mode_refused")
        return RUNNING


class CloseLock:
    """Brake current on, reached and settled; the position of the locked shaft is then its reference."""

    CLOSE, SETTLE, PROOF = 1, 2, 3

    def __init__(self, context: Context) -> None:
        self._context = context
        self._waited = 0

    def enter(self) -> None:
        """Switch the brake on; the drive stays enabled with no torque."""
        context = self._context
        context.phase = self.CLOSE
        context.lock_found = False
        context.brake_on = 1
        context.brake_current_a = context.program.lock.current_a
        self._waited = 0

    def scan(self, image: Image, elapsed: int) -> Outcome:
        """`closed` (a trigger of no state: the proof follows) when the lock has settled."""
        context, lock = self._context, self._context.program.lock
        self._waited += elapsed
        if context.phase == self.CLOSE:
            if image.brake_on and abs(image.brake_current_a - lock.current_a) <= lock.tolerance_a:
                context.phase = self.SETTLE
                self._waited = 0
                context.measured.brake_current_expected_a = lock.current_a
                context.measured.brake_tolerance_a = lock.tolerance_a
            elif self._waited > lock.limit_scans:
                return Outcome(fault="lock_not_closed")
            return RUNNING
        if self._waited < lock.settle_scans:
            return RUNNING
        context.phase = self.PROOF
        context.lock_zero_rad = context.locked_angle_rad(image)
        context.measured.lock_motion_limit_rad = context.program.limits.lock_proof_motion_rad
        return Outcome(trigger="closed")
