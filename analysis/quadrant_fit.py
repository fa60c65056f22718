"""Torque ratio of a run: four lines, the transition after a reversal, and what both leave over while calibrating."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy  # loads optimize where it is used

from analysis.errors import AnalysisError
from analysis.quadrants import QUADRANTS, Leftover, Quadrants, TorqueLine, blended, by_lines, turn_lines
from analysis.runs import Run
from analysis.torque_ratio import RatioFit, fit_torque_ratio
from analysis.trace import Trace
from analysis.units import FloatArray

LOADING_RANGE = (0.05, 0.99)

UNLOADING_RANGE = (0.05, 0.75)
"""Share of the peak torque that a line is fitted to; above, an unloading run is still in its transition."""

FIT_BLOCKS = 200
"""Samples are averaged to this many points per line, so that residuals do not repeat each other."""

TRANSITION_BOUNDS_RAD = (1e-6, 0.3)
"""Bounds of the transition length L at the input shaft."""

TRANSITION_POINTS = 20_000
"""Samples of a run that the transition is fitted to at most, evenly picked."""

TRANSITION_RESIDUAL = 0.03
"""A transition that fits worse than this share of the peak torque is masked instead."""

LEFTOVER_BINS = 240
"""Bins of torque in which what the conversion leaves over is averaged and corrected: 4 N·m of a branch of 900 N·m."""

FINE_BINS = 960
"""Bins that show what the correction itself leaves over."""


def fit_quadrants(trace: Trace, runs: Sequence[Run]) -> Quadrants:
    """Fit the four lines to the calibrate runs of a trace, and the transition after a reversal where it can be seen.

    Raises AnalysisError when a channel is missing or a quadrant has too few points, naming it.
    """
    trace.channel("torque_in_nm", "the torque ratio")
    torque_out = trace.channel("torque_out_nm", "the torque ratio")
    calibration = [run for run in runs if run.role == "calibrate"]
    if not calibration:
        raise AnalysisError(
            f"{trace.source}: no calibrate segment; the torque ratio needs input and output torque measured together; "
            "calibrate in the sequence, or give a stored calibration"
        )
    peak = max(float(np.abs(run.take(torque_out)).max()) for run in calibration)
    fits = fit_lines(trace, calibration)
    lines = [TorqueLine(fits[name].offset_nm, fits[name].slope) for name in QUADRANTS]
    steady = Quadrants(lines[0], lines[1], lines[2], lines[3], fits=fits)
    length = _fit_transition(trace, calibration, steady, peak)
    with_length = replace(steady, transition_rad=length)
    return replace(with_length, left=_leftovers(trace, calibration, with_length, peak))


def fit_lines(trace: Trace, runs: Sequence[Run]) -> dict[str, RatioFit]:
    """Fit the line of each quadrant to runs, of any role, in which both torques were measured.

    Raises AnalysisError when a channel is missing or a quadrant has too few points, naming it.
    """
    torque_in = trace.channel("torque_in_nm", "the torque ratio")
    torque_out = trace.channel("torque_out_nm", "the torque ratio")
    peak = max(float(np.abs(run.take(torque_out)).max()) for run in runs)
    fits = {}
    for name in QUADRANTS:
        sign = 1 if name.endswith("positive") else -1
        loading = name.startswith("load")
        pairs = [_points(run, torque_in, torque_out, sign, peak, loading=loading) for run in runs]
        x, y = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
        if x.size < 3:
            raise AnalysisError(
                f"{trace.source}: torque ratio: quadrant {name} has {x.size} points; needed are 3 or more; calibrate "
                "up and down on both sides of zero"
            )
        fits[name] = fit_torque_ratio(x, y)
    return fits


def _points(
    run: Run, torque_in: FloatArray, torque_out: FloatArray, sign: int, peak: float, *, loading: bool
) -> tuple[FloatArray, FloatArray]:
    """Averaged points of one run in one quadrant."""
    if (run.direction == sign) != loading:
        return np.empty(0), np.empty(0)
    x, y = run.take(torque_in), run.take(torque_out)
    low, high = LOADING_RANGE if loading else UNLOADING_RANGE
    chosen = (sign * y >= low * peak) & (sign * y <= high * peak)
    x, y = x[chosen], y[chosen]
    if x.size <= FIT_BLOCKS:
        return x, y
    edges = np.linspace(0, x.size, FIT_BLOCKS, endpoint=False).astype(np.int64)
    counts = np.diff(np.append(edges, x.size))
    return np.add.reduceat(x, edges) / counts, np.add.reduceat(y, edges) / counts


def _leftovers(trace: Trace, calibration: Sequence[Run], quadrants: Quadrants, peak: float) -> dict[int, Leftover]:
    """Return what the conversion of whole calibration branches leaves over, by direction; only with a transition.

    A branch that starts at rest has other friction than one that starts at a turn: it is left out.
    """
    if quadrants.transition_rad is None or trace.torque_in_nm is None or trace.torque_out_nm is None:
        return {}
    if trace.angle_in_rad is None:
        return {}
    found: dict[int, list[tuple[FloatArray, FloatArray]]] = {}
    for run in calibration:
        measured = run.take(trace.torque_out_nm)
        if -run.direction * measured[0] > 0.5 * peak:
            converted, _ = by_lines(
                quadrants, run.take(trace.torque_in_nm), run.direction, run.take(trace.angle_in_rad)
            )
            found.setdefault(run.direction, []).append((converted, converted - measured))
    left = {}
    for direction, pieces in found.items():
        torque, error = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
        left[direction] = Leftover(*_in_bins(torque, error, LEFTOVER_BINS), *_in_bins(torque, error, FINE_BINS))
    return left


def _in_bins(torque: FloatArray, error: FloatArray, bins: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean of torque and error in bins of equal width, and their samples; bins without samples are left out."""
    low, high = float(torque.min()), float(torque.max())
    index = np.minimum(((torque - low) / (high - low) * bins).astype(np.int64), bins - 1)
    count = np.bincount(index, minlength=bins)
    there = count > 0
    mean_torque, mean_error = (
        np.bincount(index, weights=values, minlength=bins)[there] / count[there] for values in (torque, error)
    )
    return mean_torque, mean_error, count[there].astype(np.float64)


def _fit_transition(trace: Trace, calibration: Sequence[Run], steady: Quadrants, peak: float) -> float | None:
    """Transition length L [rad], None when it cannot be seen or does not describe what was measured."""
    if trace.angle_in_rad is None or trace.torque_in_nm is None or trace.torque_out_nm is None:
        return None
    pieces = []
    for run in calibration:
        torque_out = run.take(trace.torque_out_nm)
        chosen = -run.direction * torque_out > 0.5 * peak
        if np.count_nonzero(chosen) > 10 and -run.direction * torque_out[0] > 0.5 * peak:
            angle = run.take(trace.angle_in_rad)
            travel = np.abs(angle - angle[0])[chosen]
            thin = slice(None, None, -(-travel.size // TRANSITION_POINTS))
            torque_in = run.take(trace.torque_in_nm)
            turn = float(torque_in[0])
            pieces.append((run.direction, torque_in[chosen][thin], turn, travel[thin], torque_out[chosen][thin]))
    if not pieces:
        return None

    def mean_square(log_length: float) -> float:
        length = float(np.exp(log_length))
        squares = [
            np.square(blended(*turn_lines(steady, direction), torque_in, turn, np.exp(-travel / length)) - torque_out)
            for direction, torque_in, turn, travel, torque_out in pieces
        ]
        return float(np.concatenate(squares).mean())

    shortest, longest = np.log(TRANSITION_BOUNDS_RAD)
    grid = np.linspace(float(shortest), float(longest), 40)
    best = int(np.argmin([mean_square(point) for point in grid]))
    bounds = (grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)])
    found = scipy.optimize.minimize_scalar(mean_square, bounds=bounds, method="bounded")
    if not np.sqrt(found.fun) <= TRANSITION_RESIDUAL * peak:
        return None
    return float(np.exp(found.x))
