"""What a converted torque may be wrong by beside its lines: friction about zero torque and after reversals.

Lines measured in the same run are corrected by what they leave over while calibrating, in bins along a branch. What the
correction gets wrong is the error here: the noise of the mean of a bin, and the structure that a bin does not resolve,
u² = s² − (σ_fine² − σ_bin²) + σ_bin². s² is the mean square of what finer bins show beyond the correction; declared
noise over the samples of a fine bin and of a bin makes the σ. The error has another sign in every bin. Stored lines
bring no such record: about zero torque their friction may be that of either line.
"""

from __future__ import annotations

import math

import numpy as np

from analysis.loop import Loop
from analysis.quadrants import Leftovers, Quadrants
from analysis.uncertainty.chain import Move
from analysis.uncertainty.circumstances import Circumstances, line_name
from analysis.uncertainty.figures import SensorFigures
from analysis.units import FloatArray, IntArray

PATTERNS = 12
"""Patterns of signs that are tried; their contributions are averaged as variances."""

SEED = 3

Part = tuple[FloatArray | float, FloatArray | float]


def transfer_moves(loop: Loop, circumstances: Circumstances, figures: SensorFigures) -> tuple[float, tuple[Move, ...]]:
    """Return the standard uncertainty [N·m] of the conversion at one torque (root mean square) and its moves.

    A move is one standard uncertainty of a component. Zero and none without a conversion.
    """
    quadrants = circumstances.quadrants
    if not circumstances.converted or quadrants is None:
        return 0.0, ()
    if quadrants.left and circumstances.lines_of_this_run:
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
