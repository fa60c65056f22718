"""`lostmotion replay`: steps the controller through a record, and asks what another recipe would have changed."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

from controller.controller import Controller
from controller.decisions import DECISIONS_VERSION, changes_since
from controller.held_lock import Left
from definitions.program import Program
from recipes import RecipeError
from station.bench.request import Job, stored_job
from station.cli.measure.run import EXIT_CODES
from station.cli.runs.what_if import Question, what_if_lines
from station.errors import StationError
from station.records.data_folder import Store
from station.records.program_file import PROGRAM, program_differences
from station.records.run_record import RunRecord
from station.records.samples.samples import samples_bytes
from station.records.samples.table import table_of
from station.records.seal import EXIT_ALTERED, alteration_lines, alterations
from station.results.replay import Replayed, not_compared, replay
from station.run.conclusion import NOT_DECIDABLE, finite

SAME, DIFFERS, BAD, UNDECIDED = 0, 1, 2, EXIT_CODES[NOT_DECIDABLE]
FIRST_DECISIONS = 1
"""Version of the controller's decisions of runs that do not name it: it was not kept yet."""

EVENTS = "events.jsonl"
NOT_ASKED = "effects of another recipe are not computed for"
NOT_ASKED_OF = {DIFFERS: "a replay that differs", BAD: "a damaged record", EXIT_ALTERED: "an altered record"}


def replay_run(name: str, data: Path, other: str | None, *, as_json: bool) -> int:
    """Replay a run; 0 identical, 1 not, 2 when the record is damaged, 3 when it was altered.

    An altered record is replayed, because where it differs is worth knowing, but 0 becomes 3: identical to what?
    With another recipe 0 says that nothing would have changed, 1 that something would have, 3 that nothing can be said,
    because the replay differs or the record was altered.

    Raises:
        StationError, RecipeError: there is no such run, its recipe or bench cannot be loaded any more, or the other
            recipe does not fit the run.

    """
    run = Store(data).find(name)
    altered = alterations(run)
    try:
        return _replay(run, altered, other, as_json=as_json)
    except (StationError, RecipeError):
        # What cannot be read may be what was altered: that is said before the reason.
        sys.stderr.writelines(f"{line}\n" for line in alteration_lines(altered))
        raise


def _replay(run: RunRecord, altered: tuple[str, ...], other: str | None, *, as_json: bool) -> int:
    job = stored_job(run)
    content, layout = samples_bytes(run), run.layout()
    kept = run.manifest().get("left")
    left = None if kept is None else Left(**kept)
    question = None if other is None else Question(other, run, job, left)
    controller = Controller(job.program, None, left) if question is None else question.controller
    started = time.perf_counter()
    found = replay(content, controller if question is None else question.beside, layout)
    seconds = time.perf_counter() - started
    report = _report(run, job, controller, found) | {
        "scans_per_s": round((found.identical + 1) / seconds),
        "seconds": round(seconds, 3),
        "altered": list(altered),
    }
    code = BAD if found.damage else SAME if found.same and not report["events_differ"] else DIFFERS
    if altered and code == SAME:
        code = EXIT_ALTERED
    if question is not None:
        if code == SAME:
            report["what_if"] = question.answer(table_of(content, layout))
            code = DIFFERS if report["what_if"]["changed"] else SAME
        else:
            report["what_if_refused"] = f"{NOT_ASKED} {NOT_ASKED_OF[code]}"
            code = BAD if code == BAD else UNDECIDED
    if as_json:
        sys.stdout.write(json.dumps(finite(report), ensure_ascii=False) + "\n")
    else:
        told = [*alteration_lines(altered), *_lines(report, found, int(run.manifest()["period_ns"]))]
        sys.stdout.write("\n".join(told) + "\n")
    return code


def _report(run: RunRecord, job: Job, controller: Controller, found: Replayed) -> dict[str, Any]:
    return {
        "run": run.id,
        "state": run.state(),
        "identical_scans": found.identical,
        "difference": None if found.difference is None else found.difference.to_dict(),
        "damage": found.damage,
        "cut_bytes": found.cut_bytes,
        "decisions": _decisions(run),
        "not_compared": not_compared(run.layout()),
        "program_differs": _program_differences(run, job.program),
        "events_differ": _event_differences(run, controller) if found.same else [],
    }


def _decisions(run: RunRecord) -> dict[str, Any]:
    """Return by which version of the controller's decisions a run was made, and which one replays it."""
    made_by = run.manifest().get("software") or {}
    recorded = int(made_by.get("decisions", FIRST_DECISIONS))
    found = {"recorded": recorded, "now": DECISIONS_VERSION, "recorded_by": str(made_by.get("version"))}
    return found | {"changes": changes_since(recorded)}


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


def _told_transitions(run: RunRecord) -> tuple[list[tuple[Any, Any, Any]], list[str]]:
    """Return the transitions in the run's own list of events, and what is wrong with the first line that is no event.

    Raises:
        StationError: the list cannot be read.

    """
    try:
        lines = (run.folder / EVENTS).read_bytes().splitlines()
    except OSError as error:
        raise StationError(f"{run.folder / EVENTS}: cannot be read: {error.strerror}") from error
    told, broken = [], []
    for number, line in enumerate(lines, start=1):
        try:
            row = json.loads(line)
            if row["kind"] == "transition":
                told.append((row["scan"], row["state"], row["to"]))
        except (ValueError, TypeError, KeyError):
            broken.append(number)
    if not broken:
        return told, []
    more = f", nor {'are' if len(broken) > 2 else 'is'} {len(broken) - 1} more" if len(broken) > 1 else ""
    return told, [f"{EVENTS}: line {broken[0]} is not an event{more}"]


def _decided_otherwise(decisions: dict[str, Any], *, same: bool) -> str:
    """Say that the run was made by another version of the controller's decisions, and what that means here."""
    recorded, now, by = decisions["recorded"], decisions["now"], decisions["recorded_by"]
    head = f"Recorded by version {recorded} of the controller's decisions (lostmotion {by}), replayed by version {now}"
    if recorded > now:
        head += ", which is older"
    changed = f" Decided otherwise since then: {'; '.join(decisions['changes'])}." if decisions["changes"] else ""
    means = "Both decide the same here." if same else f"A difference may be that. To tell, replay it with {by}."
    return f"{head}.{changed} {means}"


def _lines(report: dict[str, Any], found: Replayed, period_ns: int) -> list[str]:
    speed = f"{report['seconds']:.2f} s, {report['scans_per_s']} scans/s"
    lines = [f"{report['run']} ({report['state']}): {found.identical} scans replayed identically ({speed})"]
    if found.cut_bytes:
        lines.append(
            f"{found.cut_bytes} bytes of a last, incomplete record are left out: it was cut while being written"
        )
    decisions = report["decisions"]
    if decisions["recorded"] != decisions["now"]:
        lines.append(_decided_otherwise(decisions, same=found.same))
    lines += [f"order not compared: {text}" for text in report["not_compared"]]
    if found.damage:
        lines.append(f"the record is damaged: {found.damage}")
    lines += [f"the recorded recipe becomes another program now: {text}" for text in report["program_differs"][:8]]
    if found.difference is not None:
        lines += found.difference.lines(period_ns)
    lines += report["events_differ"]
    if "what_if_refused" in report:
        lines.append(report["what_if_refused"])
    if "what_if" in report:
        lines += what_if_lines(report["what_if"], period_ns)
    return lines
