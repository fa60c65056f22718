"""What the processes of a run are told when they start: a spec for each, kept in the run's folder as a JSON file.

What stands in the spec of a bench is said by the entry that reads it (`virtual_bench_process`, `gateway_process`):
bench and profiles in it are the run's own copies. A process that scans gets what was made of them, compiled:
`station.scan.scan_spec`.
"""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path

from definitions.plain_data import exact, plain
from definitions.program import Program
from station.atomic_file import as_json
from station.bench.assemble import wire_config
from station.bench.bench_spec import BenchSpec, Ports
from station.bench.request import Job
from station.bench.virtual_unit import VirtualUnit
from station.documents import entries as documents
from station.documents.manifest import LeftBy
from station.errors import StationError
from station.records.clocks import SCAN, Pacing
from station.records.program_file import PROGRAM
from station.records.run_record import BENCH_COPY, RunRecord
from station.run.way_back.left_by import taken_up
from station.scan.scan_spec import Compiled, ScanSpec, SpecFile, write_spec

TRUTH = "truth.csv"
"""Torque in the virtual reducer itself over the monotonic clock, in the folder of a run with faults."""

REAL_SPIN_NS = 100_000
EMBEDDED_SPIN_NS = REAL_SPIN_NS if (os.cpu_count() or 1) > 1 else 0
"""Spinning takes a tenth of a processor at 1 ms and makes p99 of the latency ten times smaller (docs/determinism.md);
beside an embedded bench on a single processor there is none to spare. Before a bench that waits for the scan there is
nothing to gain: its time stands still until the scan comes."""


def write_bench_spec(job: Job, record: RunRecord, unit: VirtualUnit | None, scenario: Path | None, clock: str) -> Path:
    """Write what the embedded virtual bench, or the gateway before a real one, is told; return its path."""
    folder = record.folder
    truth = None if scenario is None else folder / TRUTH
    spec = BenchSpec(
        bench=str(folder / BENCH_COPY),
        profiles=_profiles(job, record),
        unit=unit,
        scenario=None if scenario is None else str(scenario),
        truth=None if truth is None else str(truth),
        clock=clock,
    )
    path = folder / "virtual-bench-spec.json"
    path.write_text(_json(spec), encoding="utf-8")
    return path


def likely_bench_spec(job: Job, unit: VirtualUnit) -> str:
    """Return as JSON what the embedded virtual bench of a run of this job would be told, from the files as they are."""
    profiles = {name: str(path) for name, path in job.profile_paths.items()}
    return _json(BenchSpec(bench=str(job.bench_source.path), profiles=profiles, unit=unit, clock=SCAN))


def write_scan_spec(
    job: Job,
    record: RunRecord,
    ring: Path,
    report: Path,
    ports: Ports | None,
    *,
    pacing: Pacing,
    after_end_scans: int,
    left: LeftBy | None,
) -> SpecFile:
    """Write what the scan process is told; return its file.

    `ports`: where a bench listens that was started for this run, None for one on its own wires; `left` says how
    the bench was left, for a recovery. This process is named as the supervisor.
    """
    waits = pacing.clock == SCAN
    spec = ScanSpec(
        ring=str(ring),
        report=str(report),
        compiled=compiled(job, record.folder / PROGRAM, ports, waits=waits),
        clock="scan" if waits else "wall",
        fast=pacing.fast,
        spin_ns=0 if waits else REAL_SPIN_NS if ports is None else EMBEDDED_SPIN_NS,
        supervisor=os.getpid(),
        after_end_scans=after_end_scans,
        left=taken_up(left),
    )
    return write_spec(spec, record.folder / "scan-spec.json")


def compiled(job: Job, program: Path, ports: Ports | None, *, waits: bool = False) -> Compiled:
    """Return program and bench of a job for a process that scans; `program` is the file that holds the program.

    Raises:
        StationError: the program does not read back from its file as it was compiled.

    """
    content = as_json(plain(job.program))
    if exact(Program, json.loads(content), unlimited=True) != job.program:
        raise StationError(
            f"file {program}: the steps of this recipe cannot be passed on to the scan process. Report this error with "
            "the recipe"
        )
    return Compiled(
        program=str(program),
        program_sha256=hashlib.sha256(content).hexdigest(),
        bench=job.bench.bench.name,
        alone=ports is None,
        wires=wire_config(job.bench, job.profile_sources, job.recipe.sampling.period_ns, ports, waits=waits),
    )


def _profiles(job: Job, record: RunRecord) -> dict[str, str]:
    return {name: str(record.folder / "profiles" / path.name) for name, path in job.profile_paths.items()}


def _json(spec: BenchSpec) -> str:
    return json.dumps(documents.plain(spec), ensure_ascii=False)
