"""Runs with two faults at once, judged by the plant's own torque and by what a run without them reads.

The sensors are not asked: they may be what is wrong. Three things must hold in every run: the torque in the reducer
stays below its bound, the lock is not opened on a unit that is wound up, and the run ends. And a verdict stands on
values that are true: where the result says PASS or FAIL, each metric agrees with what the same unit reads without
faults, E_n ≤ 1 (ISO 13528, 9.7): the distance of both over the root of the sum of their squared U.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from faultlab.pairs.draw import OF_THE_UNIT, pair_of
from faultlab.record import keep
from faultlab.run import Bench, FaultRun
from station.bench.assemble_virtual import choose_unit, virtual_config
from station.bench.request import Job, load_job
from station.bench.virtual_unit import FIXED_SEED, VirtualUnit
from station.documents.result import MetricValue, Result
from station.run.conclusion import NOT_DECIDABLE
from virtual_bench.faults.scenario import Fault, Header, Scenario

RECIPE = "rv-40e-121-faults"
BOUND_SHARE_OF_RATED = 1.5
"""Of the torque in the reducer: above the trip, with what a drive goes on turning until it has stopped."""

OPEN_SHARE_OF_RATED = 0.05
"""Torque behind the lock above which it is never ordered open."""


@dataclass(frozen=True)
class Pair:
    """Two faults and what came of them; `wrong` has a sentence for each thing that must not be, in plain words.

    `verdict_wrong`: ids of the metrics by whose value the verdict is wrong. `largest_en`: largest E_n of a metric
    against the run without faults; None where no verdict was given.
    """

    number: int
    faults: tuple[str, ...]
    state: str
    verdict: str
    alarm: str
    peak_nm: float
    opened_nm: float | None
    largest_en: float | None
    verdict_wrong: tuple[str, ...]
    wrong: tuple[str, ...]


@cache
def _job() -> Job:
    return load_job(RECIPE, None)


@cache
def _unit() -> VirtualUnit:
    return choose_unit(None, _job().recipe, FIXED_SEED)


def run_of(scenario: Scenario) -> FaultRun:
    """Run a scenario with the recipe, the unit and the noise of all pairs."""
    job = _job()
    return Bench(job.program, virtual_config(job.bench, job.profile_paths, _unit()), scenario).finish()


def result_of(run: FaultRun, scenario: Scenario) -> Result:
    """Conclude a run as any other: recorded, evaluated, sealed, and read back."""
    with TemporaryDirectory(prefix="lostmotion-pairs-") as folder:
        path = Path(folder) / "scenario.yaml"
        path.write_text(scenario.model_dump_json(), encoding="utf-8")
        return keep(_job(), _unit(), path, scenario, run=run, data=Path(folder))[1]


@cache
def clean() -> dict[str, MetricValue]:
    """Return the metrics of the run without faults."""
    scenario = Scenario(scenario=Header(name="undisturbed"), faults=())
    return {metric.id: metric for metric in result_of(run_of(scenario), scenario).metrics}


def measure_pair(seed: int, number: int) -> Pair:
    """Run the pair `number` of the draw `seed` and judge it."""
    return measure(pair_of(seed, number), number)


def measure(scenario: Scenario, number: int = 0) -> Pair:
    """Run a scenario and judge it as a pair."""
    run = run_of(scenario)
    result = result_of(run, scenario)
    rated_nm = _job().recipe.unit_under_test.rated_torque_nm
    peak_nm, opened_nm = max(map(abs, run.torque_nm)), opened_at(run)
    wrong = []
    if peak_nm > BOUND_SHARE_OF_RATED * rated_nm:
        wrong.append(f"{peak_nm:.0f} N·m in the reducer, allowed {BOUND_SHARE_OF_RATED * rated_nm:.0f} N·m")
    if opened_nm is not None and opened_nm > OPEN_SHARE_OF_RATED * rated_nm:
        wrong.append(f"the lock was opened at {opened_nm:.1f} N·m, allowed {OPEN_SHARE_OF_RATED * rated_nm:.1f} N·m")
    if not run.finished:
        wrong.append("the run did not end")
    same_unit = all(fault.target not in OF_THE_UNIT for fault in scenario.faults)
    numbers = en_numbers(result, clean()) if same_unit and result.verdict != NOT_DECIDABLE else {}
    far = {name: en for name, en in numbers.items() if en > 1.0}
    wrong += [f"{result.verdict} with E_n {en:.1f} of {name}" for name, en in far.items()]
    return Pair(
        number=number,
        faults=tuple(_text(fault) for fault in scenario.faults),
        state=run.states[-1],
        verdict=result.verdict or "",
        alarm=next((event.text for event in run.alarms()), ""),
        peak_nm=peak_nm,
        opened_nm=opened_nm,
        largest_en=max(numbers.values(), default=None),
        verdict_wrong=tuple(far),
        wrong=tuple(wrong),
    )


def opened_at(run: FaultRun) -> float | None:
    """Return the largest torque in the reducer at which the lock was ordered open, None when it never was."""
    opened = [
        abs(torque)
        for before, after, torque in zip(run.orders, run.orders[1:], run.torque_nm[1:], strict=False)
        if before.brake_on > after.brake_on
    ]
    return max(opened, default=None)


def en_numbers(result: Result, reference: dict[str, MetricValue]) -> dict[str, float]:
    """Return E_n of each metric against its reference.

    A metric without a value or an uncertainty is left out: it decides nothing.
    """
    found = {}
    for metric in result.metrics:
        other = reference[metric.id]
        if metric.value is not None and other.value is not None and metric.uncertainty and other.uncertainty:
            found[metric.id] = abs(metric.value - other.value) / math.hypot(metric.uncertainty, other.uncertainty)
    return found


def _text(fault: Fault) -> str:
    value = "" if fault.value is None else f" {fault.value:g}"
    lasted = "" if fault.for_ms is None else f" for {fault.for_ms:g} ms"
    return f"{fault.target} {fault.verb}{value} in {fault.when.state} after {fault.when.after_scans} scans{lasted}"
