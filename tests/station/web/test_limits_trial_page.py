"""Limits on trial and the batch report on the page of quality, in a real browser: flips, risks, a draft, a download."""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from browser import Enter, needs_browser, playwright
from served import Served, prepared, served
from station_support import client_of, station_in
from stored_runs import metric, store_run

from recipes import find_recipe, parse_recipe
from station.counted import counted
from station.quality.limits_trial import Tried, limits_trial
from station.records.revisions.history import History
from station.store.quality.lot import Lot, production
from station.web.languages import ENGLISH, LANGUAGES, words_of
from station.web.pages.quality.trial_html import flips_html, risks_html, trial_words, verdicts_html, why_said

RECIPE = "rv-40e-121-quick"
LOT = Lot(recipe=RECIPE)
COUNT = 12
LONGEST_MS = 60_000


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
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = prepared(tmp_path_factory.mktemp("trial-page") / "runs")
    store_lot(data)
    return data


def test_tables_say_what_the_trial_found(folder: Path) -> None:
    with production(folder) as look:
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
def test_what_decides_on_trial_is_said_in_each_language(folder: Path, language: str) -> None:
    with production(folder) as look:
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


def test_the_batch_report_by_rest_is_of_the_lot_that_is_named(tmp_path: Path) -> None:
    station = station_in(tmp_path / "runs")
    try:
        store_lot(station.data)
        client = client_of(station, "quality")
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
    finally:
        station.close()


@pytest.fixture(scope="module")
def station(folder: Path) -> Iterator[Served]:
    with served(folder) as found:
        yield found


def tried_by(enter: Enter, role: str) -> playwright.Page:
    page: playwright.Page = enter(role)
    page.set_default_timeout(LONGEST_MS)
    page.click("nav >> text=Quality")
    page.wait_for_selector(".lm-words:has-text('On average means and spread')")
    page.get_by_label("New max").fill("wide")
    page.get_by_role("button", name="Try").click()
    page.wait_for_selector("text=Limits are numbers")
    page.get_by_label("New max").fill("0.8")
    page.get_by_role("button", name="Try").click()
    page.wait_for_selector(f"text=of {COUNT} verdicts flip")
    return page


@pytest.mark.wires
@needs_browser
def test_an_engineer_tries_a_limit_and_saves_the_draft(enter: Enter, folder: Path, tmp_path: Path) -> None:
    page = tried_by(enter, "engineer")
    assert page.locator(".lm-flips a").count() > 0
    assert "beyond max 0.8" in page.locator(".lm-flips").inner_text()
    assert "PFA" in page.locator(".lm-trial").first.inner_text()
    page.get_by_role("button", name="Save as draft").click()
    page.wait_for_selector(".lm-trial a:has-text('revision 3')")
    saved = History(folder).find(RECIPE, 3)
    assert saved is not None
    limit = next(one.max for one in parse_recipe(saved.text(), "draft").metrics if one.id == "lost_motion")
    assert limit == 0.8
    page.get_by_label("Loops to draw").click()
    page.get_by_role("option", name="none").click()
    page.wait_for_selector("a[href*='loops=0']")
    with page.expect_download() as begun:
        page.get_by_role("link", name="Make and download").click()
    begun.value.save_as(tmp_path / "batch.zip")
    assert "batch/batch.pdf" in zipfile.ZipFile(tmp_path / "batch.zip").namelist()


@pytest.mark.wires
@needs_browser
def test_quality_tries_limits_and_leaves_the_draft_to_those_who_write_recipes(enter: Enter) -> None:
    page = tried_by(enter, "quality")
    assert page.get_by_role("button", name="Save as draft").is_hidden()
