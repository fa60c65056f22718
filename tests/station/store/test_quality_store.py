"""Quality figures from a store: which runs count, and that the database forms what the runs say one by one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from lostmotion_command import ROOT
from stored_runs import metric, store_run

from analysis.line.capability import capability
from analysis.metrics.former_wordings import FORMER_DEFINITIONS
from definitions.metrics import METRICS
from recipes import RecipeError, load_recipe
from station.cli.quality.quality import print_capability
from station.errors import StationError
from station.quality.bench_ability import Part, stated_tolerance, type_one_of
from station.quality.dfq.write import dfq_of_lot
from station.quality.figures import capability_of, causes_of, chart_of, trend_of, yield_of
from station.quality.validation import performance
from station.records.run_record import RunRecord
from station.store.quality.counts import GROUPINGS, Verdicts
from station.store.quality.lot import Lot, production
from station.web.languages import ENGLISH, LANGUAGES, words_of
from station.web.pages.quality_figures import capability_html

COUNT = 24
VALUES = tuple(0.5 + 0.02 * float(one) for one in np.random.default_rng(5).standard_normal(COUNT))
LOT = Lot(recipe="inverse")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A lot of 24 real units and one that failed and passed on its second attempt, beside all that must not count."""
    data = tmp_path_factory.mktemp("quality") / "runs"
    for number, value in enumerate(VALUES):
        store_run(data, f"U{number}", [metric(value)], day=number / 3, operator="AB"[number % 2])
    store_run(data, "AGAIN", [sided(1.2, 0.95)], day=9, failed="lost_motion", operator="A")
    store_run(data, "AGAIN", [metric(0.5)], day=9.1, operator="A")
    store_run(data, "STOPPED", [], day=9.2, state="stopped")
    store_run(data, "INVALID", [metric(9.0)], day=9.3, reasons=["measurement invalid: drift"])
    store_run(data, "NEAR", [metric(0.99, verdict="NOT DECIDABLE")], day=9.4, reasons=["lost_motion too near"])
    store_run(data, "MASTER", [metric(9.0)], day=9.5, master="PASS")
    store_run(data, "VIRTUAL", [metric(9.0)], day=9.6, virtual="P1")
    store_run(data, "FAULTS", [metric(9.0)], day=9.7, scenario="scenarios/slow.yaml")
    store_run(data, "OTHER", [metric(9.0)], day=9.8, recipe="other")
    altered = store_run(data, "ALTERED", [metric(9.0)], day=9.9)
    (altered.folder / "recipe.yaml").write_bytes(b"changed\n")
    return data


def sided(plus: float, minus: float) -> dict[str, object]:
    sides = {"+": {"value": plus, "uncertainty": None, "verdict": "FAIL"},
             "-": {"value": minus, "uncertainty": None, "verdict": "PASS"}}  # fmt: skip
    return metric(plus, sides=sides)


def test_yield_of_first_attempts_and_of_units_as_they_left(folder: Path) -> None:
    with production(folder) as look:
        found = yield_of(look, LOT)
    assert found.whole.verdicts.first == Verdicts(passed=COUNT, failed=1, undecided=2, ended_otherwise=1)
    assert found.whole.verdicts.final == Verdicts(passed=COUNT + 1, failed=0, undecided=2, ended_otherwise=1)
    assert found.whole.first_pass.share == COUNT / (COUNT + 4)
    assert found.whole.final.low < found.whole.final.share < found.whole.final.high


@pytest.mark.parametrize("by", GROUPINGS)
def test_groups_add_up_to_the_lot(folder: Path, by: str) -> None:
    with production(folder) as look:
        found = yield_of(look, LOT, by)
        whole = yield_of(look, LOT).whole
    assert found.whole.verdicts == whole.verdicts
    assert sum(row.verdicts.first.units for row in found.groups) == COUNT + 4
    assert sum(row.verdicts.final.units for row in found.groups) == COUNT + 4


def test_a_kind_of_unit_or_recipe_stands_alone(folder: Path) -> None:
    with production(folder) as look:
        assert yield_of(look, Lot(virtual=True)).whole.verdicts.first == Verdicts(passed=1)
        assert yield_of(look, Lot(recipe="other")).whole.verdicts.first == Verdicts(passed=1)
        assert look.choices()[0] == ("inverse", "other")
        with pytest.raises(
            StationError, match=r"the chosen lot has no run of a virtual unit. Of real units there are 1"
        ):
            yield_of(look, Lot(recipe="other", virtual=True))
        with pytest.raises(StationError, match="runs of the recipes inverse, other; only runs of one"):
            capability_of(look, Lot())
        with pytest.raises(StationError, match="--by: found 'moon'"):
            yield_of(look, LOT, "moon")


def test_causes_are_counted_by_side_and_reason(folder: Path) -> None:
    with production(folder) as look:
        found = causes_of(look, LOT)
    assert [(one.name, one.number) for one in found.failed] == [("lost_motion mean side +", 1)]
    assert {one.name: one.number for one in found.undecided} == {
        "ended as stopped": 1, "lost_motion too near its limit": 1, "measurement invalid": 1,
    }  # fmt: skip
    assert found.first_attempts == COUNT + 4


def test_capability_is_that_of_the_values_one_by_one(folder: Path) -> None:
    with production(folder) as look:
        row = capability_of(look, LOT).rows[0]
        ten = capability_of(look, LOT._replace(newest=10)).rows[0].found
    own = [*VALUES, 1.2, 0.99]
    assert row.found == capability(own, None, 1.0)
    assert (row.side, row.others[0][0]) == ("+", "-")
    assert row.others[0][1] > row.found.overall.nearest
    assert ten == capability(own[-10:], None, 1.0)


def test_a_chart_names_the_runs_of_its_points(folder: Path) -> None:
    with production(folder) as look:
        found = chart_of(look, LOT, "lost_motion", ("limit",), subgroup=2, baseline=12)
    assert [one.point for one in found.chart.signals] == [13]
    assert found.runs[12].endswith("-NEAR")
    assert found.side == "+"
    assert found.false_alarms_per_hour(60.0, 8) == pytest.approx(8 * 30 / 84.566, rel=1e-4), "by means and ranges"


def test_a_trend_is_that_of_the_values_one_by_one(folder: Path) -> None:
    with production(folder) as look:
        found = trend_of(look, LOT._replace(until="2026-01-14T00:00:00.000+00:00"), "lost_motion", "operator")
        with pytest.raises(StationError, match="lost_motion has"):
            trend_of(look, LOT, "lost_motion", "bench", side="both")
        with pytest.raises(
            StationError, match="found 'stiffness'; the newest run of this lot has the metrics lost_motion"
        ):
            trend_of(look, LOT, "stiffness", "bench")
    assert [(one.name, one.number) for one in found.compared.groups] == [("A", 12), ("B", 12)]
    assert [one.mean for one in found.compared.groups] == pytest.approx([np.mean(VALUES[::2]), np.mean(VALUES[1::2])])


def test_runs_whose_definition_is_in_the_words_of_before_count(tmp_path: Path) -> None:
    words = (*FORMER_DEFINITIONS["lost_motion"], METRICS["lost_motion"].text, "half of it")
    for number, text in enumerate((*words, words[0])):
        store_run(
            tmp_path, f"U{number}", [metric(0.5 + number / 100, definition=text)], day=number, operator="AB"[number % 2]
        )
    with production(tmp_path) as look:
        row = capability_of(look, LOT).rows[0]
        dfq = dfq_of_lot(look, LOT, "test")
        whole = trend_of(look, LOT._replace(until="2026-01-14T00:00:00.000+00:00"), "lost_motion", "operator")
        by_row = trend_of(look, LOT._replace(until="2026-01-14T00:00:01.000+00:00"), "lost_motion", "operator")
    assert (row.found.values, row.other_meanings) == (4, 1)
    assert [one.runs for one in dfq.files] == [4, 1], "what means something else has a file of its own"
    assert dfq.left_out == 0
    assert [one.number for found in (whole, by_row) for one in found.compared.groups] == [3, 1, 3, 1]


def test_values_that_were_tested_by_other_limits_are_counted(tmp_path: Path) -> None:
    for number in range(5):
        limits = {"min": None, "max": 1.0 if number < 3 else 0.9}
        one = metric(0.5 + number / 100, limits=limits)
        store_run(tmp_path, f"U{number}", [one], day=number, revision=1 if number < 3 else 2)
    with production(tmp_path) as look:
        row = capability_of(look, LOT).rows[0]
    assert row.metric.limit_max == 0.9
    (other,) = row.by_others
    assert (other.limit_max, other.number, other.revisions) == (1.0, 3, (1,))
    assert sum(one.number for one in row.tested_by) == row.found.values == 5


def test_a_side_without_spread_is_told_beside_the_index_of_the_other(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All values of one side are the same, and worse than those of the other."""
    for number in range(5):
        sides = {
            side: {"value": value, "uncertainty": None, "verdict": "PASS"}
            for side, value in (("+", 0.5 + number / 100), ("-", 0.999))
        }
        store_run(tmp_path, f"U{number}", [metric(0.5 + number / 100, sides=sides)], day=number)
    with production(tmp_path) as look:
        figure = capability_of(look, LOT)
    (row,) = figure.rows
    assert (row.side, row.others, [side for side, _ in row.without]) == ("+", (), ["-"])
    assert row.found.overall.nearest > 1.33
    told = "nothing is known of side -, which has no index. capability: the values, or those of each"
    print_capability(tmp_path, LOT, (), 1, 0.95, as_json=False)
    assert f"lost_motion: {told}" in " ".join(capsys.readouterr().out.split())
    for language in LANGUAGES:
        say = words_of(language)
        html = capability_html(figure, say)
        assert 'class="OPEN"' in html
        assert say("▲ other side not known") in html
        assert (told in html) == (language == ENGLISH)
    evidence = [one for one in performance._process(tmp_path, LOT) if "Cpk" in one.found]
    assert [(one.state, told in one.found) for one in evidence] == [(performance.OPEN, True)]


def test_runs_that_mean_something_else_are_left_out_and_counted(tmp_path: Path) -> None:
    for number in range(4):
        store_run(tmp_path, f"U{number}", [metric(0.5 + number / 100, band=0.03 if number else 0.04)], day=number)
    with production(tmp_path) as look:
        row = capability_of(look, LOT).rows[0]
    assert (row.found.values, row.other_meanings) == (3, 1)


def test_type_one_takes_the_runs_of_one_part_on_one_bench(tmp_path: Path) -> None:
    for number in range(26):
        store_run(tmp_path, "MASTER", [metric(0.5 + 0.001 * (number % 5))], day=number, master="PASS")
    store_run(tmp_path, "U1", [metric(9.0)], day=30)
    with production(tmp_path) as look:
        found = type_one_of(look, Part("MASTER", "lost_motion"), 0.502, 0.2, 0.2)
        assert found.study.measurements == 26
        assert found.study.capable
        with pytest.raises(StationError, match="has one limit"):
            type_one_of(look, Part("MASTER", "lost_motion"), 0.502, None, 0.2)
        with pytest.raises(StationError, match="no valid run of the real unit NOBODY"):
            type_one_of(look, Part("NOBODY", "lost_motion"), 0.502, None, 0.2)


def test_a_recipe_states_the_tolerance_of_a_metric_with_one_limit(tmp_path: Path) -> None:
    text = (ROOT / "tests/proofs/golden/golden.yaml").read_text(encoding="utf-8")
    for stated, tolerance in (("tolerance: 20", 20.0), ("min: 80", None)):
        (tmp_path / "recipe.yaml").write_text(
            text.replace("{id: torque_ratio_slope", f"{{id: torque_ratio_slope, {stated}")
        )
        assert stated_tolerance(RunRecord(tmp_path), "torque_ratio_slope") == tolerance
    (tmp_path / "recipe.yaml").write_text(
        text.replace("{id: torque_ratio_slope", "{id: torque_ratio_slope, tolerance: 0")
    )
    with pytest.raises(RecipeError, match="tolerance above 0"):
        load_recipe(tmp_path / "recipe.yaml")
