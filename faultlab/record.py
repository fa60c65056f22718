"""Records of runs with faults: kept like those of measurements, so that `show`, `list` and `replay` find them."""

from __future__ import annotations

from pathlib import Path

from faultlab.run import FaultRun
from station.bench.request import Job, Source
from station.bench.virtual_unit import VirtualUnit
from station.documents.result import Result
from station.records.clocks import VIRTUAL
from station.records.run_record import RunRecord
from station.records.samples.scan_record import pack
from station.run.conclusion import conclude
from station.run.new_record import Wanted, new_record
from station.run.outcome import RunOutcome
from virtual_bench.faults.scenario import Scenario


def create_record(
    job: Job, unit: VirtualUnit | None, scenario_path: Path, scenario: Scenario, data: Path, *, clock: str
) -> RunRecord:
    """Create the record of a run with faults; its serial number names the scenario, a note says what it was.

    Raises:
        RecordError: the folder cannot be written.

    """
    name = scenario.scenario.name
    wanted = Wanted(f"fault {name}", unit, Source.read(scenario_path), None, clock)
    return new_record(data, job, wanted, notes=[f"faults were injected: {name}"])


def keep(
    job: Job, unit: VirtualUnit, scenario_path: Path, scenario: Scenario, *, run: FaultRun, data: Path
) -> tuple[Path, Result]:
    """Keep a run of virtual time below `data`, concluded as any other; return its folder and its result."""
    record = create_record(job, unit, scenario_path, scenario, data, clock=VIRTUAL)
    scans = zip(run.scans, run.images, run.orders, strict=True)
    with record.samples.open("wb") as stream:
        for sequence, (scan, image, orders) in enumerate(scans):
            stream.write(pack((sequence, scan, 0, 0), image, orders))
    return record.folder, conclude(record, job, RunOutcome(written=len(run.scans))).result
