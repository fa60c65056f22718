"""The report of a run as PDF, for printers and archives: the same sections as the HTML page, A4."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

from reportlab.lib.colors import white
from reportlab.lib.pagesizes import A4
from reportlab.lib.units import mm
from reportlab.platypus import SimpleDocTemplate, Spacer, Table

from station.documents.manifest import Manifest, attempt_text
from station.documents.result import Result
from station.reports.certificate import Certificate
from station.reports.content import CHECK_HEADS, FAILED, Content
from station.reports.headline import badges, headline, how_it_ended, remaining_reasons
from station.reports.html_page import FIRST, MetricGroup, explained, metric_groups, rule_text, side_text
from station.reports.pdf_pages.certificate import certificate_parts
from station.reports.pdf_pages.evidence import budget_parts, evaluation_parts, provenance_parts, timing_parts
from station.reports.pdf_pages.layout import (
    BADGE_COLOUR,
    BODY,
    FRAME_PT,
    MARGIN_PT,
    RED,
    SOFT,
    VERDICT_COLOURS,
    WASH,
    WIDTH_PT,
    grid,
    heading,
    paragraph,
    picture,
    section,
)
from station.reports.result_text import guarded_text, limits_text, number, spread_text, unit_text

METRIC_HEADS = ("metric", "", "value", "", "unit", "limit", "")
METRIC_WIDTHS = (64, 5, 17, 18, 22, 32, 28)
"""Shares of the width; below the values of a metric its definition goes over all of them."""

PICTURE_SHARE = 0.84
"""Share of the width at which the first pictures leave room on the first page for what is said there."""


def report_pdf(  # noqa: PLR0917 - parts of one report, in their order
    result: Result,
    run: Manifest,
    content: Content,
    pictures: dict[str, bytes],
    conditions: dict[str, str],
    certificate: Certificate | None = None,
) -> bytes:
    """Return the report as PDF; arguments as of `report_html`. The same record gives the same bytes."""
    first = [name for name in FIRST if name in pictures]
    story = [
        *(certificate_parts(certificate, pictures.get("loop.png"), rule_text(result)) if certificate else ()),
        *_top(result, run, content),
        *(picture(pictures[name], PICTURE_SHARE) for name in first),
        *_metrics(result, content),
        *_checks(content),
        *_alarms(result),
        *(section("Stiffness", picture(pictures["stiffness.png"])) if "stiffness.png" in pictures else ()),
        *budget_parts(content),
        *evaluation_parts(result, content, pictures),
        *timing_parts(result, run, content, pictures),
        *provenance_parts(result, run, content, conditions),
    ]
    stream = io.BytesIO()
    said = headline(result).text
    document = SimpleDocTemplate(
        stream,
        pagesize=A4,
        leftMargin=MARGIN_PT - FRAME_PT,
        rightMargin=MARGIN_PT - FRAME_PT,
        topMargin=14 * mm,
        bottomMargin=16 * mm,
        title=f"{result.serial} {said}",
        author="lostmotion",
        subject=str(result.run),
        invariant=1,
    )

    def footer(canvas: Any, page: Any) -> None:
        canvas.setFont(BODY, 7)
        canvas.setFillColor(SOFT)
        beside = "".join(f"   {badge}" for badge in badges(result))
        canvas.drawString(MARGIN_PT, 9 * mm, f"{result.run}   {said[:70]}{beside}")
        canvas.drawRightString(A4[0] - MARGIN_PT, 9 * mm, f"page {page.page}")

    document.build(story, onFirstPage=footer, onLaterPages=footer)
    return stream.getvalue()


def _top(result: Result, run: Manifest, content: Content) -> list[Any]:
    head = headline(result)
    colour = VERDICT_COLOURS[head.style]
    box = [
        paragraph(head.text, "verdict"),
        *([paragraph(head.verdict, bold=True, colour=white)] if head.verdict else []),
    ]
    started = run.started[:19].replace("T", " ")
    attempt = attempt_text(result.attempt or run.attempt, run.before, run.retest_reason)
    what = [
        paragraph(str(result.serial), "title"),
        paragraph(f"{run.unit.model}, {attempt}, {started} UTC", "text"),
        paragraph(
            f"{result.recipe.name} revision {result.recipe.revision} on bench {run.bench.name} "
            f"revision {run.bench.revision}; run {how_it_ended(result)}",
            "soft",
        ),
        *(paragraph(badge, "text", bold=True, colour=BADGE_COLOUR) for badge in badges(result)),
    ]
    wide = 0.3 if len(head.text) <= 14 else 0.5
    table = Table([[box, what]], colWidths=[WIDTH_PT * wide, WIDTH_PT * (1 - wide)])
    table.setStyle([("BACKGROUND", (0, 0), (0, 0), colour), ("VALIGN", (0, 0), (-1, -1), "MIDDLE"),
                    ("LEFTPADDING", (0, 0), (-1, -1), 10), ("TOPPADDING", (0, 0), (0, 0), 8),
                    ("BOTTOMPADDING", (0, 0), (0, 0), 10)])  # fmt: skip
    parts: list[Any] = []
    if result.altered:
        said = "\n".join(
            ("RECORD ALTERED. The files differ from those of the run. No verdict is given.", *result.altered)
        )
        parts += [paragraph(said, "text", bold=True, colour=VERDICT_COLOURS["FAIL"]), Spacer(1, 6)]
    parts.append(table)
    reasons = [line for reason in remaining_reasons(result) for line in str(reason).splitlines() if line.strip()]
    if result.left is not None:
        reasons.append(f"{result.left.text}: {result.left.next_action}")
    parts += [Spacer(1, 5), *(paragraph(f"• {reason}", "text") for reason in reasons)]
    if content.checks_line:
        parts += [Spacer(1, 3), paragraph(content.checks_line, "text", bold=content.checks[0][-1] == FAILED)]
    if content.open_line:
        parts.append(paragraph(content.open_line, "soft"))
    parts.append(Spacer(1, 6))
    return parts


def _names(group: MetricGroup) -> list[Any]:
    """Return title and name of a metric; an older result has no titles."""
    title = group.metric.title
    return [paragraph(title, bold=True), paragraph(group.name, "soft")] if title else [paragraph(group.name, bold=True)]


def _metrics(result: Result, content: Content) -> list[Any]:
    if not result.metrics:
        return []
    rows: list[Sequence[Any]] = []
    style: list[Any] = []
    for group in metric_groups(result.metrics):
        metric, sides = group.metric, group.rows
        guarded = [guarded_text(side, result.decision) for side in sides]
        limit = "\n".join(text for text in (limits_text(metric.limits), *guarded) if text)
        values = "\n".join(number(side.value, side.uncertainty) for side in sides)
        rows.append(
            (
                _names(group),
                paragraph("\n".join(side_text(side) for side in sides), "soft"),
                paragraph(values, "right", bold=True),
                paragraph("\n".join(spread_text(side) for side in sides), "soft"),
                unit_text(metric.unit),
                limit,
                [_tag(side.verdict) for side in sides],
            )
        )
        rows.append((paragraph(explained(metric), "soft"), *[""] * (len(METRIC_HEADS) - 1)))
        values_at, text_at = len(rows) - 1, len(rows)  # behind the row of heads
        style += [
            ("LINEBELOW", (0, values_at), (-1, values_at), 1.2, white),
            ("SPAN", (0, text_at), (-1, text_at)),
            ("NOSPLIT", (0, values_at), (-1, text_at)),
        ]
    table = grid(METRIC_HEADS, rows, METRIC_WIDTHS, style)
    said = paragraph(f"{rule_text(result)} {content.uncertainty}", "soft")
    return [*heading("Metrics", table), table, Spacer(1, 3), said]


def _tag(verdict: str | None) -> Any:
    colour = VERDICT_COLOURS.get(verdict or "")
    return paragraph("reported", "soft") if colour is None else paragraph(str(verdict), bold=True, colour=colour)


def _checks(content: Content) -> list[Any]:
    if not content.checks:
        return []
    red = [
        ("BACKGROUND", (0, place), (-1, place), RED) for place, row in enumerate(content.checks, 1) if row[-1] == FAILED
    ]
    rows = [([paragraph(title), paragraph(name, "soft")], *rest) for title, name, *rest in content.checks]
    table = grid(CHECK_HEADS, rows, (46, 90, 22), red)
    return [*heading("Validity checks", table), table]


def _alarms(result: Result) -> list[Any]:
    if not result.alarms:
        return []
    rows = []
    colours = []
    for place, alarm in enumerate(result.alarms, start=1):
        first = "First cause: " if alarm.first and not alarm.is_note else ""
        detail = f" {alarm.detail}." if alarm.detail else ""
        what = f"{first}{alarm.text}. {alarm.cause}.{detail}"
        reaction = alarm.reaction.replace("_", " ")
        rows.append((f"{alarm.t_s:.3f} s", alarm.state, what, reaction, alarm.next_action))
        colours.append(("BACKGROUND", (0, place), (-1, place), WASH if alarm.is_note else RED))
    heads = ("time", "state", "what happened", "reaction", "what to do next")
    table = grid(heads, rows, (15, 16, 60, 15, 50), colours)
    return [*heading("Alarms and notes", table), table]
