"""Copies of a finished run, as if its evaluation had still to come, and as a supervisor that died leaves them."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from run_samples import as_recorded

from station.documents.entries import plain
from station.records.chain.chain_file import CHAIN, Chain
from station.records.chain.entries import CREATED, SEALED
from station.records.chain.writing import writing_to
from station.records.ring.ring import FILE_PREFIX
from station.records.run_record import RunRecord


def copy_of(record: Path, folder: Path) -> RunRecord:
    """Copy the record of a run, without the index of its data folder, to a folder of the test's own."""
    return RunRecord(Path(shutil.copytree(record, folder / record.name)))


def from_before(run: RunRecord) -> RunRecord:
    """Make a copied run one from before the chain, which only its own files vouch for; a test then changes them."""
    run.write_json("run.json", {name: value for name, value in run.read_json("run.json").items() if name != "chain"})
    return run


def desert(record: RunRecord, *, ring: Path, report: dict[str, Any] | None) -> None:
    """Make the run one whose supervisor died before it said how its scan ended; `report` is the scan process's own."""
    as_recorded(record)
    for name in ("result.json", "events.jsonl", "timing.json", "calibration.json", "desk-report.json"):
        (record.folder / name).unlink()
    manifest = record.read_json("run.json")
    for name in ("records", "files"):
        manifest.pop(name)
    manifest["ended"] = None
    # A ring that is gone may have been named by a test in any way; the program names each of its rings so.
    ring = ring if ring.name.startswith(FILE_PREFIX) else ring.with_name(f"{FILE_PREFIX}{ring.name}")
    supervisor = {"pid": 999_999, "birth": "another process"}
    record.write_json(
        "run.json", manifest | {"state": "recording", "verdict": None, "ring": str(ring), "desk": supervisor}
    )
    if report is not None:
        record.write_json("scan-report.json", report)
    chain = Chain(record.folder.parent)
    entries = chain.entries_of(record.id)
    if not any(entry.kind == CREATED for entry in entries):
        begun_here(record)
    sealed = [entry.line + b"\n" for entry in entries if entry.kind == SEALED]
    if sealed:
        lines = chain.content.splitlines(keepends=True)
        (record.folder.parent / CHAIN).write_bytes(b"".join(line for line in lines if line not in sealed))


def begun_here(run: RunRecord, files: dict[str, str] | None = None) -> RunRecord:
    """Enter a copied run into the chain of the folder that it was copied to, as if it had been begun there.

    files: by name, the hashes of what it was begun with; without them the line is one of before it had any.
    """
    data = run.folder.parent
    manifest = run.read_json("run.json")
    with writing_to(data) as chain:
        run.write_json("run.json", manifest | {"chain": plain(chain.next_place)})
        parts = {"recipe": manifest["recipe"]["sha256"], "bench": manifest["bench"]["sha256"]}
        chain.append(CREATED, run=run.id, serial=manifest["serial"], attempt=manifest["attempt"], files=files, **parts)
    return run


def begun_anew(run: RunRecord) -> RunRecord:
    """The same with a chain of its own, in which it was not sealed yet."""
    (run.folder.parent / CHAIN).unlink(missing_ok=True)
    return begun_here(run)


def alone(run: RunRecord) -> RunRecord:
    """Copy a run's folder to a data folder of its own, where no chain knows it."""
    return RunRecord(Path(shutil.copytree(run.folder, run.folder.parent.with_name("elsewhere") / run.id)))
