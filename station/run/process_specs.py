"""What the processes of a run are told when they start: a spec for each, kept in the run's folder as a JSON file.

What stands in a spec is said by the entry that reads it (`virtual_bench_process`, `gateway_process`, `scan_process`).
Recipe, bench and profiles in it are the run's own copies: all processes read what the record holds.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from station.bench.request import Job
from station.bench.virtual_unit import VirtualUnit
from station.documents.manifest import LeftBy
from station.documents.reading import plain
from station.records.clocks import Pacing
from station.records.program_file import PROGRAM
from station.records.run_record import RunRecord

TRUTH = "truth.csv"
"""Torque in the virtual reducer itself over the monotonic clock, in the folder of a run with faults."""

REAL_SPIN_NS = 100_000
EMBEDDED_SPIN_NS = REAL_SPIN_NS if (os.cpu_count() or 1) > 1 else 0
"""Spinning takes a tenth of a processor at 1 ms and makes p99 of the lateness ten times smaller (docs/determinism.md);
beside an embedded bench on a single processor there is none to spare."""


def write_bench_spec(job: Job, record: RunRecord, unit: VirtualUnit | None, scenario: Path | None, clock: str) -> Path:
    """Write what the embedded virtual bench, or the gateway before a real one, is told; return its path."""
    folder = record.folder
    spec = {
        "bench": str(folder / "bench.yaml"),
        "profiles": _profiles(job, record),
        "unit": None if unit is None else unit.plain(),
        "scenario": None if scenario is None else str(scenario),
        "truth": None if scenario is None else str(folder / TRUTH),
        "embedded": True,
        "clock": clock,
    }
    return _written(folder / "virtual-bench-spec.json", spec)


def write_scan_spec(
    job: Job,
    record: RunRecord,
    ring: Path,
    report: Path,
    ports: dict[str, Any] | None,
    *,
    pacing: Pacing,
    after_end_scans: int,
    left: LeftBy | None,
) -> Path:
    """Write what the scan process is told; return its path.

    `ports` is the ready line of a bench that was started for this run, None for one on its own wires; `left` says how
    the bench was left, for a recovery. This process is named as the desk.
    """
    folder = record.folder
    spec = {
        "ring": str(ring),
        "report": str(report),
        "recipe": str(folder / "recipe.yaml"),
        "program": str(folder / PROGRAM),
        "bench": str(folder / "bench.yaml"),
        "profiles": _profiles(job, record),
        "ports": ports,
        "clock": pacing.clock,
        "fast": pacing.fast,
        "desk": os.getpid(),
        "spin_ns": REAL_SPIN_NS if ports is None else EMBEDDED_SPIN_NS,
        "after_end_scans": after_end_scans,
        "left": None if left is None else plain(left),
    }
    return _written(folder / "scan-spec.json", spec)


def _profiles(job: Job, record: RunRecord) -> dict[str, str]:
    return {name: str(record.folder / "profiles" / f"{name}.yaml") for name in job.profile_names}


def _written(path: Path, spec: dict[str, Any]) -> Path:
    path.write_text(json.dumps(spec))
    return path
