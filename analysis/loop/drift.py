"""Stage: slow drift of the wind-up, from branches of the same direction in successive cycles.

Two branches of the same direction differ by what changed between them. At the same torque that is angle over time: the
slope is estimated over all torques in the middle of the branches at once, with a standard error that takes the worse of
the scatter between torques and the scatter between cycles. It is taken out only where it stands out of that error, so
that a bench without drift gets no noise from the correction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.loop.branches import Blocks
from analysis.loop.method import Method
from analysis.loop.samples import BranchSamples
from analysis.loop.stages import Figure, StageRecord
from analysis.trace.units import FloatArray

Pairs = list[tuple[BranchSamples, BranchSamples]]

MIDDLE = 0.8
"""Share of the smallest peak torque between which branches are compared: next to a turn small torques move far."""

GRID_POINTS = 41
"""Torques at which branches are compared."""

SIGNIFICANT = 3.0
"""A drift is corrected when it is this many standard errors from zero."""

SMALLEST_ARCMIN = 1e-9
"""A drift per cycle below this is rounding."""


@dataclass(frozen=True)
class Drift:
    """Drift of the wind-up: rate and its standard error [arcmin/s] (None without time), shift per cycle [arcmin].

    per_cycle_arcmin is None with one cycle. corrected: it was taken out of the samples.
    """

    rate_arcmin_s: float | None
    standard_error_arcmin_s: float | None
    per_cycle_arcmin: float | None
    corrected: bool
    record: StageRecord

    @property
    def u_left_arcmin_per_min(self) -> float:
        """Standard uncertainty of the drift that is left: of the one taken out, or with the one that was not."""
        if self.rate_arcmin_s is None or self.standard_error_arcmin_s is None:
            return 0.0
        left = 0.0 if self.corrected else self.rate_arcmin_s
        return 60.0 * math.hypot(left, self.standard_error_arcmin_s)


def correct_drift(pairs: Pairs, blocks: Sequence[Blocks], method: Method) -> tuple[Pairs, Drift]:
    """Estimate the drift and take it out where it is significant; return the samples and what was found.

    blocks: of the same branches, rising and falling in turn. The wind-up in the middle of the measurement stays.
    """
    estimate = _estimate(pairs, blocks)
    if estimate is None:
        text = "drift: needs two cycles in the same direction and to the same torque"
        return pairs, Drift(None, None, None, corrected=False, record=StageRecord("drift", text))
    rate, error, cycle = estimate
    timed = all(one.t_s is not None for pair in pairs for one in pair)
    unit, factor = ("arcmin/min", 60.0) if timed else ("arcmin/cycle", 1.0)
    figures = {
        "drift": Figure(rate * factor, unit),
        "standard error": Figure(error * factor, unit),
        "per cycle": Figure(rate * cycle, "arcmin"),
    }
    said = f"drift: {rate * factor:.3g} ± {error * factor:.2g} {unit} (standard error)"
    significant = abs(rate) > SIGNIFICANT * error and abs(rate * cycle) > SMALLEST_ARCMIN
    apply = significant and timed and method.drift == "correct"
    if apply:
        text = f"{said}, corrected"
    elif not significant:
        text = f"{said}, within {SIGNIFICANT:g} standard errors of zero: not corrected"
    else:
        text = f"{said}, not corrected: {'the method only reports it' if timed else 'the trace has no time'}"
    record = StageRecord("drift", text, figures, applied=apply)
    found = Drift(rate if timed else None, error if timed else None, rate * cycle, apply, record)
    return (_without(pairs, rate) if apply else pairs), found


def _without(pairs: Pairs, rate: float) -> Pairs:
    times = [one.t_s for pair in pairs for one in pair if one.t_s is not None]
    middle = (min(float(t[0]) for t in times) + max(float(t[-1]) for t in times)) / 2.0

    def corrected(one: BranchSamples) -> BranchSamples:
        return one.moved(lambda some: np.zeros(1) if some.t_s is None else rate * (some.t_s - middle))

    return [(corrected(rising), corrected(falling)) for rising, falling in pairs]


def _estimate(pairs: Pairs, blocks: Sequence[Blocks]) -> tuple[float, float, float] | None:
    """Rate, its standard error, and the time of a cycle; in cycles instead of seconds without time."""
    angles, times = [], []
    same = _same_kind(pairs)
    if len(same) < 2:
        return None
    for side in (0, 1):
        chosen = [blocks[2 * index + side] for index in same]
        at = _at_common_torques(chosen, pairs[same[0]][side].run.direction)
        if at is not None:
            angles.append(at[0])
            times.append(at[1])
    if not angles:
        return None
    angle = np.concatenate([one - one.mean(axis=0) for one in angles], axis=1)
    time = np.concatenate([one - one.mean(axis=0) for one in times], axis=1)
    spread = float(np.square(time).sum())
    if spread <= 0.0:
        return None
    rate = float((angle * time).sum()) / spread
    rest = angle - rate * time
    cycle = float(np.mean([np.diff(one, axis=0).mean() for one in times]))
    return rate, _standard_error(rest, time, [one.shape[1] for one in angles]), cycle


def _standard_error(rest: FloatArray, time: FloatArray, widths: Sequence[int]) -> float:
    """Worse of two: every torque of every branch for itself, and each branch as one."""
    cycles, columns = rest.shape
    spread = float(np.square(time).sum())
    alone = math.sqrt(float(np.square(rest).sum()) / max(columns * (cycles - 1) - 1, 1) / spread)
    starts = np.concatenate(([0], np.cumsum(widths)[:-1]))
    branch_rest = np.add.reduceat(rest, starts, axis=1) / widths
    branch_time = np.add.reduceat(time, starts, axis=1) / widths
    free = len(widths) * (cycles - 1) - 1
    branch_spread = float(np.square(branch_time).sum())
    if free < 1 or branch_spread <= 0.0:
        return alone
    together = math.sqrt(float(np.square(branch_rest).sum()) / free / branch_spread)
    return max(alone, together)


def _same_kind(pairs: Pairs) -> list[int]:
    """Cycles that were run like the last one: ramps are not compared with steps."""
    kinds = [tuple(len(one.run.pieces) for one in pair) for pair in pairs]
    return [index for index, kind in enumerate(kinds) if kind == kinds[-1]]


def _at_common_torques(blocks: Sequence[Blocks], direction: int) -> tuple[FloatArray, FloatArray] | None:
    """Wind-up and time of each branch (rows) at common torques (columns); None when they have none."""
    peak = min(min(-float(one.torque_nm.min()), float(one.torque_nm.max())) for one in blocks)
    if not peak > 0.0:
        return None
    grid = np.linspace(-MIDDLE * peak, MIDDLE * peak, GRID_POINTS)
    angles, times = [], []
    for number, one in enumerate(blocks):
        torque = np.maximum.accumulate(direction * one.torque_nm)
        angles.append(np.interp(direction * grid, torque, one.angle_arcmin))
        time = np.full(one.torque_nm.size, float(number)) if one.t_s is None else one.t_s
        times.append(np.interp(direction * grid, torque, time))
    return np.array(angles), np.array(times)
