"""The report of a run as PDF, for printers and archives: the same sections as the HTML page, A4."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

from reportlab.lib.colors import white
from reportlab.lib.pagesizes import A4
from reportlab.lib.units import mm
from reportlab.platypus import CondPageBreak, HRFlowable, KeepTogether, SimpleDocTemplate, Spacer, Table

from station.reports.content import BUDGET_HEADS, GATE_HEADS, LINE_HEADS, Content
from station.reports.headline import badges, ending_text, headline, is_note, remaining_reasons
from station.reports.html_page import FIRST, completed, explained, guarded_text, metric_groups, rule_text, side_text
from station.reports.pdf_layout import (
    BADGE_COLOUR,
    BODY,
    FRAME_PT,
    INK,
    MARGIN_PT,
    RED,
    SOFT,
    VERDICT_COLOURS,
    WASH,
    WIDTH_PT,
    grid,
    paragraph,
    picture,
)
from station.reports.result_text import limits_text, number, spread_text, unit_text
from station.reports.result_view import timing_line
from station.reports.timing_tables import MISSED_HEADS, PERCENTILE_HEADS, SCAN_HEADS, TimingTables

LEAST_BELOW_HEADING = 35 * mm
"""A heading with less room than this below it goes to the next page."""

TWO_PICTURES = 0.84
"""Share of the width at which two pictures have room on the first page, below what is said there."""


def report_pdf(
    result: dict[str, Any],
    run: dict[str, Any],
    content: Content,
    pictures: dict[str, bytes],
    conditions: dict[str, str],
) -> bytes:
    """Return the report as PDF; arguments as of `report_html`. The same record gives the same bytes."""
    result = completed(result)
    first = [name for name in FIRST if name in pictures]
    share = 1.0 if len(first) < 2 else TWO_PICTURES
    story = [
        *_top(result, run),
        *(picture(pictures[name], share) for name in first),
        *_metrics(result, content),
        *_gates(content),
        *_alarms(result),
        *(_section("Stiffness", picture(pictures["stiffness.png"])) if "stiffness.png" in pictures else ()),
        *_budgets(content),
        *_evaluation(result, content, pictures),
        *_timing(result, run, content, pictures),
        *_provenance(result, run, content, conditions),
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
        title=f"{result['serial']} {said}",
        author="lostmotion",
        subject=str(result["run"]),
        invariant=1,
    )

    def footer(canvas: Any, page: Any) -> None:
        canvas.setFont(BODY, 7)
        canvas.setFillColor(SOFT)
        beside = "".join(f"   {badge}" for badge in badges(result))
        canvas.drawString(MARGIN_PT, 9 * mm, f"{result['run']}   {said[:70]}{beside}")
        canvas.drawRightString(A4[0] - MARGIN_PT, 9 * mm, f"page {page.page}")

    document.build(story, onFirstPage=footer, onLaterPages=footer)
    return stream.getvalue()


def _section(title: str, *parts: Any) -> list[Any]:
    """Return a heading that stays with what follows it."""
    rule = HRFlowable(width="100%", thickness=1.2, color=INK, spaceBefore=0, spaceAfter=4)
    return [KeepTogether([paragraph(title, "head"), rule, *parts[:1]]), *parts[1:]]


def _top(result: dict[str, Any], run: dict[str, Any]) -> list[Any]:
    head = headline(result)
    colour = VERDICT_COLOURS[head.style]
    box = [
        paragraph(head.text, "verdict"),
        *([paragraph(head.verdict, bold=True, colour=white)] if head.verdict else []),
    ]
    started = str(run["started"])[:19].replace("T", " ")
    what = [
        paragraph(str(result["serial"]), "title"),
        paragraph(f"{run['unit']['model']}, attempt {result['attempt'] or run.get('attempt')}, {started} UTC", "text"),
        paragraph(
            f"{result['recipe']['name']} revision {result['recipe']['revision']} on bench {run['bench']['name']} "
            f"revision {run['bench'].get('revision')}; run {ending_text(result)}",
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
    if result["altered"]:
        said = "\n".join(("RECORD ALTERED. It is not what the run left, and decides nothing.", *result["altered"]))
        parts += [paragraph(said, "text", bold=True, colour=VERDICT_COLOURS["FAIL"]), Spacer(1, 6)]
    parts.append(table)
    reasons = [line for reason in remaining_reasons(result) for line in str(reason).splitlines() if line.strip()]
    if result["left"]:
        reasons.append(f"{result['left']['text']}: {result['left']['next_action']}")
    parts += [Spacer(1, 5), *(paragraph(f"• {reason}", "text") for reason in reasons), Spacer(1, 6)]
    return parts


def _metrics(result: dict[str, Any], content: Content) -> list[Any]:
    if not result["metrics"]:
        return []
    rows: list[Sequence[Any]] = []
    for metric in metric_groups(result["metrics"]):
        sides = metric["rows"]
        guarded = [guarded_text(side, result["decision"]) for side in sides]
        limit = "\n".join(text for text in (limits_text(metric["limits"]), *guarded) if text)
        values = "\n".join(number(side["value"], side["uncertainty"]) for side in sides)
        rows.append(
            (
                paragraph(metric["name"], bold=True),
                paragraph("\n".join(side_text(side) for side in sides), "soft"),
                paragraph(values, "right", bold=True),
                paragraph("\n".join(spread_text(side) for side in sides), "soft"),
                unit_text(metric["unit"]),
                limit,
                [_tag(side["verdict"]) for side in sides],
                paragraph(explained(metric), "soft"),
            )
        )
    heads = ("metric", "", "value", "", "unit", "limit", "", "definition")
    table = grid(heads, rows, (30, 4, 14, 15, 16, 14, 24, 54))
    said = paragraph(f"{rule_text(result['decision'])} {content.uncertainty}", "soft")
    return [*_heading("Metrics"), table, Spacer(1, 3), said]


def _tag(verdict: str | None) -> Any:
    colour = VERDICT_COLOURS.get(verdict or "")
    return paragraph("reported", "soft") if colour is None else paragraph(str(verdict), bold=True, colour=colour)


def _heading(title: str) -> list[Any]:
    """Return a heading for what may be longer than a page."""
    rule = HRFlowable(width="100%", thickness=1.2, color=INK, spaceBefore=0, spaceAfter=4)
    return [CondPageBreak(LEAST_BELOW_HEADING), KeepTogether([paragraph(title, "head"), rule])]


def _gates(content: Content) -> list[Any]:
    if not content.gates:
        return []
    red = [
        ("BACKGROUND", (0, place), (-1, place), RED)
        for place, row in enumerate(content.gates, 1)
        if row[-1] == "FAILED"
    ]
    return [*_heading("Is the measurement valid?"), grid(GATE_HEADS, content.gates, (30, 110, 18), red)]


def _alarms(result: dict[str, Any]) -> list[Any]:
    if not result["alarms"]:
        return []
    rows = []
    colours = []
    for place, alarm in enumerate(result["alarms"], start=1):
        first = "First cause: " if alarm.get("first") and not is_note(alarm) else ""
        detail = f" {alarm['detail']}." if alarm.get("detail") else ""
        what = f"{first}{alarm['text']}. {alarm['cause']}.{detail}"
        reaction = str(alarm["reaction"]).replace("_", " ")
        rows.append((f"{alarm['t_s']:.3f} s", str(alarm["state"]), what, reaction, str(alarm["next_action"])))
        colours.append(("BACKGROUND", (0, place), (-1, place), WASH if is_note(alarm) else RED))
    heads = ("time", "state", "what happened", "reaction", "what to do next")
    return [*_heading("Alarms and notes"), grid(heads, rows, (15, 16, 60, 15, 50), colours)]


def _budgets(content: Content) -> list[Any]:
    parts: list[Any] = []
    for budget in content.budgets:
        table = grid(BUDGET_HEADS, budget.rows, (62, 21, 25, 18, 27, 12))
        parts.append(KeepTogether([paragraph(f"{budget.metric} = {budget.expanded}", "subhead"), table]))
    return [*_heading("Uncertainty budgets"), *parts] if parts else []


def _evaluation(result: dict[str, Any], content: Content, pictures: dict[str, bytes]) -> list[Any]:
    parts: list[Any] = []
    if content.stages:
        rows = [(name, "\n".join(part for part in (text, figures) if part)) for name, text, figures in content.stages]
        parts.append(grid(("stage", "what it did"), rows, (30, 130)))
    else:
        parts += [paragraph(f"• {note}") for note in result["notes"]]
    if content.method or content.fits:
        parts += [Spacer(1, 4), grid(("", ""), [*content.method, *content.fits], (45, 115))]
    if content.lines:
        parts += [paragraph("Torque ratio T_out = C + m·T_in", "subhead")]
        parts += [grid(LINE_HEADS, content.lines, (26, 20, 18, 14, 14, 18, 14, 12, 13))]
    if "residuals.png" in pictures:
        parts += [Spacer(1, 6), picture(pictures["residuals.png"])]
    return [*_heading("How it was evaluated"), *parts] if parts else []


def _timing(result: dict[str, Any], run: dict[str, Any], content: Content, pictures: dict[str, bytes]) -> list[Any]:
    timing = result["timing"]
    if not timing.get("scans"):
        return []
    parts = [paragraph(f"{timing_line(timing)}.", "text")]
    if "timing.png" in pictures:
        parts += [Spacer(1, 4), picture(pictures["timing.png"])]
    parts += _timing_tables(content.timing)
    if run.get("clock") == "real":
        realtime = timing.get("realtime") or {}
        rows = [
            (str(name), f"{'granted' if realtime.get(name) else 'refused'}: {text}")
            for name, text in (realtime.get("details") or {}).items()
        ]
        parts += [grid(("", ""), rows, (30, 130))] if rows else []
    return _section("Timing", *parts)


def _timing_tables(found: TimingTables) -> list[Any]:
    parts: list[Any] = []
    if found.percentiles:
        table = _numbers(PERCENTILE_HEADS, found.percentiles, (40, 30, 30, 30, 30), {0})
        parts.append(KeepTogether([paragraph("Percentiles", "subhead"), table]))
    if found.missed:
        table = _numbers(MISSED_HEADS, found.missed, (19, 18, 14, 37, 15, 14, 14, 14, 14), {3})
        more = [paragraph(found.more, "soft")] if found.more else []
        parts.append(
            KeepTogether([paragraph("Missed periods, and the scan before them, in µs", "subhead"), table, *more])
        )
    if found.scans:
        table = _numbers(SCAN_HEADS, found.scans, (17, 16, 18, 37, 15, 14, 14, 14, 14), {0, 3})
        parts.append(KeepTogether([paragraph("Longest and latest scans, in µs", "subhead"), table]))
    if found.causes:
        parts += [Spacer(1, 4), grid(("", ""), found.causes, (30, 130))]
    return parts


def _numbers(heads: Sequence[str], rows: Sequence[Sequence[str]], widths: Sequence[float], words: set[int]) -> Any:
    """Return a table of numbers, which stand at the right of their columns; `words` are the columns of text."""
    shown = [[cell if place in words else paragraph(cell, "right") for place, cell in enumerate(row)] for row in rows]
    return grid(heads, shown, widths, right=set(range(len(heads))) - words)


def provenance_rows(result: dict[str, Any], run: dict[str, Any], conditions: dict[str, str]) -> list[tuple[str, str]]:
    """Return what was run, when, by whom and with what: name and text."""
    recipe, bench, software, unit = run["recipe"], run["bench"], run["software"], run["unit"]
    return [
        ("run", str(result["run"])),
        ("started, ended", f"{run['started']}, {run['ended']}"),
        ("recipe", f"{recipe['name']} revision {recipe['revision']}, SHA-256 {recipe['sha256']}"),
        ("bench", f"{bench['name']} revision {bench.get('revision')}, SHA-256 {bench['sha256']}"),
        *([("operator", str(run["operator"]))] if run.get("operator") else []),
        *([("virtual unit", str(unit["virtual"]))] if unit.get("virtual") else []),
        *([("faults injected", str(run["scenario"]))] if run.get("scenario") else []),
        ("clock", f"{run['clock']} time"),
        ("software", f"{software['name']} {software['version']}, Python {software['python']}, {software['platform']}"),
        *conditions.items(),
    ]


def _provenance(result: dict[str, Any], run: dict[str, Any], content: Content, conditions: dict[str, str]) -> list[Any]:
    rows = provenance_rows(result, run, conditions)
    rows += [(f"calibration {name}", text) for name, text in content.calibrations]
    parts = [*_heading("What was run"), grid(("", ""), rows, (35, 125))]
    if content.checksums:
        sums = [(name, paragraph(size, "right"), paragraph(sha, "mono")) for name, size, sha in content.checksums]
        parts += [*_heading("To check it again"), grid(("file of the record", "bytes", "SHA-256"), sums, (45, 20, 95))]
        word = "analyze" if result["metrics"] else "show"
        parts.append(paragraph(f"lostmotion {word} {result['run']} reads these files again.", "soft"))
    return parts
