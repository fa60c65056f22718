"""From a trace to a result: the loops, then checks, the uncertainty, metrics and verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from analysis.evaluation.evaluate import evaluate
from analysis.evaluation.friction_offset import friction_offset_note
from analysis.evaluation.metric_result import MetricResult
from analysis.evaluation.verdict import Verdict, worst
from analysis.loop.branches import Branch
from analysis.loop.closure import closed_loops
from analysis.loop.fits import MeanCurve
from analysis.loop.interruptions import mended
from analysis.loop.measured import Measured, loops_by_output, measure
from analysis.loop.method import Decision, Method, MetricWanted
from analysis.loop.samples import part_ends_nm
from analysis.loop.stages import StageRecord
from analysis.metrics.wanted import definition
from analysis.torque_ratio.quadrants import Quadrants
from analysis.trace.errors import AnalysisError
from analysis.trace.trace import Trace
from analysis.trace.units import FloatArray
from analysis.uncertainty.figures import TORQUES, SensorFigures
from analysis.uncertainty.measurement import measurement_of
from analysis.validity.evidence import RunFacts, evidence_of
from analysis.validity.judge import CheckResult, check_reasons, judge_checks
from analysis.validity.ramp_ends import lateness_of
from analysis.validity.torque_checks import zeroes_shown_nm

CURVE_POINTS = 401
"""Torques of the mean curves given for plotting."""


@dataclass(frozen=True)
class Curves:
    """What a plot of the loop shows: branches per cycle, the mean of the first cycle, and its fit (None: no fit)."""

    forward: tuple[Branch, ...]
    backward: tuple[Branch, ...]
    mean: Branch
    fit: MeanCurve | None
    parts_nm: tuple[tuple[FloatArray, FloatArray], ...]
    """Torques [N·m] between the ramps and holds of each rising and each falling branch, in order; none of one ramp."""


@dataclass(frozen=True)
class Result:
    """Metrics, verdict with reasons and rule, curves, the torque ratio if there is one, and what each stage did."""

    metrics: tuple[MetricResult, ...]
    verdict: Verdict
    reasons: tuple[str, ...]
    decision: Decision
    curves: Curves
    quadrants: Quadrants | None
    stages: tuple[StageRecord, ...]
    checks: tuple[CheckResult, ...]
    besides: tuple[str, ...] = ()
    """What a person should know beside the verdict."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What each stage did, in words, what stands beside the verdict, why a metric without a limit has no value."""
        missing = [reason for metric in self.metrics if not metric.limited for reason in metric.reasons]
        return (*(stage.text for stage in self.stages), *self.besides, *missing)

    def to_dict(self) -> dict[str, object]:
        """Return verdict, reasons, metrics, notes, checks and stages as plain data (the JSON contract)."""
        return {
            "verdict": self.verdict.value,
            "reasons": list(self.reasons),
            "decision": {"rule": self.decision.rule, "guard_factor": self.decision.guard_factor},
            "metrics": [metric.to_dict() for metric in self.metrics],
            "notes": list(self.notes),
            "gates": [check.to_dict() for check in self.checks],
            "not_excluded": [asdict(check.left_open) for check in self.checks if check.left_open is not None],
            "stages": [stage.to_dict() for stage in self.stages],
        }


def analyse(
    trace: Trace,
    method: Method,
    wanted: Sequence[MetricWanted],
    decision: Decision | None = None,
    invalid: Sequence[str] = (),
    *,
    facts: RunFacts | None = None,
    figures: SensorFigures | None = None,
    draws: int = 0,
) -> Result:
    """Evaluate a trace and judge it.

    invalid: reasons, in plain words, why the record has errors; any makes the verdict NOT DECIDABLE, as a failed
    validity check does. facts: how the trace was recorded, for the checks on timing and samples. figures: what is
    declared of the sensors; without them the uncertainty is the scatter of the cycles. draws: of Monte Carlo
    beside the budget, 0 for none. Raises AnalysisError for a trace without what the method needs, for wanted metrics
    that do not exist, and for nothing else; a metric that the loop does not carry is NOT DECIDABLE with its reason.
    """
    rule = Decision() if decision is None else decision
    rows = [definition(one) for one in wanted]
    with np.errstate(all="ignore"):
        found = measure(trace, method, with_ratio=any(row.calibration for row in rows))
        late = lateness_of(found)
        checks = judge_checks(evidence_of(found, facts, tuple(invalid), figures, late), method.check_limits)
        checks, left_open = _left_open(checks, method, declared=figures is not None)
        problems = check_reasons(checks, tuple(invalid))
        by_output = [] if figures is None else loops_by_output(found)
        late_s = 0.0 if isinstance(late, str) else late.seconds
        moved = {} if facts is None else {name: facts.zero_shift_nm(name) for name in TORQUES}
        errors, stage = measurement_of(
            found, figures, by_output=by_output, draws=draws, late_s=late_s,
            zero_shifts_nm={name: nm for name, nm in moved.items() if nm is not None},
            zeroes_shown_nm=None if figures is None else zeroes_shown_nm(found, figures), left_open=left_open,
            holds=None if facts is None else facts.holds,
        )  # fmt: skip
        closed, unbroken = closed_loops(found), mended(found.loops, found.interruptions)
        metrics = tuple(
            evaluate(
                one, found.loops, found.quadrants, method, rule,
                invalid=bool(problems), measurement=errors, closed=closed, by_output=by_output, unbroken=unbroken,
                unbounded=late if isinstance(late, str) and found.skew.u_s is None else "",
            )
            for one in wanted
        )  # fmt: skip
        curves = _curves(found)
    verdict, reasons = _overall(metrics, problems)
    ratio = found.quadrants if isinstance(found.quadrants, Quadrants) else None
    friction = friction_offset_note(ratio, method.catalogue_offset_nm)
    besides = (friction,) if friction else ()
    return Result(metrics, verdict, tuple(reasons), rule, curves, ratio, (*found.stages, stage), checks, besides)


def _left_open(
    checks: tuple[CheckResult, ...], method: Method, *, declared: bool
) -> tuple[tuple[CheckResult, ...], dict[str, float | None] | None]:
    """Return the checks with what becomes of the errors that they leave open, and the sizes for the budget, by check.

    None where the budget shall have none. declared: there is a budget of the sensors.
    """
    if method.left_open == "told":
        return checks, None
    sizes = {check.id: check.left_open.figure for check in checks if check.left_open is not None}
    said = tuple(
        replace(check, left_open=check.left_open and replace(check.left_open, in_budget=declared)) for check in checks
    )
    return said, sizes


def _curves(found: Measured) -> Curves:
    first = found.loops[0]
    low = max(float(first.forward.torque_nm[0]), float(first.backward.torque_nm[0]))
    high = min(float(first.forward.torque_nm[-1]), float(first.backward.torque_nm[-1]))
    torque = np.linspace(low, high, CURVE_POINTS)
    mean = Branch(torque, (first.forward.at(torque) + first.backward.at(torque)) / 2.0)
    try:
        fit: MeanCurve | None = first.fit.mean
    except AnalysisError:
        fit = None
    forward, backward = zip(*((loop.forward, loop.backward) for loop in found.loops), strict=True)
    parts = tuple((part_ends_nm(rising), part_ends_nm(falling)) for rising, falling in found.pairs)
    return Curves(forward, backward, mean, fit, parts)


def _overall(metrics: Sequence[MetricResult], problems: Sequence[str]) -> tuple[Verdict, list[str]]:
    """Verdict of the run and its reasons, the deciding ones first."""
    reasons = list(problems)
    judged = sorted((one for one in metrics if one.limited), key=lambda metric: metric.verdict is not Verdict.FAIL)
    reasons += [reason for metric in judged for reason in metric.reasons]
    if problems:
        return Verdict.NOT_DECIDABLE, reasons
    if not judged:
        return Verdict.NOT_DECIDABLE, [*reasons, "no metric has a limit: there is nothing to decide"]
    return worst(metric.verdict for metric in judged if metric.verdict is not None), reasons
