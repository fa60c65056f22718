"""What the page of quality says while another definition of a metric is on trial, and who begins and stops one."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest

from station.quality.limits_trial import Tried
from station.store.quality.lot import Lot
from station.web.definition_trials import TrialState
from station.web.languages import ENGLISH, words_of
from station.web.pages.quality import trial
from station.web.pages.quality.trial_html import definition_title, progress_words
from station.web.people.accounts import Person


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
