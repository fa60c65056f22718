"""The page of quality in a real browser: a lot's figures, a master part, trials, a batch report; and its pictures."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import numpy as np
import pytest
from browser import Enter, needs_browser, playwright
from served import Served, prepared, served
from stored_runs import metric, store_run
from test_limits_trial_page import COUNT, store_lot
from test_limits_trial_page import RECIPE as OF_THE_LIMITS

from analysis.line.proportions import pareto
from analysis.line.run_rules import RULE_SETS
from recipes import load_bench, parse_recipe
from station.quality.bench_ability import due_on
from station.quality.figures import capability_of, chart_of, trend_of
from station.records.data_folder import Store
from station.records.revisions.history import History
from station.store.quality.lot import Lot, production
from station.store.view import look_at
from station.web.languages import ENGLISH, LANGUAGES, words_of
from station.web.pages.quality.parts import numbers_of
from station.web.pages.quality_figures import (
    capability_html,
    causes_html,
    chart_options,
    due_html,
    signals_html,
    trend_options,
)

SAY = words_of(ENGLISH)
SCRIPT = "<img src=x onerror=alert(1)>"
LOT = Lot(recipe="inverse")
OF_THE_RECORD = "rv-40e-121-quick"
LONGEST_MS, SETTLE_MS = 180_000, 200


@pytest.fixture(scope="module")
def folder(quick_run: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Fourteen units, one of them far off; a master part measured 26 times; a unit of the virtual bench.

    By two other recipes, whose drafts do not meet: the units of a lot on trial, and the record of a virtual unit.
    """
    data = prepared(quick_run.copy(tmp_path_factory.mktemp("quality-page") / "runs").parent)
    store_lot(data)
    random = np.random.default_rng(3)
    for number in range(14):
        value = 0.95 if number == 13 else 0.5 + 0.01 * float(random.standard_normal())
        both = [metric(value), metric(115.0 + value, id="spring_constant", unit="N·m/arcmin")]
        store_run(data, f"Q{number}", both, day=number, operator=("Anna", SCRIPT)[number % 2])
    store_run(data, "BAD", [metric(1.5, verdict="FAIL")], day=14, failed="lost_motion")
    for number in range(26):
        store_run(data, "MASTER-1", [metric(0.5 + 0.001 * (number % 5))], day=number / 2, master="PASS")
    store_run(data, "V1", [metric(0.7)], day=15, virtual="P1")
    altered = (
        store_run(data, "ALTERED", [metric(1.5, verdict="FAIL")], day=16, failed="lost_motion").folder / "result.json"
    )
    altered.write_bytes(altered.read_bytes() + b" ")
    with look_at(data):
        return data


def test_pictures_hold_their_limits_and_mark_what_is_signalled(folder: Path) -> None:
    with production(folder) as look:
        chart = chart_of(look, LOT, "lost_motion", RULE_SETS["shewhart"], subgroup=1, baseline=13)
        trend = trend_of(look, LOT, "lost_motion", "operator")
        table = capability_html(capability_of(look, LOT), SAY)
    options = chart_options(chart, SAY)
    limits = chart.chart.mean_limits
    axis = options["yAxis"][0]
    assert not any(one["axisLabel"]["showMinLabel"] for one in options["yAxis"]), "it lies over what stands below"
    assert options["yAxis"][1]["splitNumber"] < options["yAxis"][0]["splitNumber"], "the lower picture is half as high"
    assert axis["min"] < limits.low < limits.high < axis["max"]
    assert all(one["markLine"]["precision"] > 5 for one in options["series"]), "drawn at hundredths, they lie elsewhere"
    marked = [point for point in options["series"][0]["data"] if "symbol" in point]
    assert len(marked) == len({one.point for one in chart.chart.signals}) == 2
    assert chart.runs[-1] in signals_html(chart, SAY)
    assert len(trend_options(trend, SAY)["series"][0]["data"]) == 3, "Anna, the script, and nobody"
    assert 'class="FAIL"' in table


def test_axes_and_limits_tell_values_apart_that_differ_little(tmp_path: Path) -> None:
    for number in range(14):
        both = [metric(115.8 + 0.01 * (number % 5 - 2))]
        store_run(tmp_path, f"N{number}", both, day=number, operator=("Anna", "Ben")[number % 2])
    with production(tmp_path) as look:
        chart = chart_of(look, LOT, "lost_motion", RULE_SETS["shewhart"], subgroup=1, baseline=13)
        trend = trend_of(look, LOT, "lost_motion", "operator")
        table = capability_html(capability_of(look, LOT), SAY)
    assert f">{round(trend.compared.mean, 4)}<" in table
    options, limits = chart_options(chart, SAY), chart.chart.mean_limits
    held = (*chart.chart.means, limits.low, limits.high)
    means = options["series"][0]
    assert len({one["label"]["formatter"] for one in means["markLine"]["data"]}) == 3
    assert len({one["value"] for one in means["data"]}) == 5
    groups = [end for one in trend.compared.groups for end in (one.low, one.high)]
    for axis, inside in ((options["yAxis"][0], held), (trend_options(trend, SAY)["yAxis"], groups)):
        width = max(inside) - min(inside)
        assert axis["min"] < min(inside) < max(inside) < axis["max"]
        assert axis["max"] - axis["min"] < 1.3 * width
    (middle,) = trend_options(trend, SAY)["series"][1]["markLine"]["data"]
    assert float(middle["label"]["formatter"]) == pytest.approx(trend.compared.mean, abs=1e-3)


def test_a_comma_or_a_blank_makes_no_two_known_values_of_one() -> None:
    assert numbers_of(None) == numbers_of(" ; ") == []
    assert numbers_of("0.37;115 ; -2\uff1b3") == [0.37, 115.0, -2.0, 3.0]
    for wrong in ("0,37", "0,37; 115", "115; 0, 37", "1 000", "0\uff0c37", "1; nan", "inf"):
        with pytest.raises(ValueError, match=r"[, \uff0c]|nan|inf"):
            numbers_of(wrong)


def test_texts_of_records_stay_texts() -> None:
    assert "<img" not in causes_html("x", pareto({SCRIPT: 2}), SAY)


def test_what_is_due_is_what_the_bench_file_says(tmp_path: Path) -> None:
    text = (Path("recipes/benches/virtual.yaml")).read_text(encoding="utf-8")
    path = tmp_path / "bench.yaml"
    path.write_text(text + "\nmaster_parts: [{serial: M-1, expect: PASS, every: 24 h}]\n", encoding="utf-8")
    due = due_on(Store(tmp_path), load_bench(path), datetime(2026, 1, 1, tzinfo=UTC))
    assert [(one.what, one.in_order) for one in due if one.what == "master part"] == [("master part", False)]
    assert "never measured" in due_html(due, SAY)
    assert "Meisterteil M-1 wurde" in due_html(due, words_of("de"))


@pytest.fixture(scope="module")
def station(folder: Path) -> Iterator[Served]:
    with served(folder) as found:
        yield found


@pytest.fixture(scope="module")
def page_of(enter: Enter) -> Enter:
    """One page of each role, in which they log in once."""
    return cache(enter)


def page_of_lot(page_of: Enter, station: Served, role: str, **lot: str) -> playwright.Page:
    """Open what the bar leads to, with a lot in its address that is not the one that it begins with."""
    page: playwright.Page = page_of(role)
    page.set_default_timeout(LONGEST_MS)
    address = page.get_attribute("nav a:has-text('Quality')", "href")
    page.goto(f"{station.url}{address}?{urlencode(lot)}")
    return page


@pytest.mark.wires
@needs_browser
def test_a_quality_engineer_sees_the_lot_and_the_bench(page_of: Enter, station: Served) -> None:
    page = page_of_lot(page_of, station, "quality", recipe="inverse")
    page.wait_for_selector(".lm-shares b")
    assert page.locator(".lm-shares b").first.inner_text() == "93.3 %"
    page.wait_for_selector(".lm-words:has-text('every 137.2 points')")
    page.wait_for_selector(".lm-words:has-text('groups: found 1')")
    page.wait_for_selector("text=Not counted: 1 run")
    assert page.locator(".lm-capability tr").count() == 2
    assert page.locator("img[src=x]").count() == 0
    page.set_viewport_size({"width": 1280, "height": 800})
    page.wait_for_function("""() => [...document.querySelectorAll('.lm-capability, .lm-causes')]
        .every(one => one.scrollWidth <= one.clientWidth)""")
    page.set_viewport_size({"width": 1920, "height": 1080})
    page.get_by_label("Rules").click()
    page.get_by_role("option", name="western-electric").click()
    page.wait_for_selector(".lm-words:has-text('every 65.36 points')")
    page.get_by_label("Units").click()
    page.get_by_role("option", name="virtual bench").click()
    page.wait_for_selector(".lm-shares b:text-is('100.0 %')")
    page.get_by_role("tab", name="Can this bench measure?").click()
    page.wait_for_selector(".lm-words:has-text('virtual unit MASTER-1')")
    page.get_by_role("tab", name="Production").click()
    page.get_by_label("Units").click()
    page.get_by_role("option", name="real units").click()
    page.wait_for_selector(".lm-shares b:text-is('93.3 %')")
    page.get_by_role("tab", name="Can this bench measure?").click()
    page.wait_for_selector(".lm-words:has-text('26 runs')")
    page.get_by_label("Known value").fill("0.502")
    page.get_by_role("button", name="Judge").click()
    page.wait_for_selector("text=so its tolerance is not known")
    page.get_by_label("Tolerance (empty").click()
    page.keyboard.type("0,2")
    page.get_by_role("button", name="Judge").click()
    page.wait_for_selector("text='0,2' is no number")
    page.get_by_label("Tolerance (empty").fill("0.2")
    page.get_by_role("button", name="Judge").click()
    page.wait_for_selector("text=● capable")


def tried_by(page_of: Enter, role: str) -> playwright.Page:
    page: playwright.Page = page_of(role)
    page.set_default_timeout(LONGEST_MS)
    with page.expect_navigation():
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
def test_an_engineer_tries_a_limit_and_saves_the_draft(page_of: Enter, folder: Path, tmp_path: Path) -> None:
    page = tried_by(page_of, "engineer")
    assert page.locator(".lm-flips a").count() > 0
    assert "beyond max 0.8" in page.locator(".lm-flips").inner_text()
    assert "PFA" in page.locator(".lm-trial").first.inner_text()
    page.get_by_role("button", name="Save as draft").click()
    page.wait_for_selector(".lm-trial a:has-text('revision 3')")
    saved = History(folder).find(OF_THE_LIMITS, 3)
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
def test_quality_tries_limits_and_leaves_the_draft_to_those_who_write_recipes(page_of: Enter) -> None:
    page = tried_by(page_of, "quality")
    assert page.get_by_role("button", name="Save as draft").is_hidden()


def page_of_the_record(page_of: Enter, station: Served, role: str) -> playwright.Page:
    page = page_of_lot(page_of, station, role, recipe=OF_THE_RECORD, virtual="true")
    # One unit is no control chart; the list of metrics comes before it.
    page.wait_for_selector(".lm-trial .q-field:has-text('Metric on trial'):has-text('Backlash')")
    return page


def choose(page: playwright.Page, field: str, option: str) -> None:
    page.get_by_label(field).click()
    page.get_by_role("option", name=option).first.click()


@pytest.mark.wires
@needs_browser
def test_an_engineer_tries_another_definition_and_saves_it_as_a_draft(
    page_of: Enter, station: Served, folder: Path
) -> None:
    page = page_of_the_record(page_of, station, "engineer")
    choose(page, "Metric on trial", "Lost motion")
    choose(page, "Defined as", "backlash_width_zero")
    page.get_by_label("New max").fill("0.01")
    page.get_by_role("button", name="Try").click()
    page.wait_for_selector("text=1 of 1 verdicts flip")
    assert "above the limit of 0.01 arcmin" in page.locator(".lm-flips").inner_text()
    assert "on trial" in page.locator(".lm-trial").first.inner_text()
    page.get_by_role("button", name="Save as draft").click()
    link = page.wait_for_selector(".lm-trial a:has-text('revision')")
    recipe = History(folder).find(OF_THE_RECORD, int(link.inner_text().removeprefix("revision ")))
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
def test_who_operates_the_bench_tries_limits_alone(page_of: Enter, station: Served) -> None:
    page = page_of_the_record(page_of, station, "operator")
    assert page.get_by_label("Defined as").is_hidden()


CUT_OFF = """() => [...document.querySelectorAll('.lm-capability, .lm-trial, .lm-trial .lm-side-by-side > *')]
    .filter(one => one.scrollWidth > one.clientWidth).map(one => one.innerText)"""


@pytest.mark.wires
@needs_browser
def test_nothing_of_a_trial_or_of_the_capability_is_cut_off_on_any_screen_in_any_language(
    page_of: Enter, station: Served, folder: Path
) -> None:
    with production(folder) as look:
        capability = capability_of(look, LOT)
    (row,) = capability.rows
    assert row.found is not None
    what = row.metric._replace(metric="spring_constant", unit="N·m/arcmin", limit_min=95.25, limit_max=120.75)
    wide = replace(row.found, cpk_low=-116.45, cpk_high=-104.31, ppk_low=-116.45, ppk_high=-104.31)
    capability = replace(capability, rows=(replace(row, metric=what, found=wide),))
    page: playwright.Page = page_of("engineer")
    page.set_default_timeout(LONGEST_MS)
    page.goto(f"{station.url}/quality?{urlencode({'recipe': OF_THE_LIMITS})}")
    for language in LANGUAGES:
        say = words_of(language)
        with page.expect_navigation():
            page.click(f'.lm-language[lang="{language}"]')
        page.wait_for_selector(f'.lm-language[lang="{language}"][aria-pressed="true"]')
        page.wait_for_selector(".lm-trial .q-field:has-text('Lost motion')")
        page.get_by_label(say("New max")).fill("0.8")
        page.get_by_role("button", name=say("Try"), exact=True).click()
        page.wait_for_selector(".lm-flips a")
        page.evaluate(
            "html => { document.querySelector('.lm-capability').innerHTML = html }", capability_html(capability, say)
        )
        for width in (1024, 1280, 1920):
            page.set_viewport_size({"width": width, "height": 800})
            page.wait_for_timeout(SETTLE_MS)
            assert page.evaluate(CUT_OFF) == [], (language, width)
