"""A run whose ramp was held, by its record: U is stated with k = 3, and whoever reads the result is told."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from analysis.evaluation.pipeline import Result
from definitions.image import Reaction, State
from recipes import load_bench, load_recipe
from station.cli.runs.analyze import _cells
from station.documents.exported import ExportedRun
from station.documents.result import MonteCarlo
from station.documents.timing import Timing
from station.records.program_file import StoredProgram
from station.records.run_record import TIMING, RunRecord
from station.records.samples.samples import read_samples
from station.records.samples.table import Table
from station.records.timing_proof import counts_of, facts_of_counts, holds_in, run_facts
from station.reports.certificate import certificate_of
from station.reports.content import uncertainty_kind
from station.reports.stored_result import stored_result
from station.results.evaluation import evaluate_trace, trace_of
from station.results.export_origin import HOLDS_UNKNOWN, Origin


def table_with(run: RunRecord, state: State, *, held_from: tuple[int, ...]) -> Table:
    """The samples of a run whose ramp was held for 30 scans from some records of a state on."""
    stored = read_samples(run)
    table = Table(stored.rows.copy(), stored.layout)
    first = int(np.flatnonzero(table["orders"]["state"] == state)[0])
    for start in held_from:
        table["orders"]["reaction"][first + start : first + start + 30] = Reaction.HOLD
    return table


def judged(run: RunRecord, table: Table) -> Result:
    recipe, bench = load_recipe(run.folder / "recipe.yaml"), load_bench(run.folder / "bench.yaml")
    trace = trace_of(table, StoredProgram.of(run).segments, bench, run.manifest().period_ns, run.id)
    return evaluate_trace(trace, recipe, bench, [], run_facts(table, run.read(Timing, TIMING), recipe.sampling))


def test_holds_are_counted_while_the_torque_of_the_recipe_is_on(quick_run) -> None:
    run = RunRecord(quick_run.record)
    assert holds_in(table_with(run, State.RAMP_NEG, held_from=())) == 0
    assert holds_in(table_with(run, State.RAMP_NEG, held_from=(100, 500))) == 2
    assert holds_in(table_with(run, State.IDLE, held_from=(0,))) == 0


def test_a_hold_that_no_shape_shows_is_known_from_the_record(quick_run) -> None:
    """Next to a turn friction reverses, and a branch looks the same with a rest in it."""
    run = RunRecord(quick_run.record)
    sound, held = (judged(run, table_with(run, State.RAMP_NEG, held_from=at)) for at in ((), (300,)))
    assert not any(stage.name == "interruptions" for stage in held.stages)
    for before, after in zip(sound.metrics, held.metrics, strict=True):
        assert (before.headline.coverage_factor, after.headline.coverage_factor) == (2.0, 3.0), before.wanted.id
        assert after.headline.value == before.headline.value
        assert before.headline.uncertainty is not None
        assert after.headline.uncertainty is not None
        assert after.headline.uncertainty > before.headline.uncertainty


def test_where_nobody_counted_holds_that_is_said(quick_run) -> None:
    """Files that were exported by versions that did not ask: what their trace does not show is not known."""
    run = RunRecord(quick_run.record)
    counts = counts_of(read_samples(run), run.read(Timing, TIMING))
    assert counts.holds == 0
    recipe = load_recipe(run.folder / "recipe.yaml")
    assert facts_of_counts(replace(counts, holds=None), 1_000_000, recipe.sampling).holds is None
    exported = cast("ExportedRun", None)
    told = [Origin(run.folder, exported, replace(counts, holds=count), changed=False).unknown for count in (0, 1, None)]
    assert told == [(), (), (HOLDS_UNKNOWN,)]


def test_u_beside_monte_carlo_has_the_factor_of_the_run(quick_run) -> None:
    (metric, *_) = stored_result(RunRecord(quick_run.record)).metrics
    drawn = MonteCarlo(draws=100, u=1.0, shift=0.0, low=0.0, high=1.0)
    shown = [float(_cells(replace(metric, coverage_factor=k), drawn)[2]) for k in (None, 2.0, 3.0)]
    assert shown[0] == shown[1]
    assert shown[2] == pytest.approx(1.5 * shown[1], rel=0.05)
    assert metric.uncertainty is not None
    assert shown[1] == pytest.approx(metric.uncertainty, rel=0.05)


def test_report_and_certificate_say_with_which_factor(quick_run) -> None:
    run = RunRecord(quick_run.record)
    result = stored_result(run)
    held = replace(result, metrics=tuple(replace(one, coverage_factor=3.0) for one in result.metrics))
    assert uncertainty_kind(result.metrics).startswith("± is the expanded uncertainty U (k = 2)")
    assert uncertainty_kind(held.metrics).startswith("± is the expanded uncertainty U (k = 3); a ramp was interrupted")
    certificates = certificate_of(run, result), certificate_of(run, held)
    assert [one and one.uncertainty for one in certificates] == ["U (k = 2)", "U (k = 3)"]


def test_a_result_of_before_that_does_not_name_its_factor_has_the_usual_one(quick_run) -> None:
    result = stored_result(RunRecord(quick_run.record))
    old = [replace(one, coverage_factor=None) for one in result.metrics]
    assert uncertainty_kind(old).startswith("± is the expanded uncertainty U (k = 2)")
