"""Wanted metrics from loops: per cycle, then mean and deviation over the cycles, uncertainty, limits and verdict."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from analysis.evaluation.metric_result import MetricResult, SideValue
from analysis.evaluation.verdict import Verdict, check_limits, judge, judge_spread, worst
from analysis.loop.curves import DEFAULT_FIT, fit_name
from analysis.loop.loop import Loop
from analysis.loop.method import Decision, Method, MetricWanted
from analysis.metrics.estimators import ESTIMATORS, Ask, backlash_limits, grade_of, grade_uncertainty
from analysis.metrics.wanted import definition
from analysis.torque_ratio.quadrants import Quadrants, TorqueLine
from analysis.trace.errors import AnalysisError
from analysis.uncertainty.budget import NOISE, SCATTER, Budget, of_scatter
from analysis.uncertainty.left_open import OPEN
from analysis.uncertainty.loop_uncertainty import CONVERSION
from analysis.uncertainty.measurement import ONE_CYCLE, Measurement
from definitions.metrics import GRADED, Metric

UNTIMED = (
    "its uncertainty lacks the contributions of delay and drift, because the measured data have no time. A guard "
    "band needs both: record the time (column t_s)"
)
UNBOUNDED = (
    "a torque that lags makes this value smaller, and the delay could not be measured ({}); record two turning "
    "points or more, without leaving out rows"
)
OF_CYCLES = (NOISE[0], SCATTER[0], "drift", "drift_unseen")
"""Rows of a budget that more cycles make smaller."""


class _Doubt(NamedTuple):
    """What a value may pass by that is not of the unit, up to what it would be without, and what to do."""

    only: str
    remedy: str


_GAP = _Doubt(
    "if the gap of the loop is not caused by the unit. Without that gap",
    "check lock, couplings and encoder, and measure again",
)
_CONVERSION = _Doubt(
    "with the converted torque. With the torque measured at the output",
    "the torque ratio is wrong for this unit: calibrate it, or write 'output_torque: reaction'",
)


FIND_CAUSE = "find the cause of the interruptions, and measure again"


def _interrupted(found: str) -> _Doubt:
    """Return the doubt about ramps that were interrupted; found: where, and what the record knows of it."""
    return _Doubt(f"with the steps at interrupted ramps{_in_brackets(found)}. Without them", FIND_CAUSE)


def _in_brackets(found: str) -> str:
    return f" ({found})" if found else ""


class _Measured(NamedTuple):
    """Values per cycle, the budget of their mean, and what went wrong if there are none."""

    values: tuple[float, ...]
    budget: Budget | None
    trouble: str
    why_none: str = ONE_CYCLE
    """Why there is no budget where there are values."""
    unlimited: str = ""
    """Why the budget lacks an error that it shall have; '' if it has all."""


def evaluate(
    wanted: MetricWanted, loops: Sequence[Loop], quadrants: Quadrants | AnalysisError, method: Method,
    decision: Decision, *, invalid: bool, measurement: Measurement | None = None, closed: Sequence[Loop] = (),
    by_output: Sequence[Loop] = (), unbroken: Sequence[Loop] = (), unbounded: str = "",
) -> MetricResult:  # fmt: skip
    """Evaluate one wanted metric over all cycles.

    quadrants: the measured torque ratio, or why there is none. invalid: the measurement is, so limits decide nothing.
    measurement: what is known of its errors; without it the uncertainty is the scatter of the cycles.
    closed: the loops with their gap undone; what passes by the gap alone is not decided. by_output: where the torque is
    converted, the loops by the torque at the output; nor is what passes by an error of the conversion alone. unbroken:
    the loops with the steps undone that interrupted ramps left; nor is what passes by these alone. unbounded: why
    nothing tells how late the torque is; then a metric of the loop's width, which a late torque makes small, is not
    decided either.
    Raises AnalysisError only for a metric that does not exist or limits that make no sense.
    """
    row = definition(wanted)
    check_limits(wanted.id, wanted.min, wanted.max)
    sides = row.sides if wanted.side is None else (wanted.side,)
    band = row.band if wanted.band is None else wanted.band
    torque = _torque(wanted, row, method)
    variant = wanted.variant or next(iter(row.variants), "")
    fit = wanted.fit or next(iter(row.fits), DEFAULT_FIT)
    branch = wanted.branch or row.branches[0]
    found = []
    for side in sides:
        ask = Ask({"+": 1, "-": -1}.get(side, 0), branch, torque or 0.0, band or 0.0, variant, fit)
        measured = (
            _from_ratio(row, ask.side, quadrants, measurement)
            if row.calibration
            else _from_loops(row, ask, loops, measurement)
        )
        judged = _judged_grade if row.graded else _judged
        one = judged(wanted, side, measured, decision, invalid=invalid)
        limited = wanted.min is not None or wanted.max is not None
        converted = by_output if _misconverted(measured.budget) else ()
        broken = _interrupted("" if measurement is None else measurement.interruptions)
        for doubt, others in ((_GAP, closed), (_CONVERSION, converted), (broken, unbroken)):
            if not others or not limited or row.calibration or invalid or one.verdict is not Verdict.PASS:
                continue
            # Of the values alone: U was in the first judgement, and the budget moves hardly with them.
            values = _from_loops(row, ask, others, None)
            again = judged(wanted, side, values._replace(budget=measured.budget), decision, invalid=invalid)
            one = _without_doubt(wanted.id, row, one, again, doubt)
        if unbounded and row.narrowed_by_delay and limited and not invalid and one.verdict is Verdict.PASS:
            one = replace(one, verdict=Verdict.NOT_DECIDABLE, reason=f"{wanted.id}: {UNBOUNDED.format(unbounded)}")
        found.append(judged_spread(wanted, row, one, invalid=invalid))
    estimator = _estimator(row, variant, fit, method)
    return MetricResult(wanted, row, branch, estimator, band, torque, tuple(found), _choices(wanted, row))


def _estimator(row: Metric, variant: str, fit: str, method: Method) -> str:
    """Say how the value is read, with the break torques that it depends on."""
    if variant == "direct":
        return "branches as measured"
    parts = [row.estimator, variant] if row.variants else [row.estimator]
    parts += [fit_name(fit, method)] if row.fits else []
    parts += ["T1 {:.4g} and T2 {:.4g} N·m".format(*method.stiffness_breaks_nm)] if row.segmented else []
    return ", ".join(parts)


def _choices(wanted: MetricWanted, row: Metric) -> tuple[str, ...]:
    """Say what of band, variant and fit is not as the definition has it by itself."""
    found = [] if wanted.band in (None, row.band) else [f"band {100.0 * (wanted.band or 0.0):g} %"]
    found += [] if wanted.variant in (None, *row.variants[:1]) else [str(wanted.variant)]
    return (*found, *([] if wanted.fit is None or wanted.fit == row.fits[0] else [wanted.fit]))


def _torque(wanted: MetricWanted, row: Metric, method: Method) -> float | None:
    if row.torque is None:
        return None
    return row.torque * method.reference_nm if wanted.torque_nm is None else wanted.torque_nm


def _from_loops(row: Metric, ask: Ask, loops: Sequence[Loop], measurement: Measurement | None) -> _Measured:
    """Read each cycle's value from its loop."""
    estimate = ESTIMATORS[row.id]
    if not loops:
        return _Measured((), None, "the trace has no loop to evaluate")
    try:
        values = tuple(float(estimate(loop, ask)) for loop in loops)
    except (AnalysisError, ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
        return _Measured((), None, str(error))
    if not all(math.isfinite(value) for value in values):
        return _Measured((), None, f"the result is not a finite number ({', '.join(f'{value:g}' for value in values)})")
    unit = "arcmin" if row.graded else row.unit  # a grade is read from an angle
    # A magnitude is taken of the mean: about zero those of single cycles and of moved loops would never cancel.
    turn = -1.0 if row.magnitude and sum(values) < 0.0 else 1.0
    values = tuple(turn * value for value in values)
    if measurement is None:
        return _Measured(values, of_scatter(values, unit), "")
    budget = measurement.of_loops(lambda loop: turn * estimate(loop, ask), values, unit)
    unlimited = measurement.trouble_of_loops(lambda loop: turn * estimate(loop, ask))
    return _Measured(values, budget, "", measurement.why_none, unlimited)


def _from_ratio(
    row: Metric, side: int, quadrants: Quadrants | AnalysisError, measurement: Measurement | None
) -> _Measured:
    """Read the value from the loading line of one side; the negative side's offset is mirrored."""
    if isinstance(quadrants, AnalysisError):
        return _Measured((), None, str(quadrants))
    which = "load_positive" if side > 0 else "load_negative"
    line: TorqueLine = getattr(quadrants, which)
    value = line.slope if row.id == "torque_ratio_slope" else side * line.offset_nm
    if measurement is None:
        return _Measured((value,), None, "")
    budget = measurement.of_line(which, row.id, row.unit, value)
    return _Measured((value,), budget, "", unlimited=measurement.trouble_of_line(which))


def _judged(wanted: MetricWanted, side: str, measured: _Measured, decision: Decision, *, invalid: bool) -> SideValue:
    """Judge one side and word the reason when it does not pass."""
    values, budget, trouble, why_none, unlimited = measured
    expanded = None if budget is None else budget.expanded
    value = float(np.mean(values)) if values else None
    deviation = float(np.std(values, ddof=1)) if len(values) > 1 else None
    name = wanted.id if side == "both" else f"{wanted.id}, side {side}"
    limited = wanted.min is not None or wanted.max is not None
    if value is None:
        verdict, reason = Verdict.NOT_DECIDABLE, f"{name}: could not be evaluated: {trouble}"
    elif not limited:
        verdict, reason = Verdict.PASS, ""
    elif invalid:
        verdict, reason = Verdict.NOT_DECIDABLE, ""
    elif unlimited:
        verdict, reason = Verdict.NOT_DECIDABLE, f"{name}: {unlimited}"
    elif decision.rule == "guard_band" and budget is not None and budget.kind == "untimed":
        verdict, reason = Verdict.NOT_DECIDABLE, f"{name}: {UNTIMED}"
    else:
        verdict, limit = judge(value, expanded, (wanted.min, wanted.max), decision)
        reason = (
            "" if verdict is Verdict.PASS else f"{name}: {_because(wanted, value, budget, verdict, limit, why_none)}"
        )
    return SideValue(side, value, expanded, deviation, values, verdict, reason, budget)


def judged_spread(wanted: MetricWanted, row: Metric, found: SideValue, *, invalid: bool) -> SideValue:
    """Return a side with its standard deviation over the cycles judged too, where that has a limit."""
    limit = wanted.max_standard_deviation
    if limit is None or found.value is None:
        return found
    if invalid:
        return replace(found, verdict=Verdict.NOT_DECIDABLE)
    verdict = judge_spread(found.standard_deviation, limit)
    if verdict is Verdict.PASS:
        return found
    name = wanted.id if found.side == "both" else f"{wanted.id}, side {found.side}"
    unit = "" if row.unit == "1" else f" {row.unit}"
    if verdict is Verdict.FAIL:
        why = f"standard deviation over the cycles {found.standard_deviation:.3g}{unit}, above the limit of "
        why += f"{limit:g}{unit}: the unit does not repeat, or something is loose"
    else:
        why = f"a standard deviation needs two cycles or more; there is {len(found.per_cycle)}"
    reason = f"{found.reason}; {why}" if found.reason else f"{name}: {why}"
    return replace(found, verdict=worst((found.verdict, verdict)), reason=reason)


def _judged_grade(
    wanted: MetricWanted, side: str, measured: _Measured, decision: Decision, *, invalid: bool
) -> SideValue:
    """Judge a grade by its backlash [arcmin]: a limit on the one is a limit on the other."""
    backlash = GRADED[wanted.variant or next(iter(GRADED))]
    low, high = backlash_limits(wanted.min, wanted.max)
    found = _judged(MetricWanted(backlash, min=low, max=high), side, measured, decision, invalid=invalid)
    reason = found.reason and f"{wanted.id}: {found.reason}"
    if found.value is None:
        return replace(found, reason=reason)
    steps = None if found.uncertainty is None else grade_uncertainty(found.value, found.uncertainty)
    grades = tuple(float(grade_of(one)) for one in found.per_cycle)
    spread = float(np.std(grades, ddof=1)) if len(grades) > 1 else None
    return replace(
        found,
        value=float(grade_of(found.value)),
        uncertainty=steps,
        standard_deviation=spread,
        per_cycle=grades,
        reason=reason,
    )


def _misconverted(budget: Budget | None) -> bool:
    """Say whether the torque at the output shows more of the conversion than is known to be wrong with it."""
    return budget is not None and any(row.quantity == CONVERSION[0] for row in budget.rows)


def _without_doubt(name: str, row: Metric, found: SideValue, again: SideValue, doubt: _Doubt) -> SideValue:
    """Return a value that passes; not decided where it would not by the other loops that are as likely."""
    if again.verdict is Verdict.PASS:
        return found
    name = name if found.side == "both" else f"{name}, side {found.side}"
    unit = "" if row.unit == "1" else f" {row.unit}"
    would = "has no value" if again.value is None else f"is {again.value:.4g}{unit}, which does not pass"
    reason = f"{name}: {found.value:.4g}{unit} passes only {doubt.only} it {would}; {doubt.remedy}"
    return replace(found, verdict=Verdict.NOT_DECIDABLE, reason=reason)


def _because(  # noqa: PLR0917 - what was found, and what it was held against
    wanted: MetricWanted, value: float, budget: Budget | None, verdict: Verdict, limit: str, why_none: str
) -> str:
    row = definition(wanted)
    unit = "" if row.unit == "1" else f" {row.unit}"
    if budget is None and verdict is Verdict.NOT_DECIDABLE:
        return f"{value:.4g}{unit}: the guard band needs the uncertainty of this value. {why_none}"
    bound = wanted.min if limit == "min" else wanted.max
    if budget is not None and verdict is Verdict.NOT_DECIDABLE:
        return (
            f"{value:.4g}{unit} is too near to the limit of {bound:g}{unit} for its uncertainty of "
            f"{budget.expanded:.2g}{unit}: it is neither PASS nor FAIL; {_what_helps(budget)}"
        )
    where, meaning = ("below", row.bad.too_low) if limit == "min" else ("above", row.bad.too_high)
    return f"{value:.4g}{unit} is {where} the limit of {bound:g}{unit}: {meaning}"


def _what_helps(budget: Budget) -> str:
    """Say what makes an uncertainty smaller: more cycles, unless most of it is in all cycles alike."""
    if budget.coverage.why:
        where = _in_brackets(budget.coverage.found)
        return f"U is stated with k = {budget.coverage.factor:g} because a ramp was interrupted{where}; {FIND_CAUSE}"
    largest = budget.rows[0] if budget.rows else None
    if largest is None or largest.quantity in OF_CYCLES:
        return "measure more cycles"
    said = f"the largest contribution to the uncertainty is: {largest.text}"
    if largest.quantity.startswith(OPEN):
        return f"{said}; lower the limit of that check (validity), or write 'left_open: told' in the recipe"
    return f"{said}; more cycles do not reduce this contribution"
