"""Figures of the validity gates that hold input torque and output torque against each other and against the ratio.

Each returns a Reading, or the reason in words why the figure does not apply here.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from analysis.errors import AnalysisError
from analysis.measured import Measured
from analysis.quadrant_fit import fit_lines
from analysis.reading import Reading, of_measured
from analysis.torque_lines import slopes_of

LINE_SHOWN = ("load_positive", "load_negative")
"""Lines whose residual is looked at: an unloading branch begins in the transition after its turn, which is no line."""

LOADED_FRACTION = 0.5
"""Share of the reference torque above which the two torque channels are compared."""


@of_measured
def torque_agreement(found: Measured) -> Reading | str:
    """How far T_out / (i·T_in) is from one under load, %: friction takes some of it, a wrong channel much more."""
    trace, method = found.trace, found.method
    if trace.torque_in_nm is None or trace.torque_out_nm is None:
        return "one torque channel has none to agree with"
    ratios = []
    for one in (one for pair in found.pairs for one in pair):
        torque_in, torque_out = one.run.take(trace.torque_in_nm), one.run.take(trace.torque_out_nm)
        step = -(-torque_in.size // 2000)
        torque_in, torque_out = torque_in[::step], torque_out[::step]
        # Of the shaft that the servo does not drive, the torque is what friction lets through: loading only.
        loading = one.run.direction * torque_out > LOADED_FRACTION * method.reference_nm
        ratios.append(torque_out[loading] / (method.ratio * torque_in[loading]))
    under_load = np.concatenate(ratios)
    if not under_load.size:
        return "the reference torque is not half reached"
    ratio = float(np.median(under_load))
    return Reading(100.0 * abs(ratio - 1.0), f"T_out / (ratio · T_in) is {ratio:.3g} under load")


@of_measured
def efficiency_low(found: Measured) -> Reading | str:
    """Efficiency of the side that lets less torque through, %."""
    return _efficiency(found, min)


@of_measured
def efficiency_high(found: Measured) -> Reading | str:
    """Efficiency of the side that lets more torque through, %."""
    return _efficiency(found, max)


def _efficiency(found: Measured, side: Callable[[list[float]], float]) -> Reading | str:
    if found.method.loading == "output":
        return "the input is locked: what arrives there says nothing of the efficiency"
    slopes = slopes_of(found)
    if isinstance(slopes, str):
        return slopes
    ratio, slope = found.method.ratio, side(slopes.loading())
    share = 100.0 * slope / ratio
    words = f"{slopes.where} rise by {slope:.4g}, which is an efficiency of {share:.3g} % for the ratio of {ratio:g}"
    return Reading(share, words)


@of_measured
def ratio_agreement(found: Measured) -> Reading | str:
    """How far the ratio that the torques show is from the recipe's, %; the worse side."""
    slopes = slopes_of(found)
    if isinstance(slopes, str):
        return slopes
    ratio = found.method.ratio
    shown = max(slopes.ratios(), key=lambda one: abs(one / ratio - 1.0))
    words = f"{slopes.where} show a ratio of {shown:.4g}, where the recipe has {ratio:g}"
    return Reading(100.0 * abs(shown / ratio - 1.0), words)


@of_measured
def torque_lines(found: Measured) -> Reading | str:
    """What a straight loading line of T_out over T_in leaves in the measured cycles (rms), % of the reference torque.

    More than noise is left by a channel that is not linear, by one that lags behind the other, and by a load that
    swings because its control is given a late torque. The cycles are looked at, not the calibration: its first branch
    begins at rest, with friction of its own.
    """
    if found.trace.torque_in_nm is None or found.trace.torque_out_nm is None:
        return "not measured: one torque channel alone shows no line"
    try:
        fits = fit_lines(found.trace, [one.run for pair in found.pairs for one in pair])
    except AnalysisError as error:
        return f"not measured: {error}"
    left_nm = max(fits[name].residual_sd_nm for name in LINE_SHOWN)
    words = f"the torques of both shafts leave their straight lines by {left_nm:.3g} N·m"
    return Reading(100.0 * left_nm / found.method.reference_nm, words)
