"""Torque ratio of a run: four lines, the transitions between them, and what both leave over while calibrating."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from analysis.torque_ratio.line_begin import bounce_end_nm
from analysis.torque_ratio.line_fit import LEAST_POINTS, RatioFit, fit_torque_ratio
from analysis.torque_ratio.quadrants import QUADRANTS, Leftover, Leftovers, Quadrants, TorqueLine, by_lines
from analysis.torque_ratio.transition_fit import Branch, fit_transition, fit_zero, whole_branches
from analysis.trace.errors import AnalysisError
from analysis.trace.runs import Run
from analysis.trace.trace import Trace
from analysis.trace.units import FloatArray

LOADING_RANGE = (0.05, 0.99)
"""Shares of the peak torque that a loading line is fitted between; it begins later where the unit bounces."""

UNLOADING_RANGE = (0.05, 0.75)
"""Share of the peak torque that a line is fitted to; above, an unloading run is still in its transition."""

FIT_BLOCKS = 200
"""Samples are averaged to this many points per line, so that residuals do not repeat each other."""

LEFTOVER_BINS = 960
"""Bins along a branch in which what the conversion leaves over is averaged and corrected: 1 N·m of one of 900 N·m."""

FINE_BINS = 1920
"""Bins that show what the correction itself leaves over."""

ANGLE_WEIGHT = 2.0
"""Weight of the angle in the place on a branch, over that of the torque: where friction changes, it alone goes on."""


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
            "add the step 'calibrate' to the recipe, or give a stored calibration"
        )
    peak = max(float(np.abs(run.take(torque_out)).max()) for run in calibration)
    steady = _by_fits(trace, calibration)
    branches = whole_branches(trace, calibration, peak)
    length = fit_transition(branches, steady, peak)
    if length is None:
        return steady
    moving = fit_zero(branches, replace(steady, transition_rad=length), peak)
    return replace(moving, left=_leftovers(branches, moving))


def quadrants_of_cycles(trace: Trace, runs: Sequence[Run]) -> Quadrants:
    """Fit the four lines to the measured cycles, where no calibrate run was made: to be told, not to convert by.

    Raises AnalysisError as `fit_quadrants`.
    """
    cycles = [run for run in runs if run.role == "measure"]
    if not cycles:
        raise AnalysisError(
            f"{trace.source}: found no cycle for the torque ratio; expected a measured cycle or a calibrate "
            "segment. Use a trace that has one"
        )
    return _by_fits(trace, cycles)


def _by_fits(trace: Trace, runs: Sequence[Run]) -> Quadrants:
    """Fit the four lines to runs, the loading lines from where no bounce out of the play is left."""
    begins = bounce_ends_nm(trace, runs)
    fits = {name: fit.of_branch() for name, fit in fit_lines(trace, runs, begins_nm=begins).items()}
    lines = [TorqueLine(fits[name].offset_nm, fits[name].slope) for name in QUADRANTS]
    return Quadrants(lines[0], lines[1], lines[2], lines[3], fits=fits, begins_nm=begins)


def bounce_ends_nm(trace: Trace, runs: Sequence[Run]) -> dict[str, float]:
    """Return the output torque [N·m] at which a bounce out of the play is over, of the loading lines that have one.

    Raises AnalysisError when the output torque is missing.
    """
    torque_out = trace.channel("torque_out_nm", "the torque ratio")
    peak = max(float(np.abs(run.take(torque_out)).max()) for run in runs)
    ends = {}
    for name, sign in (("load_positive", 1), ("load_negative", -1)):
        ends[name] = bounce_end_nm([run for run in runs if run.direction == sign], torque_out, sign, peak)
    return {name: end for name, end in ends.items() if end > LOADING_RANGE[0] * peak}


def fit_lines(
    trace: Trace, runs: Sequence[Run], unloading: tuple[float, float] = UNLOADING_RANGE,
    loading: tuple[float, float] = LOADING_RANGE, begins_nm: Mapping[str, float] | None = None,
) -> dict[str, RatioFit]:  # fmt: skip
    """Fit the line of each quadrant to runs, of any role, in which both torques were measured.

    unloading, loading: shares of the peak torque between which such a line is fitted. begins_nm: see `quadrant_points`.
    Raises AnalysisError when a channel is missing or a quadrant has too few points, naming it.
    """
    fits = {}
    for name, (x, y) in quadrant_points(trace, runs, unloading, loading, begins_nm).items():
        if x.size < LEAST_POINTS:
            raise AnalysisError(
                f"{trace.source}: torque ratio: quadrant {name} has {x.size} points; expected {LEAST_POINTS} or "
                "more; calibrate up and down on both sides of zero"
            )
        fits[name] = fit_torque_ratio(x, y)
    return fits


def quadrant_points(
    trace: Trace, runs: Sequence[Run], unloading: tuple[float, float] = UNLOADING_RANGE,
    loading: tuple[float, float] = LOADING_RANGE, begins_nm: Mapping[str, float] | None = None,
) -> dict[str, tuple[FloatArray, FloatArray]]:  # fmt: skip
    """Return input and output torques [N·m] of the runs by quadrant, averaged; a quadrant may have none.

    unloading, loading: shares of the peak torque between which such a line is fitted. begins_nm: the output torques
    below which lines have no points, for those that begin above their share. Raises AnalysisError when a channel is
    missing, naming it.
    """
    torque_in = trace.channel("torque_in_nm", "the torque ratio")
    torque_out = trace.channel("torque_out_nm", "the torque ratio")
    peak = max(float(np.abs(run.take(torque_out)).max()) for run in runs)
    points = {}
    for name in QUADRANTS:
        sign = 1 if name.endswith("positive") else -1
        loads = name.startswith("load")
        low, high = (share * peak for share in (loading if loads else unloading))
        within = (max(low, (begins_nm or {}).get(name, 0.0)), high)
        pairs = [_points(run, torque_in, torque_out, sign, within, loading=loads) for run in runs]
        x, y = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
        points[name] = (x, y)
    return points


def _points(
    run: Run, torque_in: FloatArray, torque_out: FloatArray, sign: int, within_nm: tuple[float, float], *,
    loading: bool,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Averaged points of one run in one quadrant."""
    if (run.direction == sign) != loading:
        return np.empty(0), np.empty(0)
    x, y = run.take(torque_in), run.take(torque_out)
    low, high = within_nm
    chosen = (sign * y >= low) & (sign * y <= high)
    x, y = x[chosen], y[chosen]
    if x.size <= FIT_BLOCKS:
        return x, y
    edges = np.linspace(0, x.size, FIT_BLOCKS, endpoint=False).astype(np.int64)
    counts = np.diff(np.append(edges, x.size))
    return np.add.reduceat(x, edges) / counts, np.add.reduceat(y, edges) / counts


def _leftovers(branches: Sequence[Branch], quadrants: Quadrants) -> dict[int, Leftovers]:
    """Return what the conversion of whole calibration branches leaves over, by direction."""
    left = {}
    for direction in (1, -1):
        alike = [branch for branch in branches if branch.direction == direction]
        if not alike:
            continue
        stiffness = ANGLE_WEIGHT * alike[0].stiffness_nm_per_rad
        pieces = []
        for branch in alike:
            found = by_lines(quadrants, branch.torque_in_nm, direction, branch.angle_in_rad)
            place, error = found.places(stiffness, branch.angle_in_rad), found.torque_nm - branch.torque_out_nm
            pieces.append([values[found.valid] for values in (place, branch.torque_out_nm, error)])
        place, measured, error = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
        bins = (_in_bins(place, measured, error, count) for count in (LEFTOVER_BINS, FINE_BINS))
        left[direction] = Leftovers(stiffness, *bins)
    return left


def _in_bins(place: FloatArray, torque: FloatArray, error: FloatArray, bins: int) -> Leftover:
    """Mean of place, torque and error in bins of equal width; bins without samples are left out."""
    low, high = float(place.min()), float(place.max())
    index = np.minimum(((place - low) / (high - low) * bins).astype(np.int64), bins - 1)
    count = np.bincount(index, minlength=bins)
    there = count > 0
    mean_place, mean_torque, mean_error = (
        np.bincount(index, weights=values, minlength=bins)[there] / count[there] for values in (place, torque, error)
    )
    return Leftover(mean_place, np.maximum.accumulate(mean_torque), mean_error, count[there].astype(np.float64))
