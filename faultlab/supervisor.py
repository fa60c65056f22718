"""The supervisor of a run with faults over wires: in this process, or in its own where faults reach it."""

from __future__ import annotations

import json
import signal
import subprocess
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from faultlab.record import create_record
from station.bench.assemble_virtual import load_scenario, vocabulary_on
from station.bench.request import Job
from station.bench.virtual_unit import VirtualUnit
from station.documents.entries import plain
from station.documents.timing import Timing
from station.errors import BenchFaultError, StationError
from station.records.clocks import BY_WALL_CLOCK, SCAN, Pacing
from station.records.process_birth import process_birth
from station.records.ring.reader import RingReader
from station.records.ring.ring import ScanState, StopCause
from station.records.run_record import RECORDING, SCAN_REPORT, TIMING, RunRecord
from station.run import children
from station.run.conclusion import conclude
from station.run.faults.companion import Companion
from station.run.faults.machine_faults import Traces, deed_of
from station.run.outcome import RunOutcome, scan_report
from station.run.supervisor import Supervisor
from station.run.way_back.recover import recover
from virtual_bench.faults.scenario import Scenario

EXIT_RECORD_WAITS = 4
"""What a supervisor ends with whose disk took no records: they wait in the ring for whoever looks at the run next."""

LOOK_EVERY_S = 0.02
LONGEST_AFTER_SUPERVISOR_S = 60.0
"""Time for a scan process without a supervisor to unload and end, with much to spare."""

Say = Callable[[str], None]


@dataclass(frozen=True)
class Left:
    """What a run over wires has left: its record, its start, and what became of its scan.

    The start is on the monotonic clock; by the scan clock, which begins with the run, it is 0.
    """

    record: RunRecord
    started_ns: int = 0
    written: int = 0
    """Records that the scan says it wrote."""
    died: bool = False
    """The scan ended without saying so."""
    refused: str = ""
    """Why the bench was not opened; nothing has moved."""
    traces: Traces = field(default_factory=Traces)


def needs_supervisor_of_its_own(scenario: Scenario) -> bool:
    """Tell whether a scenario has faults of the machine, which must not reach the process that judges."""
    return any(deed_of(fault) is not None for fault in scenario.faults)


def run_here(
    job: Job,
    unit: VirtualUnit | None,
    scenario_path: Path,
    data: Path,
    say: Say,
    *,
    pacing: Pacing = BY_WALL_CLOCK,
    begun: Callable[[Path], None] | None = None,
) -> Left:
    """Run a scenario with the supervisor in this process; `begun` is told the folder of the record once it is there.

    A bench behind the gateway lives by its own clock, whatever `pacing` says.

    Raises:
        StationError: the record cannot be written, or no run may start by itself on this bench.

    """
    if unit is None and job.no_automatic_run:
        raise StationError(job.no_automatic_run)
    scenario = load_scenario(scenario_path, vocabulary_on(job.bench, job.profile_sources))
    pacing = BY_WALL_CLOCK if unit is None else pacing
    record = create_record(job, unit, scenario_path, scenario, data, clock=pacing.clock)
    if begun is not None:
        begun(record.folder)
    supervisor = Supervisor(
        job, record, _nothing, say, Companion(scenario, judged=True), gateway=unit is None, pacing=pacing
    )
    why_refused = ""
    try:
        outcome = supervisor.run(unit, record.folder / "scenario.yaml")
    except BenchFaultError as error:
        why_refused = str(error)
        record.samples.touch()
        outcome = RunOutcome.refused_by(record, error)
    conclude(record, job, outcome)
    started_ns = 0 if pacing.clock == SCAN else outcome.started_ns
    return Left(record, started_ns, outcome.written, bool(outcome.trouble), why_refused)


def _nothing(_record: bytes) -> None:
    """Show nothing: nobody watches."""


def run_apart(job: Job, unit: VirtualUnit | None, scenario_path: Path, data: Path) -> Left:
    """Run a scenario with the supervisor in a process of its own, and conclude the run where that could not.

    Raises:
        StationError: that process failed for another reason than the scenario's faults.

    """
    with ExitStack() as cleanup:
        place = Path(cleanup.enter_context(TemporaryDirectory(prefix="lostmotion-supervisor-")))
        sources = {"recipe": str(job.recipe_source.path), "bench": str(job.bench_source.path)}
        spec = place / "spec.json"
        spec.write_text(json.dumps(sources | {"unit": plain(unit), "scenario": str(scenario_path), "data": str(data)}))
        supervisor = children.run_module(
            "faultlab.supervisor_process", spec, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE
        )
        cleanup.callback(children.stop, supervisor, LONGEST_AFTER_SUPERVISOR_S)
        folder = _said(supervisor).get("record")
        if folder is None:
            raise StationError(f"the supervisor process of the run failed: exit code {supervisor.wait()}; see above")
        record = RunRecord(Path(folder))
        ring = _follow(supervisor, record)
        if ring is not None:
            cleanup.callback(ring.close)
        why_refused = _said(supervisor).get("refused", "")
        supervisor.wait()
        if supervisor.returncode not in (0, EXIT_RECORD_WAITS, -signal.SIGKILL):
            raise StationError(
                f"the supervisor process of the run failed: exit code {supervisor.returncode}; see above"
            )
        if ring is not None:
            _wait_for_end(ring)
        if record.manifest().state == RECORDING:
            recover(record)
        return _left(record, ring, supervisor, why_refused)


def _said(supervisor: subprocess.Popen[bytes]) -> dict[str, str]:
    """Wait for the next JSON line of a supervisor; nothing from one that has ended."""
    line = b"" if supervisor.stdout is None else supervisor.stdout.readline()
    said: dict[str, str] = json.loads(line) if line else {}
    return said


def _follow(supervisor: subprocess.Popen[bytes], record: RunRecord) -> RingReader | None:
    """Return the ring of the run once it is there: what it says was written is what must be found."""
    while supervisor.poll() is None:
        name = record.manifest().ring
        if name:
            return RingReader(Path(name))
        time.sleep(LOOK_EVERY_S)
    return None


def _wait_for_end(ring: RingReader) -> None:
    """Wait until a scan process that has lost its supervisor has ended."""
    until = time.monotonic() + LONGEST_AFTER_SUPERVISOR_S
    while ring.pid and process_birth(ring.pid):
        if time.monotonic() > until:
            raise StationError(
                f"the scan process {ring.pid} continues without its supervisor process. End it with 'kill {ring.pid}'"
            )
        time.sleep(LOOK_EVERY_S)


def _left(record: RunRecord, ring: RingReader | None, supervisor: subprocess.Popen[bytes], why_refused: str) -> Left:
    timing = record.read(Timing, TIMING)
    finished = record.has(SCAN_REPORT) and scan_report(record).state != "running"
    died = ring is not None and ring.written > 0 and not finished and ring.state is not ScanState.FINISHED
    traces = Traces(
        scan_died=died,
        supervisor_killed=supervisor.returncode == -signal.SIGKILL,
        disk_refused=ring is not None and ring.stop_cause is StopCause.DISK,
        clock_jumped_s=timing.wall_clock_jumped_s or 0.0,
        missed=timing.missed,
        period_ms=timing.period_ns * 1e-6,
    )
    if ring is None:
        return Left(record, refused=why_refused, traces=traces)
    return Left(record, ring.started_ns, ring.written, died, why_refused, traces)
