"""Where a loading line begins: where the unit has taken up its play, and the bounce out of it is over.

On a ramp by torque nothing holds the shaft within the play: it runs through, and strikes the other flank with its
inertia. The output torque leaps ahead of the input torque, falls back, and stands: friction, which the leap has turned
round, holds it there until the ramp has come as far as the leap. There the small loop of the bounce closes, and
friction is that of loading once the shaft has gone on by about as much as it fell back. What comes before is no
loading line, however large its share of the peak is: 15 % of a peak of 100 N·m, with a play of two arcminutes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from analysis.trace.runs import Run
from analysis.trace.units import FloatArray

FELL_BACK, NOISES = 0.01, 10.0
"""Share of the peak torque, and noise of a sample, by which the output torque of a bounce falls back at least.

Ripple stays below the one, the range of the noise of some thousand samples below the other.
"""

NOISE_SQUARE = 6.0 * 0.455
"""Median square of the second difference of normal noise over its variance."""

LEAP, LEAPT = 1.4, 0.125
"""A fall, times the one, is what the torque leapt up by at least before it, in that share of the ramp's usual time.

A leap takes up to 0.09 of it. The ramp took all of it before a sensor steps down, sags or drops out, and the part that
is beyond the fall before a spike, which goes back to where it was: 0.29 of it, or 0.16 where friction waves.
"""

BY_HALF = 0.5
"""Share of the peak torque at which a line begins at most. Of a bounce that is over later nothing is taken off, for too
little of the line would be left: the checks refuse what it does to the line."""


def bounce_end_nm(loading: Sequence[Run], torque_out: FloatArray, sign: int, peak_nm: float) -> float:
    """Return the torque [N·m] from which on no branch is in its bounce; 0 where none bounces, or one does for too long.

    loading: branches that load the side of this sign. peak_nm: the largest torque of all branches.
    """
    end_nm = max((_end_nm(sign * run.take(torque_out), peak_nm) for run in loading), default=0.0)
    return end_nm if end_nm <= BY_HALF * peak_nm else 0.0


def begin_text(line: str, begin_nm: float) -> str:
    """Say from which torque on a line of this name was fitted, as the sensor reads it."""
    signed_nm = -begin_nm if line.endswith("negative") else begin_nm
    return f"from {signed_nm:.3g} N·m, where the bounce out of the play is over"


def _end_nm(torque: FloatArray, peak_nm: float) -> float:
    """Top of the bounce that ends last, and as much again as was lost after it: torque rises, from zero on."""
    loaded = np.maximum(torque, 0.0)
    top = np.maximum.accumulate(loaded)
    tops = np.flatnonzero(np.diff(top, prepend=-math.inf))
    fell = np.maximum.reduceat(top - loaded, tops)
    far = fell > max(FELL_BACK * peak_nm, NOISES * _noise_nm(torque))
    falls = zip(tops[far], fell[far], strict=True)
    return max((float(top[at] + nm) for at, nm in falls if _leapt(torque, int(at), float(nm))), default=0.0)


def _leapt(torque: FloatArray, at: int, fell_nm: float) -> bool:
    """Say whether the torque leapt to the top that it fell back from; at: sample of the top."""
    leap_nm = LEAP * fell_nm
    passed = torque[:at] > torque[at] - leap_nm
    usual = leap_nm / float(torque.max()) * np.count_nonzero(torque > 0.0)
    return not passed.all() and bool(np.count_nonzero(passed) < LEAPT * usual)


def _noise_nm(torque: FloatArray) -> float:
    """Standard deviation of the noise of a sample; by the median, for the leap of a bounce is no noise."""
    squares = np.square(np.diff(torque, 2))
    return math.sqrt(float(np.median(squares)) / NOISE_SQUARE) if squares.size else 0.0
