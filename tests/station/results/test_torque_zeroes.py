"""The torque zeroes that are read again after a run: a sensor that has moved meanwhile decides nothing."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from analysis.evaluation.pipeline import Result
from analysis.evaluation.verdict import Verdict
from definitions.image import State
from definitions.states import LOADED
from recipes import load_bench, load_recipe
from station.documents.timing import Timing
from station.records.program_file import StoredProgram
from station.records.run_record import TIMING, RunRecord
from station.records.samples.samples import read_samples
from station.records.samples.table import Table
from station.records.timing_proof import run_facts
from station.results.evaluation import evaluate_trace, trace_of

Spoil = Callable[[Table], None]


def judged(run: RunRecord, spoil: Spoil) -> Result:
    """What a run gives whose samples were spoilt."""
    stored = read_samples(run)
    table = Table(stored.rows.copy(), stored.layout)
    spoil(table)
    recipe, bench = load_recipe(run.folder / "recipe.yaml"), load_bench(run.folder / "bench.yaml")
    trace = trace_of(table, StoredProgram.of(run).segments, bench, run.manifest().period_ns, run.id)
    facts = run_facts(table, run.read(Timing, TIMING), recipe.sampling)
    return evaluate_trace(trace, recipe, bench, [], facts)


def moved(nm: float) -> Spoil:
    """The output torque reads so much more from the first load on, to the end."""

    def spoil(table: Table) -> None:
        first = int(np.flatnonzero(np.isin(table["orders"]["state"], sorted(LOADED)))[0])
        table["image"]["torque_out_nm"][first:] += nm

    return spoil


def moved_in(nm: float) -> Spoil:
    """The input torque reads so much more from the first load on, to the end."""

    def spoil(table: Table) -> None:
        first = int(np.flatnonzero(np.isin(table["orders"]["state"], sorted(LOADED)))[0])
        table["image"]["torque_in_nm"][first:] += nm

    return spoil


def within_tare(nm: float) -> Spoil:
    """The output torque reads so much more from the middle of the tare on: the zero has half of it."""

    def spoil(table: Table) -> None:
        moved(nm)(table)
        zero = table["orders"]["torque_out_tare_nm"]
        zero += nm / 2.0

    return spoil


def without(table: Table) -> None:
    """As recorded before the zeroes were read again."""
    table["orders"]["phase"][table["orders"]["state"] == State.COMPLETE] = 0


def cut(table: Table) -> None:
    """The amplifier stands still when the run is over."""
    there = table["orders"]["state"] == State.COMPLETE
    table["image"]["sample_counter"][there] = 7


@pytest.mark.parametrize(
    ("spoil", "passed"), [(moved(0.0), True), (moved(-16.9), False), (moved(3.0), False), (without, None), (cut, False)]
)
def test_a_zero_that_moved_in_the_run_decides_nothing(quick_run, spoil: Spoil, passed: object) -> None:
    result = judged(RunRecord(quick_run.record), spoil)
    check = next(one for one in result.checks if one.id == "torque_zeroes")
    assert check.passed is passed, check
    if passed is False:
        assert result.verdict is Verdict.NOT_DECIDABLE


def test_what_a_zero_moved_beyond_friction_is_in_the_uncertainty(quick_run) -> None:
    still, off = (judged(RunRecord(quick_run.record), moved(nm)) for nm in (0.0, 1.7))
    assert next(one for one in off.checks if one.id == "torque_zeroes").passed
    names = [{row.quantity for row in one.metrics[0].sides[0].budget.rows} for one in (still, off)]
    assert "torque_out_zero_moved" not in names[0]
    assert "torque_out_zero_moved" in names[1]


@pytest.mark.parametrize(
    ("spoil", "row"),
    [
        (moved(-0.8), "torque_out_zero_shown"),
        (within_tare(-2.14), "torque_out_zero_shown"),
        (moved_in(0.011), "torque_in_zero_shown"),
    ],
)
def test_a_zero_that_loading_and_unloading_show_is_in_the_uncertainty(quick_run, spoil: Spoil, row: str) -> None:
    # Friction at rest hides such a zero from its second reading, and it is within the limit of `torque_out_zero`.
    still, off = (judged(RunRecord(quick_run.record), one) for one in (moved(0.0), spoil))
    assert all(check.passed is not False for check in off.checks)
    wanted = "torque_ratio_offset"
    true, found = (next(one for one in run.metrics if one.definition.id == wanted) for run in (still, off))
    names = [{part.quantity for side in one.sides for part in side.budget.rows} for one in (true, found)]
    assert row not in names[0]
    assert row in names[1]
    for one, other in zip(true.sides, found.sides, strict=True):
        assert abs(one.value - other.value) < float(np.hypot(one.uncertainty, other.uncertainty))
