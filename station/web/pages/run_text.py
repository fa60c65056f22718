"""What the page of a run says: verdict, reasons, metrics with the bad ones first, facts, alarms, checks and timing."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import jinja2

from station.documents.manifest import Manifest, attempt_text
from station.documents.result import MetricValue, Result
from station.records.clocks import CLOCK_TEXTS, clock_of
from station.records.run_record import RunRecord
from station.records.seal import is_sealed
from station.reports.content import FAILED, check_rows, checks_line, shown_checks, uncertainty_kind
from station.reports.headline import badges, headline, manifest_badges, remaining_reasons, virtual_unit
from station.reports.metric_sides import worst_first
from station.reports.result_notes import note_lines
from station.reports.result_text import (
    guarded_text,
    limits_text,
    metric_name,
    minus,
    number,
    software_rows,
    spread_text,
    unit_text,
)
from station.reports.result_view import timing_line
from station.reports.stored_result import result_and_doubts
from station.reports.timing_tables import timing_details, timing_proof
from station.web.languages import ENGLISH, Words, words_of
from station.web.pages.frame import HERE
from station.web.pages.words import (
    ENDINGS,
    NOT_BELIEVED,
    NOT_CONCLUDED,
    SHAPES,
    STYLES,
    VERDICTS,
    Shown,
    attempts_said,
    left_said,
    local,
    reason_said,
)

RESTORE = "Restore the record from a backup, or test the unit again."
"""What to do about a record that is not as it was left."""


@dataclass(frozen=True)
class RunText:
    """A run as its page says it. doubtful: its record is not as it was left, and nothing of its result is shown.

    html: all of it that is text. rows: every side of every metric, the bad ones first. drawn: whether there is a loop.
    """

    run: str
    serial: str
    verdict: str
    doubtful: bool
    drawn: bool
    html: str
    rows: tuple[MetricValue, ...]


@dataclass(frozen=True)
class _MetricRow:
    """One side of a metric, as texts."""

    title: str
    name: str
    side: str
    value: str
    unit: str
    limits: str
    guarded: str
    verdict: str | None


IN_ENGLISH = words_of(ENGLISH)


def run_text(run: RunRecord, say: Words = IN_ENGLISH) -> RunText:
    """Return what the page of a run says; of one whose record is not as it was left only whose it is, and why.

    Names of metrics and checks, causes of faults and the proof of timing stay as the record has them.

    Raises:
        RecordError: its run.json cannot be read.

    """
    manifest = run.manifest()
    result, doubts = result_and_doubts(run)
    sealed, doubtful = is_sealed(manifest), bool(doubts)
    rows = () if doubtful else tuple(worst_first(result.metrics))
    tile = NOT_BELIEVED if doubtful else _tile(result) if sealed else NOT_CONCLUDED
    checks = () if doubtful else check_rows(shown_checks(result))
    timing = None if doubtful else result.timing
    head = headline(result)
    reasons = [*doubts, RESTORE] if doubtful else remaining_reasons(result)
    if not doubtful and head.verdict:
        what, _, cause = head.text.partition(": ")
        reasons = [f"{say(what)}: {say(cause)}" if cause else say(what), *reasons]
    html = (
        _environment()
        .get_template("run.html")
        .render(
            run=manifest,
            tile=tile,
            attempt=attempts_said(attempt_text(manifest.attempt, manifest.before, manifest.retest_reason), say),
            badges=manifest_badges(manifest) if doubtful else badges(result),
            reasons=[reason_said(line, say) for reason in reasons for line in reason.splitlines() if line.strip()],
            metrics=[_row_text(row, result) for row in rows],
            uncertainty="" if doubtful else uncertainty_kind(result.metrics),
            facts=_facts(manifest, [] if doubtful else note_lines(result), say),
            alarms=() if doubtful else result.alarms,
            left=None if doubtful or result.left is None else left_said(result.left, say),
            checks=checks,
            checks_line=", ".join(map(say, checks_line(() if doubtful else shown_checks(result)).split(", "))),
            failed=FAILED,
            timing="" if timing is None or not timing.scans else timing_line(timing),
            timing_details=[] if doubtful else timing_details(timing_proof(run)),
            say=say,
            shapes=SHAPES,
            styles=STYLES,
        )
    )
    verdict = result.verdict if sealed and not doubtful else ""
    return RunText(run.id, manifest.serial, verdict, doubtful, sealed and not doubtful, html, rows)


def _tile(result: Result) -> Shown:
    if result.state == "complete":
        return VERDICTS[result.verdict]
    return ENDINGS.get(result.state, ENDINGS["fault"])


def metric_title(row: MetricValue) -> str:
    """Return the short title of a metric, with its side: what stands in a picture."""
    side = f", side {minus(row.side)}" if row.side in ("+", "-") else ""
    return f"{(row.title or row.id).partition(' (')[0]}{side}"


def _row_text(row: MetricValue, result: Result) -> _MetricRow:
    spread = spread_text(row)
    value = number(row.value, row.uncertainty)
    return _MetricRow(
        title=row.title or row.id,
        name=metric_name(row),
        side=minus(row.side) if row.side in ("+", "-") else "",
        value=f"{value} {spread}".rstrip(),
        unit=unit_text(row.unit),
        limits=limits_text(row.limits),
        guarded=guarded_text(row, result.decision),
        verdict=row.verdict,
    )


def _facts(run: Manifest, notes: Sequence[str], say: Words) -> list[tuple[str, str]]:
    """Return whose run it is, by what and when it was measured, and what a person should know besides."""
    clock = clock_of(run.clock)
    facts = [
        ("model", run.unit.model),
        ("virtual unit", virtual_unit(run.unit)),
        ("master part", say("should read {verdict}", verdict=say(run.unit.master)) if run.unit.master else ""),
        ("recipe", say("{name} revision {revision}", name=run.recipe.name, revision=run.recipe.revision)),
        ("bench", say("{name} revision {revision}", name=run.bench.name, revision=run.bench.revision)),
        ("operator", run.operator or ""),
        ("started", local(run.started)),
        ("ended", local(run.ended)),
        ("clock", say(CLOCK_TEXTS.get(clock, clock))),
        ("faults injected", run.scenario or ""),
        *(("note", one) for one in notes),
        *(("note", one) for one in run.notes if one not in notes),
        *software_rows(run.software)[:1],
        ("run", run.id),
    ]
    return [(name, text) for name, text in facts if text]


@functools.cache
def _environment() -> jinja2.Environment:
    """Return the templates; every text of a record is escaped by them."""
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(HERE), autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True
    )
