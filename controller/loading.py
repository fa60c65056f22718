"""Runs the segments of the program: torque and speed ramps, dwells, and the unloading, one scan at a time."""

from __future__ import annotations

from controller.calibration import LoadingLine
from controller.context import RUNNING, Context, Outcome
from controller.held_lock import HeldLock
from controller.preparation import ENABLE_PATH
from controller.ramp import SpeedRamp, TorqueRamp
from controller.states import TRIGGER_INTO
from controller.sweep import TorqueSweep
from controller.unloading import Unloading
from definitions.image import DriveCommand, DriveMode, DriveState, Image, State
from definitions.program import Segment, Sweep
from definitions.states import LOADED

TIMEOUT_FAULT: dict[State, str] = {
    State.LOCK: "lock_unproven",
    State.CALIBRATE: "target_not_reached",
    State.RAMP_POS: "target_not_reached",
    State.RAMP_NEG: "target_not_reached",
    State.REVERSE: "target_not_reached",
    State.UNLOAD: "unload_failed",
}
"""What it means when a segment of this state does not end in time."""

# Asked in every scan: a member looked up by its class costs twenty times as much.
_CALIBRATE, _UNLOAD, _VELOCITY_MODE = State.CALIBRATE, State.UNLOAD, DriveMode.CYCLIC_SYNC_VELOCITY


_CYCLES = LOADED - {State.CALIBRATE}
"""States of the load cycles themselves, which follow the torque that the recipe asks for."""


class Loading:
    """Steps through the segments; says by a trigger when the next one belongs to another state."""

    ENABLE, MODE, RUN = 10, 11, 12
    PROOF_MARGIN = 2.0

    def __init__(self, context: Context) -> None:
        self._context = context
        self._torque = TorqueRamp(context.program.control, context.program.period_s)
        self._speed = SpeedRamp(context.program.control, context.program.period_s)
        self._line = LoadingLine()
        self._unloading = Unloading(context, self._torque)
        self._held_lock = HeldLock(context)
        self._sweep = TorqueSweep(context.program.period_s)
        self._waited = 0
        self._target_nm = 0.0
        self._regulating: tuple[int, bool] = (DriveMode.NONE, False)

    def forget(self) -> None:
        """A new run: the loading line is gathered anew, and no ramp is under way."""
        self._line = LoadingLine()
        self._torque.slope = self._context.program.control.slope
        self._regulating = (DriveMode.NONE, False)

    def begin(self, index: int) -> None:
        """Take up a segment: its mode of operation first, when the drive is in another one."""
        context = self._context
        segment = context.program.segments[index]
        context.segment = segment
        self._waited = 0
        if segment.state in _CYCLES:
            context.control_from_input = context.program.control.controlled_from_input
        else:
            context.control_from_input = not context.program.has_torque_out
        self._sweep.begin()
        self._target_nm = self._controlled_target(segment)
        self._bound_torque(segment)
        if context.measured.drive_enabled_expected and (
            segment.dwell_scans or context.drive_mode == self._mode(segment)
        ):
            self._take_over()
            return
        # what comes next begins where the drive then is, never where an older ramp once was
        self._regulating = (DriveMode.NONE, False)
        if not context.measured.drive_enabled_expected:
            context.phase = self.ENABLE
            self._held_lock.begin()
        else:
            context.phase = self.MODE
            context.measured.mode_expected = 0

    def scan(self, image: Image, elapsed: int) -> Outcome:
        """One scan of the segment that is on."""
        context = self._context
        self._waited += elapsed
        segment = context.segment
        if context.phase != self.RUN:
            return self._enable(image) if context.phase == self.ENABLE else self._switch_mode(image, segment)
        state = segment.state
        if state == _CALIBRATE and segment.role == "calibrate":
            self._line.add(segment, context.measured.torque_in_nm, context.measured.torque_out_nm)
        if self._unloading.follow(image) if state == _UNLOAD else self._run(segment, elapsed):
            return self._advance()
        if self._waited > segment.limit_scans and not segment.dwell_scans:
            return Outcome(fault=TIMEOUT_FAULT[segment.state])
        return RUNNING

    @staticmethod
    def _mode(segment: Segment) -> DriveMode:
        return DriveMode.CYCLIC_SYNC_VELOCITY if segment.speed_rad_s else DriveMode.CYCLIC_SYNC_TORQUE

    def _controlled_target(self, segment: Segment) -> float:
        """The target in terms of the controlled torque: by the loading line where the input torque is controlled."""
        context, target_nm = self._context, segment.target_nm
        if not context.control_from_input:
            return target_nm
        offset_nm = context.loading_offset_nm
        return target_nm - offset_nm if target_nm > 0.0 else target_nm + offset_nm

    def _take_over(self) -> None:
        context = self._context
        context.phase = self.RUN
        context.measured.mode_expected = context.drive_mode
        controlled_nm = context.control_from(the_input=context.control_from_input)
        regulating = (context.drive_mode, context.control_from_input)
        if regulating != self._regulating:  # otherwise the reference goes on in value and rate
            self._regulating = regulating
            if context.drive_mode == DriveMode.CYCLIC_SYNC_VELOCITY:
                self._speed.begin()
            else:
                self._torque.begin(controlled_nm, context.drive_torque_nm)
        if context.segment.state == State.UNLOAD:
            self._unloading.begin()

    def _bound_torque(self, segment: Segment) -> None:
        """While the lock is not proven, the drive gets no more torque than a unit with twice the friction takes."""
        control = self._context.program.control
        limit_nm = control.torque_limit_nm
        if segment.state == State.LOCK:
            proof_nm = max(abs(item.target_nm) for item in self._context.program.segments if item.state == State.LOCK)
            limit_nm = self.PROOF_MARGIN * (proof_nm + abs(control.offset_nm)) / control.slope
        self._torque.bound(-limit_nm, limit_nm)

    def _enable(self, image: Image) -> Outcome:
        """Only during the recovery from a fault: the drive comes on without torque, to unwind what is stored."""
        context = self._context
        if context.torque_is_low(image) and not self._left_above_rest():
            return Outcome(trigger="release")
        if not context.lock_proven and context.left_loaded:
            self._waited = 0
            return self._held_lock.scan(image, 1)
        if not context.sample_is_fresh(image):  # what is stored is not known
            return RUNNING if self._waited <= context.program.enable_scans else Outcome(fault="unload_failed")
        if not context.lock_proven:
            context.notes.append("drive not enabled, because the lock is not verified: release the unit by hand")
            return Outcome(fault="unload_failed")
        context.drive_mode = DriveMode.CYCLIC_SYNC_TORQUE
        context.drive_torque_nm = 0.0
        context.drive_command = ENABLE_PATH.get(image.drive_state, DriveCommand.DISABLE_VOLTAGE)
        if image.drive_state == DriveState.OPERATION_ENABLED and image.drive_mode == context.drive_mode:
            context.measured.drive_enabled_expected = True
            self._waited = 0
            self._take_over()
        elif self._waited > context.program.enable_scans:
            return Outcome(fault="drive_enable_timeout")
        return RUNNING

    def _left_above_rest(self) -> bool:
        """Whether a locked unit holds more than an unloading leaves: just below the threshold, noise would decide."""
        context = self._context
        rest_nm = Unloading.SMALL_SHARE * context.program.release_torque_nm
        unloadable = context.lock_proven or context.left_loaded
        locked = unloadable and context.measured.brake_current_expected_a > 0.0
        return locked and abs(context.measured.controlled_nm) > rest_nm

    def _switch_mode(self, image: Image, segment: Segment) -> Outcome:
        context = self._context
        wanted = self._mode(segment)
        if context.drive_mode != wanted:
            context.drive_mode = wanted
            context.take_over_torque(image)
        if image.drive_mode == wanted:
            self._waited = 0
            self._take_over()
        elif self._waited > context.program.mode_scans:
            return Outcome(fault="drive_mode_refused")
        return RUNNING

    def _run(self, segment: Segment, elapsed: int) -> bool:
        context = self._context
        controlled_nm = context.measured.controlled_nm
        if segment.sweep is not None:
            return self._swing(segment.sweep, controlled_nm, elapsed)
        if context.drive_mode == _VELOCITY_MODE:
            if segment.dwell_scans:
                context.drive_velocity_rad_s = 0.0
                return self._waited >= segment.dwell_scans
            done = self._speed.follow(segment, controlled_nm, hold=context.hold)
            context.drive_velocity_rad_s = self._speed.velocity_rad_s
            context.reference_nm = segment.target_nm
            return done
        rate_nm_s = segment.rate_nm_s or context.program.segments[context.program.unload_segment].rate_nm_s
        done = self._torque.follow(self._target_nm, rate_nm_s, controlled_nm, hold=context.hold)
        context.drive_torque_nm = self._torque.drive_nm
        context.reference_nm = self._torque.reference_nm
        return self._waited >= segment.dwell_scans if segment.dwell_scans else done

    def _swing(self, sweep: Sweep, controlled_nm: float, elapsed: int) -> bool:
        """One scan of a sweep about the target; a hold stops its time."""
        context, ramp, swing = self._context, self._torque, self._sweep
        if context.hold:
            ramp.track(ramp.reference_nm, 0.0, controlled_nm)
        else:
            swing.advance(sweep, elapsed)
            ramp.track(self._target_nm + swing.torque_nm, swing.rate_nm_s, controlled_nm)
        context.drive_torque_nm = ramp.drive_nm
        context.reference_nm = ramp.reference_nm
        return swing.is_over(sweep)

    def _advance(self) -> Outcome:
        context = self._context
        segments = context.program.segments
        following = segments[context.segment.index + 1] if context.segment.index + 1 < len(segments) else None
        if context.segment.state == State.CALIBRATE and (following is None or following.state != State.CALIBRATE):
            fitted = self._line.fit() if context.program.control.measure_ratio else None
            if fitted is not None:
                context.loading_slope, context.loading_offset_nm = fitted
                self._torque.slope = fitted[0]
                context.notes.append(f"loading line: T_out = {fitted[1]:.3f} N·m + {fitted[0]:.3f} T_in")
            elif context.program.control.measure_ratio:
                return Outcome(fault="calibration_failed")
        if context.segment.state == State.LOCK and (following is None or following.state != State.LOCK):
            context.measured.lock_motion_limit_rad = context.program.limits.lock_slip_rad
            context.lock_proven = True
            context.notes.append("lock proven")
        if context.segment.state == State.UNLOAD:
            return Outcome(trigger="release")
        if following is None or following.state != context.segment.state:
            return Outcome(trigger=TRIGGER_INTO[following.state] if following is not None else "unload")
        self.begin(following.index)
        return RUNNING
