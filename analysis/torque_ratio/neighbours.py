"""What values in order are worth whose neighbours err alike: less than as many independent ones.

Friction that waves, a line that bends, and a sensor that wanders leave residuals of a fit that stay above zero for a
while, and below for another. A variance that takes them for independent reads too small.
"""

from __future__ import annotations

from analysis.trace.units import FloatArray

FARTHEST = 4
"""Neighbours are looked at up to this part of all values apart: farther, an autocorrelation is guesswork."""


def alike(residuals: FloatArray) -> float:
    """Return by how much residuals in order, whose neighbours err alike, make a variance larger: 1 + 2·Σρ, from 1 up.

    It holds for the mean, and for all that changes as slowly as the terms of a fit. ρ are their autocorrelations up to
    the first that is not above zero: from there on they are scatter (C. J. Geyer, Practical Markov Chain Monte Carlo,
    Statistical Science 7, 1992).
    """
    whole = float(residuals @ residuals)
    factor = 1.0
    for apart in range(1, residuals.size // FARTHEST + 1):
        along = float(residuals[apart:] @ residuals[:-apart])
        if not along > 0.0:
            break
        factor += 2.0 * along / whole
    return factor
