"""What the figure of a validity gate is: a number with words, or the reason in words why it does not apply."""

from __future__ import annotations

from typing import NamedTuple

NOT_EVALUATED = "the trace could not be evaluated"


class Reading(NamedTuple):
    """Figure of a gate in its unit, and words that say more than the gate's own; infinity where there is no number."""

    figure: float
    words: str = ""
