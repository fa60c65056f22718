"""Figures of the validity checks that hold input torque and output torque against each other and against the ratio.

Each returns a Reading, or the reason in words why the figure does not apply here.

Two torques say something of ratio, efficiency and zero without any angle. A reducer of ratio i with friction that grows
with its load, mu of it, loads along T_out = C + i/(1 + mu) · T_in and unloads along i/(1 − mu). So the slope of a
loading line over i is the efficiency, and the harmonic mean of both slopes is i, whatever the efficiency. It is the
usual relation η_backward = 2 − 1/η_forward of a gear whose friction is the same both ways; at η_forward = 50 % the gear
locks itself and there is no unloading line. In one direction of motion the unloading line of one side and the loading
line of the other meet where the load is none, for the friction without load is the same from both sides. What the
output sensor reads there is its zero.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from analysis.loop.measured import Measured
from analysis.torque_ratio.neighbours import alike
from analysis.torque_ratio.quadrant_fit import bounce_ends_nm, fit_lines, quadrant_points
from analysis.torque_ratio.quadrants import QUADRANTS, Quadrants, TorqueLine
from analysis.trace.errors import AnalysisError
from analysis.uncertainty.figures import SensorFigures, TorqueChannel
from analysis.validity.evidence import NOT_EVALUATED, Evidence, Figure, LeftOpen, Reading, of_measured, once
from analysis.validity.settled_lines import (
    IN_TRANSITION,
    SIDES,
    TOLD,
    SettledLines,
    Told,
    friction_of,
    ratio_of,
    settled_lines,
    straighter,
    zero_of,
)
from definitions.checks import CHECKS

CONVERTED_BY = "the torque ratio lines used for the conversion"

FRICTION_DIFFERS = 0.03
"""Share by which friction may differ between loading and unloading: the harmonic mean of their slopes then moves by as
much of the friction. That the two are alike is a model of gears, and not what a catalogue states."""

IDLE_DIFFERS = 0.4
"""Share by which friction without load may differ between loading and unloading, of whatever unit: each ± 20 %."""

UNDECLARED_GAIN = 0.01
"""Gain error that both torque sensors together may have where nothing is declared of them."""

STORED_LINES = 0.01
"""Expanded uncertainty of the slope of a stored line of which no covariance is known, relative."""


class Lines(NamedTuple):
    """Each quadrant's line of T_out over T_in, and where it was measured."""

    by_quadrant: Mapping[str, TorqueLine]
    where: str

    def loading(self) -> list[float]:
        """Slopes of the loading lines of both sides."""
        return [self.by_quadrant[f"load_{side}"].slope for side in SIDES]


@once
def lines_of(found: Measured) -> Lines | str:
    """Return the torque lines of a trace, or why it has none.

    They come from the segments that calibrate, else from the measured cycles; where one torque alone is in the trace,
    from the stored lines that convert it. They begin where those of the result do.
    """
    trace = found.trace
    if trace.torque_in_nm is None or trace.torque_out_nm is None:
        if isinstance(found.quadrants, Quadrants):
            return Lines({name: getattr(found.quadrants, name) for name in QUADRANTS}, CONVERTED_BY)
        return "not measured: needs two torque channels"
    calibration = [run for run in found.runs if run.role == "calibrate"]
    cycles = [one.run for pair in found.pairs for one in pair]
    runs = calibration or cycles
    try:
        fits = fit_lines(trace, runs, begins_nm=bounce_ends_nm(trace, runs))
    except AnalysisError as error:
        return f"not measured: {error}"
    where = "the lines of the calibration" if calibration else "the lines of the measured cycles"
    return Lines({name: TorqueLine(fit.offset_nm, fit.slope) for name, fit in fits.items()}, where)


LINE_SHOWN = ("load_positive", "load_negative")
"""Lines whose residual is looked at: an unloading branch begins in the transition after its turn, which is no line."""

LOADED_FRACTION = 0.5
"""Share of the reference torque above which the two torque channels are compared."""


@of_measured
def torque_agreement(found: Measured) -> Reading | str:
    """How far T_out / (i·T_in) is from one under load, %: friction takes some of it, a wrong channel much more."""
    trace, method = found.trace, found.method
    if trace.torque_in_nm is None or trace.torque_out_nm is None:
        return "needs two torque channels"
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
        return "needs a peak torque of at least half the reference torque"
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
        return "needs a locked output; this run locks the input"
    lines = lines_of(found)
    if isinstance(lines, str):
        return lines
    ratio, slope = found.method.ratio, side(lines.loading())
    share = 100.0 * slope / ratio
    words = f"{lines.where} rise by {slope:.4g}, which is an efficiency of {share:.3g} % for the ratio of {ratio:g}"
    return Reading(share, words)


@once
def shown_lines(found: Measured) -> tuple[SettledLines, str] | str:
    """Return what both torques show, and where; or why they do not.

    They come from the segments that calibrate, else from the measured cycles; where one torque alone is in the trace,
    from the stored lines that convert it.
    """
    trace = found.trace
    if trace.torque_in_nm is None or trace.torque_out_nm is None:
        if not isinstance(found.quadrants, Quadrants):
            return "not measured: needs two torque channels"
        stored = {name: getattr(found.quadrants, name) for name in QUADRANTS}
        ratios = {side: Told(one := ratio_of(stored, side), STORED_LINES * one) for side in SIDES}
        zero = zero_of(stored)
        return SettledLines(ratios, Told(zero, 0.0) if math.isfinite(zero) else None, friction_of(stored)), CONVERTED_BY
    calibration = [run for run in found.runs if run.role == "calibrate"]
    cycles = [one.run for pair in found.pairs for one in pair]
    runs, where = straighter(trace, calibration, cycles)
    try:
        return settled_lines(trace, runs), where
    except AnalysisError as error:
        return f"not measured: {error}"


def ratio_agreement(evidence: Evidence) -> Reading | str:
    """How far the ratio that the torques show is from the recipe's, and those of both sides from each other, %.

    Beyond what the gains of both sensors, friction, and the scatter of the lines explain.
    """
    found = evidence.measured
    if found is None:
        return NOT_EVALUATED
    shown = shown_lines(found)
    if isinstance(shown, str):
        return shown
    lines, where = shown
    ratio = found.method.ratio
    friction = FRICTION_DIFFERS * lines.friction
    gain = UNDECLARED_GAIN if evidence.torque_gain is None else evidence.torque_gain
    side, worst = max(lines.ratios.items(), key=lambda one: abs(one[1].value / ratio - 1.0))
    beyond = abs(worst.value / ratio - 1.0) - gain - friction - worst.expanded / ratio
    words = (
        f"{where} show a ratio of {worst.value:.4g} on the {side} side, where the recipe has {ratio:g}; gains and "
        f"friction explain {100.0 * (gain + friction + worst.expanded / ratio):.2g} % of it"
    )
    one, other = (lines.ratios[name] for name in SIDES)
    apart = abs(one.value - other.value) / ratio - friction - math.hypot(one.expanded, other.expanded) / ratio
    if apart > beyond:
        beyond = apart
        words = f"{where} show a ratio of {one.value:.4g} on the positive and {other.value:.4g} on the negative side"
    unsure = max(one.expanded for one in lines.ratios.values()) / ratio
    if unsure > max(TOLD, friction) and 100.0 * beyond <= CHECKS["ratio_agreement"].limit:
        return f"{IN_TRANSITION}; the ratio is {_known(100.0 * unsure, '%')}"
    within = abs(worst.value / ratio - 1.0) + gain + friction + worst.expanded / ratio
    return Reading(100.0 * max(0.0, beyond), words, LeftOpen(0.0, 100.0 * within))


def torque_out_zero(evidence: Evidence) -> Reading | str:
    """What the output sensor reads where no torque is, beyond the zero that is declared of it, % of the reference."""
    found = evidence.measured
    if found is None:
        return NOT_EVALUATED
    if found.method.loading == "output":
        return (
            "not measured: needs a locked output; with a locked input, the lines of loading and unloading do not meet "
            "at zero torque"
        )
    shown = shown_lines(found)
    if isinstance(shown, str):
        return shown
    lines, where = shown
    if lines.zero_nm is None:
        return "not measured: the lines of loading and unloading are nearly the same and have no clear intersection"
    zero_nm, unsure_nm = lines.zero_nm
    reference_nm = found.method.reference_nm
    words = (
        f"{where} meet where the output torque reads {zero_nm:+.3g} N·m, and {evidence.torque_out_zero_nm:.2g} "
        "N·m are declared for its zero"
    )
    beyond_nm = max(0.0, abs(zero_nm) - evidence.torque_out_zero_nm - unsure_nm)
    allowed_nm = CHECKS["torque_out_zero"].limit / 100.0 * reference_nm
    ratio = found.method.ratio
    apart = _apart_at_no_load(lines, where, evidence, ratio)
    if apart is not None and apart.figure > beyond_nm:
        beyond_nm, words = apart.figure, apart.words
    if unsure_nm > allowed_nm >= beyond_nm:
        return f"{IN_TRANSITION}; the zero is {_known(unsure_nm, 'N·m')}"
    return Reading(100.0 * beyond_nm / reference_nm, words, LeftOpen(0.0, _hysteresis_nm(lines, ratio)))


def _apart_at_no_load(lines: SettledLines, where: str, evidence: Evidence, ratio: float) -> Reading | None:
    """Return the hysteresis of the output torque at no load beyond what may be friction, N·m; None where not known."""
    if lines.hysteresis_nm is None or lines.zero_nm is None:
        return None
    (half_nm, unsure_nm), zero_nm = lines.hysteresis_nm, lines.zero_nm.value
    declared_nm = evidence.torque_out_zero_nm + evidence.torque_out_reversibility_nm
    beyond_nm = abs(half_nm) - declared_nm - unsure_nm - _from_friction_nm(lines, ratio, IDLE_DIFFERS)
    words = (
        f"{where} meet where the output torque reads {zero_nm + half_nm:+.3g} N·m while it falls and "
        f"{zero_nm - half_nm:+.3g} N·m while it rises: its sensor has hysteresis, or friction bears a part of it"
    )
    return Reading(beyond_nm, words) if math.isfinite(beyond_nm) else None


def _from_friction_nm(lines: SettledLines, ratio: float, differs: float) -> float:
    """Return how far from no load lines meet by friction without load that differs while loading and unloading, N·m.

    As far as the friction that grows with the load takes to make up for it.
    """
    return differs * lines.idle_nm * ratio / (2.0 * lines.friction) if lines.friction else math.inf


def _hysteresis_nm(lines: SettledLines, ratio: float) -> float:
    """Return the largest hysteresis of the output torque by what it reads at no load, N·m; infinity of any.

    Friction may hide some.
    """
    if lines.hysteresis_nm is None:
        return math.inf
    half_nm, unsure_nm = lines.hysteresis_nm
    return abs(half_nm) + unsure_nm + _from_friction_nm(lines, ratio, FRICTION_DIFFERS)


def zeroes_shown_nm(found: Measured, figures: SensorFigures) -> dict[TorqueChannel, float]:
    """Return how far off the torque zeroes can be that the lines show, N·m: of those beyond what is declared of them.

    A sensor that moves after its tare, or in the middle of it, is off by all of that or by a part. The zeroes after the
    run need not show it: friction stands on the sensor then. Of a locked input, and of stored lines, nothing is known.
    Friction without load that differs between the directions moves the mean of both by half of that.
    """
    trace = found.trace
    if found.method.loading == "output" or trace.torque_in_nm is None or trace.torque_out_nm is None:
        return {}
    shown = shown_lines(found)
    if isinstance(shown, str):
        return {}
    lines, _ = shown
    told: dict[TorqueChannel, tuple[Told | None, float]] = {
        "torque_out_nm": (lines.zero_nm, 0.0),
        "torque_in_nm": (lines.zero_in_nm, FRICTION_DIFFERS / 2.0 * lines.idle_nm),
    }
    off = {}
    for name, (zero, besides_nm) in told.items():
        declared_nm = figures.zero_nm(name)
        if zero is None or declared_nm is None:
            continue
        unsure_nm = zero.expanded + besides_nm
        if math.isfinite(unsure_nm) and abs(zero.value) > declared_nm + unsure_nm:
            off[name] = abs(zero.value) + unsure_nm
    return off


def _known(unsure: float, unit: str) -> str:
    return f"known only to {unsure:.2g} {unit}" if math.isfinite(unsure) else "not known"


LEAST_BLOCKS = 30
"""Points of a loading line from which its bend is told."""


def torque_bend(evidence: Evidence) -> Reading | str:
    """Change of the slope of T_out over T_in from the lower to the upper half of loading, %: a channel that is bent.

    Beyond the gains that are declared and the scatter of the points; friction grows with the load evenly. A bent
    torque makes the stiffness at one torque too large and that at another too small, and its ratio agrees. Friction
    waves with the turn of the shaft, in every cycle alike: points in order of torque, of all cycles, show how far.
    """
    found = evidence.measured
    if found is None:
        return NOT_EVALUATED
    trace = found.trace
    if trace.torque_in_nm is None or trace.torque_out_nm is None:
        return "not measured: needs both torque channels"
    points = quadrant_points(trace, [one.run for pair in found.pairs for one in pair])
    worst, words = 0.0, "the slope of output torque over input torque does not change with the load"
    open_to = LeftOpen(0.0)
    gain = UNDECLARED_GAIN if evidence.torque_gain is None else evidence.torque_gain
    peak_nm = max(float(np.abs(one.torque_nm).max()) for pair in found.pairs for one in pair)
    for name in LINE_SHOWN:
        torque_in, torque_out = points[name]
        if torque_in.size < LEAST_BLOCKS:
            return f"not measured: {name} has {torque_in.size} points"
        span = float(np.ptp(torque_in))
        if not (span > 0.0 and np.ptp(torque_out) > 0.0):
            return f"not measured: a torque does not change while loading ({name})"
        order = np.argsort(torque_in)
        x, y = (torque_in[order] - torque_in.mean()) / span, torque_out[order]
        coefficients, covariance = np.polyfit(x, y, 2, cov=True)
        bend, slope = (float(one) for one in coefficients[:2])
        variance = alike(y - np.polyval(coefficients, x)) * float(covariance[0, 0])
        change, u = abs(bend / slope), math.sqrt(variance) / abs(slope)
        beyond = change - gain - 2.0 * u
        # A hysteresis h · (1 − (T/peak)²) bends the line by h · (span/peak)² in the square of its middle.
        hysteresis_nm = peak_nm**2 / float(np.ptp(torque_out)) / 100.0
        if hysteresis_nm > open_to.for_each:
            open_to = LeftOpen(hysteresis_nm, 100.0 * hysteresis_nm * (gain + 2.0 * u))
        if beyond > worst:
            worst = beyond
            words = f"the slope of output torque over input torque changes by {100.0 * change:.2g} % with the load"
    return Reading(100.0 * worst, words, open_to)


@of_measured
def torque_lines(found: Measured) -> Reading | str:
    """What a straight loading line of T_out over T_in leaves in the measured cycles (rms), % of the reference torque.

    More than noise is left by a channel that is not linear, by one that lags behind the other, and by a load that
    swings because its control is given a late torque. The cycles are looked at, not the calibration: its first branch
    begins at rest, with friction of its own.
    """
    if found.trace.torque_in_nm is None or found.trace.torque_out_nm is None:
        return "not measured: needs both torque channels"
    try:
        fits = fit_lines(found.trace, [one.run for pair in found.pairs for one in pair])
    except AnalysisError as error:
        return f"not measured: {error}"
    left_nm = max(fits[name].residual_sd_nm for name in LINE_SHOWN)
    words = f"output torque over input torque is not a straight line by {left_nm:.3g} N·m"
    return Reading(100.0 * left_nm / found.method.reference_nm, words)


FIGURES: dict[str, Figure] = {
    "torque_agreement": torque_agreement,
    "efficiency_low": efficiency_low,
    "efficiency_high": efficiency_high,
    "ratio_agreement": ratio_agreement,
    "torque_out_zero": torque_out_zero,
    "torque_lines": torque_lines,
    "torque_bend": torque_bend,
}
"""Figures of these checks, by their ids."""
