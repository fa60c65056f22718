"""The operator's page in a real browser: one scan, no click, a verdict by word, colour and shape."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing
from itertools import pairwise
from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe
from browser import Enter, needs_browser, playwright
from served import Served, prepared, served

from station.web.pages.frame import PAGES, SESSION_EVERY_S
from station.web.pages.operator import NO_BAD_UNIT, SCAN_NEXT, STOPPING, TYPED
from station.web.people.badges import assign_badge
from station.web.people.database import StationDatabase
from station.web.scanner_test import AS_GERMAN
from station.web.settings import ScannerTest

pytestmark = [pytest.mark.wires, pytest.mark.long, needs_browser]


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    data = prepared(tmp_path_factory.mktemp("page") / "runs")
    (data / "station.yaml").write_text(f"scanner_test: {{code: '{CODE}'}}\nbadge: 'B-[0-9]{{6}}'\n", encoding="utf-8")
    with closing(StationDatabase(data)) as database, database.writing() as connection:
        assign_badge(connection, "the operator", BADGE, PIN)
    with served(data) as found:
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


FAST_WITH_CAPS_LOCK = FAST.replace("cancelable: true", "cancelable: true, modifierCapsLock: true")
CODE = ScannerTest().code
GAP_PX = 8
"""Least distance of two buttons that mean something else, for a finger in a glove."""

BADGE, PIN = "B-100042", "8305"


def refused(page: playwright.Page, words: str) -> None:
    """Wait for a refusal that was not said before."""
    page.wait_for_selector(f".lm-refused:visible *:not([data-seen]) >> text={words}")
    # The next one has to say it again, in an element of its own.
    page.evaluate("document.querySelectorAll('.lm-refused *').forEach(one => one.dataset.seen = '')")


def shown(page: playwright.Page, *words: str) -> str:
    page.wait_for_function("words => words.includes(document.querySelector('.lm-word')?.innerText)", arg=list(words))
    return str(page.inner_text(".lm-word"))


def test_no_unit_starts_before_the_scanner_was_read_as_it_should_be(page: playwright.Page) -> None:
    scan(page, "SN-1")
    refused(page, "The scanner was not tested this shift")
    page.evaluate(FAST, CODE.translate(AS_GERMAN))
    refused(page, "The computer reads the scanner with another keyboard layout")
    page.evaluate(FAST, CODE.swapcase())
    refused(page, "Caps Lock is on")
    page.evaluate(FAST, CODE)
    refused(page, "The scanner works")
    assert shown(page, "READY")


def test_what_keys_have_lost_or_changed_starts_nothing(page: playwright.Page) -> None:
    page.evaluate(FAST_WITH_CAPS_LOCK, "SN-1")
    refused(page, "Caps Lock is on: it changes what the scanner sends")
    page.evaluate(FAST.replace("[...text,", "['S', 'N', 'Dead', '-', '1',"), "")
    refused(page, "is not a serial number")
    page.evaluate(FAST, "SN-1".translate(AS_GERMAN))
    refused(page, "is not a serial number")
    page.evaluate(FAST, "SN-1SN-1")
    refused(page, "No model has serial numbers like")
    page.keyboard.type("]d221")
    page.keyboard.press("Enter")
    refused(page, "is not the whole element")
    assert shown(page, "READY")


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
    assert tile.locator(".lm-badge").inner_text() == "VIRTUAL BENCH", "no real unit passed"
    assert page.locator("table.lm tr").count() >= 1


@pytest.mark.parametrize("width", [390, 768])
def test_the_loop_stands_below_the_verdict_and_its_figures_on_a_telephone(enter: Enter, width: int) -> None:
    page = enter("technician")
    page.set_viewport_size({"width": width, "height": 844})
    page.wait_for_selector(".lm-why td")
    tile, why, loop = (page.locator(one).bounding_box() for one in (".lm-tile", ".lm-why", ".lm-right"))
    assert tile["y"] + tile["height"] <= why["y"]
    assert why["y"] + why["height"] <= loop["y"]
    assert all(one["width"] > 0.9 * width for one in (tile, why, loop))
    assert loop["height"] >= 384
    seen = "(one => one.scrollWidth <= one.clientWidth && one.scrollHeight <= one.clientHeight)"
    assert page.evaluate(f"{seen}(document.querySelector('.lm-why'))"), "no metric is cut"


def assert_all_fits(page: playwright.Page) -> None:
    """Two messages and a button below the verdict of BAD-1, in the longest language too: nothing is cut off."""
    for language, code in (("Deutsch", "de"), ("English", "en")):
        page.click(f"text={language}")
        # The page is loaded anew: a scan on the one before would be lost.
        page.wait_for_function("code => document.documentElement.lang === code", arg=code)
        page.wait_for_selector(".lm-nok:visible")
        scan(page, "BAD-1")
        page.wait_for_selector(".lm-cancel:visible")
        assert page.evaluate("document.documentElement.scrollHeight <= innerHeight"), language
        for one in (".lm-nok", ".lm-cancel"):
            box = page.locator(one).bounding_box()
            assert box["y"] + box["height"] <= page.viewport_size["height"], f"{language} {one}"


def test_a_bad_unit_is_told_by_word_shape_and_colour_and_put_away_before_the_next(
    enter: Enter, page: playwright.Page
) -> None:
    scan(page, "BAD-1")
    assert shown(page, "FAIL") == "FAIL"
    assert page.locator(".lm-tile svg rect").count() == 1
    assert "NOK box" in page.inner_text(".lm-do")
    assert page.locator(".lm-nok:visible").count() == 1, "whoever scans no other unit confirms it too"
    page.focus(".lm-nok")
    scan(page, "BAD-1 ")
    page.wait_for_selector(".lm-refused:visible")
    assert "BAD-1" in page.inner_text(".lm-scanned")
    assert page.locator(".lm-nok:visible").count() == 1, "no key of a scan presses the button that has the focus"
    assert_all_fits(enter("technician"))
    page.click(".lm-nok")
    page.wait_for_selector(".lm-refused:visible >> text=Scan unit BAD-1 again")
    page.wait_for_selector(".lm-tile.lm-put-away .lm-confirmed")
    assert shown(page, "FAIL"), "nothing starts by the confirmation alone"
    scan(page, "BAD-1")
    page.wait_for_selector(".lm-reason:visible")
    boxes = [one.bounding_box() for one in page.locator(".lm-answers .lm-button").all()]
    assert all(
        two["x"] >= one["x"] + one["width"] + GAP_PX or two["y"] >= one["y"] + one["height"] + GAP_PX
        for one, two in pairwise(boxes)
    ), "nobody gives another reason by a slip of the finger"
    page.click(".lm-cancel")
    page.wait_for_selector(".lm-refused", state="hidden")
    assert shown(page, "FAIL"), "who cancels leaves the unit alone"
    scan(page, "BAD-1")
    page.click("text=seating of the unit")
    shown(page, "STARTING", "TESTING")
    assert shown(page, "FAIL") == "FAIL"
    unit, attempt = page.inner_text(".lm-serial").split(" · ")
    assert (unit, "attempt 2" in attempt) == ("BAD-1", True)


def test_a_bad_unit_is_put_away_by_the_code_on_the_box_and_the_page_says_by_whom(page: playwright.Page) -> None:
    page.wait_for_selector(".lm-nok:visible")
    page.evaluate(FAST, "nok")
    page.wait_for_selector(".lm-tile.lm-put-away")
    page.wait_for_selector(".lm-nok", state="hidden")
    for _ in range(2):
        assert "the operator" in page.inner_text(".lm-confirmed")
        assert page.inner_text(".lm-do") == SCAN_NEXT
        page.reload()
        page.wait_for_selector(".lm-tile.lm-put-away .lm-confirmed")
    page.evaluate(FAST, "NOK")
    refused(page, NO_BAD_UNIT)
    assert shown(page, "FAIL"), "a bad unit was confirmed, and nothing was started"
    scan(page, "SN-3")
    shown(page, "STARTING", "TESTING")
    shown(page, "PASS")
    assert page.locator(".lm-put-away, .lm-confirmed, .lm-nok:visible").count() == 0


def test_what_is_typed_slowly_and_what_is_no_serial_number_starts_nothing(page: playwright.Page) -> None:
    page.keyboard.type("SN-9", delay=120)
    page.keyboard.press("Enter")
    refused(page, TYPED)
    assert "SN-9" in page.inner_text(".lm-scanned")
    page.evaluate(FAST, "x")
    refused(page, TYPED)
    page.focus(".lm-cancel")
    page.keyboard.press(" ")  # a blank alone is no scan: it presses the button that has the focus
    page.wait_for_selector(".lm-refused", state="hidden")
    for ask in (lambda text: scan(page, text), lambda text: page.evaluate(FAST, text)):
        ask("sn?8")
        refused(page, "No model has serial numbers like")
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
        with page.expect_download() as asked:
            page.click("text=These runs with their metrics, as CSV")
        assert "BAD-1" in Path(asked.value.path()).read_text("utf-8"), "what is looked for, as a table"
        assert "SN-4" not in Path(asked.value.path()).read_text("utf-8")
        address = page.wait_for_selector('a[aria-label^="report of BAD-1"]').get_attribute("href")
        page.goto(f"{station.url}{address}")
        assert "BAD-1" in page.inner_text("main")
    finally:
        page.goto(f"{station.url}/")
        page.wait_for_selector(".lm-word")
    shown(page, "PASS")


def test_a_badge_on_the_page_hands_the_bench_over_and_its_pin_lets_in(page: playwright.Page) -> None:
    page.evaluate(FAST, BADGE)
    page.wait_for_url("**/enter")
    assert BADGE not in page.url
    page.fill("#pin", "0000")
    page.keyboard.press("Enter")
    page.wait_for_selector("#why >> text=badge or PIN is wrong")
    page.click("#languages >> text=Deutsch")
    page.wait_for_selector("text=Oder Ausweis scannen.")
    page.evaluate(FAST, BADGE)
    page.fill("#pin", PIN)
    page.keyboard.press("Enter")
    page.wait_for_selector(".lm-word")
    assert shown(page, "IN ORDNUNG")
    scan(page, "of no model")
    refused(page, "Zu keinem Typ passt die Seriennummer")
    page.click("text=English")
    assert shown(page, "PASS")


def test_a_run_is_stopped_by_one_click_and_its_unit_is_decided_by_nobody(page: playwright.Page) -> None:
    assert page.locator(".lm-stop:visible").count() == 0, "there is nothing to stop"
    scan(page, "SN-5")
    page.wait_for_selector(".lm-stop:visible")
    page.focus(".lm-stop")
    scan(page, "SN-6 ")
    refused(page, "A run is in progress")
    assert page.locator(".lm-stop:visible").count() == 1, "no key of a scan presses it"
    page.dblclick(".lm-stop")
    page.wait_for_selector(f".lm-refused:visible >> text={STOPPING}")
    assert shown(page, "STOPPED", "BENCH FAULT") == "STOPPED", "pressed twice it is a controlled stop all the same"
    assert page.locator(".lm-tile.OPEN").count() == 1
    page.wait_for_selector(".lm-stop", state="hidden")
    page.wait_for_selector(".lm-refused", state="hidden")


@pytest.mark.parametrize("width", [1024, 1280, 1920])
def test_the_bar_is_one_line_on_a_smaller_screen_too(enter: Enter, width: int) -> None:
    page = enter("technician")
    page.set_viewport_size({"width": width, "height": width * 9 // 16})
    page.wait_for_function("() => document.querySelector('.lm-bar').offsetHeight < 60")
    assert page.evaluate("document.documentElement.scrollHeight <= innerHeight")
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


@pytest.mark.parametrize(("width", "language"), [(390, "de"), (390, "en"), (768, "de")])
def test_no_page_scrolls_sideways_as_a_whole_on_a_telephone(
    station: Served, enter: Enter, width: int, language: str
) -> None:
    page = enter("admin")
    page.click(f".lm-language[lang={language}]")
    page.wait_for_selector(f".lm-language[lang={language}][aria-pressed=true]")
    page.set_viewport_size({"width": width, "height": 844})
    station.log_in("operator")
    run = station.http.get("/api/runs").json()["runs"][0]["run"]
    found = {}
    for address in (*PAGES.values(), "/recipes/good/1", f"/runs/{run}", "/enter"):
        page.goto(f"{station.url}{address}")
        page.wait_for_load_state("networkidle")
        found[address] = page.evaluate("document.documentElement.scrollWidth")
    assert found == dict.fromkeys(found, width)


def test_axe_finds_nothing_serious_on_any_page(station: Served, enter: Enter) -> None:
    page = enter("technician")
    station.log_in("operator")
    run = station.http.get("/api/runs").json()["runs"][0]["run"]
    found = {}
    for address in ("/", *PAGES.values(), "/recipes/good/1", f"/runs/{run}", f"/api/runs/{run}/report.html", "/enter"):
        page.goto(f"{station.url}{address}")
        page.wait_for_load_state("networkidle")
        told = Axe().run(page, options={"resultTypes": ["violations"]}).response["violations"]
        serious = [one for one in told if one["impact"] in ("serious", "critical")]
        found |= {f"{address} {one['id']}": one["nodes"][0]["html"] for one in serious}
    assert found == {}


def test_nobody_sees_the_bench_after_the_end_of_a_session(station: Served, page: playwright.Page) -> None:
    asked = []

    def slowly(route: playwright.Route) -> None:
        asked.append(route.request.url)
        time.sleep(2.0 * SESSION_EVERY_S)  # a busy computer: a page that asks again meanwhile breaks its own way off
        route.continue_()

    page.route("**/enter", slowly)
    with closing(sqlite3.connect(Path(station.data) / "station.sqlite3")) as database, database:
        database.execute("UPDATE sessions SET ends_s = 0")
    page.wait_for_url("**/enter")
    assert len(asked) == 1
