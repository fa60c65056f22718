"""The label of another unit is not asked for on the tile of a bad one, in a real browser and after a restart."""

from __future__ import annotations

from pathlib import Path

import pytest
from browser import needs_browser, opened
from label_setup import released_text, set_up
from served import prepared, served
from stored_runs import metric, store_run
from zpl_printer import printing

pytestmark = [pytest.mark.wires, pytest.mark.long, needs_browser]


def test_the_label_of_another_unit_is_not_asked_for_on_the_tile_of_a_bad_one(tmp_path: Path) -> None:
    data = prepared(tmp_path / "runs")
    with printing() as printer:
        set_up(data, printer.port)
        with served(data):
            store_run(data, "SN-1", [metric(0.4)], text=released_text(data))
            printer.wait_for(1)
        store_run(data, "SN-7", [metric(0.4)], day=2, text=released_text(data), failed="too wide")
        with served(data) as bench, opened(bench.url) as enter:
            page = enter("operator")
            page.wait_for_selector("text=The label of unit SN-1 was not read yet.")
            page.wait_for_selector(".lm-tile.FAIL:has-text('SN-7')")
            assert "NOK box" in page.inner_text(".lm-do")
