"""What stands beside a dry run: what its trial unit proves, and what its limits do to runs that are there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from stored_runs import metric, store_run

from recipes import RecipeError, find_recipe
from station.web.languages import ENGLISH, words_of
from station.web.pages.quality.made import page_text_trial
from station.web.pages.recipes.dry_run_html import dry_run_html, text_trial_html
from station.web.recipe_text.dry_run import IDLE, DryRun

RECIPE = "rv-40e-121-quick"
COUNT = 12
LIMIT = 0.8
WRITTEN = "max: 1 arcmin"


def store_lot(data: Path) -> list[float]:
    text, random = find_recipe(RECIPE).read_bytes(), np.random.default_rng(5)
    values = [LIMIT + 0.04 * float(random.standard_normal()) for _ in range(COUNT)]
    for number, value in enumerate(values):
        sides = {side: {"value": value, "uncertainty": 0.0, "verdict": "PASS"} for side in ("+", "-")}
        one = metric(value, uncertainty=0.0, sides=sides)
        store_run(data, f"U{number}", [one], day=number, recipe=RECIPE, revision=2, text=text)
    return values


def test_limits_of_a_text_are_tried_on_the_runs_that_are_there(tmp_path: Path) -> None:
    values = store_lot(tmp_path)
    text = find_recipe(RECIPE).read_text("utf-8")
    assert WRITTEN in text
    same = page_text_trial(tmp_path, text.encode())
    assert same.lot is not None
    assert same.tried == ()

    found = page_text_trial(tmp_path, text.replace(WRITTEN, f"max: {LIMIT} arcmin").encode())
    (one,) = found.tried
    assert (one.metric.metric, one.limit_max, one.runs, one.fail_now) == ("lost_motion", LIMIT, COUNT, 0)
    assert one.would_fail == sum(value > LIMIT for value in values) > 0
    html = text_trial_html(found, words_of(ENGLISH))
    assert f"recipe={RECIPE}" in html
    assert f"max={LIMIT}" in html
    assert f"<b>{one.would_fail}</b> would fail" in html


@pytest.mark.parametrize("limit", ["max: null", "min: 0 arcmin"])
def test_a_limit_that_decides_nothing_is_refused_and_not_tried(tmp_path: Path, limit: str) -> None:
    store_lot(tmp_path)
    text = find_recipe(RECIPE).read_text("utf-8")
    with pytest.raises(RecipeError, match=r"metrics\[0\]"):
        page_text_trial(tmp_path, text.replace(WRITTEN, limit).encode())


def test_without_runs_there_is_nothing_to_try_on(tmp_path: Path) -> None:
    found = page_text_trial(tmp_path, find_recipe(RECIPE).read_bytes())
    assert found.lot is None
    assert "href" not in text_trial_html(found, words_of(ENGLISH))
    assert 'id="trial-unit"' not in dry_run_html(DryRun(), IDLE, words_of(ENGLISH))
