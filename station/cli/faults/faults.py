"""`lostmotion faults`: the vocabulary, one scenario, or the whole matrix of faults and states."""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from math import isfinite
from pathlib import Path

from faultlab.judge import Breach, breaches
from faultlab.matrix.matrix import RECIPE, Cell, cells, run_matrix
from faultlab.matrix.page import markdown, wires_markdown, write_page
from faultlab.rows import ROWS
from faultlab.run import run_scenario
from recipes import RecipeError, find_bench
from recipes.text.problems import Source
from recipes.text.yaml_source import read_source
from station.bench.assemble_virtual import (
    catalogue_of,
    check_clock,
    choose_unit,
    load_scenario,
    load_start,
    vocabulary_on,
)
from station.bench.files import load_named_bench
from station.bench.request import Job, find_profile, load_job
from station.bench.virtual_unit import VirtualUnit
from station.cli.faults.scenario_result import say_result
from station.cli.out_file import refuse_early, writing
from station.errors import StationError
from station.records.clocks import VIRTUAL, Pacing
from station.run.pacing import pacing_of
from virtual_bench.faults.scenario import OF_THE_RECORD, Scenario
from virtual_bench.faults.vocabulary import BY_NAME, FAULTS, NOT_BY_WALL_CLOCK, on_the_wire, only_over_wires
from virtual_bench.physics.find_unit import find_unit


def gateway(bench_name: str, scenario_path: Path) -> int:
    """Stand between a controller and a bench on a cable until interrupted; the ports are printed as one JSON line.

    Raises:
        RecipeError, StationError, VirtualBenchError, DriverError: what cannot be had as asked.

    """
    from station.bench.gateway_process import serve  # noqa: PLC0415 - brings the drivers

    bench_path = find_bench(bench_name)
    bench = load_named_bench(bench_path)
    serve(
        bench,
        {name: find_profile(name, bench_path) for name in bench.profile_names},
        scenario_path,
        end_with_parent=False,
    )
    return 0


def list_faults(*, as_json: bool) -> int:
    """Print what can be injected."""
    if as_json:
        rows = [
            {
                "target": target,
                "verb": verb,
                "value": row.value,
                "low": row.low if isfinite(row.low) else None,
                "high": row.high if isfinite(row.high) else None,
                "acts_on": row.acts_on,
                "in_virtual_time": not only_over_wires(target, verb),
                "over_wires": True,
                "by_wall_clock": (target, verb) not in NOT_BY_WALL_CLOCK,
                "by_gateway": on_the_wire(target, verb),
            }
            for (target, verb), row in FAULTS.items()
        ]
        sys.stdout.write(json.dumps(rows, ensure_ascii=False) + "\n")
        return 0
    for (target, verb), row in (FAULTS | BY_NAME).items():
        value = f"; value: {row.value}" if row.value else ""
        where = " (over wires only)" if only_over_wires(target, verb) else ""
        where = " (not by the wall clock)" if (target, verb) in NOT_BY_WALL_CLOCK else where
        sys.stdout.write(f"{target + ' ' + verb:32} {row.acts_on}{value}{where}\n")
    return 0


@dataclass(frozen=True)
class How:
    """How a scenario is run: recipe and unit in place of its own, over wires, a bench on a cable, where it is kept.

    Over wires the virtual bench waits for the scan, and no deadline is waited for; `wall_clock`: as with real hardware.
    """

    recipe: str | None = None
    unit: str | None = None
    wires: bool = False
    wall_clock: bool = False
    bench: str | None = None  # behind a gateway
    data: Path | None = None
    seed: int | None = None


def run(path: Path, how: How, *, as_json: bool) -> int:
    """Run a scenario, in virtual time or over wires, and judge it; 0 when it holds, 1 when not.

    Raises:
        RecipeError: the scenario, or what it starts with, has problems, each with its place.
        StationError: the record cannot be kept below `data`.

    """
    job = load_job(how.recipe or load_start(path).recipe or RECIPE, how.bench)
    scenario, source = load_scenario(path, vocabulary_on(job.bench, job.profile_sources)), read_source(path)
    pacing = pacing_of(job, scenario, wall_clock=how.wall_clock, fast=True) if how.wires else Pacing(VIRTUAL)
    _check_targets(source, path, scenario, pacing.clock)
    chosen = _unit_of(how, scenario, job)
    rated_nm = job.recipe.unit_under_test.rated_torque_nm
    behind_gateway = not job.bench.bench.embedded
    if behind_gateway and not how.wires:
        raise StationError(
            f"--bench {how.bench} is a real bench: faults can be injected only over CAN and Modbus; add --wires"
        )
    if not how.wires:
        found = run_scenario(job, chosen, scenario)
        wrong = breaches(found, scenario)
        kept = None
        if how.data is not None:
            from faultlab.record import keep  # noqa: PLC0415 - brings the analysis

            kept, _ = keep(job, chosen, path, scenario, run=found, data=how.data)
        say_result(scenario, source, found, wrong, rated_nm=rated_nm, unit=chosen, record=kept, as_json=as_json)
        return 1 if wrong else 0
    from faultlab.wires import run_over_wires  # noqa: PLC0415 - brings the analysis

    with kept_in(how.data) as folder:
        there = run_over_wires(job, None if behind_gateway else chosen, path, folder, _to_stderr, pacing=pacing)
        wrong = breaches(there.run, scenario)
        if wrong and there.held_up:
            wrong.append(Breach((), f"{there.held_up}: try again on a quiet machine"))
        kept = there.record.folder if how.data else None
        on_bench = None if behind_gateway else chosen
        say_result(scenario, source, there.run, wrong, rated_nm=rated_nm, unit=on_bench, record=kept, as_json=as_json)
    return 1 if wrong else 0


def _unit_of(how: How, scenario: Scenario, job: Job) -> VirtualUnit:
    """Return the unit that is asked for, or that of the scenario, as far as it is of the recipe's model.

    A scenario names it for its own recipe. Where another recipe is for another model, that one's good unit is taken.
    """
    unit = (scenario.start.unit or None) if how.unit is None else how.unit
    if unit is not None and how.unit is None and how.recipe is not None:
        catalogue = catalogue_of(job.recipe)
        unit = unit if find_unit(unit, catalogue).model == catalogue.model else None
    return choose_unit(unit, job.recipe, how.seed)


@contextmanager
def kept_in(data: Path | None) -> Iterator[Path]:
    """Give the folder that records are kept in, or one that is gone afterwards."""
    if data is not None:
        yield data
        return
    with tempfile.TemporaryDirectory(prefix="lostmotion-faults-") as folder:
        yield Path(folder)


def _to_stderr(text: str) -> None:
    sys.stderr.write(f"{text}\n")


def _check_targets(source: Source, path: Path, scenario: Scenario, clock: str) -> None:
    if not scenario.faults and not scenario.operator:
        allowed = "a fault to inject, or something that the operator does"
        raise RecipeError([source.problem(("faults",), "none", allowed, "Give faults or operator.")])
    check_clock(path, scenario, clock)
    asked = [(place, kind) for place, one in enumerate(scenario.expect) for kind in OF_THE_RECORD if getattr(one, kind)]
    if asked and clock == VIRTUAL:
        allowed = "what a run in virtual time has: it keeps no record of its own"
        raise RecipeError(
            [
                source.problem(("expect", at, kind), kind, allowed, "Run it over wires: add --wires", at_name=True)
                for at, kind in asked
            ]
        )


def wires_matrix(
    names: list[str], data: Path | None, page: Path | None, *, as_json: bool, wall_clock: bool = False
) -> int:
    """Run the matrix over wires; 0 when every fault keeps its bounds, 1 when not."""
    from faultlab.matrix.over_wires import WireCell, run_wires_matrix, wire_rows  # noqa: PLC0415 - brings the analysis

    chosen = wire_rows(tuple(names))
    if not chosen:
        sys.stderr.write(f"no row over wires has a name with {', '.join(names)}\n")
        return 2
    refuse_early(page, "--page")
    begin = time.monotonic()

    def show(found: WireCell) -> None:
        if as_json:
            return
        again = f"  (repeated {found.repeated} times: the machine was busy)" if found.repeated else ""
        kept = f"  {found.record}" if data else ""
        sys.stdout.write(line(found.cell) + again + kept + "\n")
        sys.stdout.flush()

    if not as_json:
        clock = "by the wall clock" if wall_clock else "the bench waits for the scan"
        sys.stdout.write(f"{len(chosen)} faults over wires, {clock}\n{HEAD}\n")
    with kept_in(data) as folder:
        found = run_wires_matrix(chosen, folder, _nothing, show, wall_clock=wall_clock)
    bad = [item for item in found if item.cell.wrong]
    if page is not None:
        with writing(page, "--page"):
            page.write_text(wires_markdown([item.cell for item in found]), encoding="utf-8")
    if as_json:
        rows = [asdict(item.cell) | {"fault": ROWS[item.cell.row].name, "repeated": item.repeated} for item in found]
        sys.stdout.write(json.dumps(rows) + "\n")
    else:
        sys.stdout.write(f"{len(found)} faults in {time.monotonic() - begin:.0f} s; outside their limits: {len(bad)}\n")
    return 1 if bad else 0


def _nothing(_text: str) -> None:
    """Say nothing: the table says it."""


def matrix(names: list[str], html: Path | None, page: Path | None, workers: int, *, as_json: bool) -> int:
    """Run the matrix; 0 when every cell keeps its bounds, 1 when not."""
    chosen = cells(names)
    if not chosen:
        sys.stderr.write(f"no row has a name with {', '.join(names)}; see 'lostmotion faults matrix --help'\n")
        return 2
    refuse_early(html, "--html")
    refuse_early(page, "--page")
    begin = time.monotonic()

    def show(cell: Cell) -> None:
        if not as_json:
            sys.stdout.write(line(cell) + "\n")
            sys.stdout.flush()

    if not as_json:
        sys.stdout.write(f"{len({row for row, _ in chosen})} faults, {len(chosen)} cells\n{HEAD}\n")
    found = run_matrix(chosen, workers, show)
    took_s = time.monotonic() - begin
    bad = [cell for cell in found if cell.wrong]
    if html is not None:
        with writing(html, "--html"):
            write_page(html, found, took_s)
    if page is not None:
        with writing(page, "--page"):
            page.write_text(markdown(found), encoding="utf-8")
    if as_json:
        sys.stdout.write(json.dumps([asdict(cell) | {"fault": ROWS[cell.row].name} for cell in found]) + "\n")
    else:
        sys.stdout.write(f"{len(found)} cells in {took_s:.0f} s; outside their limits: {len(bad)}\n")
    return 1 if bad else 0


HEAD = (
    f"{'fault':40} {'state':10} {'alarm':26} {'reaction':10} "
    f"{'alarm after':>13} {'command after':>13} {'torque < 2 % after':>18}"
)


def line(cell: Cell) -> str:
    """One cell as a line of the table."""
    detect = "" if cell.detect_scans is None else f"{cell.detect_scans} scans"
    order = "" if cell.order_scans is None else f"{cell.order_scans} scans"
    low = "" if not cell.alarm else f"{cell.torque_s:.3f} s" if cell.torque_s is not None else f"{cell.rest_nm:.0f} N·m"
    alarm, reaction = cell.alarm or "none: goes on", cell.reaction or "tolerated"
    wrong = f"  {'; '.join(cell.wrong)}" if cell.wrong else ""
    return (
        f"{ROWS[cell.row].name:40} {cell.state:10} {alarm:26} {reaction:10} {detect:>13} {order:>13} {low:>18}{wrong}"
    )
