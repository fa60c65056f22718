"""From a trace to a result, stage by stage: wind-up, runs, torque ratio, output domain, branches, metrics, verdict.

Stages in order: angles to wind-up; runs from the commanded segments or from turning points found on the curve; virgin
quarter and final unloading dropped; torque ratio; input torque to output torque; fixture; branches; fits; metrics.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.branches import Branch, make_branch, measured_windup
from analysis.errors import AnalysisError
from analysis.evaluate import MetricResult, evaluate
from analysis.loop import Loop
from analysis.method import Decision, Method, MetricWanted
from analysis.metrics import definition
from analysis.quadrants import Quadrants, fit_quadrants, output_torque
from analysis.runs import Run, commanded_runs, found_runs, paired_cycles
from analysis.segment_fit import MeanCurve
from analysis.trace import Trace
from analysis.uncertainty.figures import SensorFigures
from analysis.uncertainty.measurement import measurement_of
from analysis.units import FloatArray
from analysis.verdict import Verdict, worst

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
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, object]:
        """Return verdict, reasons, metrics and notes as plain data (the JSON contract)."""
        return {
            "verdict": self.verdict.value,
            "reasons": list(self.reasons),
            "decision": {"rule": self.decision.rule, "guard_factor": self.decision.guard_factor},
            "metrics": [metric.to_dict() for metric in self.metrics],
            "notes": list(self.notes),
        }


def analyse(
    trace: Trace,
    method: Method,
    wanted: Sequence[MetricWanted],
    decision: Decision | None = None,
    invalid: Sequence[str] = (),
    *,
    figures: SensorFigures | None = None,
) -> Result:
    """Evaluate a trace and judge it.

    invalid: reasons, in plain words, why the measurement does not count (timing, stale samples, saturation); any makes
    the verdict NOT DECIDABLE. figures: what is declared of the sensors; without them the uncertainty is the scatter of
    the cycles alone. Raises AnalysisError for a trace without what the method needs, for wanted metrics that
    do not exist, and for nothing else; a metric that the loop does not carry is NOT DECIDABLE with its reason.
    """
    rule = Decision() if decision is None else decision
    rows = [definition(one) for one in wanted]
    with np.errstate(all="ignore"):
        notes: list[str] = []
        runs = _runs(trace, method, notes)
        needs_ratio = _converts(trace, method) or any(row.estimate is None for row in rows)
        quadrants = _torque_ratio(trace, method, runs, notes) if needs_ratio else AnalysisError("not asked for")
        loops = _loops(trace, method, runs, quadrants, notes)
        problems = [*invalid, *_wrong_way(loops)]
        measurement = measurement_of(trace, method, runs, loops[0], quadrants=quadrants, figures=figures, notes=notes)
        metrics = tuple(
            evaluate(one, loops, quadrants, method, rule, invalid=bool(problems), measurement=measurement)
            for one in wanted
        )
        curves = _curves(loops)
    verdict, reasons = _overall(metrics, problems)
    ratio = quadrants if isinstance(quadrants, Quadrants) else None
    return Result(metrics, verdict, tuple(reasons), rule, curves, ratio, tuple(notes))


def _runs(trace: Trace, method: Method, notes: list[str]) -> list[Run]:
    runs = commanded_runs(trace)
    if runs:
        notes.append("branches: from the commanded segments")
    else:
        column = "torque_in_nm" if _converts(trace, method) else "torque_out_nm"
        runs = found_runs(trace.channel(column, "the turning points"))
        notes.append("branches: turning points found on the curve, no segments in the trace")
    dropped = [run.role for run in runs if run.role not in ("measure", "calibrate")]
    if dropped:
        notes.append(f"not evaluated: {', '.join(dict.fromkeys(dropped))}")
    return runs


def _torque_ratio(trace: Trace, method: Method, runs: Sequence[Run], notes: list[str]) -> Quadrants | AnalysisError:
    """Return the torque ratio as given or as measured, or the reason why there is none."""
    if method.quadrants is not None:
        notes.append("torque ratio: as given")
        return method.quadrants
    try:
        quadrants = fit_quadrants(trace, runs)
    except AnalysisError as error:
        return error
    for name, fit in quadrants.fits.items():
        notes.append(
            f"torque ratio, {name}: T_out = {fit.offset_nm:.4g} + {fit.slope:.5g} T_in (N·m), s = "
            f"{fit.residual_sd_nm:.2g} N·m over {fit.points} points, {fit.flagged.size} flagged"
        )
    return quadrants


def _loops(
    trace: Trace, method: Method, runs: Sequence[Run], quadrants: Quadrants | AnalysisError, notes: list[str]
) -> list[Loop]:
    windup, deflects, how = measured_windup(trace, method)
    notes.append(how)
    fixture = method.fixture_stiffness_nm_per_arcmin if deflects else None
    if fixture is not None:
        notes.append(f"fixture: T / {fixture:g} N·m/arcmin subtracted from the wind-up")
    pairs = paired_cycles(runs)
    loops = []
    masked: list[int] = []
    for cycle, pair in enumerate(pairs, start=1):
        branches = []
        for run in pair:
            where = f"{trace.source}: cycle {cycle}, {'rising' if run.direction > 0 else 'falling'} branch"
            torque, valid = _branch_torque(trace, method, run, quadrants)
            angle = run.take(windup)
            if valid is not None:
                masked.append(int(np.count_nonzero(~valid)))
                torque, angle = torque[valid], angle[valid]
            if fixture is not None:
                angle = angle - torque / fixture
            branches.append(make_branch(torque, angle, run.direction, f"{where} (from row {run.first_row})"))
        loops.append(Loop(branches[0], branches[1], method))
    notes.append(f"cycles: {len(loops)}")
    if _converts(trace, method) and isinstance(quadrants, Quadrants):
        notes.append(_transition_note(quadrants, masked))
    elif method.output_torque == "calibrated":
        notes.append("output torque: torque_out_nm as given; there is no input torque in the trace to convert")
    below, above = loops[0].exclusion_nm
    notes.append(
        f"reversal: {below:.3g} N·m after the negative and {above:.3g} N·m after the positive turning point are taken "
        f"from the fit ({method.reversal_exclusion:g} × friction of {loops[0].friction_nm:.3g} N·m where it reverses)"
    )
    return loops


def _branch_torque(
    trace: Trace, method: Method, run: Run, quadrants: Quadrants | AnalysisError
) -> tuple[FloatArray, np.ndarray[tuple[int], np.dtype[np.bool_]] | None]:
    """Output torque of a run, and which of its samples count (None: all)."""
    if not _converts(trace, method):
        return run.take(trace.channel("torque_out_nm", "the torque at the output")), None
    torque_in = run.take(trace.channel("torque_in_nm", "the output torque by calibration"))
    if isinstance(quadrants, AnalysisError):
        raise quadrants
    angle = None if trace.angle_in_rad is None else run.take(trace.angle_in_rad)
    return output_torque(quadrants, torque_in, run.direction, angle)


def _converts(trace: Trace, method: Method) -> bool:
    """Say whether input torque is to be converted; output torque alone was converted by somebody before."""
    return method.output_torque == "calibrated" and not (trace.torque_in_nm is None and trace.torque_out_nm is not None)


def _transition_note(quadrants: Quadrants, masked: Sequence[int]) -> str:
    if quadrants.transition_rad is None or any(masked):
        return f"transition after each reversal: masked, {sum(masked)} samples"
    return (
        "transition after each reversal: from loading to unloading line over "
        f"{quadrants.transition_rad:.3g} rad at the input"
    )


def _wrong_way(loops: Sequence[Loop]) -> list[str]:
    """Name a loop that gains energy: it was recorded with a wrong sign, for a loop must lose some."""
    wrong = [loop for loop in loops if loop.energy_nm_arcmin < 0]
    if not wrong:
        return []
    gained = wrong[0].energy_nm_arcmin
    text = (
        f"the loop runs the wrong way round ({gained:.3g} N·m·arcmin in a cycle; a loss is positive): torque or angle "
    )
    return [text + "has the wrong sign, or the branches are exchanged"]


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
    reasons = [f"measurement invalid: {problem}" for problem in problems]
    by_verdict = sorted(metrics, key=lambda metric: metric.verdict is not Verdict.FAIL)
    reasons += [reason for metric in by_verdict for reason in metric.reasons]
    if problems:
        return Verdict.NOT_DECIDABLE, reasons
    if not any(metric.limited for metric in metrics):
        return Verdict.NOT_DECIDABLE, [*reasons, "no metric has a limit: there is nothing to decide"]
    return worst(metric.verdict for metric in metrics if metric.verdict is not None), reasons
