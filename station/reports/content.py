"""What a report says, as rows of text that HTML and PDF share; records of older versions lack some of it.

Nothing is computed here that a verdict rests on. What is shown is what a reader needs to compute every number again.
"""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from analysis.evaluation.pipeline import Result as Found
from analysis.loop.method import Method
from analysis.trace.segment_names import segment_name
from analysis.trace.trace import SegmentInfo
from definitions.checks import CHECKS
from station.bench.request import Job
from station.documents.manifest import MASTER
from station.documents.result import CheckValue, MetricValue, Result, StageRow
from station.records.run_record import RunRecord
from station.reports.budget_rows import BudgetTable, budget_tables
from station.reports.result_text import COVERAGE, coverage_factor, coverage_text, figure_text, metric_name, minus
from station.reports.timing_tables import TimingTables, timing_proof, timing_tables
from station.reports.torque_ratio_rows import calibration_rows, line_rows, lines_title, ratio_csv
from station.results.evaluation import method_of, newest_calibration

LOOP_CSV = "loop.csv"
FAILED = "FAILED"
PASSED: dict[bool | None, str] = {True: "passed", False: FAILED, None: "not applicable"}

Row = tuple[str, ...]


@dataclass(frozen=True)
class Content:
    """Sections of a report; an empty one is not shown.

    checks: (title, id, words with figure and limit, said); checks_line: counts; open_line: errors that they leave open.
    stages: (name, words, figures).
    fits and method: (name, text). lines: torque ratio per quadrant; lines_of: whose they are. calibrations: (id, text).
    checksums: (file, bytes, SHA-256). loop: the branches as CSV, which `analyze` reads. ratio: the points of the lines.
    """

    uncertainty: str
    budgets: tuple[BudgetTable, ...] = ()
    checks: tuple[Row, ...] = ()
    checks_line: str = ""
    open_line: str = ""
    stages: tuple[Row, ...] = ()
    method: tuple[Row, ...] = ()
    lines: tuple[Row, ...] = ()
    lines_of: str = ""
    fits: tuple[Row, ...] = ()
    calibrations: tuple[Row, ...] = ()
    checksums: tuple[Row, ...] = ()
    loop: bytes = b""
    ratio: bytes = b""
    timing: TimingTables = field(default_factory=TimingTables)


CHECK_HEADS = ("validity check", "what was found", "")


def content_of(record: RunRecord, result: Result, analysis: Found | None, job: Job) -> Content:
    """Return the sections of a run's report; what the record or the result lacks is left out."""
    manifest = record.manifest()
    method = method_of(job.recipe, job.bench)
    stored = None if method.quadrants is None else newest_calibration(job.recipe, job.bench)
    return Content(
        uncertainty=uncertainty_kind(result.metrics),
        budgets=budget_tables(result.metrics),
        checks=check_rows(shown_checks(result)),
        checks_line=checks_line(shown_checks(result)),
        open_line=open_line(result),
        stages=stage_rows(result.stages),
        method=() if analysis is None else _method_rows(method),
        lines=line_rows(analysis, stored),
        lines_of=lines_title(record, stored),
        fits=() if analysis is None else _fit_rows(analysis),
        calibrations=calibration_rows(record, stored, job.bench),
        checksums=tuple((name, str(found.bytes), found.sha256) for name, found in (manifest.files or {}).items()),
        loop=b"" if analysis is None else loop_csv(analysis),
        ratio=ratio_csv(analysis),
        timing=timing_tables(timing_proof(record)),
    )


def uncertainty_kind(metrics: Sequence[MetricValue]) -> str:
    """Return in a sentence what the expanded uncertainties of a result contain."""
    known = [one for one in metrics if one.uncertainty is not None]
    kinds = {one.uncertainty_kind for one in known if one.budget}
    if not known:
        return f"No uncertainty (no U): {NO_U}." if metrics else ""
    budgeted = [one for one in known if one.uncertainty_kind in WITH_FIGURES and one.budget]
    none = f" No U: {NO_U}." if len(known) < len(metrics) else ""
    if not budgeted:
        return f"{_u_text(known)}. It has the scatter within this run only, no errors of the sensors.{none}"
    holds = WITH_FIGURES["untimed" if "untimed" in kinds else "budget"]
    others = [metric_name(one) for one in known if one not in budgeted]
    scatter = f" Scatter within this run only: {', '.join(others)}." if others else ""
    return f"{_u_text(known)}.{holds}{scatter}{none}"


def _u_text(metrics: Sequence[MetricValue]) -> str:
    """Say with which k the uncertainties are stated, and why, where it is not the usual one."""
    interrupted = f"; {INTERRUPTED}" if coverage_factor(metrics) > COVERAGE else ""
    return f"± is the expanded uncertainty {coverage_text(metrics)}{interrupted}"


INTERRUPTED = "a ramp was interrupted"
"""Why U is stated with a larger k."""

NO_U = "U needs two cycles or an uncertainty budget, and sensor errors small enough for the metric"

WITH_FIGURES = {
    "budget": "",
    "untimed": " U has no contribution of delay and drift, because the trace has no time column.",
}
"""Kinds of an uncertainty that comes from sensor specifications, and what it leaves out."""


def shown_checks(result: Result) -> list[CheckValue]:
    """Return the checks that say something: of a run that was not evaluated, only those that failed."""
    return [check for check in result.gates if result.metrics or check.passed is False]


def check_rows(checks: Sequence[CheckValue]) -> tuple[Row, ...]:
    """Return the validity checks: those that failed, those that passed, those that were not checked."""
    ordered = sorted(checks, key=lambda check: {False: 0, True: 1, None: 2}[check.passed])
    return tuple((check_title(check), check.id, _check_words(check), PASSED[check.passed]) for check in ordered)


def checks_line(checks: Sequence[CheckValue]) -> str:
    """Return the validity checks as counts; nothing where there are none."""
    counts = Counter(check.passed for check in checks)
    parts = (
        _counted(counts[False], "failed"),
        _counted(counts[True], "passed"),
        f"{counts[None]} not applicable" if counts[None] else "",
    )
    return ", ".join(part for part in parts if part)


def open_line(result: Result) -> str:
    """Return the errors that the checks of a run cannot see, with the largest size; '' in older results."""
    said = [
        f"{one.text}: {f'up to {one.figure:.2g} {one.unit}' if one.figure is not None else 'not checked'}"
        for one in result.not_excluded
    ]
    if not said:
        return ""
    where = "and therefore in U" if any(one.in_budget for one in result.not_excluded) else "and not in U"
    checked = result.run is None or any(note.startswith(MASTER) for note in result.notes)
    missing = "" if checked else " A master part shows such errors; the bench file names none (master_parts)."
    return f"Errors that this run cannot exclude, {where}: {'; '.join(said)}.{missing}"


def _counted(count: int, became: str) -> str:
    return f"{count} {'check' if count == 1 else 'checks'} {became}" if count else ""


def check_title(check: CheckValue) -> str:
    """Return what people read of a check; of one that this version does not know, nothing."""
    row = CHECKS.get(check.id)
    return row.title if row is not None else ""


def _check_words(check: CheckValue) -> str:
    """Return the words of a check; its figure and limit are in them, or stand behind them."""
    text, unit = check.text, check.unit
    text = text.removeprefix(f"{check_title(check)}: ").removeprefix("not applicable: ")  # both stand beside it
    if check.figure is None or "allowed" in text:
        return text
    return f"{text}: {figure_text(check.figure, unit)}, limit {figure_text(check.limit, unit)}"


def other_notes(result: Result) -> tuple[str, ...]:
    """Return the notes of a result that no stage says."""
    said = {stage.text for stage in result.stages}
    return tuple(note for note in result.notes if note not in said)


def stage_rows(stages: Sequence[StageRow]) -> tuple[Row, ...]:
    """Return what each stage of the evaluation did, in words and figures."""
    rows = []
    for stage in stages:
        said = [f"{name.replace('_', ' ')} {figure_text(one.value, one.unit)}" for name, one in stage.figures.items()]
        rows.append((stage.stage, stage.text, "; ".join(said)))
    return tuple(rows)


def _method_rows(method: Method) -> tuple[Row, ...]:
    fixture = method.fixture_stiffness_nm_per_arcmin
    return (
        (
            "reference torque",
            f"{method.reference_nm:g} N·m (rated {method.rated_torque_nm:g} N·m), ratio {method.ratio:g}",
        ),
        ("loading", f"at the {method.loading}; output torque: {method.output_torque}"),
        ("six-segment fit", f"break torque ±{method.break_nm:.6g} N·m, segments end at ±{method.fit_nm:.6g} N·m"),
        ("spring constant", f"over a step of {method.spring_step_nm:g} N·m"),
        ("after a reversal", f"at most {method.reversal_exclusion:g} × the friction torque is excluded from the fit"),
        ("fixture", "no stiffness given" if fixture is None else f"{fixture:g} N·m/arcmin"),
    )


def _fit_rows(analysis: Found) -> tuple[Row, ...]:
    """Return the fitted mean curve of the first cycle: coefficients in rising powers of torque."""
    fit = analysis.curves.fit
    if fit is None:
        return ()
    rows = [
        (
            f"F(T), {where}",
            " + ".join(_term(float(value), power) for power, value in enumerate(part)).replace("+ −", "− "),
        )
        for where, part in (
            (f"T < −{fit.break_nm:.6g} N·m", fit.negative),
            (f"|T| ≤ {fit.break_nm:.6g} N·m, without its offset", fit.middle),
            (f"T > {fit.break_nm:.6g} N·m", fit.positive),
        )
    ]
    below, above = fit.gaps_arcmin
    gaps = minus(
        f"{below:.6f} and {above:.6f} arcmin; their mean {fit.offset_arcmin:.6f} arcmin is added in the middle"
    )
    return (*rows, ("gaps at the seams", gaps))


def _term(value: float, power: int) -> str:
    return minus(f"{value:.9g}") + ("", "·T", "·T²")[power]


def loop_csv(analysis: Found) -> bytes:
    """Return the branches of every cycle as CSV: the file from which `analyze` gets the loop's metrics again.

    Torque is at the output, and every correction has been made; 0.1 mN·m and a millionth of an arcmin are kept.
    """
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(("torque_out_nm", "windup_arcmin", "segment"))
    curves = analysis.curves
    for cycle, (rising, falling, parts) in enumerate(
        zip(curves.forward, curves.backward, curves.parts_nm, strict=True), start=1
    ):
        for branch, direction, ends in ((falling, -1, parts[1]), (rising, 1, parts[0])):
            name = segment_name(SegmentInfo("measure", direction, cycle))
            # Steps are numbered, as in an export: a reader takes their holds for interrupted ramps otherwise.
            numbers = np.searchsorted(direction * ends, direction * branch.torque_nm) + 1
            names = [f"{name} {number}" if ends.size else name for number in numbers.tolist()]
            rows = list(zip(branch.torque_nm.tolist(), branch.angle_arcmin.tolist(), names, strict=True))
            writer.writerows((f"{x:.4f}", f"{y:.6f}", one) for x, y, one in rows[::direction])
    return stream.getvalue().encode()
