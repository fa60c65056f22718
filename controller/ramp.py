"""Set-points that are continuous in value and in rate: ramps by torque and ramps at constant speed.

By torque: a reference moves towards the target along a trapezoid of rate, and the drive's torque follows by an integral
law with feed-forward,

    dT_drive/dt = (dr/dt + k (r - T)) / slope,   |dT_drive/dt| <= slew,

where T is the controlled torque. Friction reverses with the motion, so at a turning point the output torque stands
still while the drive crosses twice the friction. The reference waits for it: its rate fades to zero as r - T fills the
window. That keeps the step after break-away as small as the window, without knowing the friction.

At constant speed: the velocity follows a trapezoid and brakes in time, so that it is near zero when the torque arrives.
"""

from __future__ import annotations

from math import sqrt

from definitions.program import Segment, TorqueControl


class TorqueRamp:
    """Reference and drive torque of a ramp by torque; all torques in N·m, rates in N·m/s."""

    __slots__ = ("_control", "_period_s", "_rate", "drive_nm", "high_nm", "low_nm", "reference_nm", "slope")

    def __init__(self, control: TorqueControl, period_s: float) -> None:
        self._control = control
        self._period_s = period_s
        self._rate = 0.0
        self.reference_nm = 0.0
        self.drive_nm = 0.0
        self.slope = control.slope
        self.bound(-control.torque_limit_nm, control.torque_limit_nm)

    def bound(self, low_nm: float, high_nm: float) -> None:
        """Keep the drive's torque within these from now on, whatever the controlled torque says."""
        limit_nm = self._control.torque_limit_nm
        self.low_nm, self.high_nm = max(-limit_nm, low_nm), min(limit_nm, high_nm)

    @property
    def at_bound(self) -> bool:
        """True while the drive's torque can go no further in one direction."""
        return self.drive_nm in (self.low_nm, self.high_nm)

    def begin(self, controlled_nm: float, drive_nm: float) -> None:
        """Take over at the torque that is there: no step in the reference, none in the drive's torque."""
        self.reference_nm = controlled_nm
        self.drive_nm = drive_nm
        self._rate = 0.0

    def follow(self, target_nm: float, rate_nm_s: float, controlled_nm: float, *, hold: bool) -> bool:
        """Advance one period; True once the reference is at the target and the controlled torque with it."""
        control, period_s = self._control, self._period_s
        error_nm = self.reference_nm - controlled_nm
        remaining_nm = target_nm - self.reference_nm
        wanted = 0.0
        if not hold and remaining_nm:
            direction = 1.0 if remaining_nm > 0.0 else -1.0
            acceleration = rate_nm_s / control.rate_acceleration_s
            # braking law sqrt(2 a d), less the period that is already under way
            distance_nm = abs(remaining_nm)
            wanted = min(rate_nm_s, sqrt(2.0 * acceleration * distance_nm), distance_nm / period_s)
            lead = error_nm * direction / control.window_nm
            if lead > 0.5:
                wanted *= max(0.0, 2.0 * (1.0 - lead))
            wanted *= direction
        step = abs(rate_nm_s) / control.rate_acceleration_s * period_s
        # speeding up is limited; slowing down follows the braking law, which is within the same acceleration
        if abs(wanted) > abs(self._rate) or wanted * self._rate < 0.0:
            self._rate += min(step, max(-step, wanted - self._rate))
        else:
            self._rate = wanted
        advance_nm = self._rate * period_s
        if abs(advance_nm) >= abs(remaining_nm) and advance_nm * remaining_nm > 0.0:
            advance_nm = remaining_nm
        self.reference_nm += advance_nm
        self._drive(error_nm)
        there = abs(target_nm - controlled_nm) <= control.tolerance_nm
        return there and abs(target_nm - self.reference_nm) <= 1e-9

    def track(self, reference_nm: float, rate_nm_s: float, controlled_nm: float) -> None:
        """Advance one period along a reference that somebody else moves, continuous in value and rate."""
        error_nm = self.reference_nm - controlled_nm
        self.reference_nm, self._rate = reference_nm, rate_nm_s
        self._drive(error_nm)

    def _drive(self, error_nm: float) -> None:
        """Move the drive's torque by the reference's rate and its distance to the torque, within slew and bounds."""
        control, period_s = self._control, self._period_s
        drive_rate = (self._rate + control.gain_per_s * error_nm) / self.slope
        # a comparison first: within the limits, as it nearly always is, nothing has to be cut
        slew_nm_s = control.slew_nm_s
        if not -slew_nm_s < drive_rate < slew_nm_s:
            drive_rate = min(slew_nm_s, max(-slew_nm_s, drive_rate))
        drive_nm = self.drive_nm + drive_rate * period_s
        if not self.low_nm < drive_nm < self.high_nm:
            # back from beyond a bound that came later: at the slew, not in one step
            step_nm = slew_nm_s * period_s
            low_nm, high_nm = min(self.low_nm, self.drive_nm + step_nm), max(self.high_nm, self.drive_nm - step_nm)
            drive_nm = min(high_nm, max(low_nm, drive_nm))
        self.drive_nm = drive_nm

    def relax(self) -> bool:
        """Take the drive's torque towards zero at the largest slew, whatever the unit does; True once it is zero."""
        step = self._control.slew_nm_s * self._period_s
        self.drive_nm -= min(step, max(-step, self.drive_nm))
        self._rate = 0.0
        return self.drive_nm == 0.0


class SpeedRamp:
    """Velocity of a ramp at constant speed until a torque; speeds of the loaded shaft in rad/s."""

    __slots__ = ("_period_s", "_stiffness", "velocity_rad_s")

    CREEP_SHARE = 0.05
    """Share of the speed that is kept near the target, so that the torque is reached and not approached for ever."""

    def __init__(self, control: TorqueControl, period_s: float) -> None:
        self._period_s = period_s
        self._stiffness = control.stiffness_nm_per_rad
        self.velocity_rad_s = 0.0

    def begin(self) -> None:
        """Start from standstill."""
        self.velocity_rad_s = 0.0

    def follow(self, segment: Segment, controlled_nm: float, *, hold: bool) -> bool:
        """Advance one period; True once the torque has been reached and the shaft stands."""
        direction = float(segment.direction)
        remaining_nm = (segment.target_nm - controlled_nm) * direction
        wanted = 0.0
        if not hold and remaining_nm > 0.0:
            braking = sqrt(2.0 * segment.acceleration_rad_s2 * remaining_nm / self._stiffness)
            wanted = direction * max(min(segment.speed_rad_s, braking), self.CREEP_SHARE * segment.speed_rad_s)
        step = segment.acceleration_rad_s2 * self._period_s
        self.velocity_rad_s += min(step, max(-step, wanted - self.velocity_rad_s))
        return remaining_nm <= 0.0 and self.velocity_rad_s == 0.0
