"""A run in virtual time: the same controller and recipe against the same plant, in this process, without wires."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from controller.context import Event
from controller.controller import Controller
from station.atomic_file import Appender
from station.bench.assemble_virtual import load_scenario, virtual_config
from station.bench.request import Job
from station.bench.virtual_unit import VirtualUnit
from station.documents.events import Note
from station.records.run_record import RunRecord
from station.run.asked_to_stop import Stopping, listening
from station.run.outcome import RunOutcome, take_room
from station.run.virtual_recorder import VirtualRecorder
from station.scan.realtime import quiet_collector
from station.scan.scan_loop import run_virtual, start_once
from virtual_bench.in_process import VirtualTimeBench

LOOK_EVERY = 1024
"""Scans between two looks at the operator's wishes and at the screen."""

Show = Callable[[memoryview], None]


def run_in_virtual_time(
    job: Job, record: RunRecord, unit: VirtualUnit, scenario: Path | None, show: Show
) -> RunOutcome:
    """Run a job to its end and leave its records in the run's folder.

    Raises:
        RecordError: the disk is full; what was written before stays.

    """
    faults = None if scenario is None else load_scenario(scenario)
    # The profiles that were checked and are in the record, not files that may have changed since.
    profiles = {name: record.folder / "profiles" / f"{name}.yaml" for name in job.profile_names}
    bench = VirtualTimeBench(virtual_config(job.bench, profiles, unit), job.recipe.sampling.period_ns, faults)
    controller = Controller(job.program)
    injected = None if faults is None else bench.faults
    stopping = Stopping()
    take_room(record)
    file = Appender(record.samples)
    recorder = VirtualRecorder(file)

    def take_command(scan: int) -> int:
        if scan % LOOK_EVERY == 0 and scan:
            show(recorder.last())
        return int(stopping.take_command()) or start_once(scan)

    try:
        with quiet_collector(), listening(stopping.hear):
            run_virtual(bench, controller, recorder.append, take_command, injected)
    finally:
        try:
            recorder.flush()
        finally:
            file.close()
    notes = [_note(event) for event in controller.events if event.kind == "note"]
    if injected is not None:
        last = Event(recorder.sequence - 1, "note", controller.state.name.lower(), "")
        notes += [_note(last._replace(text=f"injected fault: {text}")) for text in injected.why_unseen()]
    outcome = RunOutcome(written=recorder.sequence, notes=tuple(notes))
    outcome.keep(record)
    return outcome


def _note(event: Event) -> Note:
    return Note(scan=event.scan, kind=event.kind, state=event.state, text=event.text)
