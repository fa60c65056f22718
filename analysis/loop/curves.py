"""The fits that a stiffness curve can be read from, each made of a loop; a loop keeps each one that was asked for.

A fit gives three curves of wind-up over torque: forward branch, return branch, and their mean F(T).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from analysis.loop.fits import REGION_BORDERS, MeanCurve, SixSegmentFit, fit_six_segments, fit_three_regions, mean_of
from analysis.loop.loop import Curve, FittedCurves, Loop
from analysis.loop.method import Method
from definitions.metrics import FITS

BREAK_20_PERCENT = 0.2
"""Break torque of the six-segment fit by "inverse loading test system", of the reference torque."""


class Made(NamedTuple):
    """Row of `MADE_BY`: what makes the curves of a fit, and its breaks [N·m]."""

    make: Callable[[Loop], FittedCurves]
    breaks_nm: Callable[[Method], tuple[float, ...]]


def _curves(fit: SixSegmentFit) -> FittedCurves:
    break_nm = fit.mean.break_nm
    return FittedCurves(MeanCurve(break_nm, *fit.forward), MeanCurve(break_nm, *fit.backward), fit.mean)


def _six_segments(loop: Loop) -> FittedCurves:
    return _curves(loop.fit)


def _six_segments_20(loop: Loop) -> FittedCurves:
    break_nm = BREAK_20_PERCENT * loop.reference_nm
    return _curves(fit_six_segments(loop.forward, loop.backward, break_nm, loop.method.fit_nm, loop.exclusion_nm))


def _three_regions(loop: Loop) -> FittedCurves:
    below, above = loop.exclusion_nm
    reference, end = loop.reference_nm, loop.method.fit_nm
    forward = fit_three_regions(loop.forward, reference, end, (below, 0.0))
    backward = fit_three_regions(loop.backward, reference, end, (0.0, above))
    return FittedCurves(forward, backward, mean_of(forward, backward))


MADE_BY: dict[str, Made] = {
    "six_segment": Made(_six_segments, lambda method: (method.break_nm,)),
    "six_segment_20pct": Made(_six_segments_20, lambda method: (BREAK_20_PERCENT * method.reference_nm,)),
    "three_region": Made(
        _three_regions, lambda method: tuple(border * method.reference_nm for border in REGION_BORDERS)
    ),
}
"""What makes each fit of `FITS`, by its id."""

DEFAULT_FIT = next(iter(FITS))


def fit_name(fit: str, method: Method) -> str:
    """Return the name of a fit with the torques where its pieces meet.

    Results are told apart by it: stored values count together only where it is the same, word by word.
    """
    breaks = " and ".join(f"{torque:.4g}" for torque in MADE_BY[fit].breaks_nm(method))
    return f"{FITS[fit].name} with breaks at {breaks} N·m"


def fitted_curve(loop: Loop, fit: str, branch: str = "mean", side: int = 1) -> Curve:
    """Return a fitted curve of a loop; AnalysisError when the branches are too short for the fit.

    branch: "mean", or "load" or "unload" of the side, +1 or -1.
    """
    if fit not in loop.curves:
        loop.curves[fit] = MADE_BY[fit].make(loop)
    curves = loop.curves[fit]
    if branch == "mean":
        return curves.mean
    return curves.forward if (branch == "load") == (side > 0) else curves.backward
