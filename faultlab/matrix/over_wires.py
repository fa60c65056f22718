"""The fault matrix over real wires: one state per fault, in real time, one run after the other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from ruamel.yaml import YAML

from faultlab.matrix.matrix import RECIPE, Cell, assess, scenario_of
from faultlab.rows import ROWS, Row
from faultlab.wires import WIRE_SCANS, WireRun, run_over_wires
from station.bench.assemble_virtual import choose_unit
from station.bench.request import Job, load_job
from station.bench.virtual_unit import FIXED_SEED
from station.run.pacing import pacing_of
from virtual_bench.faults.scenario import Scenario

TRIES = 6
"""A run that the machine disturbed says nothing about the fault: it is repeated, and the table says how often."""

OF_THE_MACHINE = ("missed_periods", "sample_late")
"""Alarms that a busy machine brings about by itself."""


@dataclass(frozen=True)
class WireCell:
    """One fault over wires: what came of it, where its record is, and how often the machine had disturbed it before."""

    cell: Cell
    record: str
    repeated: int


def wire_rows(names: tuple[str, ...] = ()) -> list[int]:
    """Return the numbers of the rows that are run over wires; of those whose name holds one of `names` if any."""
    return [
        number
        for number, row in enumerate(ROWS)
        if row.wires and (not names or any(name in row.name for name in names))
    ]


def run_wires_matrix(
    numbers: list[int],
    data: Path,
    say: Callable[[str], None],
    progress: Callable[[WireCell], None],
    *,
    wall_clock: bool = False,
) -> list[WireCell]:
    """Run rows over wires; `progress` is called with each as it comes."""
    job = load_job(RECIPE, None)
    found = []
    for number in numbers:
        cell = measure_over_wires(job, number, data, say, wall_clock=wall_clock)
        progress(cell)
        found.append(cell)
    return found


def measure_over_wires(
    job: Job, number: int, data: Path, say: Callable[[str], None], *, wall_clock: bool = False
) -> WireCell:
    """Run one row over wires, again where the machine disturbed it."""
    row = ROWS[number]
    scenario = scenario_of(row, row.wires)
    unit = choose_unit(None, job.recipe, FIXED_SEED)
    rated_nm = job.recipe.unit_under_test.rated_torque_nm
    for repeated in range(TRIES):  # noqa: B007 - told below
        with TemporaryDirectory(prefix="lostmotion-scenario-") as folder:
            path = Path(folder) / "scenario.yaml"
            write_scenario(path, scenario)
            pacing = pacing_of(job, scenario, wall_clock=wall_clock, fast=True)
            there = run_over_wires(job, unit, path, data, say, pacing=pacing)
        cell = assess(there.run, number, row, row.wires, rated_nm, wire_scans=WIRE_SCANS)
        if not (cell.wrong and _disturbed(there, row)):
            break
    return WireCell(cell, str(there.record.folder), repeated)


def _disturbed(there: WireRun, row: Row) -> bool:
    alarms = there.run.alarms()
    stopped = there.run.states[-1:] == ["stopped"]  # by the scan, because the supervisor was held up
    return (
        bool(there.held_up)
        or stopped
        or bool(alarms and alarms[0].text in OF_THE_MACHINE and alarms[0].text not in row.causes)
    )


def write_scenario(path: Path, scenario: Scenario) -> None:
    """Write a scenario as the file that a person would have written."""
    plain = scenario.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
    with path.open("w", encoding="utf-8") as stream:
        YAML(typ="safe").dump({"faults": [], **plain}, stream)
