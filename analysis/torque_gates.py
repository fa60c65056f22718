"""Figures of the validity gates that hold input torque and output torque against each other and against the ratio.

Each returns a Reading, or the reason in words why the figure does not apply here.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from analysis.errors import AnalysisError
from analysis.measured import Evidence, Measured
from analysis.quadrant_fit import fit_lines
from analysis.reading import NOT_EVALUATED, Reading, of_measured
from analysis.torque_lines import lines_of

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
        if method.loading == "input":  # an output sensor that stands still is under load all the same
            loading |= one.run.direction * method.ratio * torque_in > method.reference_nm
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
    lines = lines_of(found)
    if isinstance(lines, str):
        return lines
    ratio, slope = found.method.ratio, side(lines.loading())
    share = 100.0 * slope / ratio
    words = f"{lines.where} rise by {slope:.4g}, which is an efficiency of {share:.3g} % for the ratio of {ratio:g}"
    return Reading(share, words)


@of_measured
def ratio_agreement(found: Measured) -> Reading | str:
    """How far the ratio that the torques show is from the recipe's, %; the worse side."""
    lines = lines_of(found)
    if isinstance(lines, str):
        return lines
    ratio = found.method.ratio
    shown = max(lines.ratios(), key=lambda one: abs(one / ratio - 1.0))
    words = f"{lines.where} show a ratio of {shown:.4g}, where the recipe has {ratio:g}"
    return Reading(100.0 * abs(shown / ratio - 1.0), words)


def torque_out_zero(evidence: Evidence) -> Reading | str:
    """What the output sensor reads where no torque is, beyond the zero that is declared of it, % of the reference."""
    found = evidence.measured
    if found is None:
        return NOT_EVALUATED
    if found.method.loading == "output":
        return "not measured: at a locked input the torque lines meet at the friction, not at zero torque"
    lines = lines_of(found)
    if isinstance(lines, str):
        return lines
    zero_nm = lines.zero_nm()
    if zero_nm is None:
        return "not measured: loading and unloading have nearly the same line, and meet nowhere definite"
    words = (
        f"{lines.where} meet where the output torque reads {zero_nm:+.3g} N·m, and {evidence.torque_out_zero_nm:.2g} "
        "N·m are declared of its zero"
    )
    beyond_nm = max(0.0, abs(zero_nm) - evidence.torque_out_zero_nm)
    return Reading(100.0 * beyond_nm / found.method.reference_nm, words)


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
