"""Limits on trial over runs that were judged by several decision rules: each says what judging it alone says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import here
from stored_runs import metric, store_run

from analysis.evaluation.verdict import judge, worst
from analysis.loop.method import Decision
from recipes import find_recipe, parse_recipe
from recipes.editing import changed
from station.errors import StationError
from station.quality.judged_by import judged_by
from station.quality.limits_trial import Trial, Tried, draft_text, limits_trial
from station.records.run_record import RunRecord
from station.reevaluation.jobs import Where
from station.reevaluation.question import LimitsQuestion
from station.reevaluation.run_question import Means, Reevaluated, ask_of_runs
from station.store.quality.lot import Lot, production

NAME = "rv-40e-121-quick"
GUARDED = find_recipe(NAME).read_bytes()
SIMPLE = changed(changed(GUARDED, ("recipe", "revision"), "3"), ("decision", "rule"), "simple")
FACTOR = parse_recipe(GUARDED, NAME).decision.guard_factor
UNDECIDED = "NOT DECIDABLE"
U = 0.05


def of(value: float, verdict: str, limit: float = 1.0, **changes: Any) -> dict[str, Any]:
    """A metric with the same value on both sides; its U is 0.05 arcmin."""
    sides = {side: {"value": value, "uncertainty": U, "verdict": verdict} for side in ("+", "-")}
    limits = {"min": None, "max": limit}
    return metric(value, uncertainty=U, verdict=verdict, sides=sides, limits=limits, **changes)


def store(data: Path, serial: str, text: bytes, metrics: list[dict[str, Any]], day: int) -> RunRecord:
    verdict = worst_of(metrics)
    ends = {"FAIL": {"failed": "lost_motion"}, UNDECIDED: {"reasons": ["lost_motion: too near"]}}
    revision = parse_recipe(text, NAME).recipe.revision
    told: dict[str, Any] = ends.get(verdict, {})
    return store_run(data, serial, metrics, day=day, text=text, recipe=NAME, revision=revision, **told)


def worst_of(metrics: list[dict[str, Any]]) -> str:
    return next(one for one in ("FAIL", UNDECIDED, "PASS") if one in {found["verdict"] for found in metrics})


def trial(data: Path, tried: Tried) -> Trial:
    with production(data) as look:
        return limits_trial(look, Lot(), tried)


def after_of(found: Trial) -> dict[str, str]:
    return {one.serial: one.after for one in found.flipped}


OLDER = {
    "near, by a guard band": (GUARDED, SIMPLE, 0.98, UNDECIDED),
    "doubted, by a guard band": (GUARDED, SIMPLE, 0.90, UNDECIDED),
    "near, by the simple rule": (SIMPLE, GUARDED, 0.99, "PASS"),
    "doubted, by the simple rule": (SIMPLE, GUARDED, 0.99, UNDECIDED),
    "bad, by the simple rule": (SIMPLE, GUARDED, 1.01, "FAIL"),
}
"""Recipe of the older run and of the newest, value of the older one [arcmin], and its verdict."""

DOUBTED = {name for name in OLDER if name.startswith("doubted")}


@pytest.mark.parametrize("limit", [1.005, 1.02, 1.2])
@pytest.mark.parametrize("name", OLDER)
def test_an_older_run_is_judged_as_alone_by_the_rule_of_the_newest(name: str, limit: float, tmp_path: Path) -> None:
    text, newest, value, verdict = OLDER[name]
    store(tmp_path, "OLD", text, [of(value, verdict)], 1)
    store(tmp_path, "NEW", newest, [of(0.5, "PASS")], 2)
    found = trial(tmp_path, Tried("lost_motion", limit_max=limit))
    rule = Decision("simple") if newest is SIMPLE else Decision("guard_band", FACTOR)
    alone = judge(value, U, (None, limit), rule)[0].value
    if name in DOUBTED:  # the evaluation knew more than value and U: no limit makes a PASS of it
        alone = UNDECIDED
    assert after_of(found) == ({"OLD": alone} if alone != verdict else {})
    assert (found.runs, found.not_evaluated) == (2, ())


def test_the_other_metrics_of_a_run_are_judged_by_the_rule_on_trial(tmp_path: Path, store_url: str | None) -> None:
    """By the draft they are: its decision rule is that of all metrics."""
    del store_url
    near, well = of(0.98, UNDECIDED, id="windup"), of(0.5, UNDECIDED)
    store(tmp_path, "OLD", GUARDED, [well, near], 1)
    store(tmp_path, "TWO", GUARDED, [of(0.98, UNDECIDED), of(0.98, UNDECIDED, id="windup")], 2)
    store(tmp_path, "NEW", SIMPLE, [of(0.5, "PASS"), of(0.5, "PASS", id="windup")], 3)
    assert after_of(trial(tmp_path, Tried("windup", limit_max=1.1))) == {"TWO": "PASS"}, "0.5 of OLD was doubted"
    assert after_of(trial(tmp_path, Tried("lost_motion", limit_max=0.8))) == {"TWO": "FAIL"}
    guarded = trial(tmp_path, Tried("windup", limit_max=1.1, guard_factor=FACTOR))
    assert after_of(guarded) == {}, "by a guard band lost_motion is too near"
    expected = worst(judge(one, U, (None, 1.0), Decision("guard_band", 0.2))[0] for one in (0.98, 0.98)).value
    assert after_of(trial(tmp_path, Tried("windup", limit_max=1.1, guard_factor=0.2))) == {"TWO": expected}


def test_a_run_whose_rule_is_not_known_is_named_and_not_counted(tmp_path: Path, store_url: str | None) -> None:
    del store_url
    hidden = store(tmp_path, "HIDDEN", GUARDED, [of(0.98, UNDECIDED)], 1)
    other = changed(GUARDED, ("recipe", "description"), "another one")
    for number, (value, verdict) in enumerate(((0.5, "PASS"), (1.2, "FAIL"))):
        gone = store(tmp_path, f"GONE{number}", other, [of(value, verdict)], 2)
        with production(tmp_path):
            (gone.folder / "recipe.yaml").unlink()
    store(tmp_path, "NEW", SIMPLE, [of(0.5, "PASS")], 3)
    tried = Tried("lost_motion", limit_max=1.02)
    assert after_of(trial(tmp_path, tried)) == {"HIDDEN": "PASS"}
    with production(tmp_path):
        (hidden.folder / "recipe.yaml").unlink()
    found = trial(tmp_path, tried)
    assert (found.runs, found.flips) == (3, 0), "what passed or failed by its value needs no rule"
    assert [run for run, _ in found.not_evaluated] == [hidden.id]
    told = here("quality", "trial", "--metric", "lost_motion", "--max", "1.02", "--data", str(tmp_path))
    assert told.exit_code == 1
    assert "not known by which rule" in " ".join(told.out.split())
    asked = ask(tmp_path, 1.02)
    assert list(asked.failed) == [hidden.id]
    assert hidden.id not in {line.run for line in asked.lines}


def test_one_copy_of_a_recipe_tells_the_rule_of_all_runs_by_it(tmp_path: Path) -> None:
    runs = [store(tmp_path, f"OLD{number}", GUARDED, [of(0.98, UNDECIDED)], number) for number in range(3)]
    store(tmp_path, "NEW", SIMPLE, [of(0.5, "PASS")], 5)
    with production(tmp_path) as look:
        assert sorted(judged_by(look, Lot()).by_recipe.values(), key=str) == [FACTOR, None]
    (runs[1].folder / "recipe.yaml").unlink()
    (runs[2].folder / "recipe.yaml").write_bytes(SIMPLE)
    found = trial(tmp_path, Tried("lost_motion", limit_max=1.02))
    assert after_of(found) == {f"OLD{number}": "PASS" for number in range(3)}
    assert found.not_evaluated == ()


def ask(data: Path, maximum: float, guard: float | None = None) -> Reevaluated:
    question = LimitsQuestion("lost_motion", None, None, maximum, guard)
    return ask_of_runs(data, question, Where(), Means(1))


def test_the_same_limits_are_asked_anew_when_the_newest_run_has_other_ones(tmp_path: Path) -> None:
    """What a question leaves open is that of the newest run: its rule, and its limits."""
    store(tmp_path, "OLD", GUARDED, [of(0.98, UNDECIDED)], 1)
    before = ask(tmp_path, 1.02)
    assert [line.after for line in before.lines] == [UNDECIDED]
    assert (ask(tmp_path, 1.02).known, ask(tmp_path, 1.02).hash) == (1, before.hash)
    store(tmp_path, "NEW", SIMPLE, [of(0.5, "PASS")], 2)
    after = ask(tmp_path, 1.02)
    assert [line.after for line in after.lines] == ["PASS", "PASS"]
    assert (after.known, after.hash != before.hash) == (0, True)
    lower = of(1.0, "PASS") | {"limits": {"min": 0.99, "max": 1.0}}
    store(tmp_path, "LOW", SIMPLE, [lower], 3)
    assert [line.after for line in ask(tmp_path, 1.02).lines] == ["FAIL", "FAIL", "PASS"]


def test_a_recipe_that_was_changed_after_the_run_is_no_base_of_a_draft(tmp_path: Path) -> None:
    run = store(tmp_path, "SN", SIMPLE, [of(0.5, "PASS")], 1)
    tried = Tried("lost_motion", limit_max=0.4)
    found = trial(tmp_path, tried)
    assert draft_text(tmp_path, found)
    path = run.folder / "recipe.yaml"
    path.write_bytes(changed(SIMPLE, ("metrics", 0, "max"), "5 arcmin"))
    said = f"{path}: was changed after the run: found SHA-256 .* Restore the file"
    with pytest.raises(StationError, match=said):
        draft_text(tmp_path, found)
    with pytest.raises(StationError, match=said):
        trial(tmp_path, tried)
    told = here("quality", "trial", "--metric", "lost_motion", "--max", "0.4", "--save-draft", "Q", "--data", tmp_path)
    assert told.exit_code == 2
    assert "recipe.yaml: was changed after the run" in " ".join(told.err.split())
    assert not (tmp_path / "recipes").exists()
