"""Copies of a finished run, as if its evaluation had still to come, and as a desk that died leaves them."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from station.record.run_record import RunRecord


def copy_of(record: Path, folder: Path) -> RunRecord:
    """Copy the record of a run, without the index of its data folder, to a folder of the test's own."""
    return RunRecord(Path(shutil.copytree(record, folder / record.name)))


def desert(record: RunRecord, *, ring: Path, report: dict[str, Any] | None) -> None:
    """Make the run one whose desk died before it said how its scan ended; `report` is what the scan process said."""
    for name in ("result.json", "events.jsonl", "timing.json", "calibration.json", "desk-report.json"):
        (record.folder / name).unlink()
    manifest = record.manifest()
    for name in ("records", "files", "ended"):
        manifest.pop(name)
    desk = {"pid": 999_999, "birth": "another process"}
    record.write_json("run.json", manifest | {"state": "recording", "verdict": None, "ring": str(ring), "desk": desk})
    if report is not None:
        record.write_json("scan-report.json", report)
