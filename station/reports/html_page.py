"""The report of a run: one HTML file that needs nothing else, for whoever defends the verdict months later."""

from __future__ import annotations

import base64
import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import jinja2

from station.documents.events import EventRow
from station.documents.manifest import Manifest, attempt_text
from station.documents.result import MetricValue, Result
from station.reports.budget_rows import BUDGET_HEADS
from station.reports.content import CHECK_HEADS, FAILED, LOOP_CSV, Content, other_notes, uncertainty_kind
from station.reports.headline import badges, headline, how_it_ended, remaining_reasons, virtual_unit
from station.reports.metric_sides import side_rows
from station.reports.result_notes import one_sided, within_uncertainty
from station.reports.result_text import (
    guarded_text,
    limits_text,
    metric_name,
    minus,
    number,
    plus_minus,
    software_rows,
    spread_text,
    unit_text,
)
from station.reports.result_view import timing_line
from station.reports.timing_tables import MISSED_HEADS, PERCENTILE_HEADS, SCAN_HEADS
from station.reports.torque_ratio_rows import LINE_HEADS, RATIO_CSV

if TYPE_CHECKING:
    from station.reports.certificate import Certificate

TEMPLATES = Path(__file__).parent / "templates"
TEMPLATE = "report.html.j2"

PICTURES: dict[str, str] = {
    "loop.png": "Wind-up over torque: every sample, the rising and falling branches and the mean curve",
    "time.png": "Torque and angle of the locked shaft over time, with the states of the run and its alarm",
    "stiffness.png": "Stiffness over torque, with the stiffness metrics drawn in",
    "residuals.png": "Residuals of the fits: measured values minus fitted lines",
    "timing.png": "Histograms of the scan cycles: wake-up latency and computing time",
}
"""What each picture of a run shows, for readers that do not see it."""

FIRST = ("loop.png", "time.png")
"""Pictures that stand before the metrics; the others stand where they are explained."""

RULES = {
    "simple": "Simple acceptance: the measured value is compared with the limit; its uncertainty U is ignored.",
    "guard_band": "Guard band w = r·U (U: expanded uncertainty): PASS at least w inside the limits, FAIL at least w "
    "outside, NOT DECIDABLE between.",
}


@dataclass(frozen=True)
class MetricGroup:
    """A metric with its name, and its sides as rows, the one that judges first."""

    metric: MetricValue
    name: str
    rows: tuple[MetricValue, ...]


def rule_text(result: Result) -> str:
    """Return the rule of decision in a sentence, with its factor, and what it decided on one side or within U."""
    decision = result.decision
    factor = f" Here r = {decision.guard_factor:g}." if decision.rule == "guard_band" else ""
    notes = one_sided(result) + within_uncertainty(result)
    return RULES[decision.rule] + factor + "".join(f" {note[0].upper()}{note[1:]}." for note in notes)


def explained(metric: MetricValue) -> str:
    """Return definition, estimator, and the values of the cycles that the value is the mean of."""
    parts = [metric.definition]
    if metric.estimator:
        parts[0] += f"; by {metric.estimator}"
    sides = [row for row in side_rows(metric) if len(row.per_cycle) > 1]
    for row in sides:
        shown = ", ".join(number(value, (row.uncertainty or 0.0) / 10) for value in row.per_cycle)
        side = f" (side {side_text(row)})" if side_text(row) else ""
        parts.append(f"cycles{side} {shown}; s = {row.standard_deviation or 0.0:.2g}")
    if not sides and metric.cycles:
        parts.append(f"{metric.cycles} {'cycle' if metric.cycles == 1 else 'cycles'}")
    if metric.value_j is not None:
        parts.append(f"In joules: {_joules(metric, metric.value_j)}")
    return ". ".join(parts)


def _joules(metric: MetricValue, value_j: float) -> str:
    """Return an energy in J with its uncertainty, which has the same share of it in both units."""
    share = (metric.uncertainty or 0.0) / metric.value if metric.value else 0.0
    uncertainty = abs(share * value_j) or None
    beside = "" if uncertainty is None else f" {plus_minus(uncertainty)}"
    return f"{number(value_j, uncertainty)}{beside} J"


def metric_groups(metrics: Sequence[MetricValue]) -> list[MetricGroup]:
    """Return one entry per metric, those with a limit first.

    A result of before titles were kept has none: the name stands alone.
    """
    ordered = sorted(metrics, key=lambda metric: metric.verdict is None)
    return [
        MetricGroup(metric, metric_name(replace(metric, side="both")), tuple(side_rows(metric))) for metric in ordered
    ]


def side_text(row: MetricValue) -> str:
    """Return the sign of a row's side; nothing for a metric of the whole loop."""
    return minus(row.side) if row.side in ("+", "-") else ""


@functools.cache
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "number": number,
        "guarded": guarded_text,
        "limits": limits_text,
        "metric_name": metric_name,
        "uncertainty": spread_text,
        "unit": unit_text,
        "virtual_unit": virtual_unit,
        "explained": explained,
        "side": side_text,
    }
    return environment


def report_html(
    result: Result,
    run: Manifest,
    events: Sequence[EventRow],
    files: dict[str, str],
    pictures: dict[str, bytes],
    *,
    conditions: dict[str, str] | None = None,
    content: Content | None = None,
    certificate: Certificate | None = None,
) -> bytes:
    """Return the report as HTML.

    Args:
        result: result.json.
        run: run.json.
        events: transitions, alarms, commands and notes.
        files: text of recipe.yaml and bench.yaml by name.
        pictures: PNG pictures by file name; `PICTURES` says what each shows.
        conditions: temperatures and zeroes of the run, name and text.
        content: the sections that PDF and HTML share.
        certificate: what stands before all of them, None of a run that has none.

    """
    from station.reports.certificate import code_svg  # noqa: PLC0415 - the layout library is needed here only

    content = content or Content(uncertainty_kind(result.metrics))
    encoded = {name: (PICTURES[name], base64.b64encode(picture).decode()) for name, picture in pictures.items()}
    data = {name: text.encode() for name, text in files.items()}
    data |= {name: table for name, table in ((LOOP_CSV, content.loop), (RATIO_CSV, content.ratio)) if table}
    page = (
        _environment()
        .get_template(TEMPLATE)
        .render(
            result=result,
            run=run,
            software=software_rows(run.software),
            events=events,
            files=files,
            first_pictures=[encoded[name] for name in FIRST if name in encoded],
            pictures=encoded,
            metrics=metric_groups(result.metrics),
            rule=rule_text(result),
            failed=FAILED,
            timing_line="" if result.timing is None or not result.timing.scans else timing_line(result.timing),
            head=headline(result),
            conditions=conditions or {},
            badges=badges(result),
            ending=how_it_ended(result),
            attempt=attempt_text(result.attempt or run.attempt, run.before, run.retest_reason),
            reasons=remaining_reasons(result),
            content=content,
            notes=other_notes(result),
            certificate=certificate,
            code=base64.b64encode(code_svg(certificate.code)).decode() if certificate else "",
            data={name: base64.b64encode(part).decode() for name, part in data.items()},
            heads={
                "lines": LINE_HEADS,
                "budget": BUDGET_HEADS,
                "checks": CHECK_HEADS,
                "percentiles": PERCENTILE_HEADS,
                "missed": MISSED_HEADS,
                "scans": SCAN_HEADS,
            },
        )
    )
    return page.encode()
