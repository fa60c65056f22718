"""What a converted torque may be wrong by beside its lines: friction about zero torque and after reversals.

Lines measured in the same run are corrected by what they leave over while calibrating, in bins of torque. What is still
left within the bins, noise of the calibration and structure that they do not resolve, is the error here; it has another
sign in every bin. Stored lines bring no such record: about zero torque their friction may be that of either line.
"""

from __future__ import annotations

import math

import numpy as np

from analysis.loop import Loop
from analysis.quadrants import Leftover, Quadrants
from analysis.uncertainty.chain import Move
from analysis.uncertainty.circumstances import Circumstances, line_name
from analysis.units import FloatArray, IntArray

PATTERNS = 12
"""Patterns of signs that are tried; their contributions are averaged as variances."""

SEED = 3

Part = tuple[FloatArray | float, FloatArray | float]


def transfer_moves(loop: Loop, circumstances: Circumstances) -> tuple[float, tuple[Move, ...]]:
    """Return the standard uncertainty [N·m] of the conversion at one torque (root mean square) and its moves.

    A move is one standard uncertainty of a component. Zero and none without a conversion.
    """
    quadrants = circumstances.quadrants
    if not circumstances.converted or quadrants is None:
        return 0.0, ()
    if quadrants.left:
        return _measured(loop, quadrants)
    return _stored(loop, quadrants)


def _measured(loop: Loop, quadrants: Quadrants) -> tuple[float, tuple[Move, ...]]:
    random = np.random.default_rng(SEED)
    sizes = []
    parts: dict[int, list[Part]] = {1: [(0.0, 0.0)] * PATTERNS, -1: [(0.0, 0.0)] * PATTERNS}
    for branch, direction in ((loop.forward, 1), (loop.backward, -1)):
        left = quadrants.left.get(direction)
        if left is None:
            continue
        size = _size(left)
        sizes.append(size)
        signs = random.choice((-1.0, 1.0), (PATTERNS, size.size)) / math.sqrt(PATTERNS)
        # each point has the error of its own bin: between two bins of unlike sign the error is not smaller than in them
        here = _bins_at(branch.torque_nm, left)
        parts[direction] = [((row * size)[here], 0.0) for row in signs]
    moves = tuple(Move(forward, backward) for forward, backward in zip(parts[1], parts[-1], strict=True))
    return float(np.sqrt(np.mean(np.square(np.concatenate(sizes))))), moves


def _bins_at(torque_nm: FloatArray, left: Leftover) -> IntArray:
    """Return the bin of the correction that is nearest to each torque."""
    between = (left.torque_nm[1:] + left.torque_nm[:-1]) / 2.0
    return np.searchsorted(between, torque_nm)


def _size(left: Leftover) -> FloatArray:
    """Root mean square, per bin of the correction, of what the correction leaves over."""
    over = left.fine_error_nm - np.interp(left.fine_torque_nm, left.torque_nm, left.error_nm)
    nearest = _bins_at(left.fine_torque_nm, left)
    count = np.maximum(np.bincount(nearest, minlength=left.torque_nm.size), 1)
    size: FloatArray = np.sqrt(np.bincount(nearest, weights=np.square(over), minlength=left.torque_nm.size) / count)
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
