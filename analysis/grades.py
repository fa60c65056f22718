"""Precision grade from a backlash, as a table. A grade is read off the mean backlash, never averaged itself."""

from __future__ import annotations

import math
from typing import NamedTuple


class Grade(NamedTuple):
    """Row of `GRADES`: number, the largest backlash that it takes [arcmin], and what it means."""

    grade: int
    most_arcmin: float
    text: str


GRADES: tuple[Grade, ...] = (
    Grade(1, 1.0, "precision grade 1: backlash up to 1 arcmin"),
    Grade(2, math.inf, "not grade 1: backlash above 1 arcmin, for which the source names no grade"),
)
"""Grades, best first. Source: "stiffness characterization", 3.2."""

GRADED = {
    "width_zero": "backlash_width_zero",
    "width_3pct": "backlash_width_3pct",
    "branches": "backlash_branches_3pct",
    "lost_motion": "lost_motion",
}
"""Backlash that a grade is read off, by the variant of the metric; the first one unless another is chosen."""


def grade_of(backlash_arcmin: float) -> int:
    """Return the best grade that takes a backlash [arcmin]; the border belongs to the better grade."""
    return next(row.grade for row in GRADES if backlash_arcmin <= row.most_arcmin)


def grade_uncertainty(backlash_arcmin: float, expanded_arcmin: float) -> float:
    """Return by how many grades the truth may differ, for a backlash and its expanded uncertainty [arcmin]."""
    here = grade_of(backlash_arcmin)
    worse = grade_of(backlash_arcmin + expanded_arcmin) - here
    better = here - grade_of(max(0.0, backlash_arcmin - expanded_arcmin))
    return float(max(worse, better))


def backlash_limits(least: float | None, most: float | None) -> tuple[float | None, float | None]:
    """Return the limits on the backlash [arcmin] that limits on the grade stand for; None where there is none."""
    above = [row.most_arcmin for row in GRADES if least is not None and row.grade < least]
    within = [row.most_arcmin for row in GRADES if most is not None and row.grade <= most]
    high = None if most is None else max(within, default=0.0)
    return (max(above) if above else None), (None if high == math.inf else high)
