"""With which factor k an uncertainty is stated as U = k·u: a table, and which of its rows a run has.

That value ± U holds the truth in 95 % was shown for runs whose ramps went through. Of a run that was held while it was
measured, or whose branch was interrupted, it was not: such a run is rare, what held it is not known, and 95 % of few
values is no promise for each of them. Its U is stated with k = 3. This makes a guard band wider on both sides: a value
may no longer pass, or no longer fail, and never the other way.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple


class Coverage(NamedTuple):
    """One row: factor k of U = k·u, and why it is this one; '' where nothing has to be said."""

    factor: float
    why: str = ""

    @property
    def confidence(self) -> float:
        """Return the share of a normal distribution within ± k standard deviations, 0 to 1."""
        return math.erf(self.factor / math.sqrt(2.0))

    @property
    def text(self) -> str:
        """Return `k = 2`, or `k = 3 (99.7 %): ` with the reason."""
        known = f"k = {self.factor:g}"
        return f"{known} ({100.0 * self.confidence:.1f} %): {self.why}" if self.why else known


COVERAGES = {
    "through": Coverage(2.0),
    "interrupted": Coverage(3.0, "interrupted ramp; that 95 % of the values lie within k = 2 was shown without one"),
}
"""By what became of the ramps of a run."""

USUAL = COVERAGES["through"]


def coverage_of(interruptions: Sequence[object], holds: int) -> Coverage:
    """Return the row of a run.

    Args:
        interruptions: stretches of its measured branches that are left out, as their shape shows them.
        holds: how often its ramps were held, as the record says. It knows those that no shape shows, as friction
            reverses after a turn; and those of ramps that no metric is read from, whose unit has another past.

    """
    return COVERAGES["interrupted"] if interruptions or holds else USUAL
