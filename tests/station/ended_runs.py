"""Runs that have ended on a bench, and recoveries of it, as small as a folder allows."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace

from station_samples import SETUP

from station.documents.entries import plain
from station.documents.events import EventRow, LeftState
from station.documents.manifest import BenchSource, Setup
from station.documents.result import Result
from station.records.data_folder import Store
from station.records.run_record import BENCH_COPY, EVENTS, RECIPE_COPY, RESULT
from station.records.seal import seal
from station.run.way_back.recoveries import FOLDER, recoveries


def on_a_cable(job: object) -> SimpleNamespace:
    header = SimpleNamespace(embedded=False)
    bench = SimpleNamespace(bench=header, master_parts=(), master_part=lambda _serial: None)
    return SimpleNamespace(bench=bench, program=job.program, product=None)


def cancelled(
    data: Path, serial: str, setup: Setup, *, to: tuple[str, ...] = ("stopped",), lock: str = "closed"
) -> str:
    """Make a run that was stopped behind these transitions, which begin in idle, and return its id."""
    rows = [EventRow(scan=scan, kind="transition", state="idle", to=one, t_s=0.0) for scan, one in enumerate(to)]
    return _concluded(data, serial, setup, "stopped", rows, left_with(lock), records=100)


def refused(data: Path, serial: str, setup: Setup) -> str:
    """Make a run whose bench could not be opened, and return its id."""
    return _concluded(data, serial, setup, "fault", (), None, records=0)


def _concluded(  # noqa: PLR0917 - what a run is made of
    data: Path, serial: str, setup: Setup, state: str, rows: Sequence[EventRow], left: LeftState | None, *, records: int
) -> str:
    """Make a run that is as it was sealed: recipe and bench are those that it was begun by."""
    files = {RECIPE_COPY: b"recipe", BENCH_COPY: setup.bench.name.encode()}
    recipe, bench = (hashlib.sha256(content).hexdigest() for content in files.values())
    own = dataclasses.replace(
        setup,
        recipe=dataclasses.replace(setup.recipe, sha256=recipe),
        bench=dataclasses.replace(setup.bench, sha256=bench),
    )
    record = Store(data).create(serial, own, files)
    record.write_bytes(EVENTS, b"".join(json.dumps(plain(row)).encode() + b"\n" for row in rows))
    told = dataclasses.replace(_result(record.id, own, state), serial=serial, left=left)
    record.write_json(RESULT, plain(told))
    seal(record, state=state, verdict=told.verdict, records=records)
    return record.id


def ended(data: Path, serial: str, verdict: str | None = "PASS", state: str = "complete", setup: Setup = SETUP) -> str:
    """Make a run that was concluded, and return its id."""
    record = Store(data).create(serial, setup, {})
    seal(record, state=state, verdict=verdict)
    return record.id


def bench_of(name: str, sha256: str = "b" * 64, *, embedded: bool = False) -> Setup:
    return dataclasses.replace(SETUP, bench=BenchSource(name=name, revision=1, sha256=sha256, embedded=embedded))


def recovered(data: Path, fault: str, setup: Setup, state: str = "stopped", lock: str = "open") -> None:
    """Make a recovery of the bench that a run left."""
    again = dataclasses.replace(setup, recovery_of=fault)
    if state == "recording":
        recoveries(data).create("SN-1", again, {})
        return
    events = [EventRow(scan=0, kind="transition", state="idle", to=one, t_s=0.0) for one in ("fault", state)]
    _concluded(data / FOLDER, "SN-1", again, state, events, left_with(lock), records=100)


def left_with(lock: str) -> LeftState:
    return LeftState(torque_nm=0.0, torque_known=True, lock=lock, lock_known=True, drive="off", drive_known=True,
                     release_torque_nm=1.0)  # fmt: skip


def _result(run: str, setup: Setup, state: str) -> Result:
    return Result(run=run, serial="SN-1", recipe=setup.recipe.head, state=state, verdict="NOT DECIDABLE",
                  reasons=(), metrics=())  # fmt: skip
