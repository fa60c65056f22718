"""The label of a good unit in a real browser: printed, awaited, and read back by a scan."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import needs_browser, opened, playwright
from label_setup import released_text, set_up
from served import Served, prepared, served
from stored_runs import metric, store_run
from test_start_in_browser import SCAN
from zpl_printer import ZplPrinter, printing

from station.records.certificate_code import code_of

pytestmark = [pytest.mark.wires, pytest.mark.long, needs_browser]


@pytest.fixture(scope="module")
def printer() -> Iterator[ZplPrinter]:
    with printing() as found:
        yield found


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory, printer: ZplPrinter) -> Iterator[Served]:
    data = prepared(tmp_path_factory.mktemp("labels") / "runs")
    set_up(data, printer.port)
    with served(data) as found:
        found.log_in("operator")
        yield found


@pytest.fixture(scope="module")
def page(bench: Served) -> Iterator[playwright.Page]:
    with opened(bench.url) as enter:
        yield enter("operator")


def seal(data: Path, serial: str) -> str:
    return code_of(store_run(data, serial, [metric(0.4)], text=released_text(data)))


def test_the_label_is_scanned_before_the_next_unit(bench: Served, page: playwright.Page, printer: ZplPrinter) -> None:
    code = seal(bench.data, "SN-1")
    page.wait_for_selector("text=The label of unit SN-1 was not read yet.")
    page.wait_for_selector(".lm-do :text('scan it'), .lm-do:text('scan it')")
    assert len(printer.printed) == 1
    page.evaluate(SCAN, "SN-2")
    page.wait_for_selector(".lm-refused :text('was not read yet')")
    page.evaluate(SCAN, code)
    page.wait_for_selector("text=The label of unit SN-1 is on it. Scan the next unit.")
    assert bench.now()["label"] is None


def test_a_label_that_may_have_come_out_is_printed_again_by_hand(
    bench: Served, page: playwright.Page, printer: ZplPrinter
) -> None:
    printer.cut = True
    code = seal(bench.data, "SN-3")
    page.wait_for_selector("text=may be printed or not")
    printer.cut = False
    page.evaluate(SCAN, "SN-4")
    page.click("text=Print the label again")
    page.wait_for_selector("text=The label of unit SN-3 was not read yet.")
    assert len(printer.printed) == 2
    assert "copy 2" in printer.printed[-1]
    page.evaluate(SCAN, code)
    page.wait_for_selector("text=The label of unit SN-3 is on it.")


def test_what_is_printed_again_is_the_label_of_which_the_page_tells(
    bench: Served, page: playwright.Page, printer: ZplPrinter
) -> None:
    """The button stands there for a label that was read meanwhile, as on another page, and the next unit is done."""
    code = seal(bench.data, "SN-5")
    page.wait_for_selector("text=The label of unit SN-5 was not read yet.")
    page.evaluate(SCAN, "SN-6")
    page.wait_for_selector("text=Print the label again")
    assert bench.post("read_label", {"scanned": code}, "meanwhile").status_code == 200
    there = len(printer.printed)
    seal(bench.data, "SN-6")
    printer.wait_for(there + 1)
    page.wait_for_selector("text=The label of unit SN-6 was not read yet.")
    page.click("text=Print the label again")
    page.wait_for_selector("text=Print the label again", state="hidden")
    assert bench.now()["label"]["stage"] == "printed"
    assert not [one for one in printer.printed if "SN-6" in one and "copy" in one]
