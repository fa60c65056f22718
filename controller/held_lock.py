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
    """How a bench was left: number of the fault that goes on, and the zeroes of the torque sensors [N·m]."""

    fault: int
    torque_in_tare_nm: float
    torque_out_tare_nm: float


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
        self._held = self._held + 1 if closed and still and fresh else 0
        if self._held >= self.HOLD_SCANS:
            context.lock_proven = True
            measured.lock_motion_limit_rad = limits.lock_slip_rad
            context.notes.append(f"lock proven by the {measured.controlled_nm:.1f} N·m that it holds")
        elif self._waited > self.PATIENCE * self.HOLD_SCANS:
            context.notes.append("the lock slips under the residual torque: release the unit by hand")
            return Outcome(fault="unload_failed")
        return RUNNING
