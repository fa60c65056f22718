"""Limits on trial: the verdicts that flip are those of judging each run alone, and a draft says what was tried."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lostmotion_command import here
from stored_runs import metric, store_run

from analysis.evaluation.guard_band import normal_process, risks
from analysis.evaluation.verdict import Verdict, judge, worst
from analysis.loop.method import Decision
from analysis.trace.errors import AnalysisError
from benchmarks.many_runs import make_runs
from recipes import find_recipe, parse_recipe
from recipes.editing import changed
from station.documents.result import Result
from station.errors import StationError
from station.quality.limits_trial import Tried, draft_of, draft_text, flips_with_reasons, limits_trial, side_risks
from station.records.data_folder import Store
from station.records.revisions.history import History
from station.records.revisions.revision import State
from station.records.run_record import RESULT
from station.reevaluation.definition_trial import definition_trial
from station.store.quality.guard_bands import GuardBands
from station.store.quality.lot import Lot, production
from station.store.quality.trial import Rule, flipped, flips, tried_runs
from station.store.quality.values import ValueRow, characteristic

COUNT = 1000
LOT = Lot(recipe="small")
QUICK, SPRINGS = "rv-40e-121-quick", ("spring_constant three_region", "spring_constant")
NOW = GuardBands.of_all(0.82)
"""The guard band by which the verdicts of these runs were made, as a multiple of U."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = tmp_path_factory.mktemp("trial") / "runs"
    make_runs(data, COUNT)
    return data


def alone(result: Result, metric_id: str, rule: Rule) -> str:
    """The verdict of a run by its own values, as an evaluation gives it."""
    decision = Decision("simple") if rule.guard_factor is None else Decision("guard_band", rule.guard_factor)
    limits = rule.limit_min, rule.limit_max
    found: list[Verdict] = []
    for one in result.metrics:
        if one.id == metric_id:
            found += [judge(side.value, side.uncertainty, limits, decision)[0] for side in one.sides.values()]
        else:
            found.append(Verdict(one.verdict))
    return worst(found).value


RULES = {
    "a lower upper limit": Rule(None, 0.506, None),
    "with a guard band": Rule(None, 0.506, 0.5),
    "both limits": Rule(0.503, 0.508, None),
    "both limits with a guard band": Rule(0.503, 0.508, 0.1),
    "a guard band alone": Rule(None, 1.0, 1.0),
    "no limit": Rule(None, None, 0.82),
}


@pytest.fixture(scope="module")
def results(folder: Path) -> dict[str, Result]:
    """The results of first attempts by their runs."""
    return {run.id: run.read(Result, RESULT) for run in Store(folder).runs() if run.manifest().attempt == 1}


@pytest.mark.parametrize("name", RULES)
@pytest.mark.parametrize("metric_id", ["lost_motion", "backlash_width_3pct"])
def test_flips_are_those_of_judging_each_run_alone(
    folder: Path, results: dict[str, Result], name: str, metric_id: str
) -> None:
    rule = RULES[name]
    with production(folder) as look:
        what = characteristic(look, LOT, metric_id)
        counts, runs = flips(look, LOT, what, rule, judged=NOW), flipped(look, LOT, what, rule, COUNT, judged=NOW)
        every = tried_runs(look, LOT, what, rule, judged=NOW)
    expected: Counter[tuple[str, str]] = Counter()
    named = {}
    for run, result in results.items():
        after = alone(result, metric_id, rule)
        expected[result.verdict, after] += 1
        named |= {run: (result.verdict, after)} if after != result.verdict else {}
    assert counts == expected
    assert {one.run: (one.before, one.after) for one in runs} == named
    assert {one.run: (one.before, one.after) for one in every if one.before != one.after} == named
    assert len(every) == sum(expected.values())


@pytest.mark.parametrize("name", RULES)
def test_a_flip_names_what_decides_it(folder: Path, results: dict[str, Result], name: str) -> None:
    rule = RULES[name]
    with production(folder) as look:
        what = characteristic(look, LOT, "lost_motion")
        found = flips_with_reasons(look, LOT, what, rule, COUNT, judged=NOW)
    words = {"FAIL": "is beyond", "NOT DECIDABLE": "is too near", "PASS": "is within"}
    for one in found:
        own = next(metric for metric in results[one.run].metrics if metric.id == "lost_motion")
        if rule == RULES["no limit"]:
            assert one.why.startswith("lost_motion has no limit")
            continue
        decision = Decision("simple") if rule.guard_factor is None else Decision("guard_band", rule.guard_factor)
        limits = rule.limit_min, rule.limit_max
        verdict = worst(judge(side.value, side.uncertainty, limits, decision)[0] for side in own.sides.values())
        assert words[verdict.value] in one.why
        assert ("another metric" in one.why) == (verdict.value != one.after)


def test_a_value_without_uncertainty_is_not_decidable_by_a_guard_band(tmp_path: Path) -> None:
    for number, u in enumerate((0.01, None)):
        side = {"value": 0.5, "uncertainty": u, "verdict": "PASS"}
        store_run(tmp_path, f"U{number}", [metric(0.5, uncertainty=u, sides={"+": side})], day=number)
    with production(tmp_path) as look:
        what = characteristic(look, Lot(), "lost_motion")
        assert flips(look, Lot(), what, Rule(None, 1.0, 0.82), judged=NOW) == {
            ("PASS", "PASS"): 1,
            ("PASS", "NOT DECIDABLE"): 1,
        }
        assert flips(look, Lot(), what, Rule(None, 1.0, None), judged=NOW) == {("PASS", "PASS"): 2}


@pytest.mark.parametrize(
    ("limit", "before", "after"), [(1.0, 0.82, "NOT DECIDABLE"), (0.505, 0.82, "PASS"), (0.505, None, "NOT DECIDABLE")]
)
def test_a_doubt_beyond_value_and_u_is_not_undone_by_a_limit(
    limit: float, before: float | None, after: str, tmp_path: Path
) -> None:
    """0.5 ± 0.01 passes by a limit of 1.0, yet was not decidable; by 0.505 it does so by the simple rule only."""
    side = {"value": 0.5, "uncertainty": 0.01, "verdict": "NOT DECIDABLE"}
    one = metric(0.5, uncertainty=0.01, limits={"min": None, "max": limit}, verdict="NOT DECIDABLE", sides={"+": side})
    store_run(tmp_path, "U1", [one], reasons=["lost_motion: it would pass by a gap alone"])
    with production(tmp_path) as look:
        what = characteristic(look, Lot(), "lost_motion")
        judged = GuardBands.of_all(before)
        assert list(flips(look, Lot(), what, Rule(None, 1.2, 0.82), judged=judged)) == [("NOT DECIDABLE", after)]
        assert list(flips(look, Lot(), what, Rule(None, 0.4, 0.82), judged=judged)) == [("NOT DECIDABLE", "FAIL")]
        assert list(flips(look, Lot(), what, Rule(None, None, None), judged=judged)) == [("NOT DECIDABLE", "PASS")]


def test_what_was_tried_becomes_a_draft(golden_run: Any, tmp_path: Path) -> None:
    data = golden_run.copy(tmp_path / "runs").parent
    with production(data) as look:
        lot = Lot(virtual=True)
        found = limits_trial(look, lot, Tried("torque_ratio_slope", limit_max=1.0, guard_factor=0.5))
        with pytest.raises(StationError, match="what is to be tried is what the recipe has"):
            limits_trial(look, lot, Tried("torque_ratio_slope"))
        with pytest.raises(AnalysisError, match="min 2 is above max 1"):
            limits_trial(look, lot, Tried("torque_ratio_slope", limit_min=2.0, limit_max=1.0))
    assert [(new, number) for _, new, number in found.verdicts] == [("FAIL", 1)]
    assert found.flipped[0].after == "FAIL"
    assert "is beyond max 1" in found.flipped[0].why
    assert all(one.why for one in found.risks), "one run is no process"
    saved = draft_of(data, found, "A. Tester")
    there = History(data).find(saved.name, saved.revision)
    assert there is not None
    assert there.state is State.DRAFT
    recipe = parse_recipe(there.text(), "draft")
    assert next(one.max for one in recipe.metrics if one.id == "torque_ratio_slope") == 1.0
    assert (recipe.decision.rule, recipe.decision.guard_factor) == ("guard_band", 0.5)
    assert (
        recipe.recipe.revision
        > parse_recipe((data / found.recipe_run / "recipe.yaml").read_bytes(), "r").recipe.revision
    )


def test_no_draft_limits_another_definition_than_was_tried(tmp_path: Path) -> None:
    """A preset asks for the spring constant as it is defined, the recipe's own entry for it with another fit."""
    text = changed(find_recipe(QUICK).read_bytes(), ("metrics", 2, "fit"), "three_region")
    text = text.replace(b"\nmetrics:", b"\npresets: [measurement]\nmetrics:")
    recipe = parse_recipe(text, QUICK)
    assert [one.fit for _, one in recipe.wanted() if one.id == "spring_constant"] == ["three_region", None]
    own = [metric(110.0, id=one.id, limits={}, choices=["three_region"] if one.fit else []) for one in recipe.metrics]
    shown = [*own, metric(110.0, id="spring_constant", limits={}, choices=[])]
    store_run(tmp_path, "SN", shown, text=text)
    with production(tmp_path) as look:
        tried = [limits_trial(look, Lot(), Tried(name, limit_min=99.0)) for name in SPRINGS]
    draft = parse_recipe(draft_text(tmp_path, tried[0]), "draft")
    assert (draft.metrics[2].fit, draft.metrics[2].min) == ("three_region", 99.0)
    said = "a preset asks for spring_constant; the entry .* is spring_constant three_region mean"
    with pytest.raises(StationError, match=said):
        draft_text(tmp_path, tried[1])
    with pytest.raises(StationError, match=said):
        definition_trial(tmp_path, Lot(), Tried(SPRINGS[1], definition="variant=direct"))


def test_a_stricter_limit_moves_the_risk_from_the_customer_to_the_maker() -> None:
    random = np.random.default_rng(2)
    rows = [
        ValueRow(f"R{n}", f"U{n}", "", "", float(value), 0.04) for n, value in enumerate(random.normal(0.9, 0.06, 200))
    ]
    found = side_risks("+", rows, Rule(None, 1.0, None), Rule(None, 1.0, 1.0))
    assert (found.before.false_accept, found.before.false_reject) == pytest.approx((0.0129, 0.0163), abs=0.01)
    assert found.after.false_accept < found.before.false_accept
    assert found.after.false_reject > found.before.false_reject
    assert found.sd_process == pytest.approx(math.sqrt(np.var([row.value for row in rows], ddof=1) - 0.02**2))


def test_of_an_interrupted_run_u_is_a_third_of_what_is_stated() -> None:
    """Its U is stated with k = 3: half of it would be too much, and the process would seem to scatter less."""
    values = [float(one) for one in np.random.default_rng(2).normal(0.9, 0.06, 200)]
    rows = [ValueRow(f"R{n}", f"U{n}", "", "", one, 0.04, 2.0) for n, one in enumerate(values)]
    held = [row._replace(uncertainty=0.06, coverage_factor=3.0) for row in rows]
    usual, other = (side_risks("+", some, Rule(None, 1.0, None), Rule(None, 1.0, 1.0)) for some in (rows, held))
    assert (other.u, other.sd_process) == pytest.approx((usual.u, usual.sd_process))
    assert (usual.after.guard, other.after.guard) == pytest.approx((0.04, 0.06))


def drawn(stated: list[tuple[float, float]]) -> list[ValueRow]:
    """Values of a normal process, each with the U and the k that are stated for it."""
    values = np.random.default_rng(2).normal(0.9, 0.06, len(stated))
    return [ValueRow(f"R{n}", "U", "", "", float(values[n]), u, k) for n, (u, k) in enumerate(stated)]


def integrated(mean: float, sd: float, u: float, guard: float, limit: float) -> tuple[float, float]:
    """Accepted wrongly and rejected wrongly under an upper limit, of values measured alike."""
    true, step = np.linspace(mean - 9.0 * sd, mean + 9.0 * sd, 40_001, retstep=True)
    share = np.exp(-0.5 * ((true - mean) / sd) ** 2) / (sd * math.sqrt(2.0 * math.pi)) * step
    accepted = np.array([0.5 * math.erfc((one - (limit - guard)) / (u * math.sqrt(2.0))) for one in true])
    return float(np.sum((share * accepted)[true > limit])), float(np.sum((share * (1.0 - accepted))[true <= limit]))


def test_risks_are_the_mean_of_those_of_each_run_by_its_own_u() -> None:
    stated = [(0.01, 2.0)] * 12 + [(0.04, 2.0)] * 5 + [(0.2, 3.0)] * 3
    rows, rule = drawn(stated), Rule(None, 1.0, 0.9)
    found = side_risks("+", rows, Rule(None, 1.0, None), rule)
    mean, variance = (float(how([row.value for row in rows])) for how in (np.mean, lambda some: np.var(some, ddof=1)))
    sd = math.sqrt(variance - sum((u / k) ** 2 for u, k in stated) / len(stated))
    for told, factor in ((found.before, 0.0), (found.after, 0.9)):
        each = [integrated(mean, sd, u / k, factor * u, 1.0) for u, k in stated]
        assert (told.false_accept, told.false_reject) == pytest.approx(np.mean(each, axis=0), abs=2e-5)
    pooled = math.sqrt(sum(u**2 for u, _ in stated) / len(stated))
    assert found.after.false_reject < integrated(mean, sd, found.u, 0.9 * pooled, 1.0)[1] - 0.05


def test_of_equal_u_and_where_one_leaves_no_room_between_limits() -> None:
    rows = drawn([(0.04, 2.0)] * 20)
    alike = side_risks("+", rows, Rule(0.7, 1.0, None), Rule(0.7, 1.0, 1.0))
    process = normal_process(alike.mean, alike.sd_process)
    for found, guard in ((alike.before, 0.0), (alike.after, 0.04)):
        assert astuple(found) == pytest.approx(astuple(risks(process, 0.7, 1.0, 0.02, guard)))
    wide = side_risks("+", drawn([(0.04, 2.0)] * 19 + [(0.16, 2.0)]), Rule(0.7, 1.0, None), Rule(0.7, 1.0, 1.0))
    assert wide.after.false_reject > 0.05 * (1.0 - wide.after.outside), "the one of U = 0.16 is never accepted"
    none = side_risks("+", drawn([(0.04, 2.0)] * 20), Rule(0.7, 1.0, None), Rule(0.7, 1.0, 4.0))
    assert "no accepted value is left" in none.why


def test_a_lot_whose_recipe_cannot_be_read_is_refused(folder: Path) -> None:
    told = here("quality", "trial", "--metric", "lost_motion", "--max", "0.506", "--data", str(folder))
    assert told.exit_code == 2
    assert "recipe.yaml" in told.err


def test_the_command_says_what_flips_and_saves_no_draft_unless_asked(golden_run: Any, tmp_path: Path) -> None:
    data = golden_run.copy(tmp_path / "runs").parent
    words = ("quality", "trial", "--metric", "torque_ratio_slope", "--max", "1", "--virtual", "--data", str(data))
    told = here(*words)
    assert told.exit_code == 0, told.err
    assert "1 of 1 verdicts flip" in told.out
    assert not (data / "recipes.jsonl").exists()
    assert here(*words, "--save-draft", "A. Tester", "--json").json["draft"]
