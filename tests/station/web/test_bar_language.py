"""Every page and its bar are in the person's language, and the bar offers the others."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import pytest
from browser import Enter, needs_browser
from served import Served, prepared, served

from station.web.languages import LANGUAGES, messages, words_of
from station.web.pages.frame import PAGES

pytestmark = [pytest.mark.wires, pytest.mark.long, needs_browser]


SETTLE_MS = 300
SHOWN = """() => {
    const all = document.createTreeWalker(document.querySelector('main'), NodeFilter.SHOW_TEXT), found = [];
    while (all.nextNode())
        if (!all.currentNode.parentElement.closest('.cm-editor')) found.push(all.currentNode.textContent.trim());
    return [...found, ...[...document.querySelectorAll('main [aria-label]')].map(one => one.ariaLabel)];
}"""
"""The texts of a page and its labels, but for the text of a recipe."""


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(prepared(tmp_path_factory.mktemp("bar") / "runs")) as found:
        yield found


def test_every_page_and_its_bar_are_in_the_language_of_the_person(station: Served, enter: Enter) -> None:
    page, say = enter("admin"), words_of("de")
    page.click('.lm-language[lang="de"]')
    page.wait_for_selector('.lm-language[lang="de"][aria-pressed="true"]')
    expected = [say(name.capitalize()) for name in PAGES]
    english = {text for text, becomes in messages("de").items() if text != becomes}
    for address in (*PAGES.values(), "/recipes/rv-40e-121-quick/2"):
        page.goto(f"{station.url}{address}")
        page.wait_for_selector(".lm-bar .lm-nav a")
        assert page.locator(".lm-bar nav a").all_inner_texts() == expected, address
        assert page.locator(".lm-language").count() == len(LANGUAGES), address
        page.wait_for_timeout(SETTLE_MS)
        assert english.intersection(page.evaluate(SHOWN)) == set(), address


def test_nothing_of_the_bar_lies_over_its_entries_on_a_small_screen(enter: Enter) -> None:
    page = enter("technician")
    page.set_viewport_size({"width": 1024, "height": 768})
    page.click('.lm-language[lang="de"]')
    page.wait_for_selector('.lm-language[lang="de"][aria-pressed="true"]')
    page.wait_for_selector(".lm-bar > :nth-child(2):has-text(':')")
    ends = page.evaluate("""() => [...document.querySelectorAll('.lm-bar nav a, .lm-bar > :nth-child(2), .lm-language')]
        .map(one => one.getBoundingClientRect()).map(box => [box.left, box.right])""")
    assert all(one[1] <= two[0] for one, two in pairwise(ends)), ends
