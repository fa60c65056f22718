"""What the figure of a validity gate is: a number with words, or the reason in words why it does not apply."""

from __future__ import annotations

from typing import NamedTuple

from analysis.measured import Measured

NOT_EVALUATED = "the trace could not be evaluated"


class Reading(NamedTuple):
    """Figure of a gate in its unit, and words that say more than the gate's own; infinity where there is no number."""

    figure: float
    words: str = ""


def span_arcmin(found: Measured) -> float:
    """Wind-up between the turning points of the first cycle, arcmin: what shares of the wind-up are of."""
    loop = found.loops[0]
    top = max(float(loop.forward.angle_arcmin[-1]), float(loop.backward.angle_arcmin[-1]))
    bottom = min(float(loop.forward.angle_arcmin[0]), float(loop.backward.angle_arcmin[0]))
    return max(top - bottom, 1e-12)
