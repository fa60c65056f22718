"""The page of maintenance in a real browser: a run torn off under torque, and the recovery from it, step by step."""

from __future__ import annotations

import json
import os
import re
import signal
import sqlite3
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from browser import needs_browser, opened, playwright
from lostmotion_command import here
from patient import ONE_RAMP, short_recipe
from run_samples import records_of
from served import LONGEST_S, Served, served
from station_support import GOLDEN, open_database, released

from definitions.image import State

sys.path.append(str(Path(__file__).parents[2] / "end_to_end"))
from test_recover import Apart

pytestmark = [pytest.mark.wires, pytest.mark.long, needs_browser]


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A station whose bench is a virtual one that runs on by itself, as a bench on cables does."""
    place = tmp_path_factory.mktemp("maintenance")
    bench, data = Apart(place), place / "runs"
    recipe = short_recipe(place, ONE_RAMP)
    data.mkdir()
    released(data, recipe.read_bytes())
    models = f"models:\n  - {{model: P1, serial: 'SN-[0-9]+', recipe: '{recipe}', bench: '{bench.path}'}}\n"
    (data / "models.yaml").write_text(models, encoding="utf-8")
    open_database(data).close()
    try:
        with served(data, "--port", "0") as found:  # the bench keeps its own time
            found.log_in("operator")
            yield found
    finally:
        bench.stop()


@pytest.fixture(scope="module")
def page(station: Served) -> Iterator[playwright.Page]:
    with opened(station.url) as enter:
        page = enter("technician")
        page.goto(f"{station.url}/maintenance")
        page.wait_for_selector(".lm-not-live")
        yield page


def torn_off(station: Served) -> None:
    """Kill supervisor and scan of the run that is on, above 200 N·m."""
    until = time.monotonic() + LONGEST_S
    while True:
        assert time.monotonic() < until
        for described in station.data.glob("*/run.json"):
            table = records_of(described.parent)
            if len(table) > 0 and table[-1]["image"]["torque_out_nm"] > 200.0:
                os.kill(json.loads((described.parent / "scan-report.json").read_bytes())["pid"], signal.SIGKILL)
                desk = json.loads((described.parent / "run.json").read_bytes())["desk"]
                os.kill(desk["pid"], signal.SIGKILL)
                return
        time.sleep(0.05)


def audited(station: Served, action: str) -> list[tuple[str, str]]:
    with closing(sqlite3.connect(station.data / "station.sqlite3")) as database:
        rows = database.execute("SELECT name, outcome FROM audit WHERE action = ? ORDER BY number", (action,))
        return [(name, outcome) for name, outcome in rows]


def standings(page: playwright.Page) -> list[str]:
    return [str(one.get_attribute("class")) for one in page.query_selector_all(".lm-steps li")]


def test_values_are_live_while_a_run_is_on(station: Served, page: playwright.Page) -> None:
    assert station.post("start_run", {"scanned": "SN-1"}, "start").status_code == 200
    page.wait_for_selector(".lm-live")
    page.wait_for_selector("section[aria-label='Servo drive'] td:has-text('operation enabled')")
    page.wait_for_selector(".lm-limits tr:has-text('Output torque above its trip limit') .lm-share")
    torn_off(station)
    page.wait_for_selector(".lm-not-live")
    of_another_bench = ("--serial", "W-1", "--virtual-time", "--no-report", "--data", str(station.data))
    here("run", str(GOLDEN), *of_another_bench)
    assert list(station.data.glob("*-W-1/result.json"))


def test_the_way_back_is_gone_step_by_step_with_the_torque_that_is_left(station: Served, page: playwright.Page) -> None:
    refused = station.post("start_run", {"scanned": "SN-2"}, "too early")
    assert [one["id"] for one in refused.json()["refused"]] == ["bench_recovered"]
    assert station.post("begin_recovery", {}, "not mine").status_code == 403
    page.wait_for_selector(".lm-steps")
    assert standings(page) == ["now", *["to-come"] * 5]
    page.click("text=Begin the recovery")
    acknowledge = page.get_by_role("button", name="All is checked: acknowledge")
    acknowledge.wait_for()
    assert standings(page)[:3] == ["done", "now", "now"]
    torque = re.search(r"([+−]\d+\.\d) N·m", page.inner_text(".lm-wide .lm-serial"))
    assert torque is not None
    assert abs(float(torque[1].replace("−", "-"))) > 4.12, "friction keeps some of the torque behind the lock"
    assert page.inner_text(".lm-live").startswith("LIVE")
    assert page.locator("section[aria-label^='Alarm']").count() >= 1
    acknowledge.click()
    page.wait_for_selector(".lm-steps li:nth-child(6).now")
    assert standings(page) == [*["done"] * 5, "now"]
    record = max((station.data / "recoveries").glob("*/run.json")).parent
    table = records_of(record)
    assert table["orders"]["state"][-1] == State.STOPPED
    assert table["image"]["brake_on"][-1] == 0
    assert json.loads((record / "run.json").read_bytes())["operator"] == "the technician"
    assert ("the technician", "done") in audited(station, "acknowledge_fault")
    assert audited(station, "begin_recovery")[0] == ("the operator", "refused")
    page.wait_for_selector(".lm-not-live")  # its record is sealed: until then the recovery is in progress
    again = station.post("start_run", {"scanned": "SN-2"}, "free again")
    assert again.status_code == 200, again.text
    station.wait("running", "ended")


def test_a_certificate_is_checked_by_its_code(station: Served, page: playwright.Page) -> None:
    run = max(station.data.glob("*/run.json")).parent.name
    page.goto(f"{station.url}/certificates")
    code = page.get_by_label("Code of the certificate")
    for text, shown in (
        ("SN-1", ".lm-refused"),
        (f"LM1.{'0' * 64}.20200101T000000.000Z-NONE", ".lm-tile.OPEN >> text=UNKNOWN"),
        (f"LM1.{'0' * 64}.{run}", ".lm-tile.FAIL >> text=ALTERED"),
    ):
        code.fill(text)
        page.keyboard.press("Enter")
        page.wait_for_selector(f"{shown}")


def test_the_page_says_that_it_loads_until_the_first_look_has_come(station: Served, page: playwright.Page) -> None:
    """A page whose connection is not there yet, as on a computer that does other things: no empty cards."""
    cut = page.context.new_page()
    cut.route_web_socket(re.compile("socket"), lambda _: None)
    cut.goto(f"{station.url}/maintenance")
    cut.wait_for_selector(".lm-loading >> nth=6")
    assert {one.inner_text() for one in cut.locator(".lm-loading").all()} == {"Being read."}
    cut.close()
    page.goto(f"{station.url}/maintenance")
    page.wait_for_selector("section[aria-label='Servo drive']")
    page.wait_for_function("() => !document.querySelector('.lm-loading')")


def test_a_technician_reads_the_page_in_german(page: playwright.Page) -> None:
    page.get_by_role("button", name="Deutsch").click()
    page.wait_for_selector("section[aria-label='Servoantrieb'] td:has-text('Drehmoment Antrieb')")
    page.wait_for_selector("h2:has-text('Wiederherstellung nach einer Störung')")
    page.wait_for_selector(".lm-not-live:has-text('NICHT LIVE')")
    page.get_by_role("button", name="English").click()
    page.wait_for_selector("section[aria-label='Servo drive']")
