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
from scipy import ndimage, optimize

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

BLEND_END = 1e-5
"""The transition ends where less than this share of the loading line is left."""

ZERO_SAMPLES = 15
"""Samples over which the input torque is averaged to find where unloading ends."""

NEAR_ZERO = (0.4, 0.06)
"""Piece of the unloading line, in fractions of its friction torque, that is continued to zero."""

LEFTOVER_BINS = 240
"""Bins of torque in which what the conversion leaves over is averaged and corrected: 4 N·m of a branch of 900 N·m."""

FINE_BINS = 960
"""Bins that show what the correction itself leaves over."""

MASK_BELOW_TURN = 0.15
"""Share of the torque at the turn that is masked after a reversal when the transition length is not known."""


class TorqueLine(NamedTuple):
    """One quadrant: T_out = offset_nm + slope · T_in, N·m."""

    offset_nm: float
    slope: float


class Leftover(NamedTuple):
    """Converted less measured torque [N·m] over converted torque [N·m], in two fineness: what is corrected, and all."""

    torque_nm: FloatArray
    error_nm: FloatArray
    fine_torque_nm: FloatArray
    fine_error_nm: FloatArray


@dataclass(frozen=True)
class Quadrants:
    """Four lines, the transition length L [rad at the input shaft] or None, and the fits they came from if measured.

    left: by direction of motion, what lines and transition leave over while calibrating; it is taken off.
    """

    load_positive: TorqueLine
    unload_positive: TorqueLine
    load_negative: TorqueLine
    unload_negative: TorqueLine
    transition_rad: float | None = None
    fits: Mapping[str, RatioFit] = field(default_factory=dict)
    left: Mapping[int, Leftover] = field(default_factory=dict)

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
    with_length = replace(steady, transition_rad=length)
    return replace(with_length, left=_leftovers(trace, calibration, with_length, peak))


def output_torque(
    quadrants: Quadrants, torque_in_nm: FloatArray, direction: int, angle_in_rad: FloatArray | None
) -> tuple[FloatArray, BoolArray]:
    """Convert a run's input torque to output torque; return it [N·m] and the mask of samples fit to be evaluated.

    angle_in_rad: input angle of the same samples, None when it was not measured.
    """
    torque, valid = _by_lines(quadrants, torque_in_nm, direction, angle_in_rad)
    left = quadrants.left.get(direction)
    return (torque if left is None else torque - np.interp(torque, left.torque_nm, left.error_nm)), valid


def _by_lines(
    quadrants: Quadrants, torque_in_nm: FloatArray, direction: int, angle_in_rad: FloatArray | None
) -> tuple[FloatArray, BoolArray]:
    """Convert by lines and transition."""
    steady = _steady(quadrants, torque_in_nm, direction, angle_in_rad)
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
    return np.where(
        share > BLEND_END, _blended(before, after, torque_in_nm, float(torque_in_nm[0]), share), steady
    ), valid


def _steady(
    quadrants: Quadrants, torque_in_nm: FloatArray, direction: int, angle_in_rad: FloatArray | None
) -> FloatArray:
    """Away from reversals: the unloading line until it reaches zero, the loading line from there on.

    Where unloading has more friction than loading both lines have a torque for the same input torque about zero, so the
    order in time decides. The friction goes over from one to the other with the angle turned, as after a reversal.
    """
    loading, unloading = (
        (quadrants.load_positive, quadrants.unload_negative)
        if direction > 0
        else (quadrants.load_negative, quadrants.unload_positive)
    )
    unloaded = direction * (unloading.offset_nm + unloading.slope * torque_in_nm)
    crossing = _end_of_unloading(unloaded, abs(unloading.offset_nm))
    at_zero = -loading.offset_nm / loading.slope
    step = -unloading.offset_nm / unloading.slope - at_zero
    share: FloatArray | float = 0.0
    if quadrants.transition_rad is not None and angle_in_rad is not None and crossing < unloaded.size:
        turn = _step(*_turn_lines(quadrants, direction), float(torque_in_nm[0]))
        length = quadrants.transition_rad * min(1.0, abs(2.0 * at_zero / turn)) if turn else 0.0
        turned = np.abs(angle_in_rad - angle_in_rad[crossing])
        share = np.exp(-turned / length) if length > 0.0 else 0.0
    loaded = direction * (loading.offset_nm + loading.slope * (torque_in_nm - step * share))
    before = np.arange(unloaded.size) < crossing
    result: FloatArray = direction * np.where(before, np.minimum(unloaded, 0.0), np.maximum(loaded, 0.0))
    return result


def _end_of_unloading(unloaded: FloatArray, friction_nm: float) -> int:
    """Sample at which unloading is over; unloaded: its torque, from below zero up to zero.

    Near zero friction changes and the line no longer holds: the last piece that it holds for is continued straight.
    """
    smooth = ndimage.uniform_filter1d(unloaded, ZERO_SAMPLES, mode="nearest")
    far, near = (int(np.argmax(smooth >= -share * friction_nm)) for share in NEAR_ZERO)
    if smooth[near] < -NEAR_ZERO[1] * friction_nm:
        return int(unloaded.size)
    if near - far < ZERO_SAMPLES:
        return near
    at, slope = np.polynomial.polynomial.polyfit(np.arange(far, near) - near, unloaded[far:near], 1)
    ahead = -at / slope if slope > 0.0 else 0.0
    return min(near + round(min(max(ahead, 0.0), near - far)), int(unloaded.size))


def _turn_lines(quadrants: Quadrants, direction: int) -> tuple[TorqueLine, TorqueLine]:
    """Line before and line after the reversal that a run starts with."""
    if direction < 0:
        return quadrants.load_positive, quadrants.unload_positive
    return quadrants.load_negative, quadrants.unload_negative


def _blended(
    before: TorqueLine, after: TorqueLine, torque_in_nm: FloatArray, at_turn_nm: float, share: FloatArray
) -> FloatArray:
    """Output torque while friction goes over to the other side: at the turn it is that of the line before.

    What is left of the old friction, an input torque, is the share (1 to 0) of the step between the lines at the turn;
    at_turn_nm is the input torque there.
    """
    result: FloatArray = after.offset_nm + after.slope * (torque_in_nm - _step(before, after, at_turn_nm) * share)
    return result


def _step(before: TorqueLine, after: TorqueLine, at_turn_nm: float) -> float:
    """Input torque between two lines at the output torque of a turn: the friction that reverses, N·m."""
    turn_nm = before.offset_nm + before.slope * at_turn_nm
    return at_turn_nm - (turn_nm - after.offset_nm) / after.slope


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
            converted, _ = _by_lines(
                quadrants, run.take(trace.torque_in_nm), run.direction, run.take(trace.angle_in_rad)
            )
            found.setdefault(run.direction, []).append((converted, converted - measured))
    left = {}
    for direction, pieces in found.items():
        torque, error = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
        left[direction] = Leftover(*_in_bins(torque, error, LEFTOVER_BINS), *_in_bins(torque, error, FINE_BINS))
    return left


def _in_bins(torque: FloatArray, error: FloatArray, bins: int) -> tuple[FloatArray, FloatArray]:
    """Mean of torque and error in bins of equal width; bins without samples are left out."""
    low, high = float(torque.min()), float(torque.max())
    index = np.minimum(((torque - low) / (high - low) * bins).astype(np.int64), bins - 1)
    count = np.bincount(index, minlength=bins)
    there = count > 0
    mean_torque, mean_error = (
        np.bincount(index, weights=values, minlength=bins)[there] / count[there] for values in (torque, error)
    )
    return mean_torque, mean_error


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
            np.square(_blended(*_turn_lines(steady, direction), torque_in, turn, np.exp(-travel / length)) - torque_out)
            for direction, torque_in, turn, travel, torque_out in pieces
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
