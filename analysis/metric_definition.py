"""What the definition of a metric says: a row of the table of metrics."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from analysis.estimators import Ask
from analysis.loop import Loop

BRANCHES = ("load", "unload", "mean")
"""Branches that can be asked for."""

SIDED = ("+", "-")
"""Sides of a metric that each side of the loop has for itself."""

BOTH = ("both",)
"""Side of a metric of the whole loop."""

STIFFNESS_WORDS = ("the unit is softer than allowed", "the unit is stiffer than allowed: bound, preloaded or jammed")
"""What a stiffness that is too low and one that is too high mean."""


class Definition(NamedTuple):
    """One metric: unit, text, where it comes from, what it is read from and by, and what a bad value means."""

    unit: str
    text: str
    source: str
    estimate: Callable[[Loop, Ask], float] | None
    """None: read from the torque ratio, not from the loop."""
    sides: tuple[str, ...]
    branch: str
    branches: tuple[str, ...]
    """Branches that may be chosen."""
    estimator: str
    variants: tuple[str, ...]
    """The first one is taken when none is asked for."""
    band: float | None
    torque: float | None
    """Torque in fractions of the reference torque where a metric is read."""
    free: tuple[str, ...]
    """Of "band" and "torque_nm", what may be chosen; the others are part of the definition."""
    too_low: str
    too_high: str
    fits: tuple[str, ...] = ()
    """Fitted curves that may be chosen, the first one unless another is; none for a metric read off the branches."""
    graded: bool = False
    """The estimate is a backlash [arcmin], and the value is its grade."""
    magnitude: bool = False
    """The estimate has a sign, and the value is the magnitude of its mean over the cycles."""
    segmented: bool = False
    """The break torques T1 and T2 of the method are part of what is read."""


def defined(
    unit: str,
    text: str,
    source: str,
    estimate: Callable[[Loop, Ask], float] | None,
    *,
    sides: tuple[str, ...] = BOTH,
    branch: str = "mean",
    branches: tuple[str, ...] = (),
    estimator: str = "interpolation",
    variants: tuple[str, ...] = ("",),
    band: float | None = None,
    torque: float | None = None,
    free: tuple[str, ...] = (),
    words: tuple[str, str] = STIFFNESS_WORDS,
    fits: tuple[str, ...] = (),
    graded: bool = False,
    magnitude: bool = False,
    segmented: bool = False,
) -> Definition:
    """Return a row of the table of metrics; what is left out is what most of them have.

    words: what a value that is too low and one that is too high mean.
    """
    allowed = branches or (branch,)
    return Definition(
        unit, text, source, estimate, sides, branch, allowed, estimator, variants, band, torque, free, *words, fits,
        graded, magnitude, segmented,
    )  # fmt: skip
