"""`lostmotion replay`: steps the controller through a record, and asks what another recipe would have changed."""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

from controller.controller import Controller
from controller.decisions import DECISIONS_VERSION, changes_since
from definitions.program import Program
from recipes import RecipeError
from station.atomic_file import read_file
from station.bench.request import Job, stored_job
from station.cli.measure.run import EXIT_CODES
from station.cli.runs.show import tell_alone
from station.cli.runs.what_if import Answer, Question, what_if_lines
from station.documents.entries import left_out, plain
from station.documents.events import EventRow
from station.documents.reading import document_in
from station.errors import RecordError, StationError
from station.records.program_file import PROGRAM, program_differences
from station.records.run_record import EVENTS, RunRecord
from station.records.samples.samples import samples_bytes
from station.records.samples.table import table_of
from station.records.seal import EXIT_ALTERED, alteration_lines, alterations
from station.results.replay import FirstDiffering, Replayed, not_compared, replay
from station.run.conclusion import NOT_DECIDABLE
from station.run.jog.jogs import find_record, stored_jog
from station.run.way_back.left_by import taken_up

SAME, DIFFERS, BAD, UNDECIDED = 0, 1, 2, EXIT_CODES[NOT_DECIDABLE]
FIRST_DECISIONS = 1
"""Version of the controller's decisions of runs that do not name it: it was not kept yet."""

NOT_ASKED = "effects of another recipe cannot be computed for"
NOT_ASKED_OF = {DIFFERS: "a replay that differs", BAD: "a damaged record", EXIT_ALTERED: "an altered record"}


def replay_run(name: str, data: Path, other: str | None, *, as_json: bool) -> int:
    """Replay a run or a jog; 0 identical, 1 not, 2 when the record is damaged, 3 when it was altered.

    An altered record is replayed, because where it differs is worth knowing, but 0 becomes 3: identical to what?
    With another recipe 0 says that nothing would have changed, 1 that something would have, 3 that nothing can be said,
    because the replay differs or the record was altered.

    Raises:
        StationError, RecipeError: there is no such run, its recipe or bench cannot be loaded any more, or the other
            recipe does not fit the run.

    """
    run, is_jog = find_record(data, name, alone=True)
    tell_alone(run)
    if is_jog and other is not None:
        raise StationError(
            f"--recipe: {run.id} is a jog (the shaft was turned by hand control), which uses no recipe. Replay it "
            "without --recipe"
        )
    altered = alterations(run)
    try:
        job = stored_job(run)
        return _replay(run, stored_jog(run, job) if is_jog else job, altered, other, as_json=as_json)
    except (StationError, RecipeError):
        # What cannot be read may be what was altered: that is said before the reason.
        sys.stderr.writelines(f"{line}\n" for line in alteration_lines(altered))
        raise


def _replay(run: RunRecord, job: Job, altered: tuple[str, ...], other: str | None, *, as_json: bool) -> int:
    content, layout = samples_bytes(run), run.layout()
    left = taken_up(run.manifest().left)
    question = None if other is None else Question(other, run, job, left)
    controller = Controller(job.program, None, left) if question is None else question.controller
    started = time.perf_counter()
    found = replay(content, controller if question is None else question.beside, layout)
    seconds = time.perf_counter() - started
    report = _report(run, job, controller, found, seconds, altered)
    code = BAD if found.damage else SAME if found.same and not report.events_differ else DIFFERS
    if altered and code == SAME:
        code = EXIT_ALTERED
    if question is not None:
        if code == SAME:
            answer = question.answer(table_of(content, layout))
            report = replace(report, what_if=answer)
            code = DIFFERS if answer.changed else SAME
        else:
            report = replace(report, what_if_refused=f"{NOT_ASKED} {NOT_ASKED_OF[code]}")
            code = BAD if code == BAD else UNDECIDED
    if as_json:
        sys.stdout.write(json.dumps(plain(report), ensure_ascii=False) + "\n")
    else:
        told = [*alteration_lines(altered), *_lines(report, found, run.manifest().period_ns)]
        sys.stdout.write("\n".join(told) + "\n")
    return code


@dataclass(frozen=True, slots=True, kw_only=True)
class DecidedBy:
    """By which version of the controller's decisions a run was made, which one replays it, and what changed between."""

    recorded: int
    now: int
    recorded_by: str
    changes: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayReport:
    """What a replay found, as it is printed."""

    run: str
    state: str
    identical_scans: int
    difference: FirstDiffering | None
    damage: str
    cut_bytes: int
    decisions: DecidedBy
    not_compared: tuple[str, ...]
    program_differs: tuple[str, ...]
    events_differ: tuple[str, ...]
    scans_per_s: int
    seconds: float
    altered: tuple[str, ...]
    what_if: Answer | None = left_out()
    what_if_refused: str | None = left_out()


def _report(  # noqa: PLR0917 - what was replayed, by what, what came of it, and what is known of the record
    run: RunRecord, job: Job, controller: Controller, found: Replayed, seconds: float, altered: tuple[str, ...]
) -> ReplayReport:
    return ReplayReport(
        run=run.id,
        state=run.state(),
        identical_scans=found.identical,
        difference=None if found.difference is None else found.difference.document(),
        damage=found.damage,
        cut_bytes=found.cut_bytes,
        decisions=_decisions(run),
        not_compared=tuple(not_compared(run.layout())),
        program_differs=tuple(_program_differences(run, job.program)),
        events_differ=tuple(_event_differences(run, controller)) if found.same else (),
        scans_per_s=round((found.identical + 1) / seconds),
        seconds=round(seconds, 3),
        altered=altered,
    )


def _decisions(run: RunRecord) -> DecidedBy:
    made_by = run.manifest().software
    recorded = FIRST_DECISIONS if made_by.decisions is None else made_by.decisions
    changes = tuple(changes_since(recorded))
    return DecidedBy(recorded=recorded, now=DECISIONS_VERSION, recorded_by=made_by.version, changes=changes)


def _program_differences(run: RunRecord, program: Program) -> list[str]:
    """Return where the recorded recipe now becomes another program than it became then."""
    if not run.has(PROGRAM):
        return []
    return program_differences(run.read_json(PROGRAM), program)


def _event_differences(run: RunRecord, controller: Controller) -> list[str]:
    """Return the first transition that differs from the run's own list of events, and lines in it that are no events.

    A run without such a list, as one that was cut off, has nothing to differ from.
    """
    if not run.has(EVENTS):
        return []
    told, unread = _told_transitions(run)
    made = [(event.scan, event.state, event.text) for event in controller.events if event.kind == "transition"]
    if told == made:
        return unread
    differing = [(a, b) for a, b in zip(told, made, strict=False) if a != b]
    first = differing[0] if differing else (len(told), len(made))
    return [*unread, f"transitions differ: recorded {first[0]}, replayed {first[1]}"]


def _told_transitions(run: RunRecord) -> tuple[list[tuple[int, str, str | None]], list[str]]:
    """Return the transitions in the run's own list of events, and what is wrong with the first line that is no event.

    Raises:
        StationError: the list cannot be read.

    """
    lines = read_file(run.folder / EVENTS).splitlines()
    told, broken = [], []
    for number, line in enumerate(lines, start=1):
        try:
            event = document_in(EventRow, line, run.folder / EVENTS)
            if event.kind == "transition":
                told.append((event.scan, event.state, event.to))
        except RecordError:
            broken.append(number)
    if not broken:
        return told, []
    more = f", nor {'are' if len(broken) > 2 else 'is'} {len(broken) - 1} more" if len(broken) > 1 else ""
    return told, [f"{EVENTS}: line {broken[0]} is not an event{more}"]


def _decided_otherwise(decisions: DecidedBy, *, same: bool) -> str:
    """Say that the run was made by another version of the controller's decisions, and what that means here."""
    recorded, now, by = decisions.recorded, decisions.now, decisions.recorded_by
    head = f"Recorded by version {recorded} of the controller's decisions (lostmotion {by}), replayed by version {now}"
    if recorded > now:
        head += ", which is older"
    changed = f" Decided otherwise since then: {'; '.join(decisions.changes)}." if decisions.changes else ""
    means = "Both decide the same here." if same else f"A difference may be that. To tell, replay it with {by}."
    return f"{head}.{changed} {means}"


def _lines(report: ReplayReport, found: Replayed, period_ns: int) -> list[str]:
    speed = f"{report.seconds:.2f} s, {report.scans_per_s} scans/s"
    lines = [f"{report.run} ({report.state}): {found.identical} scans replayed identically ({speed})"]
    if found.cut_bytes:
        lines.append(
            f"{found.cut_bytes} bytes at the end of the file were left out: the last record was not written completely"
        )
    decisions = report.decisions
    if decisions.recorded != decisions.now:
        lines.append(_decided_otherwise(decisions, same=found.same))
    lines += [f"order not compared: {text}" for text in report.not_compared]
    if found.damage:
        lines.append(f"the record is damaged: {found.damage}. Restore it from a backup")
    lines += [
        f"this version compiles the recorded recipe to another program: {text}" for text in report.program_differs[:8]
    ]
    if found.difference is not None:
        lines += found.difference.lines(period_ns)
    lines += report.events_differ
    if report.what_if_refused is not None:
        lines.append(report.what_if_refused)
    if report.what_if is not None:
        lines += what_if_lines(report.what_if, period_ns)
    return lines
