"""What the operator's page says of a result: one line for a metric beyond its limit, and the side that decides."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator
from types import SimpleNamespace

import pytest
from browser import launched, needs_browser, playwright
from made_documents import metric

from station.documents.result import Limits, MetricValue, SideValue
from station.web.languages import ENGLISH, words_of
from station.web.pages.frame import HERE
from station.web.pages.operator_text import beyond_lines, metrics_table

SAY = words_of(ENGLISH)


def backlash(plus: float, minus: float, limit: float = 1.0) -> MetricValue:
    """Return a metric of two sides with a limit above, as an evaluation leaves it: its own side is the first."""
    verdicts = {side: "FAIL" if value > limit else "PASS" for side, value in (("+", plus), ("-", minus))}
    why = "arcmin is above the limit of 1 arcmin: the unit has more play than allowed"
    return dataclasses.replace(
        metric(),
        id="backlash_width_3pct",
        value=plus,
        unit="arcmin",
        title="Backlash (loop width)",
        side="+",
        uncertainty=None,
        limits=Limits(max=limit),
        verdict="FAIL" if "FAIL" in verdicts.values() else "PASS",
        sides={"+": SideValue(value=plus, verdict=verdicts["+"]), "-": SideValue(value=minus, verdict=verdicts["-"])},
        reasons=tuple(
            f"backlash_width_3pct, side {side}: {value} {why}"
            for side, value in (("+", plus), ("-", minus))
            if verdicts[side] == "FAIL"
        ),
    )


@pytest.mark.parametrize(
    ("plus", "minus", "said"),
    [
        (1.16, 1.17, "Backlash 1.17 > 1 arcmin (both sides)"),
        (1.18, 1.17, "Backlash 1.18 > 1 arcmin (both sides)"),
        (0.9, 1.17, "Backlash 1.17 > 1 arcmin (side \N{MINUS SIGN})"),
        (0.9, 0.8, None),
    ],
)
def test_both_sides_of_a_metric_beyond_its_limit_are_one_line(plus: float, minus: float, said: str | None) -> None:
    lines, told = beyond_lines(backlash(plus, minus), SAY)
    assert lines == ([] if said is None else [said])
    assert told == set(backlash(plus, minus).reasons), "none is said twice, and none is left out"


def test_a_reason_that_is_no_figure_beyond_a_limit_is_left_as_it_is() -> None:
    near = dataclasses.replace(backlash(0.9, 0.9), reasons=("backlash_width_3pct, side +: something else",))
    assert beyond_lines(near, SAY) == ([], set())


def test_a_value_below_its_limit_is_said_by_the_lowest_side_and_in_german_with_a_comma() -> None:
    below = "{}.5 N·m/arcmin is below the limit of -2.5 N·m/arcmin: the unit is too soft"
    reasons = tuple(f"k, side {side}: {below.format(value)}" for side, value in (("+", -3), ("-", -4)))
    lines, _ = beyond_lines(dataclasses.replace(backlash(0.9, 0.9), reasons=reasons), words_of("de"))
    assert lines == ["Backlash −4,5 < −2,5 N·m/arcmin (beide Seiten)"]


@pytest.mark.parametrize(
    ("plus", "minus", "shown", "named"),
    [(0.9, 1.17, "1.17", True), (1.17, 0.9, "1.17", True), (1.1, 1.17, "1.17", False), (0.5, 0.25, "0.5", False)],
)
def test_the_table_shows_the_side_that_decides_and_names_it_where_not_both_do(
    plus: float, minus: float, shown: str, *, named: bool
) -> None:
    cells = re.findall("<td.*?>(.*?)</td>", metrics_table(SimpleNamespace(metrics=(backlash(plus, minus),)), SAY))
    assert cells[1] == shown
    assert ("side" in cells[0]) == named
    assert cells[4] == ("FAIL" if max(plus, minus) > 1 else "PASS")


@pytest.fixture(scope="module")
def browser() -> Iterator[playwright.Browser]:
    with launched() as found:
        yield found


@needs_browser
@pytest.mark.parametrize("width", [1024, 1280, 1920])
def test_no_verdict_is_cut_on_any_screen_in_any_language(browser: playwright.Browser, width: int) -> None:
    sides = {side: SideValue(value=-113.96, verdict="NOT DECIDABLE") for side in ("+", "-")}
    what = {"unit": "N·m/arcmin", "title": "Torque ratio, offset", "uncertainty": 0.37, "sides": sides}
    one = dataclasses.replace(backlash(0.9, 0.9), limits=Limits(min=-125.0), **what)
    table = metrics_table(SimpleNamespace(metrics=(one,) * 5), words_of("de"))
    style = (HERE / "style.css").read_text(encoding="utf-8")
    parts = ('<main class="lm-main">', '<section class="lm-left">', '<div class="lm-why">', "</div></section></main>")
    shown = "".join((f"<style>{style}</style>", *parts[:-1], table, parts[-1]))
    page = browser.new_page(viewport={"width": width, "height": width * 9 // 16})
    page.set_content(shown)
    assert "ENTSCHEIDBAR" in page.inner_text(".lm-why td:last-child >> nth=0")
    assert page.evaluate("(one => one.scrollWidth <= one.clientWidth)(document.querySelector('.lm-why'))")
