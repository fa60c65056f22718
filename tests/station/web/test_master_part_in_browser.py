"""A bad master part that passes stops production: nobody's unit starts, in the browser, until the part reads right."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from browser import Enter, needs_browser, playwright
from served import Served, prepared, served
from station_support import MODELS

from recipes.shipped import find_bench
from station.records.master_parts import NOT_AS_IT_SHOULD

pytestmark = [pytest.mark.wires, pytest.mark.long, needs_browser]

MASTER = "BAD-1"
"""Of the model BAD: its recipe fails it, as it should, until a recipe with wrong limits is released."""

SCAN = """text => [...text, "Enter"].forEach(
    key => document.body.dispatchEvent(new KeyboardEvent("keydown", {key, bubbles: true, cancelable: true})))"""


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    data = prepared(tmp_path_factory.mktemp("master") / "runs")
    bench = data.parent / "bench.yaml"
    part = f"\nmaster_parts:\n  - {{serial: {MASTER}, expect: FAIL, every: 8 h}}\n"
    bench.write_text(find_bench("virtual").read_text("utf-8") + part, encoding="utf-8")
    recipes = data.parent / "recipes"
    rows = MODELS.replace("RECIPES/bad.yaml", "RECIPES/good.yaml")  # limits that nobody fails: the bad part passes
    text = rows.replace("RECIPES", str(recipes)).replace("attempts: 2", f"bench: {bench}, attempts: 2")
    (data / "models.yaml").write_text(text, encoding="utf-8")
    with served(data) as found:
        found.log_in("operator")
        yield found


def scan(page: playwright.Page, text: str) -> None:
    page.evaluate("document.querySelectorAll('.lm-refused *').forEach(one => one.dataset.seen = '')")
    page.evaluate(SCAN, text)


def refused(page: playwright.Page) -> str:
    page.wait_for_selector(".lm-refused:visible *:not([data-seen])")
    return str(page.inner_text(".lm-refused"))


def test_a_bad_master_part_that_passes_stops_production(station: Served, enter: Enter) -> None:
    page = enter("operator")
    scan(page, "SN-1")
    assert f"Master part {MASTER} was never measured on this bench" in refused(page)
    scan(page, MASTER)  # a master part may always be measured
    station.wait("running")
    assert station.wait("ended")["verdict"] == "PASS", "it should not"
    page.wait_for_function("() => document.querySelector('.lm-word').innerText === 'PASS'")
    assert page.inner_text(".lm-do") == NOT_AS_IT_SHOULD, "a green tile alone would send it back to its place"
    for serial in ("SN-1", "BAD-2"):
        page.wait_for_timeout(500)
        scan(page, serial)
        said = refused(page)
        assert f"Master part {MASTER} read PASS, and FAIL is right" in said
        assert "this bench may measure wrong" in said
    assert len(list(station.data.glob("*/run.json"))) == 1, "nothing was begun"
    scan(page, MASTER)  # and measured again it stops it again: not by a button is production let go on
    station.wait("running")
    station.wait("ended")
    scan(page, "SN-1")
    assert "FAIL is right" in refused(page)
