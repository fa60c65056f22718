"""The live page: its loop grows by what is new, a lost connection costs nothing, and a server is soon found again."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from browser import Enter, needs_browser, playwright
from served import Served, prepared, served

from station.web.pages.frame import LONGEST_PAUSE_MS

pytestmark = [pytest.mark.wires, pytest.mark.long, needs_browser]

TOLD = """() => { const show = window.showLoop; window.told = [];
window.showLoop = (id, first, points) => { told.push([first, points.length]); show(id, first, points); }; }"""
DRAWN = """() => { const node = document.querySelector('.nicegui-echart');
return getElement(node.id.slice(1)).chart.getOption().series[0].data; }"""
CUT = """pause_ms => { const manager = socket.io; manager.randomizationFactor(0);
manager.reconnectionDelayMax(pause_ms); manager.reconnectionDelay(pause_ms); manager.engine.close(); }"""
AWAY_S = 6.0
"""Twice as long as NiceGUI keeps a page by itself, whose connection was lost."""


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(prepared(tmp_path_factory.mktemp("live") / "runs")) as found:
        yield found


@pytest.fixture(scope="module")
def page(enter: Enter) -> playwright.Page:
    return enter("operator")


def shows(page: playwright.Page, *words: str) -> None:
    page.wait_for_function("words => words.includes(document.querySelector('.lm-word')?.innerText)", arg=list(words))


def test_each_point_of_the_loop_is_sent_once_and_whoever_comes_later_sees_all(
    page: playwright.Page, enter: Enter
) -> None:
    page.evaluate(TOLD)
    page.keyboard.type("]d221SN-1")
    page.keyboard.press("Enter")
    shows(page, "TESTING")
    shows(page, "PASS")
    page.wait_for_function(f"() => told.length && ({DRAWN})().length === told.at(-1)[0] + told.at(-1)[1]")
    told, drawn = page.evaluate("told"), page.evaluate(DRAWN)
    assert len(told) > 1, "it grows"
    ends = [0, *(first + count for first, count in told)]
    assert [first for first, _ in told] == ends[:-1], "each begins where the one before ended"
    assert len(drawn) == ends[-1]
    later = enter("operator")
    later.wait_for_function(f"length => ({DRAWN})().length === length", arg=len(drawn))
    assert later.evaluate(DRAWN) == drawn
    later.close()


def test_the_loop_of_the_next_run_begins_anew(page: playwright.Page) -> None:
    page.evaluate("told.length = 0")
    page.keyboard.type("]d221SN-2")
    page.keyboard.press("Enter")
    shows(page, "TESTING")
    shows(page, "PASS")
    page.wait_for_function(f"() => told.length && ({DRAWN})().length === told.at(-1)[0] + told.at(-1)[1]")
    told = page.evaluate("told")
    assert told[0] == [0, 0], "what was drawn of the run before goes with it"
    assert len(page.evaluate(DRAWN)) == sum(count for _, count in told)


def test_a_page_tries_often_to_reach_a_server_that_is_away(page: playwright.Page) -> None:
    assert page.evaluate("socket.io.reconnectionDelayMax()") == LONGEST_PAUSE_MS


def test_a_page_keeps_no_marks_of_time_and_its_rules_come_without_a_script(page: playwright.Page) -> None:
    """A script that makes rules for classes marks each of its looks at the page, ten a second; browsers keep them."""
    assert page.evaluate("['mark', 'measure'].map(kind => performance.getEntriesByType(kind).length)") == [0, 0]
    bare = page.evaluate("""() => ['ul', 'p', 'button'].map(name => {
        const style = getComputedStyle(document.querySelector('main').appendChild(document.createElement(name)));
        return [style.listStyleType === 'none' || name !== 'ul', style.margin, style.borderWidth].join(' '); })""")
    assert set(bare) == {"true 0px 0px"}
    page.evaluate("document.querySelectorAll('main > ul, main > p, main > button').forEach(one => one.remove())")


def test_a_page_that_was_away_for_a_while_is_as_it_was(page: playwright.Page) -> None:
    page.evaluate("window.marked = true")
    page.evaluate(CUT, 1000.0 * AWAY_S)
    page.wait_for_function("() => !socket.connected")
    page.wait_for_function("() => socket.connected")
    page.keyboard.type("]d221SN-3")
    page.keyboard.press("Enter")
    shows(page, "STARTING", "TESTING")
    shows(page, "PASS")
    assert page.evaluate("window.marked"), "it was not loaded anew"
    assert "SN-3" in page.inner_text(".lm-serial")


def test_a_server_that_was_just_started_draws_the_loop_of_the_run_from_its_record(
    station: Served, page: playwright.Page
) -> None:
    station.kill()
    with served(station.data) as again:
        later = page.context.new_page()
        later.goto(f"{again.url}/")
        shows(later, "PASS")
        later.wait_for_function(f"() => ({DRAWN})().length > 100")
        later.wait_for_selector(".lm-right:not(.lm-not-drawn) .nicegui-echart")
        later.close()


def test_axes_without_a_loop_stand_beside_no_verdict(station: Served, page: playwright.Page) -> None:
    newest = max(one.parent for one in station.data.glob("*/run.json"))
    (newest / "samples.parquet").write_bytes(b"")
    with served(station.data) as again:
        later = page.context.new_page()
        later.goto(f"{again.url}/")
        later.wait_for_selector(".lm-word")
        later.wait_for_selector(".lm-right.lm-not-drawn", state="attached")
        later.close()
