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


def test_what_was_typed_is_there_in_the_language_that_is_chosen_then(station: Served, enter: Enter) -> None:
    page = enter("quality")

    def choose(language: str) -> None:
        page.click(f'.lm-language[lang="{language}"]')
        page.wait_for_selector(f'.lm-language[lang="{language}"][aria-pressed="true"]')

    page.goto(f"{station.url}/quality")
    for language in ("de", "en"):
        choose(language)  # with the tab that is open at first
    page.get_by_role("tab", name="Guided studies").click()
    typed = {"Name of the study": "grr-1", "Serial numbers, with commas": "SN-1, SN-2"}
    typed["Trials (empty: 50 for type 1, 3 for gage)"] = "2"
    for label, value in typed.items():
        page.get_by_label(label).fill(value)
    page.keyboard.press("Tab")
    page.wait_for_timeout(SETTLE_MS)
    for language in ("de", "zh"):
        choose(language)
        say = words_of(language)
        page.wait_for_selector(f"[role=tab][aria-selected=true]:has-text('{say('Guided studies')}')")
        for label, value in typed.items():
            page.wait_for_function(
                "([label, value]) => [...document.querySelectorAll('input')]"
                ".some(one => one.ariaLabel === label && one.value === value)",
                arg=[say(label), value],
            )
    page.goto(f"{station.url}/certificates")
    page.fill(".lm-code input", "an unfinished code")
    page.wait_for_timeout(SETTLE_MS)
    choose("en")
    page.wait_for_function("document.querySelector('.lm-code input').value === 'an unfinished code'")
    page.reload()
    page.wait_for_timeout(SETTLE_MS)
    assert page.input_value(".lm-code input") == "", "kept for the choice of a language alone"


def test_nothing_of_the_bar_lies_over_its_entries_on_a_small_screen(enter: Enter) -> None:
    page = enter("technician")
    page.set_viewport_size({"width": 1024, "height": 768})
    page.click('.lm-language[lang="de"]')
    page.wait_for_selector('.lm-language[lang="de"][aria-pressed="true"]')
    page.wait_for_selector(".lm-bar > :nth-child(2):has-text(':')")
    ends = page.evaluate("""() => [...document.querySelectorAll('.lm-bar nav a, .lm-bar > :nth-child(2), .lm-language')]
        .map(one => one.getBoundingClientRect()).map(box => [box.left, box.right])""")
    assert all(one[1] <= two[0] for one, two in pairwise(ends)), ends
