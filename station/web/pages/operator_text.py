"""What the operator's page says of a run: its tile, its reasons, its metrics, and what a scan is called."""

from __future__ import annotations

from html import escape

from station.documents.result import MetricValue, Result
from station.reports.headline import remaining_reasons
from station.reports.result_text import limits_text
from station.web.languages import Words
from station.web.pages.words import ENDINGS, NOT_BELIEVED, READY, RUNNING, STARTING, VERDICTS, Shown, reason_said
from station.web.running import ENDED, Now
from station.web.running import RUNNING as IS_RUNNING
from station.web.running import STARTING as IS_STARTING
from station.web.scanner import ScanError, serial_of


def named(scanned: str) -> str:
    """Return what a scan is called on the page: by the serial number in it, else as it came."""
    try:
        return serial_of(scanned)
    except ScanError:
        return scanned.strip()[:60]


def shown_of(now: Now) -> Shown:
    """Return the tile of what the bench does."""
    if now.stage == IS_STARTING:
        return STARTING
    if now.stage == IS_RUNNING:
        return RUNNING
    if now.stage != ENDED:
        return READY
    if now.altered or now.result is None:
        return NOT_BELIEVED
    if now.result.state != "complete":
        return ENDINGS.get(now.result.state, ENDINGS["fault"])
    return VERDICTS[now.result.verdict]


def why_text(now: Now, say: Words) -> str:
    """Return what stands below the tile: why a start was refused, the reasons of a verdict, the metrics."""
    if now.refused:
        return f"<b>{escape(say('The run was not started.'))}</b> {escape(say(now.refused))}"
    if now.altered:
        return "<br>".join(escape(one) for one in now.altered)
    if now.result is None:
        return ""
    reasons = "".join(f"<p>{escape(reason_said(one, say))}</p>" for one in remaining_reasons(now.result)[:4])
    return f"{reasons}{metrics_table(now.result, say)}"


def metrics_table(result: Result, say: Words) -> str:
    """Return the metrics that have limits, with value, uncertainty, limits and verdict, as a table."""
    rows = "".join(_row(one, say) for one in result.metrics if one.limits)
    return f'<table class="lm">{rows}</table>' if rows else ""


def _row(metric: MetricValue, say: Words) -> str:
    value = "–" if metric.value is None else f"{metric.value:.4g}"
    u = "" if metric.uncertainty is None else f" ± {metric.uncertainty:.2g}"
    cells = (f"{value}{u}".replace("-", "−"), metric.unit, limits_text(metric.limits), say(metric.verdict or ""))
    title = (metric.title or metric.id).partition(" (")[0]
    return f"<tr><td>{escape(title)}</td>" + "".join(f'<td class="n">{escape(one)}</td>' for one in cells) + "</tr>"
