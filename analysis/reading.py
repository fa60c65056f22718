"""What the figure of a validity gate is: a number with words, or the reason in words why it does not apply."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import wraps
from typing import NamedTuple

from analysis.measured import Evidence, Measured

NOT_EVALUATED = "the trace could not be evaluated"
NO_SPAN = "there is no measurable span: the wind-up does not change over the cycle"

MIDDLE = 0.8
"""Share of the peak torque up to which branches are compared: beyond it friction may still be reversing."""

LEAST_SPAN_ARCMIN = 1e-9
"""A wind-up below this is rounding: nothing is a share of it."""


class Reading(NamedTuple):
    """Figure of a gate in its unit, and words that say more than the gate's own; infinity where there is no number."""

    figure: float
    words: str = ""


Figure = Callable[[Evidence], Reading | str]
"""What a gate looks at: its figure, or in words why it does not apply."""


def of_measured(figure: Callable[[Measured], Reading | str]) -> Figure:
    """Make a gate's figure of one that reads the evaluated trace: without, it does not apply."""

    @wraps(figure)
    def read(evidence: Evidence) -> Reading | str:
        return NOT_EVALUATED if evidence.measured is None else figure(evidence.measured)

    return read


def of_span(found: Measured, arcmin: float, words: str = "") -> Reading:
    """Return an angle as a share of the wind-up, %; infinity, in plain words, where there is none to be a share of."""
    return Reading(100.0 * arcmin / span_arcmin(found), words) if has_span(found) else Reading(math.inf, NO_SPAN)


def has_span(found: Measured) -> bool:
    """Say whether the wind-up changes over the first cycle at all."""
    return span_arcmin(found) > LEAST_SPAN_ARCMIN


def span_arcmin(found: Measured) -> float:
    """Wind-up between the turning points of the first cycle, arcmin: what shares of the wind-up are of."""
    loop = found.loops[0]
    ends = [float(branch.angle_arcmin[end]) for branch in (loop.forward, loop.backward) for end in (0, -1)]
    return max(ends) - min(ends)
