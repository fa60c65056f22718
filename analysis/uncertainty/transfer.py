"""What a converted torque may be wrong by beside its lines: friction about zero torque and after reversals.

Lines measured in the same run are corrected by what they leave over while calibrating, in bins along a branch. What the
correction gets wrong is the error here: the noise of the mean of a bin, and the structure that a bin does not resolve,
u² = s² − (σ_fine² − σ_bin²) + σ_bin². s² is the mean square of what finer bins show beyond the correction; declared
noise over the samples of a fine bin and of a bin makes the σ. The error has another sign in every bin. Stored lines
bring no such record: about zero torque their friction may be that of either line.

Stored lines may be the mean of several units, used on another one. How each unit differs from the mean, in all
quadrants and in the transition together, is one component, so what goes together in a unit (more friction everywhere)
goes together here. A unit that is not among n of them is as far from their mean as they are from each other, and the
mean is not known better than they show: u² = s² (1 + 1/n), with Student's factor for n − 1 degrees of freedom
(GUM 4.2.3, G.3).
"""

from __future__ import annotations

import math

import numpy as np

from analysis.loop.loop import Loop
from analysis.torque_ratio.quadrants import Leftovers, Quadrants, reversed_friction_nm, turn_lines
from analysis.trace.units import FloatArray, IntArray
from analysis.uncertainty.chain import LineMove, Move, by_changed_lines
from analysis.uncertainty.conditions import MeasurementConditions, Points, line_name
from analysis.uncertainty.figures import SensorFigures, UnitDeviation
from analysis.uncertainty.scatter import student_factor
from definitions.units import RAD_PER_ARCMIN

PATTERNS = 12
"""Patterns of signs that are tried; their contributions are averaged as variances."""

SEED = 3

Part = tuple[FloatArray | float, FloatArray | float]


def transfer_moves(
    loop: Loop, conditions: MeasurementConditions, figures: SensorFigures
) -> tuple[float, tuple[Move, ...]]:
    """Return the standard uncertainty [N·m] of the conversion at one torque (root mean square) and its moves.

    A move is one standard uncertainty of a component. Zero and none without a conversion.
    """
    quadrants = conditions.quadrants
    if not conditions.converted or quadrants is None:
        return 0.0, ()
    if quadrants.left and conditions.lines_of_this_run:
        return _measured(loop, quadrants, figures)
    return _stored(loop, quadrants)


def _measured(loop: Loop, quadrants: Quadrants, figures: SensorFigures) -> tuple[float, tuple[Move, ...]]:
    random = np.random.default_rng(SEED)
    sizes = []
    parts: dict[int, list[Part]] = {1: [(0.0, 0.0)] * PATTERNS, -1: [(0.0, 0.0)] * PATTERNS}
    for branch, direction in ((loop.forward, 1), (loop.backward, -1)):
        left = quadrants.leftovers(direction)
        if left is None:
            continue
        size = _size(left, _sample_variance(quadrants, left, direction, figures))
        sizes.append(size)
        signs = random.choice((-1.0, 1.0), (PATTERNS, size.size)) / math.sqrt(PATTERNS)
        # each point has the error of its own bin: between two bins of unlike sign the error is not smaller than in them
        here = _nearest(left.corrected.torque_nm, branch.torque_nm)
        parts[direction] = [((row * size)[here], 0.0) for row in signs]
    moves = tuple(Move(forward, backward) for forward, backward in zip(parts[1], parts[-1], strict=True))
    return float(np.sqrt(np.mean(np.square(np.concatenate(sizes))))), moves


def _nearest(bins: FloatArray, values: FloatArray) -> IntArray:
    """Return the index of the bin, of those in rising order, that is nearest to each value."""
    return np.searchsorted((bins[1:] + bins[:-1]) / 2.0, values)


def _sample_variance(quadrants: Quadrants, left: Leftovers, direction: int, figures: SensorFigures) -> FloatArray:
    """Variance [N²·m²] of one sample of converted less measured torque by noise, at the fine bins."""
    noise_in, noise_out = (
        0.0 if sensor is None else sensor.noise_fraction * sensor.full_scale_nm
        for sensor in (figures.torque_in, figures.torque_out)
    )
    positive, negative = (getattr(quadrants, line_name(sign, direction)).slope for sign in (1, -1))
    slope = np.where(left.fine.torque_nm >= 0.0, positive, negative)
    variance: FloatArray = np.square(slope * noise_in) + noise_out**2
    return variance


def _size(left: Leftovers, sample_variance: FloatArray) -> FloatArray:
    """Error of the correction, per bin of it: its noise, and what of the finer bins is more than noise."""
    corrected, fine = left.corrected, left.fine
    over = fine.error_nm - left.at(fine.place_nm)
    nearest = _nearest(corrected.place_nm, fine.place_nm)
    bins = corrected.place_nm.size
    count = np.maximum(np.bincount(nearest, minlength=bins), 1)
    shown, of_sample, of_fine = (
        np.bincount(nearest, weights=values, minlength=bins) / count
        for values in (np.square(over), sample_variance, sample_variance / fine.counts)
    )
    noise = of_sample / corrected.counts
    size: FloatArray = np.sqrt(np.maximum(shown - np.maximum(of_fine - noise, 0.0), 0.0) + noise)
    return size


def _stored(loop: Loop, quadrants: Quadrants) -> tuple[float, tuple[Move, ...]]:
    found: list[Move] = []
    largest = 0.0
    for direction in (1, -1):
        loading, unloading = (getattr(quadrants, line_name(sign * direction, direction)) for sign in (1, -1))
        reach = abs(unloading.offset_nm / unloading.slope - loading.offset_nm / loading.slope) * loading.slope
        branch = loop.forward if direction > 0 else loop.backward
        shift = np.where(np.abs(branch.torque_nm) <= reach, reach / math.sqrt(3.0), 0.0)
        found.append(Move((shift, 0.0), (0.0, 0.0)) if direction > 0 else Move((0.0, 0.0), (shift, 0.0)))
        largest = max(largest, reach / math.sqrt(3.0))
    return largest, tuple(found)


def unit_moves(loop: Loop, conditions: MeasurementConditions, figures: SensorFigures) -> tuple[float, tuple[Move, ...]]:
    """Return the standard uncertainty [N·m] of the conversion at the reference torque, and its moves.

    A move is one standard uncertainty of a component. Zero and none where no units are declared, or where the lines
    are of the run itself.
    """
    units, quadrants = figures.calibrated_units, conditions.quadrants
    if len(units) < 2 or not conditions.converted or quadrants is None or conditions.lines_of_this_run:
        return 0.0, ()
    freedom = len(units) - 1
    scale = math.sqrt((1.0 + 1.0 / len(units)) / freedom) * student_factor(freedom) / 2.0
    branches = conditions.points_of(loop)
    ratio = conditions.method.ratio
    changes = [[scale * _changed(unit, quadrants, points, ratio) for points in branches] for unit in units]
    moves = tuple(Move((rising, 0.0), (falling, 0.0)) for rising, falling in changes)
    place = int(np.argmin(np.abs(branches[0].torque_nm - conditions.method.reference_nm)))
    return math.hypot(*(float(rising[place]) for rising, _ in changes)), moves


def _changed(unit: UnitDeviation, quadrants: Quadrants, points: Points, ratio: float) -> FloatArray:
    """Return the converted torque [N·m] of a branch by a unit's own lines and transition, less that by their mean."""
    lines = {name: LineMove(*line) for name, line in unit.lines.items()}
    changed = np.zeros_like(points.torque_nm) + by_changed_lines(lines, points)
    if quadrants.transition_rad is None:
        return changed
    before, after = turn_lines(quadrants, points.direction)
    turn = 0 if points.direction > 0 else -1
    at_turn_nm = (float(points.torque_nm[turn]) - before.offset_nm) / before.slope
    travel = np.abs(points.angle_arcmin - points.angle_arcmin[turn]) * (ratio * RAD_PER_ARCMIN)
    lengths = travel / quadrants.transition_rad
    share = np.exp(-lengths)  # of the old friction, as in `quadrants.blended`
    sign = -points.direction
    of_before, of_after = (lines[line_name(sign, way)] for way in (sign, points.direction))
    jump = (of_after.offset_nm - of_before.offset_nm) + (of_after.slope - of_before.slope) * at_turn_nm
    friction_nm = reversed_friction_nm(before, after, at_turn_nm)  # the input torque is higher by its share
    longer = after.slope * lengths * unit.transition_rad / quadrants.transition_rad
    found: FloatArray = changed + share * ((of_after.slope - longer) * friction_nm - jump)
    return found
