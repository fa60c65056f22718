"""What a run shows of its own errors: noise, fast and slow, coarse steps, a late locked shaft, and a delay tried.

Nothing that is declared says so: a data sheet knows neither the cable nor a filter that somebody has switched on.

Noise of a torque whose neighbours err alike is not averaged away by them. Two cycles show it by their scatter. In one
cycle the torque is off the line over the torque of the other shaft, and off the course of the wind-up alike.

A delay of the torque is tried: the samples are delayed, and reduced to branches again. The mean rate of the torque says
too little. A drive is slower next to a turn and in the gap, and its torque ripples: where it runs back for a moment
monotone regression makes the points equal, so what is left of a branch was measured while the torque ran fast.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from analysis.loop.branches import Branch, binned, monotone
from analysis.loop.measured import Measured
from analysis.loop.samples import BranchSamples, converts
from analysis.torque_ratio.neighbours import alike
from analysis.torque_ratio.quadrant_fit import FIT_BLOCKS
from analysis.trace.units import FloatArray
from analysis.uncertainty.figures import TORQUES, TorqueChannel
from definitions.units import ARCMIN_PER_RAD

SLOWEST_S = 0.005
"""Time between samples up to which what a sample has of its own is noise, and not the course of the angle."""

SECOND_DIFFERENCE = 6.0
"""Variance of x(n−1) − 2·x(n) + x(n+1) of noise, in variances of the noise: 1 + 4 + 1."""

MIDDLE = 0.5
"""Share of a branch's largest torque within which the locked shaft is held against the torque: friction has turned."""

LEAST_SAMPLES = 20
"""Of a branch, from which a straight line of the locked shaft is fitted."""

OF_A_LINE = 2
"""Independent values that a line takes of its points: its offset and its slope follow what is slower than itself."""

LOADED = (0.15, 0.97)
"""Shares of the peak torque between which the torques are held against each other: beyond the gap, before the turn."""

CURVE = 3
"""Degree of the course of the wind-up over the torque where it loads, which is curved and not noise."""

DELAY_S = 4e-3
"""Delay that is tried, and one sample at least: shorter, noise outweighs it, longer, it passes over ripples."""

FINEST_STEP = 2e-5
"""Share of the largest torque below which a step is none that anybody sees."""

STANDING, OFF_GRID = 0.01, 1e-3
"""Share of the neighbours that are the same in a torque of coarse steps, at least; and how far off its grid it may be,
in steps."""

PARTS = 400
"""Parts of a branch in which the change is averaged."""


def noise_seen_arcmin(found: Measured) -> float:
    """Return the standard deviation of what a sample of the wind-up has of its own, arcmin; 0 where it is not told.

    Of the angles as they were recorded: what moves the channels to one clock smooths them.
    """
    trace = found.recorded
    if trace.step_s is None or trace.samples < LEAST_SAMPLES or trace.step_s > SLOWEST_S:
        return 0.0
    variance = 0.0
    for values, scale in _shafts(found, trace.angle_in_rad, trace.angle_out_rad):
        pieces = [np.diff(values[rows], 2) for pair in found.pairs for one in pair for rows in one.run.pieces]
        squares = np.square(np.concatenate(pieces)) / SECOND_DIFFERENCE
        variance += float(squares.mean()) * (ARCMIN_PER_RAD / scale) ** 2 if squares.size else 0.0
    return math.sqrt(variance)


def torque_steps_nm(found: Measured) -> dict[TorqueChannel, float]:
    """Return the step of each torque that was recorded in coarse steps, N·m; no entry for one that was not.

    Such values lie on a grid, and neighbours are often the same: a torque that is held or repeated lies on none, and
    one that was computed may lie on one and never stands.
    """
    steps = {name: _step_nm(found, getattr(found.recorded, name)) for name in TORQUES}
    return {name: step for name, step in steps.items() if step > 0.0}


def _step_nm(found: Measured, values: FloatArray | None) -> float:
    """Return the step of the grid on which a torque lies in the measured branches, N·m; 0 of none."""
    if values is None:
        return 0.0
    pieces = [values[rows] for pair in found.pairs for one in pair for rows in one.run.pieces]
    moves = np.abs(np.concatenate([np.diff(piece) for piece in pieces]))
    moved = moves[moves > 0.0]
    least = FINEST_STEP * max(float(np.abs(piece).max()) for piece in pieces)
    if not moved.size or moved.size > (1.0 - STANDING) * moves.size or moved.min() < least:
        return 0.0
    step = float(moved.min())
    counts = (np.concatenate(pieces) - pieces[0][0]) / step
    return step if np.abs(counts - np.round(counts)).max() < OFF_GRID else 0.0


class SlowNoise(NamedTuple):
    """Noise of the torque whose neighbours err alike: standard deviation, and the torque along which they do, N·m."""

    sd_nm: float
    along_nm: float


NO_SLOW_NOISE = SlowNoise(0.0, 0.0)


def slow_noise_seen(found: Measured) -> SlowNoise:
    """Return the slow noise of the output torque that loading shows in a single cycle; none where two scatter by it.

    None either where a torque is missing, or the output's is converted: what is left of a conversion has its own row.
    """
    trace = found.trace
    if len(found.pairs) > 1 or trace.torque_in_nm is None or converts(trace, found.method):
        return NO_SLOW_NOISE
    flanks = [_flank(one, one.run.take(trace.torque_in_nm)[one.masked :]) for pair in found.pairs for one in pair]
    if any(flank[0].size < LEAST_SAMPLES or not all(np.ptp(values) > 0.0 for values in flank) for flank in flanks):
        return NO_SLOW_NOISE
    off = [torque - _course(other, torque, 1) for torque, other, _ in flanks]
    parts = [_slow_part(torque, residuals) for (torque, *_), residuals in zip(flanks, off, strict=True)]
    variance, together = np.mean(parts, axis=0).tolist()
    if not variance > 0.0:
        return NO_SLOW_NOISE
    return SlowNoise(_confirmed(flanks, off) * math.sqrt(variance), together / variance)


def _flank(one: BranchSamples, other_nm: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a branch where it loads, averaged along time: its torque, the torque at the input, and its wind-up."""
    loaded = one.run.direction * one.torque_nm
    low, high = (share * float(loaded.max()) for share in LOADED)
    chosen = np.flatnonzero((loaded >= low) & (loaded <= high))
    starts = np.arange(0, chosen.size, max(-(-chosen.size // FIT_BLOCKS), 1))
    counts = np.diff(np.append(starts, chosen.size))
    torque, other, windup = (
        np.add.reduceat(values[chosen], starts) / counts for values in (one.torque_nm, other_nm, one.windup_arcmin)
    )
    return torque, other, windup


def _confirmed(flanks: Sequence[tuple[FloatArray, FloatArray, FloatArray]], off_nm: Sequence[FloatArray]) -> float:
    """Return which share of what the torques are apart the wind-up confirms as an error of the output's, 0 to 1.

    An error of that torque is off the course of the wind-up as well. The input torque has friction and what speeds the
    drive up; the wind-up has a curve. They do not know of each other.
    """
    both, alone = 0.0, 0.0
    for (torque, _, windup), residuals in zip(flanks, off_nm, strict=True):
        stiffness = float(np.ptp(torque) / np.ptp(windup))
        along = np.linspace(-1.0, 1.0, torque.size)
        by_windup = stiffness * (_course(torque, windup, CURVE) - windup)
        one, other = (values - _course(along, values, CURVE) for values in (residuals, by_windup))
        both += float(one @ other)
        alone += float(one @ one)
    return min(max(both / alone, 0.0), 1.0) if alone > 0.0 else 0.0


def _course(x: FloatArray, y: FloatArray, degree: int) -> FloatArray:
    """Values of the polynomial of least squares through points."""
    course: FloatArray = np.polynomial.Polynomial.fit(x, y, degree)(x)
    return course


def _slow_part(torque_nm: FloatArray, residuals: FloatArray) -> tuple[float, float]:
    """Return what of a line's residuals, in order, is slow: its variance, and that times the torque that is alike."""
    size, factor = residuals.size, alike(residuals)
    independent = max(size / factor, OF_A_LINE + 1.0)
    variance = float(residuals @ residuals) / size * independent / (independent - OF_A_LINE)
    fast = float(np.square(np.diff(residuals, 2)).mean()) / SECOND_DIFFERENCE
    step_nm = float(np.ptp(torque_nm)) / size
    return max(variance - fast, 0.0), max(factor * variance - fast, 0.0) * step_nm


def locked_width_arcmin(found: Measured) -> float:
    """Return by how much the locked shaft's angle is wider than a line over the torque, arcmin at the output; signed.

    A lock is a spring: its shaft goes and comes back along one line. Where it comes back on another, its channel is
    late, or the lock gives way with friction; one run cannot tell which. The mean of all cycles; 0 where the wind-up is
    not the difference of two shafts.
    """
    if found.angles != "both":
        return 0.0
    by_input = found.method.loading == "input"
    locked, scale = (found.trace.angle_out_rad, 1.0) if by_input else (found.trace.angle_in_rad, found.method.ratio)
    if locked is None:
        return 0.0
    widths = []
    for rising, falling in found.pairs:
        up, down = (_at_zero(one, one.run.take(locked)[one.masked :]) for one in (rising, falling))
        if up is not None and down is not None:
            widths.append((down - up) * ARCMIN_PER_RAD / scale)
    return float(np.mean(widths)) if widths else 0.0


def _at_zero(branch: BranchSamples, angle_rad: FloatArray) -> float | None:
    """Angle at zero torque of the straight line through the middle of a branch; None of too few samples."""
    torque = branch.torque_nm
    inside = np.abs(torque) <= MIDDLE * float(np.abs(torque).max())
    if np.count_nonzero(inside) < LEAST_SAMPLES or not np.ptp(torque[inside]) > 0.0:
        return None
    slope, offset = np.polyfit(torque[inside], angle_rad[inside], 1)
    return float(offset) if math.isfinite(slope) else None


def _shafts(
    found: Measured, angle_in_rad: FloatArray | None, angle_out_rad: FloatArray | None
) -> list[tuple[FloatArray, float]]:
    """Angles that the wind-up is made of, each with what divides it at the output."""
    if found.angles == "given":
        return []
    loaded_only = found.angles == "loaded"
    by_input = found.method.loading == "input"
    both = [(angle_in_rad, found.method.ratio, by_input), (angle_out_rad, 1.0, not by_input)]
    return [(values, scale) for values, scale, loaded in both if values is not None and (loaded or not loaded_only)]


class DelayTried(NamedTuple):
    """Torque [N·m], rising, and change of the wind-up there per second by which the torque is late [arcmin/s]."""

    torque_nm: FloatArray
    arcmin_per_s: FloatArray


def delay_tried(branches: Sequence[BranchSamples]) -> DelayTried | None:
    """Return what a delay does to branches of one direction, mean of all cycles.

    None without time, and for branches in steps, which are not delayed while they hold.
    """
    found = []
    for one in branches:
        time = one.t_s
        if time is None or len(one.run.pieces) > 1 or not (np.diff(time) > 0.0).all():
            return None
        delay_s = max(DELAY_S, float(np.median(np.diff(time))))
        late, early = (_moved(one, time, way * delay_s) for way in (1.0, -1.0))
        found.append((late, early, delay_s))
    low = max(branch.torque_nm[0] for late, early, _ in found for branch in (late, early))
    high = min(branch.torque_nm[-1] for late, early, _ in found for branch in (late, early))
    if not high > low:
        return None
    edges = np.linspace(low, high, PARTS + 1)
    changes = [(_means(late, edges) - _means(early, edges)) / (2.0 * delay_s) for late, early, delay_s in found]
    return DelayTried((edges[1:] + edges[:-1]) / 2.0, np.mean(changes, axis=0))


def _moved(samples: BranchSamples, time_s: FloatArray, delay_s: float) -> Branch:
    """Return the branch with its torque so much later."""
    torque = np.interp(time_s - delay_s, time_s, samples.torque_nm)
    return monotone(binned(replace(samples, torque_nm=torque)), samples.run.direction, samples.where)


def _means(branch: Branch, edges_nm: FloatArray) -> FloatArray:
    """Mean wind-up [arcmin] between neighbouring torques."""
    torque, angle = branch.torque_nm, branch.angle_arcmin
    area = np.append(0.0, np.cumsum((angle[1:] + angle[:-1]) / 2.0 * np.diff(torque)))
    means: FloatArray = np.diff(np.interp(edges_nm, torque, area)) / np.diff(edges_nm)
    return means
