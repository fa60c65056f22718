"""The page of a run, in a real browser: why a unit failed. Texts of a record stay text; altered, it has no verdict."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from browser import Enter, needs_browser, playwright
from lostmotion_command import here
from served import Served, prepared, served
from station_support import GOLDEN
from stored_runs import metric, store_run

from station.records.data_folder import Store
from station.reports.loop_curves import loop_curves
from station.web.languages import words_of
from station.web.pages.run import allowed_width, beside
from station.web.pages.run_text import run_text

SCRIPT = "<img src=x onerror=alert(1)>"


@pytest.fixture(scope="module")
def folder(worn_run: Any, quarter: Callable[[str], str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A worn unit that failed twice, and a unit whose serial number is a script."""
    data = tmp_path_factory.mktemp("run-page") / "runs"
    shutil.copytree(worn_run.data, data)
    again = ("--unit", "worn", "--serial", "W1", "--operator", SCRIPT, "--retest-reason", SCRIPT, "--note", SCRIPT)
    for words in ((quarter("rv-40e-121-quick"), *again), (str(GOLDEN), "--serial", SCRIPT)):
        here("run", *words, "--virtual-time", "--no-report", "--data", str(data))
    return data


def test_what_failed_stands_first(folder: Path) -> None:
    found = run_text(Store(folder).find("W1"))
    assert (found.verdict, found.doubtful) == ("FAIL", False)
    verdicts = [row.verdict for row in found.rows]
    assert {(row.id, row.side) for row in found.rows[:2]} == {("backlash_width_3pct", side) for side in ("+", "-")}
    assert verdicts[:2] == ["FAIL", "FAIL"]
    assert "FAIL" not in verdicts[2:]
    assert "attempt 2; attempt 1 simulated FAIL Backlash" in found.html
    assert SCRIPT not in found.html
    places = loop_curves(Store(folder).find("W1")).places
    read_at = {found.rows[place.row].id: place.spans_nm for place in places}
    assert abs(read_at["backlash_width_3pct"][0][0]) == pytest.approx(12.36)
    assert read_at["spring_constant"][0] in ((402.0, 412.0), (-412.0, -402.0))
    assert found.html.count("&lt;img src=x onerror=alert(1)&gt;") >= 3, "operator, reason and note stand there as text"


@pytest.mark.parametrize(
    ("language", "failed", "fact"), [("de", "NICHT IN ORDNUNG", "Prüfstand"), ("zh", "不合格", "试验台")]
)
def test_the_page_speaks_the_language_of_the_person(folder: Path, language: str, failed: str, fact: str) -> None:
    run = Store(folder).find("W1")
    html = run_text(run, words_of(language)).html
    english = run_text(run).html
    assert failed in html
    assert f"<dt>{fact}</dt>" in html
    for text in ("Validity checks:", ">Limits</th>", "<dt>operator</dt>", "checks passed", "attempt 2", ">passed<",
                 "more play than allowed"):  # fmt: skip
        assert text in english, text
        assert text not in html, text
    assert html.count("<tr") == english.count("<tr")


def test_earlier_attempts_and_the_golden_unit_of_the_model_are_offered(tmp_path: Path) -> None:
    data = tmp_path / "runs"
    first = store_run(data, "A", [metric(2.0)], failed="too large")
    store_run(data, "GOLDEN", [metric(0.4)], master="PASS")
    store_run(data, "BAD MASTER", [metric(2.0)], failed="too large", master="FAIL")
    second = store_run(data, "A", [metric(0.4)])
    found = beside(data, second.id, "A", "RV")
    assert [one.run for one in found.attempts] == [first.id]
    assert [one.serial for one in found.golden] == ["GOLDEN"]
    assert beside(data, second.id, "A", "RV-80E").golden == ()


def test_a_width_of_the_loop_has_an_allowed_width_and_nothing_else_has(folder: Path) -> None:
    rows = run_text(Store(folder).find("W1")).rows
    assert {row.id: allowed_width(row) for row in rows if allowed_width(row) is not None} == {
        "backlash_width_3pct": 1.0
    }


@pytest.mark.parametrize("name", ["result.json", "run.json", "samples.parquet"])
def test_an_altered_run_has_no_verdict_and_no_figures_and_keeps_its_mark(
    folder: Path, tmp_path: Path, name: str
) -> None:
    shutil.copytree(folder, tmp_path / "runs")
    run = Store(tmp_path / "runs").of_serial("W1")[0]
    file = run.folder / name
    content = file.read_bytes()
    file.write_bytes(content[:-9] + bytes([content[-9] ^ 1]) + content[-8:] if name.endswith("t") else content + b" ")
    found = run_text(run)
    assert (found.verdict, found.doubtful, found.drawn, found.rows) == ("", True, False, ())
    assert "NO VERDICT" in found.html
    assert "FAIL" not in found.html
    assert "1.16" not in found.html
    assert "VIRTUAL BENCH" in found.html


@pytest.fixture(scope="module")
def station(folder: Path) -> Iterator[Served]:
    with served(prepared(folder)) as found:
        yield found


@pytest.fixture(scope="module")
def page(enter: Enter) -> playwright.Page:
    return enter("quality")


@pytest.mark.wires
@needs_browser
def test_why_a_unit_failed_is_found_from_the_screen_alone(page: playwright.Page) -> None:
    scripts: list[str] = []
    page.on("dialog", lambda dialog: (scripts.append(dialog.message), dialog.dismiss()))
    page.click("nav >> text=Results")
    page.get_by_label("Serial number begins with").fill("W1")
    page.wait_for_selector("text=1 to 2 of 2 runs")  # the rows are drawn anew then: a click before it may miss them
    page.click('a[aria-label="run of W1, attempt 2"]')
    page.wait_for_selector(".lm-tile.FAIL .lm-word:text-is('FAIL')")
    assert page.locator(".lm-tile svg rect").count() == 1, "told by its shape too"
    first = page.locator(".lm-metrics tbody tr").first
    assert "Backlash" in first.inner_text()
    assert "FAIL" in first.inner_text()
    page.wait_for_selector(".lm-loop .shapelayer path", state="attached")
    assert page.locator(".lm-loop .legend .traces").count() == 2, "this run, and how wide it may be"
    page.click("text=attempt 1:")
    page.wait_for_function("document.querySelectorAll('.lm-loop .legend .traces').length == 3")
    page.get_by_label("Draw another run").fill("<")
    page.click(f"text={SCRIPT} attempt 1")
    page.wait_for_function("document.querySelectorAll('.lm-loop .legend .traces').length == 4")
    assert SCRIPT in page.inner_text(".lm-facts"), "the operator's name is text"
    assert SCRIPT in page.text_content(".lm-loop .legend")
    assert page.locator('img[src="x"]').count() == 0
    assert scripts == []
    files = page.locator(".lm-files a").evaluate_all("all => all.map(one => one.getAttribute('href'))")
    assert {name.rpartition("/")[2] for name in files} == {"report.html", "report.pdf", "loop.csv", "run.parquet"}


@pytest.mark.wires
@needs_browser
@pytest.mark.parametrize("language", ["de", "en"])
def test_the_limits_and_the_verdict_of_a_metric_are_seen_without_scrolling(
    station: Served, enter: Enter, language: str
) -> None:
    page = enter("technician")
    page.click(f".lm-language[lang={language}]")
    page.wait_for_selector(f".lm-language[lang={language}][aria-pressed=true]")
    page.goto(f"{station.url}/runs/{Store(station.data).find('W1').id}")
    page.wait_for_selector(".lm-metrics")
    undecided = {"de": "NICHT ENTSCHEIDBAR", "en": "NOT DECIDABLE"}[language]
    page.evaluate(f"document.querySelector('.lm-metrics .lm-verdict').innerText = '▲ {undecided}'")
    for width in (1101, 1280, 1366, 1440, 1501, 1600, 1801, 1920):
        page.set_viewport_size({"width": width, "height": width * 9 // 16})
        table = page.locator(".lm-metrics").bounding_box()
        card = page.locator(".lm-card:has(.lm-metrics)").bounding_box()
        assert table["x"] + table["width"] <= card["x"] + card["width"], width


@pytest.mark.wires
@needs_browser
@pytest.mark.parametrize(("address", "sign"), [("/results", ".ag-row"), ("/runs/{run}", ".lm-tile")])
def test_nobody_looks_on_after_the_end_of_a_session(
    station: Served, page: playwright.Page, address: str, sign: str
) -> None:
    page.goto(station.url + address.format(run=Store(station.data).find("W1").id))
    page.wait_for_selector(sign)
    with closing(sqlite3.connect(station.data / "station.sqlite3")) as database:
        ends = database.execute("SELECT max(ends_s) FROM sessions").fetchone()[0]
        for moment in (0, ends):
            with database:
                database.execute("UPDATE sessions SET ends_s = ?", (moment,))
            if not moment:
                page.wait_for_url("**/enter")
