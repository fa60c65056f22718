"""The page of quality in a real browser: a lot's figures, another metric's chart, a master part; and its pictures."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from browser import Enter, needs_browser, playwright
from served import Served, prepared, served
from stored_runs import metric, store_run

from analysis.line.proportions import pareto
from analysis.line.run_rules import RULE_SETS
from recipes import load_bench
from station.quality.bench_ability import due_on
from station.quality.figures import capability_of, chart_of, trend_of
from station.records.data_folder import Store
from station.store.quality.lot import Lot, production
from station.web.languages import ENGLISH, words_of
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
LONGEST_MS = 180_000


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Fourteen units, one of them far off; a master part measured 26 times; a unit of the virtual bench."""
    data = prepared(tmp_path_factory.mktemp("quality-page") / "runs")
    random = np.random.default_rng(3)
    for number in range(14):
        value = 0.95 if number == 13 else 0.5 + 0.01 * float(random.standard_normal())
        both = [metric(value), metric(115.0 + value, id="spring_constant", unit="N·m/arcmin")]
        store_run(data, f"U{number}", both, day=number, operator=("Anna", SCRIPT)[number % 2])
    store_run(data, "BAD", [metric(1.5, verdict="FAIL")], day=14, failed="lost_motion")
    for number in range(26):
        store_run(data, "MASTER-1", [metric(0.5 + 0.001 * (number % 5))], day=number / 2, master="PASS")
    store_run(data, "V1", [metric(0.7)], day=15, virtual="P1")
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
    assert len(trend_options(trend)["series"][0]["data"]) == 3, "Anna, the script, and nobody"
    assert 'class="FAIL"' in table


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


@pytest.mark.wires
@needs_browser
def test_a_quality_engineer_sees_the_lot_and_the_bench(enter: Enter) -> None:
    page: playwright.Page = enter("quality")
    page.set_default_timeout(LONGEST_MS)
    page.click("nav >> text=Quality")
    page.wait_for_selector(".lm-shares b")
    assert page.locator(".lm-shares b").first.inner_text() == "93.3 %"
    page.wait_for_selector(".lm-words:has-text('every 137.2 points')")
    page.wait_for_selector(".lm-words:has-text('groups: found 1')")
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
    page.get_by_label("Tolerance (empty").fill("0.2")
    page.get_by_role("button", name="Judge").click()
    page.wait_for_selector("text=● capable")
