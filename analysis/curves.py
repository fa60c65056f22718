"""The fits that a stiffness curve can be read from, as a table; a loop keeps each one that was asked for.

A fit gives three curves of wind-up over torque: forward branch, return branch, and their mean F(T).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from analysis.loop import Curve, FittedCurves, Loop
from analysis.method import Method
from analysis.region_fit import REGION_BORDERS, fit_three_regions, mean_of
from analysis.segment_fit import MeanCurve, SixSegmentFit, fit_six_segments

BREAK_20_PERCENT = 0.2
"""Break torque of the six-segment fit by "inverse loading test system", of the reference torque."""


class Fit(NamedTuple):
    """Row of `FITS`: name in a result, what it does, where it comes from, what makes it, its breaks [N·m]."""

    name: str
    text: str
    source: str
    make: Callable[[Loop], FittedCurves]
    breaks_nm: Callable[[Method], tuple[float, ...]]

    def called(self, method: Method) -> str:
        """Return its name with the torques where its pieces meet."""
        return f"{self.name} with breaks at {' and '.join(f'{torque:.4g}' for torque in self.breaks_nm(method))} N·m"


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


FITS: dict[str, Fit] = {
    "six_segment": Fit(
        "six-segment fit",
        "linear to the break torque (±90 N·m for 412 N·m unless the recipe gives one), quadratic beyond; the middle is "
        "shifted by the mean gap at its seams",
        "backlash and stiffness measurement",
        _six_segments,
        lambda method: (method.break_nm,),
    ),
    "six_segment_20pct": Fit(
        "six-segment fit",
        "as six_segment, with the break torque at 20 % of the reference torque",
        "inverse loading",
        _six_segments_20,
        lambda method: (BREAK_20_PERCENT * method.reference_nm,),
    ),
    "three_region": Fit(
        "three-region fit",
        "each side quadratic to 20 %, linear to 80 %, quadratic beyond; the regions are not shifted to meet",
        "inverse loading",
        _three_regions,
        lambda method: tuple(border * method.reference_nm for border in REGION_BORDERS),
    ),
}
"""All fits by name; the first one is taken when none is asked for."""

DEFAULT_FIT = next(iter(FITS))


def fitted_curve(loop: Loop, fit: str, branch: str = "mean", side: int = 1) -> Curve:
    """Return a fitted curve of a loop; AnalysisError when the branches are too short for the fit.

    branch: "mean", or "load" or "unload" of the side, +1 or -1.
    """
    if fit not in loop.curves:
        loop.curves[fit] = FITS[fit].make(loop)
    curves = loop.curves[fit]
    if branch == "mean":
        return curves.mean
    return curves.forward if (branch == "load") == (side > 0) else curves.backward
