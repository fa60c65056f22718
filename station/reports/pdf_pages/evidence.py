"""What the result of a run rests on, as pages of its PDF report: budgets, evaluation, timing, and what was run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from reportlab.platypus import KeepTogether, Spacer

from station.documents.manifest import Manifest
from station.documents.result import Result
from station.records.clocks import CLOCK_TEXTS, SCAN, WALL, clock_of
from station.reports.budget_rows import BUDGET_HEADS, BudgetTable
from station.reports.content import Content, other_notes
from station.reports.headline import virtual_unit
from station.reports.pdf_pages.layout import grid, heading, paragraph, picture, section
from station.reports.result_text import software_rows
from station.reports.result_view import timing_line
from station.reports.timing_tables import MISSED_HEADS, PERCENTILE_HEADS, SCAN_HEADS, TimingTables
from station.reports.torque_ratio_rows import LINE_HEADS


def budget_parts(content: Content) -> list[Any]:
    """Return the uncertainty budget of every metric that has one, each as a table; nothing without any."""
    tables = [_budget(budget) for budget in content.budgets]
    if not tables:
        return []
    return [*heading("Uncertainty budgets", *tables[0], whole=True), *(KeepTogether(parts) for parts in tables)]


def _budget(budget: BudgetTable) -> list[Any]:
    """Return the budget of one side: its name and its table; the words of sums go over the figures they have not."""
    wide = [("SPAN", (0, place), (3, place)) for place, row in enumerate(budget.rows, 1) if not any(row[1:4])]
    title = paragraph(f"{budget.metric} = {budget.expanded}", "subhead")
    return [title, grid(BUDGET_HEADS, budget.rows, (62, 21, 25, 18, 27, 12), wide)]


def evaluation_parts(result: Result, content: Content, pictures: dict[str, bytes]) -> list[Any]:
    """Return what the stages did, the method, the fits and the picture of their residuals, as far as they are there."""
    parts: list[Any] = []
    if content.stages:
        rows = [(name, "\n".join(part for part in (text, figures) if part)) for name, text, figures in content.stages]
        parts.append(grid(("stage", "what it did"), rows, (30, 130)))
    parts += [paragraph(f"• {note}") for note in other_notes(result)]
    if content.method or content.fits:
        parts += [Spacer(1, 4), grid(("", ""), [*content.method, *content.fits], (45, 115))]
    if content.lines:
        title = paragraph(f"Torque ratio T_out = C + m·T_in, {content.lines_of}", "subhead")
        parts += [KeepTogether([title, grid(LINE_HEADS, content.lines, (26, 20, 18, 14, 14, 18, 14, 12, 13))])]
    if "residuals.png" in pictures:
        parts += [Spacer(1, 6), picture(pictures["residuals.png"])]
    return [*heading("How the run was evaluated", parts[0]), *parts] if parts else []


def timing_parts(result: Result, run: Manifest, content: Content, pictures: dict[str, bytes]) -> list[Any]:
    """Return how the scan kept its periods: figures, picture and tables; nothing for a run without a scan."""
    timing = result.timing
    if timing is None or not timing.scans:
        return []
    parts = [paragraph(f"{timing_line(timing)}.", "text")]
    if "timing.png" in pictures:
        parts += [Spacer(1, 4), picture(pictures["timing.png"])]
    parts += _timing_tables(content.timing)
    if clock_of(run.clock) in (WALL, SCAN):
        realtime = timing.realtime
        rows = [
            (name, f"{'granted' if realtime.granted(name) else 'refused'}: {text}")
            for name, text in realtime.details.items()
        ]
        parts += [grid(("", ""), rows, (30, 130))] if rows else []
    return section("Timing", *parts)


def _timing_tables(found: TimingTables) -> list[Any]:
    parts: list[Any] = []
    if found.percentiles:
        table = _numbers(PERCENTILE_HEADS, found.percentiles, (40, 30, 30, 30, 30), {0})
        parts.append(KeepTogether([paragraph("Percentiles", "subhead"), table]))
    if found.missed:
        table = _numbers(MISSED_HEADS, found.missed, (19, 18, 14, 37, 15, 14, 14, 14, 14), {3})
        more = [paragraph(found.more, "soft")] if found.more else []
        parts.append(
            KeepTogether([paragraph("Missed scan cycles, and the cycle before each, in µs", "subhead"), table, *more])
        )
    if found.scans:
        table = _numbers(SCAN_HEADS, found.scans, (17, 16, 18, 37, 15, 14, 14, 14, 14), {0, 3})
        parts.append(KeepTogether([paragraph("Longest scan cycles and latest wake-ups, in µs", "subhead"), table]))
    if found.causes:
        parts += [Spacer(1, 4), grid(("", ""), found.causes, (30, 130))]
    return parts


def _numbers(heads: Sequence[str], rows: Sequence[Sequence[str]], widths: Sequence[float], words: set[int]) -> Any:
    """Return a table of numbers, which stand at the right of their columns; `words` are the columns of text."""
    shown = [[cell if place in words else paragraph(cell, "right") for place, cell in enumerate(row)] for row in rows]
    return grid(heads, shown, widths, right=set(range(len(heads))) - words)


def provenance_rows(result: Result, run: Manifest, conditions: dict[str, str]) -> list[tuple[str, str]]:
    """Return what was run, when, by whom and with what: name and text."""
    recipe, bench, unit = run.recipe, run.bench, run.unit
    return [
        ("run", str(result.run)),
        ("started, ended", f"{run.started}, {run.ended}"),
        ("recipe", f"{recipe.name} revision {recipe.revision}, SHA-256 {recipe.sha256}"),
        ("bench", f"{bench.name} revision {bench.revision}, SHA-256 {bench.sha256}"),
        *([("operator", run.operator)] if run.operator else []),
        *([("virtual unit", virtual_unit(unit))] if unit.virtual else []),
        *([("faults injected", run.scenario)] if run.scenario else []),
        ("clock", CLOCK_TEXTS.get(clock_of(run.clock), clock_of(run.clock))),
        *software_rows(run.software),
        *conditions.items(),
    ]


def provenance_parts(result: Result, run: Manifest, content: Content, conditions: dict[str, str]) -> list[Any]:
    """Return what was run by whom and with what, and the checksums to check it again by."""
    rows = provenance_rows(result, run, conditions)
    rows += [(f"calibration {name}", text) for name, text in content.calibrations]
    table = grid(("", ""), rows, (35, 125))
    parts = [*heading("What was run", table), table]
    if content.checksums:
        sums = [(name, paragraph(size, "right"), paragraph(sha, "mono")) for name, size, sha in content.checksums]
        table = grid(("file of the record", "bytes", "SHA-256"), sums, (45, 20, 95))
        parts += [*heading("Files for checking this run again", table), table]
        word = "analyze" if result.metrics else "show"
        parts.append(paragraph(f"The command 'lostmotion {word} {result.run}' reads these files again.", "soft"))
    return parts
