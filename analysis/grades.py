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


def grade_of(backlash_arcmin: float) -> int:
    """Return the best grade that takes a backlash [arcmin]; the border belongs to the better grade."""
    return next(row.grade for row in GRADES if backlash_arcmin <= row.most_arcmin)


def grade_uncertainty(backlash_arcmin: float, expanded_arcmin: float) -> float:
    """Return by how many grades the truth may differ, for a backlash and its expanded uncertainty [arcmin]."""
    here = grade_of(backlash_arcmin)
    worse = grade_of(backlash_arcmin + expanded_arcmin) - here
    better = here - grade_of(max(0.0, backlash_arcmin - expanded_arcmin))
    return float(max(worse, better))
