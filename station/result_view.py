"""The result for a person: verdict, why, and a table of metrics."""

from __future__ import annotations

import sys
from typing import Any

from rich.console import Console
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from station.headline import ending_text, headline, remaining_reasons, virtual_badges

VERDICT_STYLES = {"PASS": "bold white on green", "FAIL": "bold white on red", "NOT DECIDABLE": "bold black on yellow"}
HEADLINE_STYLES = VERDICT_STYLES | {"fault": "bold white on red", "stopped": "bold black on yellow"}
BADGE_STYLE = "bold white on magenta"


def number(value: float | None) -> str:
    """Return a value with four significant digits, without an exponent where it can be had; a dash when missing."""
    if value is None:
        return "–"
    text = f"{value:.4g}"
    return text if "e" not in text else f"{value:.3e}"


def limits_text(limits: dict[str, float | None]) -> str:
    """Return limits as they are said: `≤ 1`, `≥ 108`, `95 … 120`, or nothing."""
    low, high = limits.get("min"), limits.get("max")
    if low is not None and high is not None:
        return f"{low:g} … {high:g}"
    if low is not None:
        return f"≥ {low:g}"
    return f"≤ {high:g}" if high is not None else ""


def metric_name(metric: dict[str, Any]) -> str:
    """Return a metric's id with torque, branch and side where they tell it from others."""
    parts = [str(metric["id"])]
    if metric.get("torque_nm") is not None:
        parts.append(f"{metric['torque_nm']:g} N·m")
    if metric["branch"] in ("load", "unload") or metric["id"] == "stiffness_50_100":
        parts.append(metric["branch"])
    if metric["side"] in ("+", "-"):
        parts.append(metric["side"].replace("-", "−"))
    return " ".join(parts)


def uncertainty_text(metric: dict[str, Any]) -> str:
    """Return the expanded uncertainty with two digits, or nothing."""
    return f"± {metric['uncertainty']:.2g}" if metric["uncertainty"] is not None else ""


def unit_text(unit: str) -> str:
    """Return the unit as it stands behind a number; nothing for pure numbers."""
    return "" if unit == "1" else unit


def shown_rows(metrics: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the metrics as rows: the headline side, and every other side whose verdict is not the same."""
    rows = []
    for metric in metrics:
        sides = metric.get("sides", {})
        headline = sides.get(metric["side"], metric)
        rows.append(metric | {"verdict": headline["verdict"]})
        rows += [
            metric
            | {"side": side, "value": found["value"], "uncertainty": found["uncertainty"], "verdict": found["verdict"]}
            for side, found in sides.items()
            if side != metric["side"] and found["verdict"] != headline["verdict"]
        ]
    return rows


def metrics_table(metrics: list[dict[str, Any]]) -> Table:
    """Return the metrics as a table, those that decide first."""
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    table.add_column("metric", no_wrap=True)
    table.add_column("value", justify="right", no_wrap=True)
    for name in ("", "unit", "limit", ""):
        table.add_column(name, no_wrap=True)
    for metric in sorted(shown_rows(metrics), key=lambda one: one["verdict"] is None):
        verdict = metric["verdict"]
        style = {"PASS": "green", "FAIL": "bold red", "NOT DECIDABLE": "yellow"}.get(verdict or "", "")
        table.add_row(
            metric_name(metric),
            Text(number(metric["value"]), style="bold" if verdict else ""),
            Text(uncertainty_text(metric), style="dim"),
            unit_text(metric["unit"]),
            limits_text(metric["limits"]),
            Text(verdict or "", style=style),
        )
    return table


def timing_line(timing: dict[str, Any]) -> str:
    """Return the proof of timing as one line."""
    scans, missed = timing["scans"], timing["missed"]
    if timing.get("clock") == "virtual":
        return f"{scans} scans of {timing['period_ns'] / 1e6:g} ms in virtual time"
    late, work = timing["lateness_us"], timing["work_us"]
    share = missed / max(scans + missed, 1)
    return (
        f"{scans} scans of {timing['period_ns'] / 1e6:g} ms, {missed} missed ({share:.3%}), "
        f"lateness {late['p50']:.0f} µs typical, {late['p99']:.0f} µs p99, {late['max']:.0f} µs worst, "
        f"work {work['p50']:.0f} µs, oldest sample {timing['oldest_sample_scans']} scans"
    )


def result_console() -> Console:
    """Return a console on standard output; into a file or a pipe it writes lines of 110 characters."""
    return Console() if sys.stdout.isatty() else Console(width=110)


def show_result(console: Console, result: dict[str, Any], *, files: bool = True) -> None:
    """Print a result: the verdict last, where the eye is when the scrolling stops."""
    if result["metrics"]:
        console.print(metrics_table(result["metrics"]))
        console.print()
    for alarm in result.get("alarms", []):
        console.print(f"ALARM  {alarm['text']}: {alarm['cause']}", style="red", highlight=False)
        console.print(f"       next: {alarm['next_action']}", highlight=False)
    if result.get("timing"):
        console.print(timing_line(result["timing"]), style="dim", highlight=False)
    if files and result.get("record"):
        console.print(f"record  {result['record']}", style="dim", highlight=False, soft_wrap=True)
    console.print(verdict_panel(result))


def verdict_panel(result: dict[str, Any]) -> Panel:
    """Return the box at the end of a result: headline, verdict, whether it is real, why, how the bench was left."""
    head = headline(result)
    style = HEADLINE_STYLES[head.style]
    recipe = result["recipe"]
    body = Text.assemble(Text(f" {head.text} ", style=style))
    for badge in virtual_badges(result):
        body.append("  ").append(f" {badge} ", style=BADGE_STYLE)
    if head.verdict:
        body.append("\n").append(head.verdict, style=f"bold {VERDICT_STYLES[head.verdict].split()[-1]}")
    body.append(f"  {result.get('serial') or ''}  {recipe['name']} revision {recipe['revision']}")
    if head.verdict:
        body.append(f"  run {ending_text(result)}")
    for reason in remaining_reasons(result):
        body.append(f"\n{reason}")
    left = result.get("left")
    if left:
        body.append(f"\n{left['text']}: ", style="bold").append(left["next_action"])
    return Panel(body, border_style=style.split()[-1], padding=(0, 1))
