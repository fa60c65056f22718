"""Every action by every role over REST; what a request must bring; what is refused and audited."""

from __future__ import annotations

import json
import socket
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from starlette.websockets import WebSocketDisconnect
from station_support import FIRST, HOST, PASSWORD, client_of

from recipes import RecipeError
from station.errors import StationError
from station.records.data_folder import LONGEST_SERIAL
from station.records.studies import study_names
from station.web.actions.table import ACTIONS
from station.web.people import audit
from station.web.people.accounts import COOKIE, ROLES
from station.web.server import Served, hosts_of, open_station
from station.web.station import Station

VALUES = {
    "start_run": {"scanned": "of no model at all"},
    "ask_permission": {"scanned": "of no model at all"},
    "announce_unit": {"serial": "ä", "previous_step": "passed"},
    "begin_study": {"study": "g", "kind": "gage", "parts": ["of no model at all"], "metrics": ["lost_motion"]},
    "settle_study": {"study": "no such study"},
    "stop_run": {},
    "confirm_nok": {"run": "R"},
    "read_label": {"scanned": "no label"},
    "print_label": {"run": "R"},
    "set_label_aside": {"run": "R", "reason": "none is needed"},
    "acknowledge_aqdef": {"run": "R", "reason": "none is needed"},
    "begin_recovery": {},
    "acknowledge_fault": {"recovery": "R"},
    "leave_recovery": {"recovery": "R"},
    "begin_jog": {"model": "of no model at all"},
    "hold_jog": {"direction": 1},
    "release_jog": {},
    "press_device": {"down": True},
    "end_jog": {},
    "add_bypass": {"condition": "bench_free", "reason": "r", "hours": 1.0},
    "end_bypass": {"condition": "bench_free"},
    "save_recipe": {"text": "no recipe"},
    "try_recipe": {"text": "no recipe"},
    "ask_release": {"name": "none", "revision": 1, "sha256": "0" * 64},
    "release_recipe": {"name": "none", "revision": 1, "sha256": "0" * 64},
    "send_recipe_back": {"name": "none", "revision": 1, "sha256": "0" * 64, "reason": "the limit is too wide"},
    "add_person": {"name": " no", "role": "operator", "password": FIRST},
    "assign_badge": {"name": "nobody of this name", "badge": "B-100001", "pin": "8305"},
    "withdraw_badge": {"name": "nobody of this name"},
    "change_pin": {"password": "wrong", "pin": "8"},
    "test_scanner": {"scanned": "yz"},
    "choose_language": {"language": "xx"},
    "disable_person": {"name": "nobody of this name"},
    "reset_person": {"name": "nobody of this name", "password": FIRST},
    "change_password": {"old_password": PASSWORD, "new_password": PASSWORD},
    "leave": {},
}
"""What each action is asked with: allowed, it does nothing that another cell would see."""


def newest_line(station: Station) -> audit.Line:
    with station.database.writing() as connection:
        return audit.lines_of(connection, 1)[0]


def test_every_action_is_asked() -> None:
    assert set(VALUES) == set(ACTIONS)
    for row in ACTIONS.values():
        assert row.roles
        assert row.roles <= set(ROLES)
        assert row.text
        assert set(row.audited) <= set(row.needs.model_fields)
        assert set(row.tells) <= set(row.gives.model_fields)


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize("action", list(ACTIONS))
def test_an_action_is_open_to_its_roles_alone(shared_station: Station, action: str, role: str) -> None:
    answer = client_of(shared_station, role).post(action, VALUES[action])
    refused = [one["id"] for one in answer.json().get("refused", [])]
    assert ("role" not in refused) == (role in ACTIONS[action].roles)
    assert (answer.status_code == 403) == (role not in ACTIONS[action].roles)
    line = newest_line(shared_station)
    assert (line.name, line.action) == (f"the {role}", action)
    assert line.outcome == ("done" if answer.status_code == 200 else "refused")


@pytest.mark.parametrize("action", list(ACTIONS))
def test_nothing_is_done_for_nobody_nor_without_the_token_of_the_page(shared_station: Station, action: str) -> None:
    assert client_of(shared_station).post(action, VALUES[action]).status_code == 401
    found = client_of(shared_station, "admin")
    for token in (None, "", "guessed"):
        answer = found.post(action, VALUES[action], **{"X-CSRF-Token": token})
        assert (answer.status_code, answer.json()["refused"][0]["id"]) == (403, "csrf")
    assert found.http.get(f"/api/actions/{action}").status_code == 405


def test_a_request_needs_a_key_and_the_same_key_is_answered_the_same_once(shared_station: Station) -> None:
    found = client_of(shared_station, "admin")
    for key in (None, "", "x" * 65, "k\x7f"):
        answer = found.post("confirm_nok", {"run": "K"}, **{"Idempotency-Key": key})
        assert (answer.status_code, answer.json()["refused"][0]["id"]) == (422, "idempotency_key")
    first = found.post("add_person", {"name": "Ada", "role": "quality", "password": FIRST}, **{"Idempotency-Key": "A"})
    lines = newest_line(shared_station).number
    again = found.post("add_person", {"name": "Ada", "role": "quality", "password": FIRST}, **{"Idempotency-Key": "A"})
    assert (first.status_code, first.json()) == (again.status_code, again.json()) == (200, again.json())
    assert newest_line(shared_station).number == lines, "it was not done twice"
    other = found.post("add_person", {"name": "Bea", "role": "quality", "password": FIRST}, **{"Idempotency-Key": "A"})
    assert (other.status_code, other.json()["refused"][0]["id"]) == (409, "key_used")
    anew = client_of(shared_station, "admin")
    later = anew.post("add_person", {"name": "Ada", "role": "quality", "password": FIRST}, **{"Idempotency-Key": "A"})
    assert (later.status_code, later.json()) == (200, first.json()), "the key is the account's, not the session's"
    assert newest_line(shared_station).number == lines
    stranger = client_of(shared_station, "engineer").post("confirm_nok", {"run": "K"}, **{"Idempotency-Key": "A"})
    assert (stranger.status_code, stranger.json()["refused"][0]["id"]) == (409, "key_used")
    refused = [one.post("confirm_nok", {"run": "K"}, **{"Idempotency-Key": "B"}) for one in (found, anew)]
    assert [one.status_code for one in refused] == [409, 409]
    assert refused[0].json() == refused[1].json()


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "http://127.0.0.1:9999", "null", f"http://{HOST}.evil.example"]
)
def test_a_page_of_another_server_can_neither_post_nor_open_a_socket(shared_station: Station, origin: str) -> None:
    found = client_of(shared_station, "admin")
    assert found.post("leave", {}, Origin=origin).status_code == 403
    assert found.http.get("/api/me").status_code == 200, "the session was not ended"
    socket = found.http.websocket_connect("/_nicegui_ws/socket.io/", headers={"Origin": origin})
    with pytest.raises(WebSocketDisconnect) as refused, socket:
        pass
    assert refused.value.code == 1008


def test_a_name_that_points_here_is_no_name_of_this_server(shared_station: Station) -> None:
    found = client_of(shared_station, "admin")
    assert found.http.get("/api/me", headers={"Host": "rebound.example"}).status_code == 403
    answer = found.http.get("/api/me")
    assert answer.headers["x-frame-options"] == "DENY"


def test_what_is_sent_must_be_what_the_action_needs(shared_station: Station) -> None:
    found = client_of(shared_station, "admin")
    for values in ({}, {"scanned": 4}, {"scanned": "SN-1", "serial": "SN-1"}, {"scanned": "x" * 513}):
        assert found.post("start_run", values).status_code == 422
    headers = {"X-CSRF-Token": found.csrf}
    for number, body in enumerate((b"{", b'{"scanned": "SN-\\ud800"}', b'"text"', b"[" * 100_000, b"\xff", b"NaN")):
        odd = found.http.post(
            "/api/actions/start_run", content=body, headers=headers | {"Idempotency-Key": f"o{number}"}
        )
        assert odd.status_code == 422, body[:20]
        assert newest_line(shared_station).outcome == "refused"
    for name, password in (("\ud800", "x"), ("the admin", "\ud800"), ("x" * 65, "x")):
        body = json.dumps({"name": name, "password": password})
        odd = found.http.post("/api/enter", content=body, headers={"Content-Type": "application/json"})
        assert odd.status_code in (401, 422)
        assert password not in odd.json()["refused"][0]["text"].split()
    # A client takes a plain dot out of the address, and asks for the list of runs.
    for name in ("x" * 300, "%00", "%ff", "%2E", "%2E%2E"):
        assert found.http.get(f"/api/runs/{name}").status_code == 404
    assert found.http.get("/api/runs/..%2F..%2Fetc").status_code == 404
    assert found.http.get("/api/runs/none").status_code == 404


def test_a_study_of_units_that_no_single_recipe_measures_is_refused_before_it_is_begun(shared_station: Station) -> None:
    found = client_of(shared_station, "technician")
    asked = {"study": "mixed", "kind": "gage", "operators": ["the operator", "the technician"]}
    asked |= {"metrics": ["torque_ratio_slope"], "trials": 2}
    for parts, name, named in ((["SN-1", "BAD-1"], "parts", "BAD-1"), (["SN-1", "XX-1"], "model_known", "XX-1")):
        answer = found.post("begin_study", asked | {"parts": parts})
        (refused,) = answer.json()["refused"]
        assert (answer.status_code, refused["id"], named in refused["text"]) == (409, name, True)
    assert study_names(shared_station.data) == []


def test_a_serial_number_of_any_length_can_be_looked_for(shared_station: Station) -> None:
    found = client_of(shared_station, "mes").http
    asked = [found.get("/api/runs", params={"unit": "x" * length}).status_code for length in (LONGEST_SERIAL, 129)]
    assert asked == [200, 422]


def test_the_trail_is_for_those_who_look_after_it(shared_station: Station) -> None:
    for role in ROLES:
        answer = client_of(shared_station, role).http.get("/api/audit", params={"newest": 3})
        assert answer.status_code == (200 if role in ("admin", "quality") else 403)
    found = client_of(shared_station, "quality").http.get("/api/audit", params={"newest": 3}).json()
    assert len(found["newest"]) == 3
    assert found["head_sha256"] == found["newest"][0]["sha256"]
    assert PASSWORD not in json.dumps(found)


def test_reading_needs_a_session(shared_station: Station) -> None:
    nobody = client_of(shared_station).http
    for path in ("/api/me", "/api/now", "/api/bench", "/api/audit", "/api/runs/x"):
        assert nobody.get(path).status_code == 401
    nobody.cookies.set(COOKIE, "of nobody")
    assert nobody.get("/api/me").status_code == 401


def test_the_document_describes_every_action(shared_station: Station) -> None:
    paths = client_of(shared_station).http.get("/api/openapi.json").json()["paths"]
    assert {f"/api/actions/{name}" for name in ACTIONS} <= set(paths)
    assert all(set(paths[f"/api/actions/{name}"]) == {"post"} for name in ACTIONS)
    for name, row in ACTIONS.items():
        asked = paths[f"/api/actions/{name}"]["post"]
        body = asked["requestBody"]["content"]["application/json"]["schema"]
        assert set(body.get("properties", {})) == set(row.needs.model_fields)
        assert {"200", "401", "403", "409", "422", "503"} <= set(asked["responses"])


def test_a_database_that_cannot_be_written_is_said(station: Station) -> None:
    found = client_of(station, "operator")
    with closing(sqlite3.connect(station.database.path)) as other:
        other.execute("PRAGMA busy_timeout = 0")
        other.execute("BEGIN EXCLUSIVE")
        answer = found.post("stop_run")
    assert (answer.status_code, answer.json()["refused"][0]["id"]) == (503, "station")


def test_a_server_is_called_by_its_address_and_by_the_names_that_lead_to_it() -> None:
    there = ("127.0.0.1", "localhost", "[::1]")
    here = Served(Path(), "127.0.0.1", 80)
    assert hosts_of(here, 8080) == {f"{one}:8080" for one in there}
    assert hosts_of(here, 80) == {f"{one}:80" for one in there} | set(there)
    plant = Served(Path(), "0.0.0.0", 443, certificate=Path("c.pem"), names=("Bench-3.plant.example",))  # noqa: S104
    found = hosts_of(plant, 443)
    assert {"bench-3.plant.example", "bench-3.plant.example:443", socket.gethostname().lower()} <= found
    assert "bench-3.plant.example" not in hosts_of(plant, 8443)


REFUSED = ({"host": "10.0.0.7"}, {"certificate": Path("c.pem")}, {"models": Path("none.yaml")})


@pytest.mark.parametrize("options", REFUSED)
def test_a_station_that_cannot_be_served_as_asked_is_refused_and_holds_nothing(tmp_path: Path, options: dict) -> None:
    asked = Served(**({"data": tmp_path, "host": "127.0.0.1", "port": 0} | options))
    with pytest.raises((StationError, RecipeError)):
        open_station(asked)
    station, password = open_station(Served(tmp_path, "127.0.0.1", 0))
    station.database.close()
    assert password is not None, "the first password was not made where nobody could read it"
