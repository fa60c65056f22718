"""How a loop was measured, as far as errors depend on it: speeds, times, the chain of sensors, the calibration."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from analysis.loop.branches import Branch
from analysis.loop.closure import closure_gaps_arcmin
from analysis.loop.interruptions import Interruption
from analysis.loop.loop import Loop
from analysis.loop.measured import Measured
from analysis.loop.method import Method
from analysis.loop.samples import BranchSamples, converts
from analysis.torque_ratio.quadrant_fit import LOADING_RANGE, UNLOADING_RANGE
from analysis.torque_ratio.quadrants import QUADRANTS, Quadrants, TorqueLine
from analysis.trace.units import FloatArray
from analysis.uncertainty.figures import TorqueChannel
from analysis.uncertainty.scatter import USUAL, Coverage, coverage_of
from analysis.uncertainty.seen_in_run import (
    NO_SLOW_NOISE,
    DelayTried,
    SlowNoise,
    delay_tried,
    locked_width_arcmin,
    noise_seen_arcmin,
    slow_noise_seen,
    torque_steps_nm,
)

AngleName = Literal["angle_in", "angle_out"]

LINE_POINTS = 100
"""Torques at which an error that bends a calibration line is evaluated."""


class Stretch(NamedTuple):
    """One branch in time: samples, start [s] and duration [s]; no times in a trace without a time column.

    delayed: what a delay of the torque does to the branch, by a trial of it; None where it could not be tried.
    """

    samples: int
    start_s: float
    seconds: float
    delayed: DelayTried | None = None

    @property
    def timed(self) -> bool:
        """Say whether the times are known."""
        return math.isfinite(self.start_s) and self.seconds > 0.0


class Points(NamedTuple):
    """Torque at the output [N·m] and wind-up [arcmin] of a branch, direction (+1 rising), input torque, and time.

    slope: of the calibration line at each point. torque_in_nm and seconds are None where they are not known; slope and
    rate_nm_s are 0 then. late_arcmin_s: change of the wind-up per second by which the torque is late; None where the
    rate is all that tells it.
    """

    torque_nm: FloatArray
    angle_arcmin: FloatArray
    direction: int
    torque_in_nm: FloatArray | None
    slope: FloatArray | float
    seconds: FloatArray | None
    rate_nm_s: float
    late_arcmin_s: FloatArray | None = None


@dataclass(frozen=True)
class MeasurementConditions:
    """Method, branches in time of the first cycle, encoders in the wind-up, and whether the fixture was corrected.

    u_drift_arcmin_per_min: standard uncertainty of what is left of the drift between cycles; 0 where it has no rate.
    unseen_drift_arcmin_per_min: largest drift that the gap of the loop allows where no second cycle shows it; 0 where
    one does, or where there is no gap to read. masked_nm: torque that is masked after the negative turn, where the
    rising branch begins, and after the positive one. u_skew_s: standard uncertainty of a skew of torque and angle that
    was estimated from the cycles; 0 where it was not. late_s: delay of the torque behind the wind-up that the ends of
    ramps, or the turns of the load, show and nothing has corrected; 0 where they show none. interruptions: of the
    branches of all cycles, so many. zero_shifts_nm: by how much torque zeroes had moved when they were read again after
    the run, of the channels where they were. zeroes_shown_nm: how far off torque zeroes can be, of the channels whose
    lines show more than is declared. torque_steps_nm: of the torques that were recorded in coarse steps. coverage: with
    which k an uncertainty is stated. noise_seen_arcmin, locked_width_arcmin, slow_noise: what angles and torques show
    of their own errors (`seen_in_run`). way_arcmin: that
    the loaded shaft turns in a cycle, at the output. left_open: sizes of the errors that the validity checks leave open
    and the budget shall have, by check, in the unit of its error.
    """

    method: Method
    peak_nm: float
    forward: Stretch
    backward: Stretch
    encoders: tuple[AngleName, ...]
    fixture_corrected: bool
    converted: bool
    quadrants: Quadrants | None
    u_drift_arcmin_per_min: float = 0.0
    unseen_drift_arcmin_per_min: float = 0.0
    masked_nm: tuple[float, float] = (0.0, 0.0)
    u_skew_s: float = 0.0
    late_s: float = 0.0
    interruptions: tuple[Interruption, ...] = ()
    coverage: Coverage = USUAL
    cycles: int = 1
    zero_shifts_nm: Mapping[TorqueChannel, float] = field(default_factory=dict)
    zeroes_shown_nm: Mapping[TorqueChannel, float] = field(default_factory=dict)
    torque_steps_nm: Mapping[TorqueChannel, float] = field(default_factory=dict)
    noise_seen_arcmin: float = 0.0
    slow_noise: SlowNoise = NO_SLOW_NOISE
    locked_width_arcmin: float = 0.0
    way_arcmin: float = 0.0
    left_open: Mapping[str, float] = field(default_factory=dict)

    @property
    def lines_of_this_run(self) -> bool:
        """Say whether the calibration lines were measured in this run, by the same sensors and tares."""
        return self.quadrants is not None and bool(self.quadrants.fits)

    def corrects(self, direction: int) -> bool:
        """Say whether what the lines of this run left over while calibrating is taken off a branch."""
        return self.quadrants is not None and self.quadrants.leftovers(direction) is not None

    @property
    def locked(self) -> str:
        """Encoder of the locked shaft."""
        return "angle_out" if self.method.loading == "input" else "angle_in"

    def points_of(self, loop: Loop) -> tuple[Points, Points]:
        """Return the rising and the falling branch of a loop with what errors depend on."""
        return self.points(loop.forward, 1), self.points(loop.backward, -1)

    def points(self, branch: Branch, direction: int) -> Points:
        """Return a branch with what errors depend on."""
        torque = branch.torque_nm
        stretch = self.forward if direction > 0 else self.backward
        seconds, rate, late = None, 0.0, None
        if stretch.timed:
            rate = direction * float(torque[-1] - torque[0]) / stretch.seconds
            seconds = stretch.start_s + (torque - torque[0 if direction > 0 else -1]) / rate
            if stretch.delayed is not None:
                late = np.interp(torque, *stretch.delayed)
        torque_in = self._torque_in(torque, direction)
        return Points(torque, branch.angle_arcmin, direction, *torque_in, seconds, rate, late)

    def _torque_in(self, torque_nm: FloatArray, direction: int) -> tuple[FloatArray | None, FloatArray | float]:
        """Input torque by the calibration lines, and their slopes."""
        if self.quadrants is None:
            return None, 0.0
        positive, negative = (getattr(self.quadrants, line_name(sign, direction)) for sign in (1, -1))
        slope = np.where(torque_nm >= 0.0, positive.slope, negative.slope)
        offset = np.where(torque_nm >= 0.0, positive.offset_nm, negative.offset_nm)
        return (torque_nm - offset) / slope, slope

    @cached_property
    def line_points(self) -> dict[str, Points]:
        """Points of the four calibration lines, as they are fitted."""
        found = {}
        if self.quadrants is None:
            return {}
        for name in QUADRANTS:
            sign, loading = (1 if name.endswith("positive") else -1), name.startswith("load")
            low, high = LOADING_RANGE if loading else UNLOADING_RANGE
            line: TorqueLine = getattr(self.quadrants, name)
            if name in self.quadrants.begins_nm and name in self.quadrants.fits:  # it may begin beyond these cycles
                fitted_nm = np.abs(self.quadrants.fits[name].outputs_nm)
                low, high = (float(end) / self.peak_nm for end in (fitted_nm.min(), fitted_nm.max()))
            torque = sign * self.peak_nm * np.linspace(low, high, LINE_POINTS)
            torque_in = (torque - line.offset_nm) / line.slope
            direction = sign if loading else -sign
            rate = self.points(Branch(np.array([-self.peak_nm, self.peak_nm]), np.zeros(2)), direction).rate_nm_s
            found[name] = Points(torque, np.zeros_like(torque), direction, torque_in, line.slope, None, rate)
        return found


def line_name(sign: int, direction: int) -> str:
    """Name the line that holds for a sign of torque and a direction of motion."""
    return f"{'load' if sign == direction else 'unload'}_{'positive' if sign > 0 else 'negative'}"


def conditions_of(
    found: Measured, *, late_s: float = 0.0, zero_shifts_nm: Mapping[TorqueChannel, float] | None = None,
    zeroes_shown_nm: Mapping[TorqueChannel, float] | None = None, left_open: Mapping[str, float] | None = None,
    holds: int | None = None,
) -> MeasurementConditions:  # fmt: skip
    """Return how the first cycle of a measurement was made; what is named here is as in `MeasurementConditions`."""
    method, trace, loop = found.method, found.trace, found.loops[0]
    encoders: dict[str, tuple[AngleName, ...]] = {
        "both": ("angle_in", "angle_out"),
        "loaded": ("angle_in" if method.loading == "input" else "angle_out",),
        "given": (),
    }
    curve = method.fixture_curve
    by_curve = curve is not None and curve.angles == found.angles
    corrects = by_curve or (method.fixture_stiffness_nm_per_arcmin is not None and found.angles == "loaded")
    ends = [branch.torque_nm[[0, -1]] for branch in (loop.forward, loop.backward)]
    peak_nm = float(np.abs(np.concatenate(ends)).max())
    stiffness = method.fixture_stiffness_nm_per_arcmin or math.inf
    return MeasurementConditions(
        method=method,
        peak_nm=peak_nm,
        forward=_stretch([pair[0] for pair in found.pairs]),
        backward=_stretch([pair[1] for pair in found.pairs]),
        encoders=encoders[found.angles],
        fixture_corrected=corrects and method.fixture == "correct",
        converted=converts(trace, method) and isinstance(found.quadrants, Quadrants),
        quadrants=found.quadrants if isinstance(found.quadrants, Quadrants) else None,
        u_drift_arcmin_per_min=found.drift.u_left_arcmin_per_min,
        unseen_drift_arcmin_per_min=_unseen_drift(found),
        u_skew_s=found.skew.u_s or 0.0,
        late_s=late_s,
        interruptions=tuple(found.interruptions),
        coverage=coverage_of([one.place for one in found.interruptions], holds),
        cycles=len(found.loops),
        zero_shifts_nm=zero_shifts_nm or {},
        zeroes_shown_nm=zeroes_shown_nm or {},
        torque_steps_nm=torque_steps_nm(found),
        noise_seen_arcmin=noise_seen_arcmin(found),
        slow_noise=slow_noise_seen(found),
        locked_width_arcmin=locked_width_arcmin(found),
        way_arcmin=max(float(np.ptp(one.angle_arcmin)) for one in (loop.forward, loop.backward))
        + 2.0 * peak_nm / stiffness,
        left_open=left_open or {},
        masked_nm=(_masked_nm(found.pairs[0][0]), _masked_nm(found.pairs[0][1])),
    )


def _masked_nm(samples: BranchSamples) -> float:
    """Torque from the turn that a branch begins at to its first sample that counts."""
    return abs(float(samples.cut.turn_nm[0] - samples.torque_nm[0])) if samples.masked else 0.0


def _unseen_drift(found: Measured) -> float:
    """Gap of the loop over the time of the cycle: a single cycle cannot tell drift from creep at its turns."""
    times = [one.t_s for one in found.pairs[0] if one.t_s is not None]
    if found.drift.per_cycle_arcmin is not None or len(times) < len(found.pairs[0]):
        return 0.0
    gaps = closure_gaps_arcmin(found)
    minutes = (max(float(one[-1]) for one in times) - min(float(one[0]) for one in times)) / 60.0
    return max(gaps) / minutes if minutes > 0.0 else 0.0


def _stretch(branches: Sequence[BranchSamples]) -> Stretch:
    """Return the branch of the first cycle in time, of all that go its way."""
    first = branches[0]
    time = first.t_s
    if time is None:
        return Stretch(first.torque_nm.size, math.nan, math.nan)
    return Stretch(first.torque_nm.size, float(time[0]), float(time[-1] - time[0]), delay_tried(branches))
