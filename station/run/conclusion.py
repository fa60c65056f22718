"""From the end of a run to its result: events, timing, metrics, verdict, and the proof that all of it is on disk.

The verdict leaves this module only after every record and the result itself have been read back from the disk.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

from analysis.evaluation.pipeline import Result as Found
from analysis.trace.errors import AnalysisError
from analysis.trace.trace import Trace
from analysis.validity.evidence import Evidence, RunFacts
from analysis.validity.judge import check_reasons, judge_checks
from definitions.image import State
from station.atomic_file import read_from_disk
from station.bench.request import Job
from station.bench.virtual_unit import NOT_NAMED
from station.documents.entries import plain
from station.documents.events import Alarm, EventRow
from station.documents.manifest import MASTER, Manifest
from station.documents.reading import document_in
from station.documents.result import DecisionRule, Judged, Result
from station.documents.timing import Timing
from station.errors import RecordError, StationError
from station.records.begun_by import BegunBy, beginning_of, begun_with, not_begun_by, not_begun_with, unlike_its_line
from station.records.chain.chain_file import Chain
from station.records.left_state import left_state
from station.records.program_file import SegmentRow, StoredProgram
from station.records.run_record import CALIBRATION, EVENTS, INTERRUPTED, PROFILES, RESULT, TIMING, RunRecord
from station.records.samples.check import check_bytes, sound_table
from station.records.samples.event_log import alarms_in, events_of, has_begun
from station.records.samples.samples import pack_samples
from station.records.samples.table import Table, table_of
from station.records.seal import data_folder, fingerprint, seal
from station.records.timing_proof import clock_note, objections_to_clock, run_facts, timing_block
from station.results.evaluation import evaluate_trace, ratio_of, trace_of
from station.results.judged import check_values, judged_in
from station.results.lock_angle import lock_angle_deg
from station.run.outcome import RunOutcome
from station.scan.supervisor_watch import SUPERVISOR_GONE, SUPERVISOR_SILENT
from station.wall_clock import now_text

NOT_DECIDABLE = "NOT DECIDABLE"
END_STATES: dict[int, str] = {State.COMPLETE: "complete", State.STOPPED: "stopped", State.FAULT: "fault"}


@dataclass(frozen=True)
class Conclusion:
    """Result as it stands in result.json, and what a plot needs (None where the run did not get that far)."""

    result: Result
    trace: Trace | None
    analysis: Found | None


def conclude(record: RunRecord, job: Job, outcome: RunOutcome) -> Conclusion:
    """Evaluate a run that has ended, write everything, read it back, and only then return the verdict.

    By a recipe or a bench file that is not the one that the run was begun by, nothing is evaluated.

    Raises:
        RecordError: something cannot be stored, or not be read back. The run has no verdict then and is not sealed:
            it can be concluded again when the disk can be written again.

    """
    content, layout = read_from_disk(record.samples, most=None), record.layout()
    read_back = check_bytes(content, outcome.written, layout)
    table = table_of(content, layout) if read_back.sound else sound_table(content, layout)
    run, program = record.manifest(), StoredProgram.of(record)
    period_ns = run.period_ns
    timing = replace(
        timing_block(table, period_ns, run.clock, outcome.realtime),
        wires=outcome.counters,
        pace=outcome.pace,
        disk=outcome.disk,
        wall_clock_jumped_s=outcome.clock_jumped_s or None,
    )
    if outcome.pace is not None:
        run = _with_virtual_unit(record, run, outcome.pace.unit)
    proof = replace(timing, **{one.name: getattr(outcome.times, one.name) for one in fields(outcome.times)})
    events = events_of(table, period_ns, outcome.notes)
    state = "fault" if outcome.refused else _end_state(table)
    broken = [f"the record is not sound: {problem}" for problem in read_back.problems]
    if outcome.lost:
        broken.append(f"{outcome.lost} records were lost: the supervisor process was too slow. Close other programs")
    altered = _not_its_own(record, run, job)
    # The last record may say complete although the process that wrote it was lost before it could say so.
    unsure = [outcome.trouble] if outcome.trouble and state == "complete" else []
    # A scan that was lost could not name its unit: the loss is the reason then, and nothing is decided for it either.
    of_clock = [] if outcome.refused or (outcome.trouble and outcome.pace is None) else objections_to_clock(timing)
    objections, facts = broken + altered + unsure + of_clock, run_facts(table, timing, job.recipe.sampling)
    trace, found, reasons = None, None, _early_reasons(state, events, outcome)
    if len(table) and not broken and not altered:
        trace, found, trouble = _evaluate(table, job, objections, facts, run_id=record.id, segments=program.segments)
        reasons += [trouble] if trouble and state == "complete" else []
    if found is not None and state == "complete":
        judged = judged_in(found)
        reasons += list(found.reasons)
    else:
        checks = judge_checks(Evidence(None, facts, tuple(objections)))
        judged = Judged(verdict=NOT_DECIDABLE, gates=check_values(checks))
        reasons += check_reasons(checks, objections)
    result = Result(
        run=record.id,
        serial=run.serial,
        attempt=run.attempt,
        recipe=run.recipe.head,
        bench=run.bench,
        unit=run.unit,
        scenario=run.scenario,
        operator=run.operator,
        retest_reason=run.retest_reason,
        before=run.before,
        clock=run.clock,
        state=state,
        stopped_by=stopped_by(outcome) if state == "stopped" else None,
        verdict=judged.verdict,
        reasons=tuple(reasons),
        decision=DecisionRule(rule=job.recipe.decision.rule, guard_factor=job.recipe.decision.guard_factor),
        metrics=judged.metrics,
        gates=judged.gates,
        not_excluded=judged.not_excluded,
        notes=(
            *run.notes,
            *_master_notes(run, state, judged.verdict),
            *_supervisor_notes(outcome),
            *_clock_notes(timing, outcome.clock_jumped_s),
            *judged.notes,
        ),
        stages=judged.stages,
        timing=timing,
        alarms=tuple(alarms_in(events)),
        lock_angle_deg=lock_angle_deg(table, loading_input=program.loading_input),
        left=None if state == "complete" else left_state(table, program, to_its_end=_seen_to_its_end(state, outcome)),
        record=str(record.folder),
    )
    ratio = ratio_of(found, run, job.bench) if found is not None and state == "complete" else None
    if ratio is not None:
        record.write_json(CALIBRATION, plain(ratio))
    else:
        record.remove(CALIBRATION)  # left by somebody who was killed while he concluded the run
    lines = [json.dumps(plain(event), ensure_ascii=False) + "\n" for event in events]
    record.write_bytes(EVENTS, "".join(lines).encode())
    record.write_json(TIMING, plain(proof))
    result = _store(record, result)
    samples = pack_samples(record, content, sound=bool(len(table)) and not broken and state != INTERRUPTED)
    changes = {"state": state, "ended": now_text(), "verdict": result.verdict, "ring": None}
    seal(record, **changes, records=read_back.records, samples=samples)
    return Conclusion(result, trace, found if state == "complete" else None)


def _not_its_own(record: RunRecord, run: Manifest, job: Job) -> list[str]:
    """Return why a job is not the one that a run was begun by; whoever concludes it later reads it from its folder.

    Raises:
        RecordError: a file that the run was begun with is not there or cannot be read now.

    """
    found = not_begun_by(run, BegunBy(job.recipe_source.sha256, job.bench_source.sha256))
    created = beginning_of(Chain(data_folder(record)), record.id)
    if created is not None:
        named = begun_with(created)
        files = {name: fingerprint(record.folder / name).sha256 for name in named}
        found += unlike_its_line(run, created) + not_begun_with(created, files)
        used = [f"{PROFILES}/{source.path.name}" for source in job.profile_sources.values()]
        found += [f"{name}: was not there when the run was begun" for name in used if named and name not in named]
    return [f"the record was altered: {one}" for one in found]


def _with_virtual_unit(record: RunRecord, run: Manifest, unit: str) -> Manifest:
    """Return the manifest with the unit that a virtual bench on wires has named; nobody else knew of it."""
    if run.unit.virtual not in (None, NOT_NAMED) or not unit:
        return run
    record.update(unit=replace(run.unit, virtual=unit))
    return record.manifest()


def _end_state(table: Table) -> str:
    return END_STATES.get(int(table["orders"]["state"][-1]), INTERRUPTED) if len(table) else INTERRUPTED


def _seen_to_its_end(state: str, outcome: RunOutcome) -> bool:
    """Whether the last record is the last of the run: a fault or a stop may be torn off as a load may."""
    return state != INTERRUPTED and not outcome.trouble


def stopped_by(outcome: RunOutcome) -> str:
    """Return who or what stopped a run: `operator`, or a cause that the ring or a note of the scan names."""
    said = {note.text for note in outcome.notes}
    told = {SUPERVISOR_GONE: "desk_gone", SUPERVISOR_SILENT: "desk_silent"}
    return outcome.stopped_by or next((name for text, name in told.items() if text in said), "operator")


def _supervisor_notes(outcome: RunOutcome) -> list[str]:
    return [outcome.desk_died] if outcome.desk_died else []


def _clock_notes(timing: Timing, jumped_s: float) -> list[str]:
    of_scan = [note] if (note := clock_note(timing)) else []
    if not jumped_s:
        return of_scan
    note = (
        f"the computer's wall clock was set by {jumped_s:+.1f} s during the run: its times of day do not give its "
        "duration. Scans and all their times are on another clock, which is never set"
    )
    return [*of_scan, note]


def _early_reasons(state: str, events: Sequence[EventRow | Alarm], outcome: RunOutcome) -> list[str]:
    reasons = [outcome.trouble] if outcome.trouble and state != "complete" else []
    if outcome.refused:
        return reasons
    if state == "fault":
        causes = [alarm for alarm in alarms_in(events) if alarm.first]
        reasons += [f"{alarm.text}: {alarm.cause}. {alarm.next_action}" for alarm in causes[:1]]
        reasons += [f"servo drive: {alarm.detail}" for alarm in causes[:1] if alarm.detail]
    elif state == "stopped" and stopped_by(outcome) == "desk_gone":
        reasons.append(
            "the supervisor process ended before the run started; the scan process ended the run; nothing moved"
        )
    elif state == "stopped":
        silent = stopped_by(outcome) == "desk_silent"
        who = (
            "the scan process, because the supervisor process ended,"
            if silent
            else outcome.stopped_because or "the operator"
        )
        reasons.append(
            f"{who} stopped the run; the torque was brought to zero and the lock opened"
            if has_begun(events)
            else f"{who} stopped the run before it started; nothing moved, and the lock is as it was found"
        )
    elif state == INTERRUPTED and not reasons:
        reasons.append("the run is incomplete: its scan process ended during the run")
    return reasons


def _master_notes(run: Manifest, state: str, verdict: str) -> list[str]:
    """Say of a master part whether it read as it should; of a product, nothing."""
    right = run.unit.master
    if right is None or state != "complete":
        return []
    if verdict == right:
        return [f"{MASTER}{run.serial}: expected {right}, measured {right}"]
    wrong = "this bench may measure wrong. Do not measure other units before the cause is found"
    return [f"{MASTER}{run.serial}: expected {right}, measured {verdict}: {wrong}"]


def _evaluate(
    table: Table, job: Job, objections: list[str], facts: RunFacts, *, run_id: str, segments: Sequence[SegmentRow]
) -> tuple[Trace | None, Found | None, str]:
    """Return trace and analysis, None for what could not be had, and why."""
    trace = None
    try:
        trace = trace_of(table, segments, job.bench, job.recipe.sampling.period_ns, run_id)
        return trace, evaluate_trace(trace, job.recipe, job.bench, objections, facts), ""
    except (AnalysisError, StationError) as error:
        return trace, None, str(error)


def _store(record: RunRecord, result: Result) -> Result:
    """Write result.json and return it as it reads back; RecordError when it does not: it decides nothing."""
    written, path = plain(result), record.folder / RESULT
    record.write_json(RESULT, written)
    try:
        stored = document_in(Result, read_from_disk(path), path)
    except RecordError as error:
        raise RecordError(f"{path}: cannot be read back: {error}. Check the disk") from error
    if plain(stored) != written:
        raise RecordError(f"{path}: reads back differently from what was written. Check the disk")
    return stored
