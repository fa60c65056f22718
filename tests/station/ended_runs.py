"""Runs that have ended on a bench, and recoveries of it, as small as a folder allows."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace

from station_samples import SETUP

from station.documents.entries import plain
from station.documents.events import LeftState
from station.documents.manifest import BenchSource, Setup
from station.documents.result import Result
from station.records.data_folder import Store
from station.records.run_record import RESULT
from station.records.seal import seal
from station.run.way_back.recoveries import recoveries


def on_a_cable(job: object) -> SimpleNamespace:
    header = SimpleNamespace(embedded=False)
    bench = SimpleNamespace(bench=header, master_parts=(), master_part=lambda _serial: None)
    return SimpleNamespace(bench=bench, program=job.program, product=None)


def ended(data: Path, serial: str, verdict: str | None = "PASS", state: str = "complete", setup: Setup = SETUP) -> str:
    """Make a run that was concluded, and return its id."""
    record = Store(data).create(serial, setup, {})
    seal(record, state=state, verdict=verdict)
    return record.id


def bench_of(name: str, sha256: str = "b" * 64, *, embedded: bool = False) -> Setup:
    return dataclasses.replace(SETUP, bench=BenchSource(name=name, revision=1, sha256=sha256, embedded=embedded))


def recovered(data: Path, fault: str, setup: Setup, state: str = "stopped", lock: str = "open") -> None:
    """Make a recovery of the bench that a run left."""
    found = recoveries(data).create("SN-1", dataclasses.replace(setup, recovery_of=fault), {})
    if state == "recording":
        return
    left = LeftState(torque_nm=0.0, torque_known=True, lock=lock, lock_known=True, drive="off", drive_known=True,
                     release_torque_nm=1.0)  # fmt: skip
    told = Result(run=found.id, serial="SN-1", recipe=setup.recipe.head, state=state, verdict="NOT DECIDABLE",
                  reasons=(), metrics=(), left=left)  # fmt: skip
    found.write_json(RESULT, plain(told))
    found.update(state=state, files={})
