"""What an earlier run left behind: the fault that goes on, and a lock that is proven by the torque which it holds.

A controller that has just been started knows nothing of the lock. Yet a unit that stays wound up behind a closed lock,
while nothing drives it, says that the lock holds that torque: unloading it asks for less. This proves a lock for the
way to zero and for nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass

from controller.context import RUNNING, Context, Outcome
from definitions.image import Image


@dataclass(frozen=True)
class Left:
    """How a bench was left: number of the fault that goes on, and the zeroes of the torque sensors [N·m].

    zeroes_known: false where no run of the bench has taken any; the sensors may then show what a zero may be wrong by.
    """

    fault: int
    torque_in_tare_nm: float
    torque_out_tare_nm: float
    zeroes_known: bool = True


class HeldLock:
    """Watches, with the drive off, that lock and torque stay as they are."""

    HOLD_SCANS = 200
    """Scans in a row with fresh samples, a closed lock at its current, and a locked shaft that does not turn."""

    PATIENCE = 5
    """Multiples of that after which the lock is given up."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._held = self._waited = 0

    def begin(self) -> None:
        """Watch anew."""
        self._held = self._waited = 0

    def scan(self, image: Image, elapsed: int) -> Outcome:
        """Advance one scan; sets `lock_proven`, or gives up with the fault `unload_failed`."""
        context = self._context
        measured, limits = context.measured, context.program.limits
        self._waited += elapsed
        at_current = image.brake_current_a >= measured.brake_current_expected_a - measured.brake_tolerance_a
        closed = bool(image.brake_on) and measured.brake_current_expected_a > 0.0 and at_current
        still = abs(measured.locked_motion_rad) <= limits.lock_proof_motion_rad
        fresh = context.sample_is_fresh(image) and image.brake_age_scans <= limits.brake_stale_scans
        loaded = context.left_zeroes_known or abs(measured.controlled_nm) > self._least_nm()
        self._held = self._held + 1 if closed and still and fresh and loaded else 0
        if self._held >= self.HOLD_SCANS:
            context.lock_proven = True
            measured.lock_motion_limit_rad = limits.lock_slip_rad
            context.notes.append(f"lock proven by the {measured.controlled_nm:.1f} N·m that it holds")
        elif self._waited > self.PATIENCE * self.HOLD_SCANS:
            context.notes.append(
                "the lock slips under the residual torque: release the unit by hand"
                if loaded
                else f"{measured.controlled_nm:.1f} N·m may be the zero error of the sensor, because no run has taken "
                "its zero: the lock is not verified, release the unit by hand"
            )
            return Outcome(fault="unload_failed")
        return RUNNING

    def _least_nm(self) -> float:
        """Torque that is more than an unloading leaves even where the zero is as wrong as a run would accept, N·m."""
        program = self._context.program
        tare, control = program.tare, program.control
        zero_nm = tare.torque_out_zero_nm if program.has_torque_out else tare.torque_in_zero_nm * control.slope
        return zero_nm + program.release_torque_nm
