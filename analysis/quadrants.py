"""Output torque from input torque, with the friction on the right side in each quadrant.

Friction reverses with the motion: loading obeys T_out = C + m·T_in with one pair (C, m), unloading with another. Four
lines (sign of torque × loading or unloading) map a whole loop. After a reversal the input torque traverses twice the
friction before the output follows: there the map moves from the loading line to the unloading line with the angle
turned since, λ = exp(−|Δangle_in| / L), as friction with presliding does; L comes from the calibration. Without L (a
stored calibration, or no input angle) that stretch is masked.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy import optimize

from analysis.errors import AnalysisError
from analysis.runs import Run
from analysis.torque_ratio import RatioFit, fit_torque_ratio
from analysis.trace import Trace
from analysis.units import BoolArray, FloatArray

QUADRANTS = ("load_positive", "unload_positive", "load_negative", "unload_negative")
"""Names of the four lines."""

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

BLEND_END = 1e-3
"""The transition ends where less than this share of the loading line is left."""

MASK_BELOW_TURN = 0.15
"""Share of the torque at the turn that is masked after a reversal when the transition length is not known."""


class TorqueLine(NamedTuple):
    """One quadrant: T_out = offset_nm + slope · T_in, N·m."""

    offset_nm: float
    slope: float


@dataclass(frozen=True)
class Quadrants:
    """Four lines, the transition length L [rad at the input shaft] or None, and the fits they came from if measured."""

    load_positive: TorqueLine
    unload_positive: TorqueLine
    load_negative: TorqueLine
    unload_negative: TorqueLine
    transition_rad: float | None = None
    fits: Mapping[str, RatioFit] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse lines that cannot be inverted."""
        for name in QUADRANTS:
            line: TorqueLine = getattr(self, name)
            if not (np.isfinite(line.offset_nm) and np.isfinite(line.slope) and line.slope > 0):
                raise AnalysisError(
                    f"torque ratio: {name}: found {line}; needed are a finite offset and a slope above 0"
                )


def fit_quadrants(trace: Trace, runs: Sequence[Run]) -> Quadrants:
    """Fit the four lines to the calibrate runs of a trace, and the transition after a reversal where it can be seen.

    Raises AnalysisError when a channel is missing or a quadrant has too few points, naming it.
    """
    torque_in = trace.channel("torque_in_nm", "the torque ratio")
    torque_out = trace.channel("torque_out_nm", "the torque ratio")
    calibration = [run for run in runs if run.role == "calibrate"]
    if not calibration:
        raise AnalysisError(
            f"{trace.source}: no calibrate segment; the torque ratio needs input and output torque measured together; "
            "calibrate in the sequence, or give a stored calibration"
        )
    peak = max(float(np.abs(run.take(torque_out)).max()) for run in calibration)
    fits = {}
    for name in QUADRANTS:
        sign = 1 if name.endswith("positive") else -1
        loading = name.startswith("load")
        pairs = [_points(run, torque_in, torque_out, sign, peak, loading=loading) for run in calibration]
        x, y = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
        if x.size < 3:
            raise AnalysisError(
                f"{trace.source}: torque ratio: quadrant {name} has {x.size} points; needed are 3 or more; calibrate "
                "up and down on both sides of zero"
            )
        fits[name] = fit_torque_ratio(x, y)
    lines = [TorqueLine(fits[name].offset_nm, fits[name].slope) for name in QUADRANTS]
    steady = Quadrants(lines[0], lines[1], lines[2], lines[3], fits=fits)
    length = _fit_transition(trace, calibration, steady, peak)
    return replace(steady, transition_rad=length)


def output_torque(
    quadrants: Quadrants, torque_in_nm: FloatArray, direction: int, angle_in_rad: FloatArray | None
) -> tuple[FloatArray, BoolArray]:
    """Convert a run's input torque to output torque; return it [N·m] and the mask of samples fit to be evaluated.

    angle_in_rad: input angle of the same samples, None when it was not measured.
    """
    steady = _steady(quadrants, torque_in_nm, direction)
    valid = np.ones(steady.size, dtype=np.bool_)
    before, after = _turn_lines(quadrants, direction)
    at_turn = before.offset_nm + before.slope * float(torque_in_nm[0])
    if at_turn * direction >= 0:
        return steady, valid
    if quadrants.transition_rad is None or angle_in_rad is None:
        beyond = -direction * steady > (1.0 - MASK_BELOW_TURN) * abs(at_turn)
        if beyond.any():
            valid[: int(np.flatnonzero(beyond)[-1]) + 1] = False
        return steady, valid
    share = np.exp(-np.abs(angle_in_rad - angle_in_rad[0]) / quadrants.transition_rad)
    return np.where(share > BLEND_END, _blended(before, after, torque_in_nm, share), steady), valid


def _steady(quadrants: Quadrants, torque_in_nm: FloatArray, direction: int) -> FloatArray:
    """Away from reversals: the loading line on one side of zero, the unloading line on the other, joined at zero."""
    loading, unloading = (
        (quadrants.load_positive, quadrants.unload_negative)
        if direction > 0
        else (quadrants.load_negative, quadrants.unload_positive)
    )
    loaded = direction * (loading.offset_nm + loading.slope * torque_in_nm)
    unloaded = direction * (unloading.offset_nm + unloading.slope * torque_in_nm)
    result: FloatArray = direction * (np.maximum(loaded, 0.0) + np.minimum(unloaded, 0.0))
    return result


def _turn_lines(quadrants: Quadrants, direction: int) -> tuple[TorqueLine, TorqueLine]:
    """Line before and line after the reversal that a run starts with."""
    if direction < 0:
        return quadrants.load_positive, quadrants.unload_positive
    return quadrants.load_negative, quadrants.unload_negative


def _blended(before: TorqueLine, after: TorqueLine, torque_in_nm: FloatArray, share: FloatArray) -> FloatArray:
    """Output torque while friction moves from one line to the other; share of the line before, 1 to 0.

    What moves is the friction, an input torque: the lines are mixed as T_in = a + b·T_out.
    """
    offset = -share * before.offset_nm / before.slope - (1.0 - share) * after.offset_nm / after.slope
    gradient = share / before.slope + (1.0 - share) / after.slope
    result: FloatArray = (torque_in_nm - offset) / gradient
    return result


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
            torque_in = run.take(trace.torque_in_nm)[chosen]
            pieces.append((run.direction, torque_in[thin], travel[thin], torque_out[chosen][thin]))
    if not pieces:
        return None

    def mean_square(log_length: float) -> float:
        length = float(np.exp(log_length))
        squares = [
            np.square(_blended(*_turn_lines(steady, direction), torque_in, np.exp(-travel / length)) - torque_out)
            for direction, torque_in, travel, torque_out in pieces
        ]
        return float(np.concatenate(squares).mean())

    shortest, longest = np.log(TRANSITION_BOUNDS_RAD)
    grid = np.linspace(float(shortest), float(longest), 40)
    best = int(np.argmin([mean_square(point) for point in grid]))
    bounds = (grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)])
    found = optimize.minimize_scalar(mean_square, bounds=bounds, method="bounded")
    if not np.sqrt(found.fun) <= TRANSITION_RESIDUAL * peak:
        return None
    return float(np.exp(found.x))
