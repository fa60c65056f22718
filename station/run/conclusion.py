"""From the end of a run to its result: events, timing, metrics, verdict, and the proof that all of it is on disk.

The verdict leaves this module only after every record and the result itself have been read back from the disk.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from analysis import AnalysisError, Evidence, Result, RunFacts, Trace, gate_reasons, judge_gates
from controller.image import State
from station.bench.request import Job
from station.durable import read_from_disk
from station.errors import BenchFaultError, RecordError, StationError
from station.record.check import Table, check_bytes, table_of
from station.record.event_log import alarms_in, events_of
from station.record.left_state import left_state
from station.record.run_record import INTERRUPTED, RESULT, RunRecord
from station.record.seal import seal
from station.record.timing_proof import run_facts, timing_block
from station.results.evaluation import calibration_of, evaluate_trace, trace_of
from station.scan.desk_watch import DESK_GONE, DESK_SILENT
from station.wall_clock import now_text

NOT_DECIDABLE = "NOT DECIDABLE"
END_STATES = {State.COMPLETE: "complete", State.STOPPED: "stopped", State.FAULT: "fault"}
VIRTUAL_REALTIME: dict[str, object] = {
    "fifo": False,
    "mlock": False,
    "details": {"clock": "virtual time: scans follow each other as fast as they go, nothing is asked of the machine"},
}


@dataclass(frozen=True)
class Ending:
    """How the scan ended: records it says it wrote, those it lost, its report, and why it ended early if it did.

    `refused`: the bench could not be opened, nothing has moved. `started_ns`: monotonic time; scan n was due n + 1
    periods after it.
    """

    written: int
    lost: int = 0
    realtime: dict[str, object] = field(default_factory=lambda: dict(VIRTUAL_REALTIME))
    notes: list[dict[str, Any]] = field(default_factory=list)
    trouble: str = ""
    refused: bool = False
    counters: dict[str, int] = field(default_factory=dict)
    times: dict[str, Any] = field(default_factory=dict)
    started_ns: int = 0
    clock_jumped_s: float = 0.0
    """By how much the computer's wall clock was set in the middle."""
    stopped_because: str = ""
    """Subject of the sentence that tells who stopped the run and why; empty for the operator."""
    disk: dict[str, float] = field(default_factory=dict)

    @classmethod
    def refused_by(cls, record: RunRecord, error: BenchFaultError) -> Ending:
        """Return the ending of a run whose bench could not be opened: nothing has moved."""
        return cls(written=record.records(), realtime={"details": {}}, trouble=str(error), refused=True)


@dataclass(frozen=True)
class Conclusion:
    """Result as it stands in result.json, and what a plot needs (None where the run did not get that far)."""

    result: dict[str, Any]
    trace: Trace | None
    analysis: Result | None


def conclude(record: RunRecord, job: Job, ending: Ending) -> Conclusion:
    """Evaluate a run that has ended, write everything, read it back, and only then return the verdict."""
    content = read_from_disk(record.samples)
    read_back = check_bytes(content, ending.written)
    table = table_of(content)
    run = record.manifest()
    period_ns = int(run["period_ns"])
    timing = timing_block(table, period_ns, run["clock"], ending.realtime) | {"wires": ending.counters}
    if ending.disk:
        timing |= {"disk": ending.disk}
    if ending.clock_jumped_s:
        timing |= {"wall_clock_jumped_s": ending.clock_jumped_s}
    proof = timing | ending.times
    events = events_of(table, period_ns, ending.notes)
    state = "fault" if ending.refused else _end_state(table)
    broken = [f"the record is not sound: {problem}" for problem in read_back.problems]
    if ending.lost:
        broken.append(f"{ending.lost} records were lost because they were not taken from the ring in time")
    # The last record may say complete although the process that wrote it was lost before it could say so.
    unsure = [ending.trouble] if ending.trouble and state == "complete" else []
    objections, facts = broken + unsure, run_facts(table, timing, job.recipe.sampling)
    trace, found, reasons = None, None, _early_reasons(state, events, ending)
    if len(table) and not broken:
        trace, found, trouble = _evaluate(table, job, record, objections, facts)
        reasons += [trouble] if trouble and state == "complete" else []
    judged: dict[str, Any] = {"verdict": NOT_DECIDABLE, "metrics": [], "notes": [], "stages": []}
    if found is not None and state == "complete":
        judged = found.to_dict()
        reasons += list(found.reasons)
    else:
        gates = judge_gates(Evidence(None, facts, tuple(objections)))
        judged["gates"] = [gate.to_dict() for gate in gates]
        reasons += gate_reasons(gates, objections)
    result = {
        "run": record.id,
        "serial": run["serial"],
        "attempt": run["attempt"],
        "recipe": {key: run["recipe"][key] for key in ("name", "revision", "sha256")},
        "bench": run["bench"],
        "unit": run["unit"],
        "scenario": run.get("scenario"),
        "operator": run.get("operator"),
        "clock": run["clock"],
        "state": state,
        "verdict": judged["verdict"],
        "reasons": reasons,
        "decision": {"rule": job.recipe.decision.rule, "guard_factor": job.recipe.decision.guard_factor},
        "metrics": judged["metrics"],
        "gates": judged["gates"],
        "notes": [*run.get("notes", []), *_clock_notes(ending.clock_jumped_s), *judged["notes"]],
        "stages": judged["stages"],
        "timing": timing,
        "alarms": alarms_in(events),
        "left": None
        if state == "complete"
        else left_state(table, record.read_json("program.json"), to_its_end=state != INTERRUPTED),
        "record": str(record.folder),
    }
    if found is not None and state == "complete":
        calibration = calibration_of(found, run, job.bench)
        if calibration is not None:
            record.write_json("calibration.json", calibration)
    lines = [json.dumps(event, ensure_ascii=False) + "\n" for event in events]
    record.write_bytes("events.jsonl", "".join(lines).encode())
    record.write_json("timing.json", proof)
    result = _store(record, result)
    seal(record, state=state, ended=now_text(), verdict=result["verdict"], records=len(table), ring=None)
    return Conclusion(result, trace, found if state == "complete" else None)


def _end_state(table: Table) -> str:
    return END_STATES.get(State(int(table["orders"]["state"][-1])), INTERRUPTED) if len(table) else INTERRUPTED


def _clock_notes(jumped_s: float) -> list[str]:
    if not jumped_s:
        return []
    note = (
        f"the computer's wall clock was set by {jumped_s:+.1f} s during the run: its times of day do not give its "
        "duration. Scans and all their times are on another clock, which is never set"
    )
    return [note]


def _early_reasons(state: str, events: list[dict[str, Any]], ending: Ending) -> list[str]:
    reasons = [ending.trouble] if ending.trouble and state != "complete" else []
    if ending.refused:
        return reasons
    if state == "fault":
        causes = [alarm for alarm in alarms_in(events) if alarm["first"]]
        reasons += [f"{alarm['text']}: {alarm['cause']}. {alarm['next_action']}" for alarm in causes[:1]]
    elif state == "stopped" and any(note["text"] == DESK_GONE for note in ending.notes):
        reasons.append(
            "the desk was gone before it had started the run, so the scan process ended it; nothing has moved"
        )
    elif state == "stopped":
        silent = any(note["text"] == DESK_SILENT for note in ending.notes)
        who = "the desk was gone and the scan process" if silent else ending.stopped_because or "the operator"
        reasons.append(f"{who} stopped the run; the torque was brought to zero and the lock opened")
    elif state == INTERRUPTED and not reasons:
        reasons.append("the run has no end: its scan process stopped in the middle")
    return reasons


def _evaluate(
    table: Table, job: Job, record: RunRecord, objections: list[str], facts: RunFacts
) -> tuple[Any, Any, str]:
    """Return trace and analysis, None for what could not be had, and why."""
    segments = record.read_json("program.json")["segments"]
    trace = None
    try:
        trace = trace_of(table, segments, job.bench, job.recipe.sampling.period_ns, record.id)
        return trace, evaluate_trace(trace, job.recipe, job.bench, objections, facts), ""
    except (AnalysisError, StationError) as error:
        return trace, None, str(error)


def _store(record: RunRecord, result: dict[str, Any]) -> dict[str, Any]:
    """Write result.json and return it as it reads back; what cannot be read back decides nothing."""
    try:
        record.write_json(RESULT, result)
        stored: dict[str, Any] = json.loads(read_from_disk(record.folder / RESULT))
    except (RecordError, ValueError) as error:
        return _undecided(result, f"the result could not be stored: {error}")
    if stored != json.loads(json.dumps(result)):
        return _undecided(result, "the result reads back differently from what was written: check the disk")
    return stored


def _undecided(result: dict[str, Any], reason: str) -> dict[str, Any]:
    return result | {"verdict": NOT_DECIDABLE, "reasons": [reason, *result["reasons"]]}


def finite(value: Any) -> Any:
    """Return plain data with infinities and NaN as None: JSON has no other way to say that there is no number."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
