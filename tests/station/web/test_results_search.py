"""What is looked for on the page of results is there again after Back, and from the bar of another page."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from browser import Enter, needs_browser
from served import Served, prepared, served
from stored_runs import metric, store_run

pytestmark = [pytest.mark.wires, pytest.mark.long, needs_browser]
FIELD = "input[aria-label='Serial number begins with']"


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    data = prepared(tmp_path_factory.mktemp("search") / "runs")
    for number in range(4):
        failed = "lost_motion" if number % 2 else None
        verdict = "FAIL" if failed else "PASS"
        store_run(data, f"{'AB'[number // 2]}{number}", [metric(1.5, verdict=verdict)], day=number, failed=failed)
    with served(data) as found:
        yield found


def test_a_search_survives_back_and_the_bar(station: Served, enter: Enter) -> None:
    page = enter("quality")
    page.goto(f"{station.url}/results")
    page.wait_for_selector(".ag-row >> nth=3")
    page.fill(FIELD, "B")
    page.wait_for_url("**/results?serial=B")
    page.wait_for_function("document.querySelectorAll('.ag-center-cols-container .ag-row').length === 2")
    page.wait_for_selector(".ag-cell[col-id=notes]:has-text('Lost motion')")
    page.click("a[href^='/runs/']:has-text('B3')")
    page.wait_for_selector(".lm-tile")
    for back in (page.go_back, lambda: page.click("nav >> text=Results")):
        back()
        page.wait_for_url("**/results?serial=B")
        page.wait_for_function("document.querySelectorAll('.ag-center-cols-container .ag-row').length === 2")
        assert page.input_value(FIELD) == "B"
        page.click("nav >> text=Maintenance")
        page.wait_for_url("**/maintenance")
        page.wait_for_selector(".lm-tile")
    page.click("nav >> text=Results")
    page.wait_for_url("**/results?serial=B")
    page.wait_for_selector(".ag-row")
    page.click("nav >> text=Results")
    page.wait_for_selector(".ag-row >> nth=3")
    assert page.input_value(FIELD) == "", "on the page itself the bar leads to all runs"


@pytest.mark.parametrize("first", ["5000", "1" + 30 * "0", "-1"])
def test_an_address_behind_the_last_run_leads_to_the_last_ones(station: Served, enter: Enter, first: str) -> None:
    page = enter("quality")
    page.goto(f"{station.url}/results?first={first}")
    page.wait_for_selector(".ag-row >> nth=3")
    assert "1 to 4 of 4 runs" in page.inner_text(".lm-pager")
    page.context.close()
