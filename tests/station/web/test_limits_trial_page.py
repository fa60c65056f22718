"""What the page of quality says of limits on trial, flips and risks; and the batch report by REST."""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from station_support import client_of, station_in
from stored_runs import metric, store_run

from recipes import find_recipe
from station.counted import counted
from station.quality.limits_trial import Tried, limits_trial
from station.store.quality.lot import Lot, production
from station.web.languages import ENGLISH, LANGUAGES, words_of
from station.web.pages.quality.trial_html import flips_html, risks_html, trial_words, verdicts_html, why_said
from station.web.station import Station

RECIPE = "rv-40e-121-sweep"
LOT = Lot(recipe=RECIPE)
COUNT = 12


def store_lot(data: Path) -> None:
    """Store units with values about 0.8 arcmin, each with its U."""
    text = find_recipe(RECIPE).read_bytes()
    random = np.random.default_rng(5)
    for number in range(COUNT):
        value = 0.8 + 0.04 * float(random.standard_normal())
        sides = {side: {"value": value, "uncertainty": 0.01, "verdict": "PASS"} for side in ("+", "-")}
        one = metric(value, uncertainty=0.01, sides=sides)
        store_run(data, f"U{number}", [one], day=number, recipe=RECIPE, revision=2, text=text)


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    found = station_in(tmp_path_factory.mktemp("trial-page") / "runs")
    store_lot(found.data)
    yield found
    found.close()


def test_tables_say_what_the_trial_found(station: Station) -> None:
    with production(station.data) as look:
        found = limits_trial(look, LOT, Tried("lost_motion", limit_max=0.8), 3)
        none = limits_trial(look, LOT, Tried("lost_motion", limit_max=2.0))
    say = words_of(ENGLISH)
    assert 0 < found.flips < COUNT
    assert f"{found.flips} of {COUNT} verdicts flip" in trial_words(found, say)
    shown = flips_html(found, 3, say)
    assert shown.count('<a href="/runs/') == min(3, found.flips)
    assert "beyond max 0.8 arcmin" in shown or "too near to max 0.8 arcmin" in shown
    assert (f"of {found.flips}" in shown) == (found.flips > 3)
    assert flips_html(none, 3, say) == ""
    assert "flips" not in verdicts_html(none, say)
    assert risks_html(found, say).count("on trial") == 2


@pytest.mark.parametrize("language", [one for one in LANGUAGES if one != ENGLISH])
def test_what_decides_on_trial_is_said_in_each_language(station: Station, language: str) -> None:
    with production(station.data) as look:
        trials = [limits_trial(look, LOT, Tried("lost_motion", limit_max=limit), COUNT) for limit in (0.8, 0.81, 0.82)]
    say = words_of(language)
    for found in trials:
        texts = [trial_words(found, say), *(why_said(one.why, say) for one in found.flipped)]
        assert len(texts) > 1
        assert [text for text in texts if re.search(r"\b(side|is|near|beyond|on trial|verdicts)\b", text)] == []


@pytest.mark.parametrize(("number", "said"), [(0, "0 runs"), (1, "1 run"), (2, "2 runs")])
def test_one_is_not_many(number: int, said: str) -> None:
    assert counted(number, "run") == said
    assert counted(1, "entry", "entries") == "1 entry"
    assert counted(3, "entry", "entries") == "3 entries"


def test_the_batch_report_by_rest_is_of_the_lot_that_is_named(station: Station) -> None:
    client = client_of(station, "quality")
    station.evaluations.fork()  # it has loaded most of what evaluates
    found = client.http.get("/api/batch.zip", params={"recipe": RECIPE, "loops": 0, "locale": "de"})
    assert found.status_code == 200, found.text
    files = zipfile.ZipFile(io.BytesIO(found.content))
    assert {"batch/batch.html", "batch/batch.pdf", "batch/values.csv"} <= set(files.namelist())
    assert len(files.read("batch/values.csv").splitlines()) == COUNT + 1
    nobody = client.http.get("/api/batch.zip", params={"recipe": "nobody"})
    assert nobody.status_code == 409
    assert str(station.data) not in nobody.text
    for wrong in ({"loops": 61}, {"locale": "fr"}, {"since": "2026-01-05T08:00:00"}):
        assert client.http.get("/api/batch.zip", params=wrong).status_code == 422
    since = {"recipe": RECIPE, "loops": 0, "since": "2026-01-15T00:00:00+00:00"}
    part = zipfile.ZipFile(io.BytesIO(client.http.get("/api/batch.zip", params=since).content))
    assert len(part.read("batch/values.csv").splitlines()) == 3
