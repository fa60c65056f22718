"""One run's folder: its files, its manifest, and the state that the run is in.

    <data>/<run id>/
        run.json          what, who, when, state of the run
        recipe.yaml       the recipe as run, byte for byte
        bench.yaml        the bench file, byte for byte
        program.json      what the recipe became: segments and limits
        samples.parquet   every scan (samples.bin while it is recorded, and where it was interrupted)
        samples.json      the layout of a record
        events.jsonl      transitions, alarms with cause and next action, notes
        timing.json       proof of timing
        calibration.json  torque ratio, when the run measured one
        result.json       metrics and verdict
        log.jsonl         and, when they were asked for, loop.png, report.html, report.pdf

A folder stands alone and is never overwritten.
"""

from __future__ import annotations

import json
from contextlib import suppress
from datetime import date
from pathlib import Path
from typing import Any

from station.atomic_file import as_json, document_bytes, open_file, read_file, refused, write_atomic
from station.documents.entries import Plain, plain
from station.documents.exported import ExportedRun
from station.documents.manifest import INTERRUPTED, MANIFEST, RECORDING, Manifest, RunningProcess
from station.documents.reading import NEXT_STEP, Document, read_document
from station.errors import RecordError
from station.records.clocks import VIRTUAL, clock_of
from station.records.process_birth import process_birth
from station.records.run_lock import RunLock
from station.records.samples.layout import CURRENT, LAYOUT, Layout, layout_in
from station.there import is_there

__all__ = [
    "CALIBRATION",
    "EVENTS",
    "INTERRUPTED",
    "MANIFEST",
    "NOT_CONCLUDED",
    "PACKED",
    "RECORDING",
    "RESULT",
    "SAMPLES",
    "SCAN_REPORT",
    "TIMING",
    "RunRecord",
]

RECIPE_COPY = "recipe.yaml"
BENCH_COPY = "bench.yaml"
PROFILES = "profiles"
PROFILE_ENDINGS = (".yaml", ".dbc")
"""How the name of a device profile ends; any other file in their folder is no part of a run."""

SAMPLES = "samples.bin"
PACKED = "samples.parquet"
RESULT = "result.json"
TIMING = "timing.json"
CALIBRATION = "calibration.json"
EVENTS = "events.jsonl"
SCAN_REPORT = "scan-report.json"
NOT_CONCLUDED = "not concluded"
"""Shown state of a run that no process owns any more and that nobody has concluded yet; never written to run.json."""


def running_process(pid: int) -> RunningProcess:
    """Return what names a process that runs for good: `Manifest.desk` of the runs that it supervises."""
    return RunningProcess(pid=pid, birth=process_birth(pid))


class RunRecord:
    """One run's folder."""

    def __init__(self, folder: Path, *, shown_alone: bool = False) -> None:
        """Take the folder; shown_alone: it lies in no data folder, and who looks is told that no chain vouches for it.

        Then a chain that its run.json names may be elsewhere. Of any other record it is evidence, and has to be there.
        """
        self.folder, self.shown_alone = folder, shown_alone
        self.lock = RunLock(folder)

    @property
    def id(self) -> str:
        """Run id: the folder's name."""
        return self.folder.name

    @property
    def samples(self) -> Path:
        """File that scan records are written to; a concluded run may have them packed (`records.samples`)."""
        return self.folder / SAMPLES

    def is_packed(self) -> bool:
        """Whether the samples were packed when the run was concluded; RecordError as `manifest`."""
        return self.manifest().samples is not None

    def layout(self) -> Layout:
        """Return the layout of the records as the run describes it; RecordError when it does not.

        A run that ended before it described its records has none: it is read as one of today's.
        """
        if not self.has(LAYOUT) and not self.has(SAMPLES) and not self.has(PACKED):
            return CURRENT
        path = self.folder / LAYOUT
        if read_file(path) == CURRENT.described:
            return CURRENT  # as most runs are; to take the description apart takes longer than to read it
        return layout_in(self.read_json(LAYOUT), path)

    def manifest(self) -> Manifest:
        """Return run.json, sound in every entry; RecordError when it cannot be read or is damaged."""
        return self.read(Manifest, MANIFEST)

    def day(self) -> date:
        """Return the day of the run, in UTC: calibrations in its bench file are judged by it, whenever that is.

        Raises:
            RecordError: run.json cannot be read.

        """
        return date.fromisoformat(self.manifest().started[:10])

    def update(self, **changes: Any) -> None:
        """Change entries of run.json durably; what only a later version knows of stays in it."""
        self.write_json(MANIFEST, self.changed_manifest(changes))

    def changed_manifest(self, changes: Plain) -> Plain:
        """Return run.json with other entries, as it is to be written; RecordError as `manifest`."""
        self.manifest()
        return {**self.read_json(MANIFEST), **{name: plain(value) for name, value in changes.items()}}

    def read(self, kind: type[Document], name: str) -> Document:
        """Return one of the run's files as a document; RecordError when it cannot be read or is damaged."""
        return read_document(kind, self.folder / name)

    def write_json(self, name: str, content: Any) -> None:
        """Write one of the run's JSON files durably."""
        write_atomic(self.folder / name, as_json(content))

    def write_bytes(self, name: str, content: bytes) -> None:
        """Write one of the run's files durably."""
        write_atomic(self.folder / name, content)

    def read_json(self, name: str) -> Any:
        """Read one of the run's JSON files; RecordError when it is missing or damaged."""
        path = self.folder / name
        try:
            with open_file(path) as file:
                return json.loads(document_bytes(file))
        except OSError as error:
            raise refused(path, error, "read") from error
        except (ValueError, RecursionError) as error:
            raise RecordError(f"{path}: is damaged: {error}. {NEXT_STEP}") from error

    def remove(self, name: str) -> None:
        """Remove one of the run's files if it is there; RecordError when the disk refuses that."""
        path = self.folder / name
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise refused(path, error, "removed") from error

    def has(self, name: str) -> bool:
        """Whether the run has this file; one that nobody can look at is there, and who reads it is told why not."""
        return is_there(self.folder / name) is not False

    def records(self) -> int:
        """Complete scan records on disk; none where nobody can tell."""
        with suppress(OSError, RecordError, TypeError, ValueError):
            manifest = self.manifest()
            if manifest.samples is not None:
                return manifest.records or 0
            return self.samples.stat().st_size // self.layout().record_bytes
        return 0

    def serial(self) -> str | None:
        """Serial number of the unit; None when the manifest is damaged."""
        try:
            return self.manifest().serial
        except RecordError:
            return None

    def scanning(self) -> int:
        """Process id of the scan process while it lives, else 0."""
        said = self.scan_process()
        return said.pid if said is not None and process_birth(said.pid) == said.birth else 0

    def scan_process(self) -> RunningProcess | None:
        """Return the scan process as it named itself; None before it scans, and when it has ended by itself."""
        if self.has(SCAN_REPORT):
            with suppress(RecordError):
                said = self.read(RunningProcess, SCAN_REPORT)
                return said if said.birth else None
        return None

    def state(self) -> str:
        """State of the run; a recording that no process owns is `not concluded`."""
        if self.deserted() and not self.lock.taken():
            return NOT_CONCLUDED
        return self.manifest().state

    def deserted(self) -> bool:
        """Whether the run was not concluded and its supervisor is not here; somebody else may own it (see `lock`)."""
        manifest = self.manifest()
        supervisor = manifest.desk
        return manifest.state == RECORDING and process_birth(supervisor.pid) != supervisor.birth


def only_simulated(run: Manifest | ExportedRun) -> bool:
    """Whether a run named a real bench and used nothing of it: in virtual time its devices are simulated.

    Such a run says nothing of how the bench is, what it can measure, or how it was left.
    """
    return not run.bench.embedded and clock_of(run.clock) == VIRTUAL


def was_simulated(record: RunRecord) -> bool:
    """Whether a run's own word is that it was `only_simulated`; False where that cannot be read."""
    try:
        return only_simulated(record.manifest())
    except RecordError:
        return False
