"""Figures of the validity gates that hold the noise of the torques against what is declared of their sensors.

Noise is what a sample has that its neighbours have not. A trace with much less of it was smoothed, and smoothing takes
from the play of a loop; one with much more has a fault, or a coarser resolution, that no row of the budget knows.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from analysis.measured import Evidence, Measured
from analysis.reading import NOT_EVALUATED, Reading

SLOWEST_S = 0.005
"""Time between samples up to which what a sample has of its own is noise, and not the course of the torque."""

SECOND_DIFFERENCE = 6.0
"""Variance of x(n−1) − 2·x(n) + x(n+1) of noise, in variances of the noise: 1 + 4 + 1."""


def noise_low(evidence: Evidence) -> Reading | str:
    """Measured over declared noise of the torque channel that has least of it, %."""
    return _noise(evidence, min)


def noise_high(evidence: Evidence) -> Reading | str:
    """Measured over declared noise of the torque channel that has most of it, %."""
    return _noise(evidence, max)


def _noise(evidence: Evidence, side: Callable[[list[tuple[float, str]]], tuple[float, str]]) -> Reading | str:
    found = evidence.measured
    if found is None:
        return NOT_EVALUATED
    declared = {name: nm for name, nm in evidence.torque_noise_nm.items() if nm > 0.0}
    there = [name for name in declared if getattr(found.trace, name) is not None]
    if not there:
        return "no noise of a torque sensor is declared"
    time = found.trace.t_s
    if time is None or float(np.median(np.diff(time))) > SLOWEST_S:
        return f"not measured: with less than {1.0 / SLOWEST_S:g} samples per second noise is not told from the course"
    ratio, name = side([(noise_nm(found, name) / declared[name], name) for name in there])
    words = f"{name} has noise of {ratio * declared[name]:.2g} N·m, and {declared[name]:.2g} are declared"
    return Reading(100.0 * ratio, words)


def noise_nm(found: Measured, channel: str) -> float:
    """Return the standard deviation of a torque channel's noise in the measured branches, N·m."""
    values = getattr(found.trace, channel)
    pieces = [values[piece] for pair in found.pairs for one in pair for piece in one.run.pieces]
    squares = [np.square(np.diff(piece, 2)) for piece in pieces if piece.size > 2]
    count = sum(one.size for one in squares)
    return float(np.sqrt(sum(float(one.sum()) for one in squares) / count / SECOND_DIFFERENCE)) if count else 0.0
