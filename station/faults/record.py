"""Records of runs with faults: kept like those of measurements, so that `show`, `list` and `replay` find them."""

from __future__ import annotations

from pathlib import Path

from drivers.virtual.scenario import Scenario
from station.bench.request import Job, Source
from station.faults.run import FaultRun
from station.record.run_record import RunRecord
from station.record.scan_record import pack
from station.run.conclusion import Ending, conclude
from station.run.new_record import Wanted, new_record


def create_record(
    job: Job, unit: str | None, scenario_path: Path, scenario: Scenario, data: Path, *, wires: bool
) -> RunRecord:
    """Create the record of a run with faults; its serial number names the scenario, a note says what it was.

    Raises:
        RecordError: the folder cannot be written.

    """
    name = scenario.scenario.name
    wanted = Wanted(f"fault {name}", unit, Source.read(scenario_path), None, virtual_time=not wires)
    return new_record(data, job, wanted, notes=[f"faults were injected: {name}"])


def keep(job: Job, unit: str, scenario_path: Path, scenario: Scenario, *, run: FaultRun, data: Path) -> Path:
    """Keep a run of virtual time below `data` and return its folder."""
    record = create_record(job, unit, scenario_path, scenario, data, wires=False)
    scans = zip(run.scans, run.images, run.orders, strict=True)
    with record.samples.open("wb") as stream:
        for sequence, (scan, image, orders) in enumerate(scans):
            stream.write(pack((sequence, scan, 0, 0), image, orders))
    conclude(record, job, Ending(written=len(run.scans)))
    return record.folder
