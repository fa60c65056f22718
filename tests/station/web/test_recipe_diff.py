"""The difference of two texts: every line of both once, each by its sign, and text stays text."""

from __future__ import annotations

import re

from hypothesis import given
from hypothesis import strategies as st

from station.web.languages import ENGLISH, words_of
from station.web.pages.recipes.diff import NOTHING, diff_html

LINES = st.lists(st.sampled_from(["a: 1", "b: <2>", "", "c: 3  # &"]), max_size=12)


@given(LINES, LINES)
def test_what_came_in_and_what_was_taken_out_makes_one_text_of_the_other(before: list[str], now: list[str]) -> None:
    html = diff_html("\n".join(before), "\n".join(now), words_of(ENGLISH))
    if "\n".join(before).splitlines() == "\n".join(now).splitlines():
        assert NOTHING in html
        return
    removed = [int(one) for one in re.findall(r'"lm-removed"><td>(\d+)</td><td></td>', html)]
    added = {int(one) for one in re.findall(r'"lm-added"><td></td><td>(\d+)</td>', html)}
    old, new = "\n".join(before).splitlines(), "\n".join(now).splitlines()
    left = [line for number, line in enumerate(old, 1) if number not in removed]
    assert left == [line for number, line in enumerate(new, 1) if number not in added]
    assert "<2>" not in html, "what stands in a text is no HTML"
