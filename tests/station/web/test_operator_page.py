"""The operator's page in a real browser: one scan, no click, a verdict by word, colour and shape."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from browser import Enter, needs_browser, playwright
from served import Served, prepared, served

pytestmark = [pytest.mark.wires, needs_browser]


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(prepared(tmp_path_factory.mktemp("page") / "runs")) as found:
        yield found


@pytest.fixture(scope="module")
def page(enter: Enter) -> playwright.Page:
    return enter("operator")


def scan(page: playwright.Page, serial: str, end: str = "Enter") -> None:
    """Scan a GS1 code: told by its prefix, however slowly a busy machine passes the keys on."""
    page.keyboard.type(f"]d221{serial}")
    page.keyboard.press(end)


FAST = """text => [...text, "Enter"].forEach(
    key => document.body.dispatchEvent(new KeyboardEvent("keydown", {key, bubbles: true, cancelable: true})))"""
"""A scanner without a prefix, faster than any machine is slow."""


def shown(page: playwright.Page, *words: str) -> str:
    page.wait_for_function("words => words.includes(document.querySelector('.lm-word').innerText)", arg=list(words))
    return str(page.inner_text(".lm-word"))


def test_one_scan_without_a_click_comes_to_a_verdict(page: playwright.Page) -> None:
    assert shown(page, "READY")
    scan(page, "SN-1")
    shown(page, "STARTING", "TESTING")
    scan(page, "SN-2", "Tab")
    page.wait_for_selector(".lm-refused:visible")
    assert "A run is in progress" in page.inner_text(".lm-refused"), "a scan while a run is on is refused visibly"
    assert shown(page, "PASS") == "PASS"
    tile = page.locator(".lm-tile")
    assert tile.locator("svg circle").count() == 1, "told by its shape too"
    assert tile.evaluate("one => getComputedStyle(one).backgroundColor") == "rgb(29, 122, 60)"
    assert "SN-1" in tile.inner_text()
    assert page.locator("table.lm tr").count() >= 1


def test_a_bad_unit_is_told_by_word_shape_and_colour_and_put_away_before_the_next(page: playwright.Page) -> None:
    scan(page, "BAD-1")
    assert shown(page, "FAIL") == "FAIL"
    assert page.locator(".lm-tile svg rect").count() == 1
    assert "NOK box" in page.inner_text(".lm-do")
    scan(page, "BAD-1")
    page.click("text=The bad unit is in the NOK box")
    page.click("text=seating of the unit")
    shown(page, "STARTING", "TESTING")
    assert shown(page, "FAIL") == "FAIL"
    assert "attempt 2" in page.inner_text(".lm-serial")
    scan(page, "SN-3")
    page.click("text=The bad unit is in the NOK box")
    shown(page, "STARTING", "TESTING")
    shown(page, "PASS")


def test_what_is_typed_slowly_and_what_is_no_serial_number_starts_nothing(page: playwright.Page) -> None:
    page.keyboard.type("SN-9", delay=120)
    page.keyboard.press("Enter")
    for ask in (lambda text: scan(page, text), lambda text: page.evaluate(FAST, text)):
        ask("sn?8")
        page.wait_for_selector(".lm-refused:visible *:not([data-seen]) >> text=No model has serial numbers like")
        # The next one has to say it again, in an element of its own.
        page.evaluate("document.querySelectorAll('.lm-refused *').forEach(one => one.dataset.seen = '')")
    assert shown(page, "PASS") == "PASS", "the result stays until the next unit"


def test_a_scan_that_was_refused_is_asked_anew_at_once(station: Served, page: playwright.Page) -> None:
    recipe = next((Path(station.data).parent / "recipes").glob("good.yaml"))
    text = recipe.read_text(encoding="utf-8")
    recipe.write_text("broken", encoding="utf-8")
    scan(page, "SN-4")
    page.wait_for_selector(".lm-refused:visible >> text=good.yaml")
    recipe.write_text(text, encoding="utf-8")
    scan(page, "SN-4")
    shown(page, "STARTING", "TESTING")
    shown(page, "PASS")


def test_what_was_measured_is_found_with_its_report(station: Served, page: playwright.Page) -> None:
    rows = ".ag-center-cols-container .ag-row"
    try:
        page.click("nav >> text=Results")
        page.wait_for_selector(f"{rows}:has-text('SN-4')")
        page.evaluate(f"""document.querySelectorAll("{rows}").forEach(row => row.dataset.seen = row.innerText)""")
        page.get_by_label("Serial number begins with").fill("BAD")
        page.wait_for_selector(f"{rows}:has-text('SN-4')", state="detached")
        # A row that stays is the same element: a click on it is not lost while an answer comes.
        page.wait_for_selector(f"{rows}[data-seen*='BAD-1'] .lm-bad:has-text('FAIL')")
        address = page.wait_for_selector('a[aria-label^="report of BAD-1"]').get_attribute("href")
        page.goto(f"{station.url}{address}")
        assert "BAD-1" in page.inner_text("main")
    finally:
        page.goto(f"{station.url}/")
        page.wait_for_selector(".lm-word")
    shown(page, "PASS")


def test_nobody_sees_the_bench_after_the_end_of_a_session(station: Served, page: playwright.Page) -> None:
    with closing(sqlite3.connect(Path(station.data) / "station.sqlite3")) as database, database:
        database.execute("UPDATE sessions SET ends_s = 0")
    page.wait_for_url("**/enter")
