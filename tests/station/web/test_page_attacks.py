"""What a page of the station does in a real browser for somebody who means harm: by its socket, and by stored texts."""

from __future__ import annotations

import json
import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from urllib.parse import quote

import pytest
from browser import Enter, needs_browser, playwright
from served import LONGEST_S, Served, prepared, served
from sqlalchemy import insert
from station_support import MODELS, PASSWORD, hashed
from test_station_actions import VALUES

from station.web.actions.table import ACTIONS
from station.web.people.accounts import ROLES
from station.web.people.database import PEOPLE, StationDatabase

pytestmark = [pytest.mark.wires, pytest.mark.long, needs_browser]

SCRIPT = "<img src=x onerror=window.hit=1>"
"""What would run in whoever's browser shows it as anything but text."""

OPERATOR = f"Eve {SCRIPT}"


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    data = prepared(tmp_path_factory.mktemp("attacks") / "runs")
    recipes = data.parent / "recipes"
    loose = f"  - {{model: ANY, serial: '<.+', recipe: {recipes}/good.yaml, attempts: 9}}\n"
    (data / "models.yaml").write_text(MODELS.replace("RECIPES", str(recipes)) + loose, encoding="utf-8")
    with closing(StationDatabase(data)) as database, database.writing() as connection:
        row = {"name": OPERATOR, "role": "operator", "password": hashed()}
        connection.execute(insert(PEOPLE).values(must_change=False, failed=0, disabled=False, **row))
    with served(data) as found:
        yield found


def audited(station: Served, name: str, after: int = 0) -> list[tuple[str, str, str]]:
    with closing(sqlite3.connect(Path(station.data) / "station.sqlite3")) as database:
        asked = "SELECT action, outcome, detail FROM audit WHERE name = ? AND number > ? ORDER BY number"
        return [(action, outcome, detail) for action, outcome, detail in database.execute(asked, (name, after))]


def newest(station: Served) -> int:
    with closing(sqlite3.connect(Path(station.data) / "station.sqlite3")) as database:
        return int(database.execute("SELECT max(number) FROM audit").fetchone()[0] or 0)


def wait_for(station: Served, name: str, after: int, count: int) -> list[tuple[str, str, str]]:
    until = time.monotonic() + LONGEST_S
    while len(found := audited(station, name, after)) < count:
        assert time.monotonic() < until, found
        time.sleep(0.1)
    return found


@pytest.mark.parametrize("role", ROLES)
def test_every_action_asked_by_the_socket_of_a_page_is_open_to_its_roles_alone(
    station: Served, enter: Enter, role: str
) -> None:
    page, name = enter(role), f"the {role}"
    after = newest(station)
    asked = [one for one in ACTIONS if one != "leave"]  # that one last: it ends the session
    for action in asked:
        page.evaluate("asked => emitEvent('action', asked)", {"action": action, "values": VALUES[action]})
    found = {action: (outcome, detail) for action, outcome, detail in wait_for(station, name, after, len(asked))}
    assert set(found) == set(asked)
    for action, (outcome, detail) in found.items():
        refused = json.loads(detail).get("reasons", [])
        assert ("role" in refused) == (role not in ACTIONS[action].roles), action
        assert outcome == "refused" or role in ACTIONS[action].roles
    for odd in (None, "text", {}, {"action": 1}, {"action": "no such"}, {"action": "leave", "key": 7}):
        page.evaluate("asked => emitEvent('action', asked)", odd)
    page.evaluate("emitEvent('action', {action: 'leave', values: {}})")
    assert wait_for(station, name, after, len(ACTIONS))[-1][:2] == ("leave", "done")
    page.wait_for_url("**/enter")
    page.context.close()


BUILT = "() => document.readyState === 'complete' && (!window.socket || window.socket.connected)"
"""The page is there and its server answers it. How long it asks for more, a busy machine decides."""

LONGEST_REPORT_MS = 600_000
"""A report is made in a process of low priority, which waits for whatever else the machine does."""


def settled(page: playwright.Page) -> None:
    """Wait until a page is built, and a moment more, in which a script that stands in it would run."""
    page.wait_for_function(BUILT)
    page.wait_for_timeout(1000)


EVERY_LISTENER = """() => {
    let count = 0;
    for (const [id, element] of Object.entries(mounted_app.elements))
        for (const event of element.events || []) {
            window.socket.emit("event", {
                id: Number(id), client_id: window.clientId, listener_id: event.listener_id, args: ["{}"] });
            count += 1;
        }
    return count;
}"""
"""Every listener of an open page is told, whatever is shown or hidden: what a hand-made message can do at most."""


def test_no_listener_of_a_page_does_more_than_its_role(station: Served, enter: Enter) -> None:
    page, name = enter("mes"), "the mes"
    after, told = newest(station), 0
    for address in (
        "/",
        "/maintenance",
        "/recipes",
        "/recipes/good/1",
        "/results",
        "/quality",
        "/certificates",
        "/people",
    ):
        page.goto(f"{station.url}{address}")
        settled(page)
        told += page.evaluate(EVERY_LISTENER)
        page.wait_for_timeout(500)
    assert told >= 30
    done = {action for action, outcome, _ in audited(station, name, after) if outcome == "done"}
    assert all("mes" in ACTIONS[action].roles for action in done if action in ACTIONS)
    assert station.http.get("/").status_code < 500, "the server goes on"
    page.context.close()


def test_a_script_as_serial_number_operator_or_comment_stays_a_text(station: Served, enter: Enter) -> None:
    answer = station.http.post("/api/enter", json={"name": OPERATOR, "password": PASSWORD})
    assert answer.status_code == 200
    station.csrf = answer.json()["csrf"]
    after = newest(station)
    for number, reason in enumerate(("", f"seating {SCRIPT}")):
        asked = {"scanned": SCRIPT, "retest_reason": reason}
        assert station.post("start_run", asked, f"run {number}").status_code == 200
        station.wait("running")
        station.wait("ended")
    assert [json.loads(detail)["scanned"] for action, _, detail in audited(station, OPERATOR, after)] == [SCRIPT] * 2
    assert SCRIPT in audited(station, OPERATOR, after)[-1][2]
    station.log_in("technician")
    bypass = {"condition": "retest_reason", "reason": f"why {SCRIPT}", "hours": 1.0}
    assert station.post("add_bypass", bypass, "bypass").status_code == 200
    assert json.loads(audited(station, "the technician", after)[-1][2])["reason"] == f"why {SCRIPT}"
    assert station.post("start_run", {"scanned": SCRIPT}, "by bypass").status_code == 200
    station.wait("running")
    station.wait("ended")
    runs = [one["run"] for one in station.http.get("/api/runs").json()["runs"]]
    assert len(runs) == 3
    page = enter("technician")
    page.on("dialog", lambda dialog: pytest.fail(dialog.message))
    places = {
        "/": SCRIPT,
        "/results": SCRIPT,
        "/quality": "",
        "/maintenance": "",
        "/certificates": "",
        "/recipes": "",
        "/people": "",
    }
    places |= {f"/runs/{quote(run)}": SCRIPT for run in runs}
    places |= {f"/api/runs/{quote(run)}/report.html": SCRIPT for run in runs}
    shown = ""
    for address, text in places.items():
        page.goto(f"{station.url}{address}", timeout=LONGEST_REPORT_MS)
        if text:
            page.wait_for_function("text => document.body.innerText.includes(text)", arg=text)
        settled(page)
        assert page.evaluate("window.hit") is None, address
        assert page.evaluate("document.querySelectorAll('img[src=x]').length") == 0, address
        shown += page.inner_text("body")
    assert OPERATOR in shown
    assert f"why {SCRIPT}" in shown
    page.goto(f"{station.url}/enter")
    page.fill("#name", OPERATOR)
    page.fill("#password", PASSWORD)
    page.keyboard.press("Enter")
    page.wait_for_function("name => document.body.innerText.includes(name)", arg=OPERATOR)
    assert page.evaluate("window.hit") is None
