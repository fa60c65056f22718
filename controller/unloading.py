"""Torque to zero so that it stays zero: friction would hold a rest in the unit once the drive lets go.

When the output torque has come to zero, the input still carries its friction torque. Switching the drive off there
would let the output torque rise again by what the friction held. So the drive's torque is relaxed to zero first, the
rest is read, and the unloading is repeated past zero by that rest until it is small. A handful of passes is enough.
"""

from __future__ import annotations

import math

from controller.context import Context
from controller.ramp import TorqueRamp
from definitions.image import Image


class Unloading:
    """Brings the torque to zero with the drive in torque mode; `follow` once per scan until it answers True."""

    RELAX_SCANS = 50
    SMALL_SHARE = 0.5
    """Rest that is accepted, as a share of the torque at which the lock may open."""

    FRICTION_MARGIN = 2.5
    """How far past zero the drive's torque may go, in multiples of the friction by the loading line."""

    LEAST_MARGIN_OF_LIMIT = 0.08
    """And at least this share of the drive's limit, for units whose friction is not known."""

    STUCK_SCANS = 500
    """At that bound for so long, the controlled torque is no longer believed: the drive's torque is relaxed."""

    def __init__(self, context: Context, ramp: TorqueRamp) -> None:
        self._context = context
        self._ramp = ramp
        self._target_nm = 0.0
        self._relaxing = False
        self._at_rest = self._at_bound = 0

    def begin(self) -> None:
        """Start towards zero from wherever the torque is.

        A torque sensor that is stuck would lead the drive through zero and up on the other side; so the drive's torque
        is let past zero by no more than friction can ask for.
        """
        context = self._context
        control = context.program.control
        margin_nm = max(
            self.FRICTION_MARGIN * abs(context.loading_offset_nm) / control.slope,
            self.LEAST_MARGIN_OF_LIMIT * control.torque_limit_nm,
        )
        drive_nm = self._ramp.drive_nm
        self._ramp.bound(min(0.0, drive_nm) - margin_nm, max(0.0, drive_nm) + margin_nm)
        self._at_bound = 0
        self._relaxing = False
        self._target_nm = 0.0
        if context.control_from_input:
            # without an output sensor, the loading line tells how far past zero the input has to go
            self._target_nm = math.copysign(context.loading_offset_nm, -context.measured.controlled_nm)

    def follow(self, image: Image) -> bool:
        """Advance one scan; True once the drive's torque is zero and so is the unit's, as far as can be measured.

        A rest is read from a fresh sample only; `sample_stale` ends the wait for one.
        """
        context, ramp = self._context, self._ramp
        program, controlled_nm = context.program, context.measured.controlled_nm
        if not self._relaxing:
            rate_nm_s = program.segments[program.unload_segment].rate_nm_s
            self._relaxing = ramp.follow(self._target_nm, rate_nm_s, controlled_nm, hold=False)
            self._at_bound = self._at_bound + 1 if ramp.at_bound else 0
            self._relaxing = self._relaxing or self._at_bound > self.STUCK_SCANS
            self._at_rest = 0
        elif ramp.relax():
            self._at_rest += 1
            if self._at_rest >= self.RELAX_SCANS:
                small = abs(controlled_nm) <= self.SMALL_SHARE * program.release_torque_nm
                known = context.sample_is_fresh(image)
                if context.control_from_input or (small and known) or self._at_bound > self.STUCK_SCANS:
                    return True
                if known:
                    self._target_nm -= controlled_nm
                    self._relaxing = False
                    ramp.begin(controlled_nm, 0.0)
        context.drive_torque_nm = ramp.drive_nm
        context.reference_nm = ramp.reference_nm
        return False
