"""Another definition of a metric on trial on the page of quality, in a real browser, over runs with whole records."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from browser import Enter, needs_browser, playwright
from served import Served, prepared, served

from recipes import parse_recipe
from station.quality.limits_trial import Tried
from station.records.revisions.history import History
from station.store.quality.lot import Lot
from station.web.definition_trials import TrialState
from station.web.languages import ENGLISH, words_of
from station.web.pages.quality import trial
from station.web.pages.quality.trial_html import definition_title, progress_words
from station.web.people.accounts import Person

LONGEST_MS = 180_000
RECIPE = "rv-40e-121-quick"


@pytest.fixture(scope="module")
def folder(quick_run: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    copied = quick_run.copy(tmp_path_factory.mktemp("definition-page") / "runs").parent
    return prepared(copied)


@pytest.fixture(scope="module")
def station(folder: Path) -> Iterator[Served]:
    with served(folder) as found:
        yield found


@pytest.mark.parametrize(
    ("state", "said"),
    [
        ({}, "Starting."),
        ({"done": 3, "of": 50, "seconds": 2.0}, "b: 3 of 50 runs evaluated."),
        ({"done": 10, "of": 50, "seconds": 20.0}, "b: 10 of 50 runs evaluated, about 1:20 left."),
        ({"done": 40, "of": 50, "known": 30, "seconds": 20.0}, "b: 40 of 50 runs evaluated, about 0:20 left."),
        ({"done": 1, "of": 1, "known": 1, "seconds": 20.0}, "b: 1 of 1 run evaluated."),
    ],
)
def test_how_far_a_trial_is_stands_in_words(state: dict[str, Any], said: str) -> None:
    now = TrialState(Lot(), Tried("a", definition="b"), **state)
    assert progress_words(now, words_of(ENGLISH)) == said


def test_a_metric_stands_with_its_title_and_choices_for_themselves() -> None:
    assert definition_title("spring_constant fit=three_region") == "fit=three_region"
    assert definition_title("backlash_width_zero").endswith(" · backlash_width_zero")


def test_who_has_left_neither_begins_nor_stops_a_trial(monkeypatch: pytest.MonkeyPatch) -> None:
    """A socket outlives a log-out: what takes minutes of a processor is not begun over it."""

    async def closed(*_: object) -> bool:
        return False

    monkeypatch.setattr(trial, "still_open", closed)
    station = SimpleNamespace(trials=SimpleNamespace(start=pytest.fail, stop=pytest.fail))
    card = trial.TrialCard(station, SimpleNamespace(person=Person("Ada", "engineer")), Lot, words_of(ENGLISH))
    asyncio.run(card._try())
    asyncio.run(card._stop())


def _page(enter: Enter, role: str) -> playwright.Page:
    page: playwright.Page = enter(role)
    page.set_default_timeout(LONGEST_MS)
    page.click("nav >> text=Quality")
    # One unit is no control chart; the list of metrics comes before it.
    page.wait_for_selector(".lm-trial .q-field:has-text('Metric on trial'):has-text('Backlash')")
    return page


def _choose(page: playwright.Page, field: str, option: str) -> None:
    page.get_by_label(field).click()
    page.get_by_role("option", name=option).first.click()


@pytest.mark.wires
@needs_browser
def test_an_engineer_tries_another_definition_and_saves_it_as_a_draft(enter: Enter, folder: Path) -> None:
    page = _page(enter, "engineer")
    _choose(page, "Metric on trial", "Lost motion")
    _choose(page, "Defined as", "backlash_width_zero")
    page.get_by_label("New max").fill("0.01")
    page.get_by_role("button", name="Try").click()
    page.wait_for_selector("text=1 of 1 verdicts flip")
    assert "above the limit of 0.01 arcmin" in page.locator(".lm-flips").inner_text()
    assert "on trial" in page.locator(".lm-trial").first.inner_text()
    page.get_by_role("button", name="Save as draft").click()
    link = page.wait_for_selector(".lm-trial a:has-text('revision')")
    recipe = History(folder).find(RECIPE, int(link.inner_text().removeprefix("revision ")))
    assert recipe is not None
    wanted = {one.id: one.max for one in parse_recipe(recipe.text(), "draft").metrics}
    assert wanted["backlash_width_zero"] == 0.01
    assert "lost_motion" not in wanted
    page.get_by_label("Defined as").fill("hysteresis_energy")
    page.keyboard.press("Enter")
    page.get_by_role("button", name="Try").click()
    page.wait_for_selector("text=Choose a metric in arcmin")


@pytest.mark.wires
@needs_browser
def test_who_operates_the_bench_tries_limits_alone(enter: Enter) -> None:
    page = _page(enter, "operator")
    assert page.get_by_label("Defined as").is_hidden()
