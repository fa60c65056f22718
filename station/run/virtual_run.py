"""A run in virtual time: the same controller and recipe against the same plant, in this process, without wires."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from controller.context import Event
from controller.controller import Controller
from definitions.image import Image, Orders, image_values
from station.atomic_file import Appender
from station.bench.assemble_virtual import load_scenario, virtual_config, vocabulary_on
from station.bench.request import Job
from station.bench.virtual_unit import VirtualUnit
from station.documents.events import Note
from station.records.run_record import RunRecord
from station.records.samples.scan_record import BODY_BYTES, BODY_STRUCT, CHECK_STRUCT, RECORD_BYTES
from station.run.asked_to_stop import Stopping, listening
from station.run.outcome import RunOutcome, take_room
from station.scan.realtime import quiet_collector
from station.scan.scan_loop import run_virtual, start_once
from virtual_bench.in_process import VirtualTimeBench

BLOCK_RECORDS = 256


class VirtualRecorder:
    """Appends records to a file; `append` has the signature that the scan loop wants."""

    def __init__(self, file: Appender) -> None:
        self._file = file
        self._waiting: list[tuple[int, int, int, int, tuple[Any, ...], Orders]] = []
        self._block = memoryview(bytearray(BLOCK_RECORDS * RECORD_BYTES))
        self._last = self._block[:0]
        self.sequence = 0

    def append(self, scan: int, lateness_ns: int, work_ns: int, image: Image, orders: Orders) -> bool:
        """Append one record; raises RecordError when the disk is full."""
        waiting = self._waiting
        waiting.append((self.sequence, scan, lateness_ns, work_ns, image_values(image), orders))
        self.sequence += 1
        if len(waiting) == BLOCK_RECORDS:
            self.flush()
        return True

    def last(self) -> memoryview:
        """Return the newest record, which is written with all before it; empty before the first."""
        self.flush()
        return self._last

    def flush(self) -> None:
        """Pack and write what waits; a record that cannot be packed raises after those before it have been written."""
        waiting, self._waiting = self._waiting, []
        block, at = self._block, 0
        try:
            for sequence, scan, lateness_ns, work_ns, inputs, orders in waiting:
                end = at + BODY_BYTES
                BODY_STRUCT.pack_into(block, at, sequence, scan, lateness_ns, work_ns, *inputs, *orders)
                CHECK_STRUCT.pack_into(block, end, zlib.crc32(block[at:end]))
                at += RECORD_BYTES
        finally:
            if at:
                self._last = block[at - RECORD_BYTES : at]
                self._file.write(block[:at])


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
    faults = None if scenario is None else load_scenario(scenario, vocabulary_on(job.bench, job.profile_sources))
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
