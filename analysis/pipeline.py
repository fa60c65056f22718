"""From a trace to a result: the stages in their order, then gates, metrics and verdict.

Order: common clock; wind-up; turning points; virgin quarter dropped; output torque; drift; fixture; branches; bins;
monotone regression; reversal zones; fits; metrics. Each stage is a function of its own module and leaves a record.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.alignment import MOST_ROUNDS, Skew, align, skew_of_cycles
from analysis.branches import Blocks, Branch, binned, branch_records, monotone
from analysis.closure import closed_loops
from analysis.drift import Pairs, correct_drift
from analysis.errors import AnalysisError
from analysis.evaluate import evaluate
from analysis.fixture import correct_fixture
from analysis.gates import GateResult, gate_reasons, judge_gates
from analysis.loop import Loop, fit_record, reversal_record
from analysis.measured import Evidence, Measured, RunFacts
from analysis.method import Decision, Method, MetricWanted
from analysis.metric_result import MetricResult
from analysis.metrics import definition
from analysis.quadrants import Quadrants
from analysis.samples import branch_samples, output_torque_record, torque_ratio
from analysis.segment_fit import MeanCurve
from analysis.stages import StageRecord
from analysis.trace import Trace
from analysis.turning import converts, turning_points, virgin_quarter
from analysis.uncertainty.figures import SensorFigures
from analysis.uncertainty.measurement import measurement_of
from analysis.verdict import Verdict, worst
from analysis.windup import measured_windup

CURVE_POINTS = 401
"""Torques of the mean curves given for plotting."""


@dataclass(frozen=True)
class Curves:
    """What a plot of the loop shows: branches per cycle, the mean of the first cycle, and its fit (None: no fit)."""

    forward: tuple[Branch, ...]
    backward: tuple[Branch, ...]
    mean: Branch
    fit: MeanCurve | None


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
    gates: tuple[GateResult, ...]

    @property
    def notes(self) -> tuple[str, ...]:
        """What each stage did, in words."""
        return tuple(stage.text for stage in self.stages)

    def to_dict(self) -> dict[str, object]:
        """Return verdict, reasons, metrics, notes, gates and stages as plain data (the JSON contract)."""
        return {
            "verdict": self.verdict.value,
            "reasons": list(self.reasons),
            "decision": {"rule": self.decision.rule, "guard_factor": self.decision.guard_factor},
            "metrics": [metric.to_dict() for metric in self.metrics],
            "notes": list(self.notes),
            "gates": [gate.to_dict() for gate in self.gates],
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

    invalid: reasons, in plain words, why the record does not count; any makes the verdict NOT DECIDABLE, as a failed
    validity gate does. facts: how the trace was recorded, for the gates on timing and samples. figures: what is
    declared of the sensors; without them the uncertainty is the scatter of the cycles. draws: of Monte Carlo
    beside the budget, 0 for none. Raises AnalysisError for a trace without what the method needs, for wanted metrics
    that do not exist, and for nothing else; a metric that the loop does not carry is NOT DECIDABLE with its reason.
    """
    rule = Decision() if decision is None else decision
    rows = [definition(one) for one in wanted]
    with np.errstate(all="ignore"):
        found = measure(trace, method, with_ratio=any(row.estimate is None for row in rows))
        gates = judge_gates(_evidence(found, facts, tuple(invalid), figures), method.gate_limits)
        problems = gate_reasons(gates, tuple(invalid))
        by_output = [] if figures is None else _loops_by_output(found)
        errors, stage = measurement_of(found, figures, by_output=by_output, draws=draws)
        closed = closed_loops(found)
        metrics = tuple(
            evaluate(
                one, found.loops, found.quadrants, method, rule,
                invalid=bool(problems), measurement=errors, closed=closed, by_output=by_output,
            )
            for one in wanted
        )  # fmt: skip
        curves = _curves(found.loops)
    verdict, reasons = _overall(metrics, problems)
    ratio = found.quadrants if isinstance(found.quadrants, Quadrants) else None
    return Result(metrics, verdict, tuple(reasons), rule, curves, ratio, (*found.stages, stage), gates)


def _evidence(
    found: Measured, facts: RunFacts | None, invalid: tuple[str, ...], figures: SensorFigures | None
) -> Evidence:
    if figures is None:
        return Evidence(found, facts, invalid)
    return Evidence(found, facts, invalid, figures.noisy, figures.torque_out_zero_nm, figures.torque_noise_nm)


def measure(trace: Trace, method: Method, *, with_ratio: bool = False) -> Measured:
    """Run the stages on a trace, up to the loops that metrics are read from.

    with_ratio: the torque ratio is wanted for its own sake too. Raises AnalysisError for a trace without what the
    method needs.
    """
    if method.alignment == "two_speeds":
        found = _by_two_speeds(trace, method, with_ratio=with_ratio)
    else:
        found = _stages(*align(trace, method), method, with_ratio=with_ratio)
    return replace(found, recorded=trace)


def _by_two_speeds(trace: Trace, method: Method, *, with_ratio: bool) -> Measured:
    """Run the stages with the skew of torque and angle that the cycles themselves show."""
    found = _stages(*align(trace, replace(method, alignment="report")), method, with_ratio=with_ratio)
    left = estimated = skew_of_cycles(found.loops, found.pairs)
    for _ in range(MOST_ROUNDS):
        found = _stages(*align(trace, method, estimated), method, with_ratio=with_ratio)
        # The speed is not the same along a ramp of torque: what one round leaves, the next one finds.
        left = skew_of_cycles(found.loops, found.pairs)
        if left.settled:
            break
        estimated = replace(left, skew_s=estimated.skew_s + left.skew_s)
    else:
        found = _stages(*align(trace, method, estimated), method, with_ratio=with_ratio)
    # Noise that is moved is another noise: below that an estimate does not settle, and is not known any better.
    u_s = max(estimated.standard_error_s or 0.0, abs(left.skew_s))
    return replace(found, skew=replace(found.skew, u_s=u_s))


def _stages(trace: Trace, skew: Skew, method: Method, *, with_ratio: bool) -> Measured:
    windup = measured_windup(trace, method)
    runs, turning = turning_points(trace, method)
    quadrants: Quadrants | AnalysisError = AnalysisError("not asked for")
    ratio_found: list[str] = []
    if with_ratio or converts(trace, method):
        quadrants, ratio_found = torque_ratio(trace, method, runs)
    pairs = branch_samples(trace, method, runs, windup.arcmin, quadrants)
    torque = output_torque_record(trace, method, pairs, quadrants, ratio_found)
    blocks = _binned(pairs)
    pairs_now, drift = correct_drift(pairs, blocks, method)
    pairs_now, fixture = correct_fixture(pairs_now, windup.angles, method)
    if pairs_now is not pairs:
        blocks = _binned(pairs_now)
    sides = [one for pair in pairs_now for one in pair]
    branches = [monotone(some, one.run.direction, one.where) for some, one in zip(blocks, sides, strict=True)]
    loops = [Loop(rising, falling, method) for rising, falling in zip(branches[::2], branches[1::2], strict=True)]
    stages = (
        skew.record, windup.record, turning, virgin_quarter(runs), torque, drift.record, fixture,
        *branch_records(pairs_now, blocks, branches), reversal_record(loops), fit_record(loops),
    )  # fmt: skip
    return Measured(trace, method, runs, windup.angles, skew, drift, quadrants, pairs_now, blocks, loops, stages, trace)


def _loops_by_output(found: Measured) -> Sequence[Loop]:
    """Return the loops by the torque at the output where it was measured beside one that is converted; else none."""
    if not converts(found.trace, found.method) or found.trace.torque_out_nm is None:
        return ()
    try:
        # the trace is aligned, and drift is what it was: the angles are the same
        return _stages(found.trace, found.skew, replace(found.method, output_torque="reaction"), with_ratio=False).loops
    except AnalysisError:
        return ()  # the sensor was not there while measuring


def _binned(pairs: Pairs) -> list[Blocks]:
    return [binned(one) for pair in pairs for one in pair]


def _curves(loops: Sequence[Loop]) -> Curves:
    first = loops[0]
    low = max(float(first.forward.torque_nm[0]), float(first.backward.torque_nm[0]))
    high = min(float(first.forward.torque_nm[-1]), float(first.backward.torque_nm[-1]))
    torque = np.linspace(low, high, CURVE_POINTS)
    mean = Branch(torque, (first.forward.at(torque) + first.backward.at(torque)) / 2.0)
    try:
        fit: MeanCurve | None = first.fit.mean
    except AnalysisError:
        fit = None
    return Curves(tuple(loop.forward for loop in loops), tuple(loop.backward for loop in loops), mean, fit)


def _overall(metrics: Sequence[MetricResult], problems: Sequence[str]) -> tuple[Verdict, list[str]]:
    """Verdict of the run and its reasons, the deciding ones first."""
    reasons = list(problems)
    by_verdict = sorted(metrics, key=lambda metric: metric.verdict is not Verdict.FAIL)
    reasons += [reason for metric in by_verdict for reason in metric.reasons]
    if problems:
        return Verdict.NOT_DECIDABLE, reasons
    if not any(metric.limited for metric in metrics):
        return Verdict.NOT_DECIDABLE, [*reasons, "no metric has a limit: there is nothing to decide"]
    return worst(metric.verdict for metric in metrics if metric.verdict is not None), reasons
