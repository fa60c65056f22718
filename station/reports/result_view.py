"""The result for a person: verdict, why, and a table of metrics."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.padding import Padding
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from station.documents.manifest import attempt_text
from station.documents.result import Evaluation, MetricValue, Result
from station.documents.scan_report import Pace
from station.documents.timing import Timing
from station.plain_text import with_known_signs
from station.records.clocks import SCAN, VIRTUAL, WALL, clock_of
from station.records.run_record import RunRecord
from station.reports.headline import badges, headline, how_it_ended, remaining_reasons, virtual_unit
from station.reports.metric_sides import judging_rows, side_rows
from station.reports.result_notes import check_lines, note_lines, summary_lines
from station.reports.result_text import (
    VERDICT_STYLES,
    limits_text,
    metric_name,
    number,
    spread_text,
    uncertainty_text,
    unit_text,
)
from station.reports.timing_tables import timing_details, timing_proof

HEADLINE_STYLES = VERDICT_STYLES | {"fault": "bold white on red", "stopped": "bold black on yellow"}
BADGE_STYLE = "bold white on magenta"


def metrics_table(metrics: Sequence[MetricValue], encoding: str = "utf-8") -> Table:
    """Return the metrics as a table, those that decide first, each by the side that judges it.

    encoding: of the stream that it is printed on.
    """
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    table.add_column("metric", overflow="fold")
    table.add_column("value", justify="right", no_wrap=True)
    for name in ("", "unit", "limit", ""):
        table.add_column(name, no_wrap=True)
    for metric in sorted(judging_rows(metrics), key=lambda one: one.verdict is None):
        verdict = metric.verdict
        style = {"PASS": "green", "FAIL": "bold red", "NOT DECIDABLE": "yellow"}.get(verdict or "", "")
        cells = (
            titled_name(metric),
            Text(number(metric.value, metric.uncertainty), style="bold" if verdict else ""),
            Text(spread_text(metric), style="dim"),
            Text(unit_text(metric.unit)),
            Text(limits_text(metric.limits)),
            Text(verdict or "", style=style),
        )
        table.add_row(*(_with_known_signs(cell, encoding) for cell in cells))
    return table


def _with_known_signs(text: Text, encoding: str) -> Text:
    """Return a styled text as an encoding can say it, before it is laid out."""
    for sign in sorted(set(text.plain)):
        known = with_known_signs(sign, encoding)
        if known != sign:
            text = Text(known).join(text.split(sign, allow_blank=True))
    return text


def titled_name(row: MetricValue) -> Text:
    """Return the title of a metric with its name below; the name alone where an older result has no title."""
    name = metric_name(row)
    return Text.assemble(row.title, "\n", (name, "dim")) if row.title else Text(name)


def definitions_table(metrics: Sequence[MetricValue]) -> Table:
    """Return every metric, each side of it, with its whole definition below."""
    table = Table(box=None, padding=(0, 2, 0, 0), show_header=False)
    table.add_column(ratio=1)
    for metric in metrics:
        _add_defined(table, metric)
    return table


def _add_defined(table: Table, metric: MetricValue) -> None:
    """Add a metric: a line per side, and below them what the numbers are."""
    for row in side_rows(metric):
        title = row.title
        head = Text.assemble(
            f"{title}   " if title else "",
            (metric_name(row), "dim" if title else ""),
            "   ",
            (f"{number(row.value, row.uncertainty)} {unit_text(row.unit)}".strip(), "bold"),
            (f" {uncertainty_text(row)}", "dim"),
            f"   {limits_text(row.limits)}",
            f"   {row.verdict or ''}",
        )
        head.rstrip()
        table.add_row(head)
    table.add_row(Padding(Text(definition_text(metric), style="dim"), (0, 0, 0, 4)))


def definition_text(metric: MetricValue) -> str:
    """Return what a number is: definition, branch, estimator and cycles."""
    cycles = f"{metric.cycles} {'cycle' if metric.cycles == 1 else 'cycles'}"
    branch = "" if metric.branch == "width" else f"{metric.branch} branch, "
    return f"{metric.definition}; {branch}by {metric.estimator}, {cycles}"


def timing_line(timing: Timing) -> str:
    """Return the proof of timing as one line."""
    scans, missed = timing.scans, timing.missed
    clock = clock_of(timing.clock)
    if clock == VIRTUAL:
        return f"{scans} scan cycles of {timing.period_ns / 1e6:g} ms in virtual time"
    if clock == SCAN:
        return f"{scans} scan cycles of {timing.period_ns / 1e6:g} ms, scan clock, {pace_text(timing.pace or Pace())}"
    late, work = timing.lateness_us, timing.work_us
    share = missed / max(scans + missed, 1)
    return (
        f"{scans} scan cycles of {timing.period_ns / 1e6:g} ms, {missed} missed ({share:.3%}), "
        f"wake-up latency {late.p50:.0f} µs typical, {late.p99:.0f} µs in 99 % of cycles, {late.max:.0f} µs worst, "
        f"computing time {work.p50:.0f} µs, oldest sample {timing.oldest_sample_scans} cycles"
    )


def pace_text(pace: Pace) -> str:
    """Return what became of the periods on a bench that waits: how many were stretched, and by how much."""
    if pace.fast:
        return "as fast as possible: no deadlines"
    stretched = pace.stretched
    if not stretched:
        return "no cycle lengthened"
    cycles = "1 cycle" if stretched == 1 else f"{stretched} cycles"
    total_ms, longest_ms = 1e3 * pace.stretched_s, 1e3 * pace.longest_s
    return f"{cycles} lengthened: {total_ms:.0f} ms in total, {longest_ms:.0f} ms at most"


def proof_of(result: Result) -> Timing | None:
    """Return the whole proof of timing of a result: from its record, which has more of it than the result."""
    found = timing_proof(RunRecord(Path(result.record))) if result.record else None
    return found or result.timing


def result_console() -> Console:
    """Return a console on standard output; into a file or a pipe it writes lines of 110 characters.

    Brackets and colons in what a person named, as a unit or an operator, are no markup: they are shown as they are.
    """
    return Console(width=None if sys.stdout.isatty() else 110, markup=False, emoji=False)


def show_result(console: Console, result: Result, *, files: bool = True) -> None:
    """Print a result: the verdict last, where the eye is when the scrolling stops."""
    selection = result.selection if isinstance(result, Evaluation) else ()
    if result.metrics and selection:
        console.print(", ".join(selection), style="bold", highlight=False)
        console.print(definitions_table(result.metrics))
        console.print()
    elif result.metrics:
        console.print(metrics_table(result.metrics, console.encoding))
        for told in summary_lines(result):
            console.print(told, style="dim", highlight=False)
        console.print()
    for style, word, lines in (("red", "FAILED ", check_lines(result)), ("cyan", "note   ", note_lines(result))):
        for said in lines:
            console.print(Text.assemble((word, style), said))
    for line in alarm_lines(result):
        console.print(line, highlight=False)
    if result.timing is not None:
        for told in (timing_line(result.timing), *timing_details(proof_of(result))):
            console.print(told, style="dim", highlight=False)
    _show_origin(console, result, files=files)
    console.print(verdict_panel(result, console.encoding))
    if files and result.record:
        show_report(console, Path(result.record))


def _show_origin(console: Console, result: Result, *, files: bool) -> None:
    """Print what was on a virtual bench, and where the record is."""
    on_bench = virtual_unit(result.unit)
    record = result.record if files else None
    for name, text in (("unit    virtual ", on_bench), ("record  ", record)):
        if text:
            console.print(f"{name}{text}", style="dim", highlight=False, soft_wrap=True)


def show_report(console: Console, folder: Path) -> None:
    """Print where the report of a run is, for each form that is there."""
    for name in ("report.html", "report.pdf"):
        if (folder / name).is_file():
            console.print(f"report  {folder / name}", highlight=False, soft_wrap=True)


def alarm_lines(result: Result) -> list[Text]:
    """Return each alarm once, with when it first came, how often, and what to do; notes are not red.

    The cause and the next action of the alarm that ended the run stand in the box below.
    """
    lines, seen = [], set()
    alarms = result.alarms
    for alarm in alarms:
        if alarm.id in seen:
            continue
        seen.add(alarm.id)
        note = alarm.is_note
        times = sum(other.id == alarm.id for other in alarms)
        line = Text("note   " if note else "ALARM  ", style="cyan" if note else "red")
        line.append(f"{alarm.t_s:.3f} s  {alarm.text}")
        line.append(f", {times} times" if times > 1 else "")
        if alarm.first and not note:
            line.append("  ◀ first cause", style="bold red")
        else:
            line.append(f". {alarm.next_action}", style="default")
            line.append(f". {alarm.detail[:1].upper()}{alarm.detail[1:]}" if alarm.detail else "", style="default")
        lines.append(line)
    return lines


def way_back_command(result: Result) -> str:
    """Return the command that takes a bench back after a fault; '' where nothing is left to take back."""
    over_wires = clock_of(result.clock) in (WALL, SCAN) and result.bench is not None and not result.bench.embedded
    if not over_wires or result.state not in ("fault", "interrupted"):
        return ""
    data = Path(result.record or "").parent
    return "lostmotion recover" + ("" if data.name == "runs" and not data.is_absolute() else f" --data {data}")


def verdict_panel(result: Result, encoding: str = "utf-8") -> Panel:
    """Return the box at the end of a result: headline, verdict, whether it is real, why, how the bench was left.

    encoding: of the stream that it is printed on.
    """
    head = headline(result)
    style = HEADLINE_STYLES[head.style]
    recipe = result.recipe
    body = Text.assemble(Text(f" {head.text} ", style=style))
    for badge in badges(result):
        body.append("  ").append(f" {badge} ", style=BADGE_STYLE)
    if head.verdict:
        body.append("\n").append(head.verdict, style=f"bold {VERDICT_STYLES[head.verdict].split()[-1]}")
    body.append(f"  {result.serial or ''}  {recipe.name} revision {recipe.revision}")
    if head.verdict:
        body.append(f"  run {how_it_ended(result)}")
    if result.before or result.retest_reason:
        body.append(f"\n{attempt_text(result.attempt, result.before, result.retest_reason)}")
    for reason in remaining_reasons(result):
        body.append(f"\n{reason}")
    left = result.left
    if left is not None:
        body.append(f"\n{left.text}: ", style="bold").append(left.next_action)
        way_back = way_back_command(result)
        if way_back:
            body.append("\nThis command recovers the bench step by step, and asks before it moves: ").append(
                way_back, style="bold"
            )
    return Panel(_with_known_signs(body, encoding), border_style=style.split()[-1], padding=(0, 1))
