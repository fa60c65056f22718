"""What is done with a unit is said as its recipe says it: on the page, at the terminal, else as the program does."""

from __future__ import annotations

from pathlib import Path

import pytest
from browser import needs_browser, opened
from served import prepared, served
from station_support import released, write_models

from recipes import RecipeError
from recipes.shipped import parse_recipe
from station.cli.measure.at_terminal import AtTerminal
from station.cli.measure.line import DO, to_do

SAID = "Red box at gate 3 <b>. Tell the shift leader."
OWN = f"what_to_do: {{passed: '{SAID}', failed: '{SAID}'}}\n"


def written(data: Path, more: str) -> Path:
    """Write the recipes of the tests with something more in the good one, and release it; return the recipe."""
    write_models(data)
    recipe = data.parent / "recipes" / "good.yaml"
    text = recipe.read_text("utf-8").replace("revision: 1", "revision: 2") + f"\n{more}"
    recipe.write_text(text, encoding="utf-8")
    return recipe


def test_a_recipe_says_what_is_done_and_at_the_terminal_how_a_bad_unit_is_put_away(tmp_path: Path) -> None:
    recipe = written(tmp_path / "runs", OWN)
    found = parse_recipe(recipe.read_bytes(), str(recipe)).what_to_do
    assert [found.after(one) for one in ("PASS", "FAIL", "NOT DECIDABLE", None)] == [SAID, SAID, "", ""]
    bench = AtTerminal(tmp_path / "runs", (str(recipe), ""))
    own = {one: bench.to_do_after(one) for one in DO}
    assert [to_do(own[one], one) for one in ("PASS", "NOT DECIDABLE")] == [SAID, DO["NOT DECIDABLE"]]
    assert not any(bench.to_do_with_part("SN-1", one) for one in DO), "it is no master part"
    assert to_do(own["FAIL"], "FAIL") == f"{SAID} Then scan the code on the NOK box, or type NOK."
    assert to_do(AtTerminal(tmp_path / "runs").to_do_after("FAIL"), "FAIL") == DO["FAIL"]


@pytest.mark.parametrize("more", ["what_to_do: {failed: 'a\\tb'}", f"what_to_do: {{failed: {'x' * 121}}}"])
def test_what_no_screen_can_show_in_a_line_is_refused(tmp_path: Path, more: str) -> None:
    recipe = written(tmp_path / "runs", more.replace("'a\\tb'", '"a\\tb"'))
    with pytest.raises(RecipeError, match=r"what_to_do\.failed"):
        parse_recipe(recipe.read_bytes(), str(recipe))


@pytest.mark.parametrize("hidden", [r"\x9b2J", r"\u202e", r"\u2066", r"\u2028", r"\x85"])
def test_what_moves_the_cursor_or_turns_the_text_round_is_refused(tmp_path: Path, hidden: str) -> None:
    recipe = written(tmp_path / "runs", f'what_to_do: {{failed: "Put it {hidden} away"}}')
    with pytest.raises(RecipeError, match=r"what_to_do\.failed"):
        parse_recipe(recipe.read_bytes(), str(recipe))


@pytest.mark.wires
@pytest.mark.long
@needs_browser
def test_the_page_says_it_below_the_verdict(tmp_path: Path) -> None:
    data = prepared(tmp_path / "runs")
    released(data, written(data, OWN).read_bytes())
    with served(data) as station, opened(station.url) as enter:
        page = enter("operator")
        page.keyboard.type("]d221SN-1")
        page.keyboard.press("Enter")
        page.wait_for_function("() => document.querySelector('.lm-word').innerText === 'PASS'")
        assert page.inner_text(".lm-do") == SAID, "a text, and never a part of the page"
