"""Jog: the shaft turns slowly for as long as a key is held and the enabling device is pressed, and no longer.

Rules, in plain words:
- Motion needs both: a token that is not older than `token_scans`, and the contact of the enabling device. When either
  goes, the speed is brought to zero on a ramp and the drive switched off.
- The contact has to be seen open while the key is held, and only then to close: so one that is stuck, or was pressed
  before the key, moves nothing. Each movement needs that anew.
- Another direction is another movement: it stops, and needs a new press.
- The lock is open. With a closed lock a jog would wind the unit up, so the interlock `brake_stays_closed` is live here,
  and the lock is never touched: what is wound up is unloaded by the recovery, which measures the torque.
- A stop by the operator ends the jog once the drive is off.

Ages and times are counted in scans, missed ones included. The phases and their words are in `definitions.jog`.
"""

from __future__ import annotations

from collections.abc import Callable

from controller.aftermath import DRIVE_IS_OFF
from controller.context import RUNNING, Context, Outcome
from controller.preparation import ENABLE_PATH
from definitions.image import AGE_NEVER, DriveCommand, DriveMode, DriveState, Image
from definitions.jog import DIRECTIONS, JogPhase
from definitions.program import Jog as JogLimits

P = JogPhase
VELOCITY = DriveMode.CYCLIC_SYNC_VELOCITY


class Jog:
    """Steps through the phases of a jog. `limits` are those of the program; nothing is asked of one without."""

    STANDSTILL = 0.1
    """Of the jog's speed: below it the shaft counts as standing, when no speed is ordered any more."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._token_age = self._pressed = self._waited = 0
        self._direction = 0
        self._held = False
        self._scan_by_phase: dict[int, Callable[[Image, JogLimits], Outcome]] = {
            P.ENABLING: self._enable,
            P.TURNING: self._turn,
            P.STOPPING: self._stop,
            P.SWITCHING_OFF: self._switch_off,
        }

    def enter(self, image: Image) -> None:
        """Begin with the drive off and angles from where the shafts stand; no token has come yet."""
        context = self._context
        context.take_references(image)
        context.disable_drive()
        context.phase = P.RELEASE_DEVICE
        self._token_age = AGE_NEVER
        self._pressed = self._waited = self._direction = 0
        self._held = False

    def scan(self, image: Image, elapsed: int) -> Outcome:
        """One scan: `stopped` once a stop was ordered and the drive is off; a fault where something does not end."""
        context, jog = self._context, self._context.program.jog
        if jog is None:
            return Outcome(trigger="stopped")
        self._waited += elapsed
        self._take_token(image, elapsed, jog)
        self._pressed = self._pressed + elapsed if image.enabling_device else 0
        if self._pressed > jog.longest_press_scans:
            return Outcome(fault="enabling_device_stuck")
        return self._scan_by_phase.get(context.phase, self._wait)(image, jog)

    def _take_token(self, image: Image, elapsed: int, jog: JogLimits) -> None:
        """Age the token, then take a new one; one that comes too late has been missed all the same."""
        self._token_age = min(self._token_age + elapsed, AGE_NEVER)
        self._held = self._token_age <= jog.token_scans and not self._context.stopping
        direction = DIRECTIONS.get(image.command, 0)
        if direction:
            self._held = self._held and direction == self._direction
            self._direction, self._token_age = direction, 0

    def _next(self, phase: JogPhase) -> Outcome:
        self._context.phase = phase
        self._waited = 0
        return RUNNING

    def _wait(self, image: Image, _jog: JogLimits) -> Outcome:
        """Drive off: contact seen open with the key held, then the contact closed."""
        if self._context.stopping:
            return Outcome(trigger="stopped")
        phase, pressed = self._context.phase, bool(image.enabling_device)
        if phase == P.PRESS_DEVICE and self._held:
            return self._next(P.ENABLING) if pressed else RUNNING
        if pressed:
            return self._next(P.RELEASE_DEVICE)
        return self._next(P.PRESS_DEVICE if self._held and phase != P.RELEASE_DEVICE else P.HOLD_KEY)

    def _enable(self, image: Image, _jog: JogLimits) -> Outcome:
        context = self._context
        if not (self._held and image.enabling_device):
            context.disable_drive()
            return self._next(P.SWITCHING_OFF)
        context.drive_mode = VELOCITY
        context.drive_velocity_rad_s = 0.0
        context.drive_command = ENABLE_PATH.get(image.drive_state, DriveCommand.DISABLE_VOLTAGE)
        if image.drive_state == DriveState.OPERATION_ENABLED and image.drive_mode == VELOCITY:
            context.measured.drive_enabled_expected = True
            context.measured.mode_expected = VELOCITY
            return self._next(P.TURNING)
        if self._waited > context.program.enable_scans:
            return Outcome(fault="drive_enable_timeout")
        return RUNNING

    def _turn(self, image: Image, jog: JogLimits) -> Outcome:
        if not (self._held and image.enabling_device):
            self._next(P.STOPPING)
            return self._stop(image, jog)
        self._approach(self._direction * jog.speed_rad_s, jog.acceleration_rad_s2)
        return RUNNING

    def _stop(self, image: Image, jog: JogLimits) -> Outcome:
        context = self._context
        self._approach(0.0, jog.deceleration_rad_s2)
        standing = abs(image.drive_velocity_rad_s) <= self.STANDSTILL * jog.speed_rad_s
        if context.drive_velocity_rad_s == 0.0 and standing:
            context.disable_drive()
            return self._next(P.SWITCHING_OFF)
        return Outcome(fault="jog_not_stopped") if self._waited > jog.stop_scans else RUNNING

    def _switch_off(self, image: Image, _jog: JogLimits) -> Outcome:
        if image.drive_state in DRIVE_IS_OFF:
            return self._next(P.RELEASE_DEVICE)
        if self._waited > self._context.program.enable_scans:
            return Outcome(fault="jog_not_stopped")
        return RUNNING

    def _approach(self, speed_rad_s: float, acceleration_rad_s2: float) -> None:
        """Bring the ordered speed nearer to the wanted one, by no more than a period's acceleration."""
        context = self._context
        step = acceleration_rad_s2 * context.program.period_s
        ordered = context.drive_velocity_rad_s
        context.drive_velocity_rad_s = min(ordered + step, max(ordered - step, speed_rad_s))
