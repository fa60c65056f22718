"""What somebody tries who has no business here, over REST: refused, and a line of the audit trail."""

from __future__ import annotations

import json
from urllib.parse import quote

import pytest
from sqlalchemy import update
from station_support import PASSWORD, Client, client_of

from station.web.people import audit
from station.web.people.accounts import COOKIE, WRONG_TRIES
from station.web.people.database import PEOPLE
from station.web.station import Station

GUESSES = 3 * WRONG_TRIES
STEPS = ("..", "../..", "../../etc/passwd", "..\\..", "/etc/passwd", "%2e%2e/x", "R\0", "./R", "~root")


def lines(station: Station, count: int) -> list[audit.Line]:
    """Return the newest lines of the trail, oldest first; the chain is whole."""
    with station.database.reading() as connection:
        assert audit.problems_of(connection) == []
        return audit.lines_of(connection, count)[::-1]


def test_guessing_passwords_locks_the_account_and_every_guess_is_a_line(station: Station) -> None:
    guesser = client_of(station).http
    told = [
        guesser.post("/api/enter", json={"name": "the admin", "password": f"guess number {number}"})
        for number in range(GUESSES)
    ]
    assert {one.status_code for one in told} == {401}
    assert not any("set-cookie" in one.headers for one in told)
    right = guesser.post("/api/enter", json={"name": "the admin", "password": PASSWORD})
    assert (right.status_code, "locked" in right.json()["refused"][0]["text"]) == (401, True), "the right one, too late"
    found = lines(station, GUESSES + 1)
    assert [(one.name, one.action, one.outcome) for one in found] == [("the admin", "enter", "refused")] * len(found)
    assert not any("guess" in one.detail or PASSWORD in one.detail for one in found)
    other = guesser.post("/api/enter", json={"name": "the quality", "password": PASSWORD})
    assert other.status_code == 200, "others go on working"


def test_guessing_pins_of_a_badge_is_a_line_each_and_locks_it(station: Station) -> None:
    values = {"name": "the operator", "badge": "B-100042", "pin": "8305"}
    assert client_of(station, "admin").post("assign_badge", values).status_code == 200
    guesser = client_of(station).http
    for number in range(GUESSES):
        answer = guesser.post("/api/enter_badge", json={"badge": "B-100042", "secret": f"{number:04d}"})
        assert answer.status_code == 401
    answer = guesser.post("/api/enter_badge", json={"badge": "B-100042", "secret": "8305"})
    assert answer.status_code == 401, "the right one, too late"
    found = lines(station, GUESSES + 1)
    assert {(one.action, one.outcome) for one in found} == {("enter_badge", "refused")}
    assert {one.name for one in found} == {"the operator"}


def test_a_session_that_was_planted_before_the_log_in_is_not_the_one_after_it(station: Station) -> None:
    attacker = client_of(station, "operator")
    planted = attacker.http.cookies[COOKIE]
    for token in (planted, "planted by somebody", "x" * 4000):
        victim = client_of(station)
        victim.http.cookies.set(COOKIE, token)
        answer = victim.http.post("/api/enter", json={"name": "the admin", "password": PASSWORD})
        assert answer.status_code == 200
        given = answer.cookies[COOKIE]
        assert given not in (token, planted)
        assert len(given) >= 43, "256 bits that nobody knows"
        planter = client_of(station)
        planter.http.cookies.set(COOKIE, token)
        found = planter.http.get("/api/me")
        assert (found.status_code, found.json().get("name")) in ((401, None), (200, "the operator"))
    assert attacker.http.get("/api/me").json()["name"] == "the operator", "the planted one has become nobody else's"
    attacker.csrf = answer.json()["csrf"]
    assert attacker.post("stop_run").json()["refused"][0]["id"] == "csrf", "the victim's token is of no use beside it"
    line = lines(station, 1)[0]
    assert (line.name, line.action, line.outcome) == ("the operator", "stop_run", "refused")


def test_a_session_is_not_taken_from_the_address(station: Station) -> None:
    token = client_of(station, "admin").http.cookies[COOKIE]
    nobody = client_of(station).http
    assert nobody.get(f"/api/me?{COOKIE}={token}").status_code == 401
    assert nobody.get("/api/me", headers={"Authorization": f"Bearer {token}"}).status_code == 401


@pytest.mark.parametrize(
    ("action", "values"),
    [
        ("confirm_nok", {"run": ""}),
        ("acknowledge_fault", {"recovery": ""}),
        ("leave_recovery", {"recovery": ""}),
        ("release_recipe", {"name": "", "revision": 1, "sha256": "0" * 64}),
        ("ask_release", {"name": "", "revision": 1, "sha256": "0" * 64}),
    ],
)
def test_a_name_of_a_file_elsewhere_is_no_run_and_no_recipe(
    shared_station: Station, action: str, values: dict[str, object]
) -> None:
    found = client_of(shared_station, "admin")
    (field,) = (name for name, value in values.items() if value == "")
    for step in STEPS:
        answer = found.post(action, values | {field: step})
        assert answer.status_code in (409, 422), step
        assert "/etc/passwd:" not in answer.text
        line = lines(shared_station, 1)[0]
        assert (line.name, line.action, line.outcome) == ("the admin", action, "refused")
        if answer.status_code == 409:
            assert json.loads(line.detail)[field] == step, "what was tried stands in the trail"


@pytest.mark.parametrize(
    "place", ["/api/runs/{}", "/api/runs/{}/report.html", "/api/recipes/{}/1.yaml", "/{}", "/_nicegui/{}"]
)
@pytest.mark.parametrize("step", ["../x", "../../../etc/passwd", "..\\x", "R\0"])
def test_an_address_that_leads_elsewhere_is_refused_and_a_line(shared_station: Station, place: str, step: str) -> None:
    for role in ("operator", None):
        found: Client = client_of(shared_station, role)
        asked = place.format(quote(step, safe=""))
        answer = found.http.get(asked)
        assert (answer.status_code, answer.json()["refused"][0]["id"]) == (404, "path")
        line = lines(shared_station, 1)[0]
        who = "?" if role is None else f"the {role}"
        assert (line.name, line.action, line.outcome) == (who, "read", "refused")
        assert json.loads(line.detail)["path"] == asked


def test_a_closed_account_guesses_on_without_effect(station: Station) -> None:
    with station.database.writing() as connection:
        connection.execute(update(PEOPLE).where(PEOPLE.c.name == "the engineer").values(disabled=True))
    answer = client_of(station).http.post("/api/enter", json={"name": "the engineer", "password": PASSWORD})
    assert answer.status_code == 401
    assert lines(station, 1)[0].outcome == "refused"
