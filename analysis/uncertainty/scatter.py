"""How wide an interval has to be: by the factor k of U = k·u that a run has, and by the scatter of few cycles.

That value ± U holds the truth in 95 % was shown for runs whose ramps went through. Of a run that was held while it was
measured, or whose branch was interrupted, it was not: such a run is rare, what held it is not known, and 95 % of few
values is no promise for each of them. Its U is stated with k = 3. This makes a guard band wider on both sides: a value
may no longer pass, or no longer fail, and never the other way.

The standard deviation of n values is itself hardly known when n is small. Student's t pays for that: it is the factor
by which an interval of the same confidence grows (GUM 4.2.3, G.3, G.4).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy  # loads special where it is used


class Coverage(NamedTuple):
    """One row: factor k of U = k·u, and why it is this one; '' where nothing has to be said.

    found: of one run, where its ramps were interrupted, and what the record knows of it.
    """

    factor: float
    why: str = ""
    found: str = ""

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
    "interrupted": Coverage(3.0, "interrupted ramp; k = 2 (95 %) was shown only for runs without one"),
}
"""By what became of the ramps of a run."""

USUAL = COVERAGES["through"]


MOST_PLACES = 4
"""Places of interruptions that a reason names."""


def coverage_of(places: Sequence[str], holds: int | None) -> Coverage:
    """Return the row of a run.

    Args:
        places: in words, the stretches of its measured branches that are left out, as their shape shows them.
        holds: how often its ramps were held, as the record says; None where nobody has asked. It knows those that no
            shape shows, as friction reverses after a turn; and those of ramps that no metric is read from, whose unit
            has another past.

    """
    return COVERAGES["interrupted"]._replace(found=_found(places, holds)) if places or holds else USUAL


def _found(places: Sequence[str], holds: int | None) -> str:
    ordered = {None: "", 0: "no hold was ordered: the torque itself stood or went back", 1: "one hold was ordered"}
    said = ordered.get(holds, f"{holds} holds were ordered")
    left = len(places) - MOST_PLACES
    where = [*places[:MOST_PLACES], *([f"and {left} more"] if left > 0 else [])]
    return "; ".join(filter(None, ("; ".join(where) or "no branch shows where", said)))


CONFIDENCE = USUAL.confidence
"""Confidence that k = 2 stands for, of a normal distribution: 95.45 %."""


def student_factor(freedom: float, coverage: Coverage = USUAL) -> float:
    """Return t of the two-sided confidence of k, for degrees of freedom above zero; k for infinitely many."""
    if not math.isfinite(freedom):
        return coverage.factor
    return float(scipy.special.stdtrit(freedom, 0.5 + coverage.confidence / 2.0))


def enlarged(u_known: float, u_scatter: float, freedom: float, coverage: Coverage = USUAL) -> float:
    """Return the share of scatter that makes k·√(known² + share²) an interval of the confidence of k: 95.45 % of 2.

    u_known: standard uncertainty of everything known well; u_scatter: standard deviation of the mean from few values,
    with so many degrees of freedom. Welch–Satterthwaite: of all, ν = u⁴·freedom / u_scatter⁴ are left.
    """
    if u_scatter == 0.0:
        return 0.0
    total = math.hypot(u_known, u_scatter)
    left = freedom * (total / u_scatter) ** 4
    expanded = student_factor(left, coverage) * total
    return math.sqrt(max((expanded / coverage.factor) ** 2 - u_known**2, u_scatter**2))


def deviation(values: Sequence[float]) -> float:
    """Standard deviation of values, 0 of fewer than two."""
    return float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
