"""What the operator's page says of a run: its tile, its reasons, its metrics, and what a scan is called."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from html import escape

from station.documents.result import MetricValue, Result
from station.reports.headline import remaining_reasons
from station.reports.metric_sides import side_rows
from station.reports.result_text import limits_text, minus, number, uncertainty_text, unit_text
from station.web.languages import Words
from station.web.pages.words import ENDINGS, NOT_BELIEVED, READY, RUNNING, STARTING, VERDICTS, Shown, reason_said
from station.web.running import ENDED, Now
from station.web.running import RUNNING as IS_RUNNING
from station.web.running import STARTING as IS_STARTING
from station.web.scanner import ScanError, serial_of

BEYOND = {"above": ">", "below": "<"}
BEYOND_LIMIT = re.compile(
    r"\w+(?:, side (?P<side>[+-]))?: (?P<value>[-+.\de]+)(?: \S+)? is (?P<where>above|below) the limit of "
    r"(?P<limit>[-+.\de]+(?: \S+)?): .+"
)
"""The reason of one side of a metric beyond its limit, as a record has it."""


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


def badge_line(now: Now, say: Words) -> str:
    """Return what stands on the tile of a run that says nothing of a real unit, as that it is simulated; else ''."""
    said = " ".join(f'<span class="lm-badge">{escape(say(one))}</span>' for one in now.badges)
    return f"<div>{said}</div>" if said else ""


def why_text(now: Now, say: Words) -> str:
    """Return what stands below the tile: why a start was refused, the reasons of a verdict, the metrics."""
    if now.refused:
        return f"<b>{escape(say('The run was not started.'))}</b> {escape(say(now.refused))}"
    if now.altered:
        return "<br>".join(escape(one) for one in now.altered)
    if now.result is None:
        return ""
    return f"{_reasons(now.result, say)}{metrics_table(now.result, say)}"


def _reasons(result: Result, say: Words) -> str:
    """Return the reasons: of each metric beyond a limit one line, the others as they are."""
    lines, told = list[str](), set[str]()
    for metric in result.metrics:
        said, those = beyond_lines(metric, say)
        lines += (f"<p><b>{escape(one)}</b></p>" for one in said)
        told |= those
    others = remaining_reasons(replace(result, reasons=tuple(one for one in result.reasons if one not in told)))
    return "".join([*lines, *(f"<p>{escape(reason_said(one, say))}</p>" for one in others)])


def beyond_lines(metric: MetricValue, say: Words) -> tuple[list[str], set[str]]:
    """Return a line for each limit that a metric is beyond, of both its sides, and the reasons that it stands for."""
    lines, told = list[str](), set[str]()
    for where, sign in BEYOND.items():
        found = [one for one in map(BEYOND_LIMIT.fullmatch, metric.reasons) if one and one["where"] == where]
        if found:
            lines.append(_beyond(metric, sign, found, say))
            told |= {one[0] for one in found}
    return lines, told


def _beyond(metric: MetricValue, sign: str, found: Sequence[re.Match[str]], say: Words) -> str:
    """Return how far a metric is beyond a limit, in one line: the worse side, and which sides."""
    worse = (max if sign == ">" else min)(found, key=lambda one: float(one["value"]))
    sides = [one["side"] for one in found if one["side"]]
    where = say("both sides") if len(sides) > 1 else say("side {side}", side=minus(sides[0])) if sides else ""
    value, limit = (minus(say.number(worse[name])) for name in ("value", "limit"))
    return f"{_title(metric)} {value} {sign} {limit}{f' ({where})' if where else ''}"


def metrics_table(result: Result, say: Words) -> str:
    """Return the metrics that have limits, each on the side that decides: value, uncertainty, limits and verdict."""
    rows = "".join(_row(side_rows(one)[0], say) for one in result.metrics if one.limits)
    return f'<table class="lm">{rows}</table>' if rows else ""


def _row(metric: MetricValue, say: Words) -> str:
    value, u = number(metric.value, metric.uncertainty), uncertainty_text(metric)
    u = u if metric.uncertainty is not None else ""
    figure, limits = (say.number(text) for text in (f"{value} {u}".rstrip(), limits_text(metric.limits)))
    cells = (figure, unit_text(metric.unit), limits, say(metric.verdict or ""))
    verdicts = {one.verdict for one in metric.sides.values()}
    named = metric.side in metric.sides and len(metric.sides) > 1 and len(verdicts) > 1
    title = f"{_title(metric)}, {say('side {side}', side=minus(metric.side))}" if named else _title(metric)
    return f"<tr><td>{escape(title)}</td>" + "".join(f'<td class="n">{escape(one)}</td>' for one in cells) + "</tr>"


def _title(metric: MetricValue) -> str:
    return (metric.title or metric.id).partition(" (")[0]
