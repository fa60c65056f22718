"""The audit trail outlives its server: killed at any point of an action, a line says who did what, or nothing was done.

The child is a process of its own that is killed by SIGKILL in the middle of an action, on a real database.
"""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from station_support import FIRST, GOLDEN, PASSWORD, client_of, station_in

from station.records.revisions import writing
from station.records.revisions.history import History
from station.records.revisions.revision import State, hash_of
from station.web.actions import perform as performing
from station.web.actions.row import Answer
from station.web.actions.table import ACTIONS
from station.web.actions.values import Outcome
from station.web.people import audit
from station.web.people.accounts import Person, Session, open_session
from station.web.people.database import StationDatabase
from station.web.server import Served, open_station
from station.web.station import Station

DRAFT = GOLDEN.read_bytes().replace(b"name: golden", b"name: killed")
POINTS = ("before the note", "after the note", "before it is done", "after it is done", "after the line", "after all")
"""Where the server is killed: the line is signed and written between the last but two and the commit."""

DONE_AT = POINTS.index("after it is done")


def killed() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def then_killed(function: Callable[..., Any]) -> Callable[..., Any]:
    def called(*words: Any, **named: Any) -> Any:
        function(*words, **named)
        killed()

    return called


def first_killed(_function: Callable[..., Any]) -> Callable[..., Any]:
    return lambda *_words, **_named: killed()


def arm(point: str, action: str) -> None:
    """Make this process die at a point of the next action."""
    row = ACTIONS[action]
    if point == "before the note":
        performing._noted = first_killed(performing._noted)
    elif point == "after the note":
        performing._noted = then_killed(performing._noted)
    elif point == "before it is done":
        ACTIONS[action] = row._replace(does=first_killed(row.does))
    elif point == "after it is done":
        ACTIONS[action] = row._replace(does=then_killed(row.does))
    elif point == "after the line":
        audit.write = then_killed(audit.write)


def perform_and_die(database: StationDatabase, station: Station, point: str, action: str, values: dict) -> None:
    """Do an action in a process that is killed at a point of it."""
    with database.writing() as connection:
        session = open_session(
            connection, Person("the quality" if action == "release_recipe" else "the admin", "admin")
        )
    child = os.fork()
    if child == 0:
        try:
            station.database._engine.dispose(close=False)  # connections of the parent are not the child's
            arm(point, action)
            answered(station, session, action, values)
            killed()
        finally:
            os._exit(1)
    assert os.WTERMSIG(os.waitpid(child, 0)[1]) == signal.SIGKILL


def answered(station: Station, session: Session, action: str, values: dict) -> Answer:
    return performing.perform(station, action, session.token, session.csrf, "key", values)


@contextmanager
def opened(data: Path) -> Iterator[StationDatabase]:
    """Open the station as the next server does."""
    station, _ = open_station(Served(data, "127.0.0.1", 0))
    try:
        yield station.database
    finally:
        station.close()


def lines_of(database: StationDatabase, action: str) -> list[tuple[str, str, dict]]:
    with database.reading() as connection:
        assert audit.problems_of(connection) == []
        found = [one for one in audit.lines_of(connection, 50)[::-1] if one.action == action]
    return [(one.name, one.outcome, json.loads(one.detail)) for one in found]


@pytest.mark.parametrize("point", POINTS)
def test_a_release_that_was_signed_has_a_line_wherever_the_server_was_killed(tmp_path: Path, point: str) -> None:
    station = station_in(tmp_path / "runs")
    draft = writing.save_draft(station.data, DRAFT, "the technician")
    writing.ask_release(station.data, "killed", draft.revision, draft.sha256, "the technician")
    values = {"name": "killed", "revision": draft.revision, "sha256": hash_of(DRAFT)}
    perform_and_die(station.database, station, point, "release_recipe", values)
    station.close()
    with opened(station.data) as database:
        lines = lines_of(database, "release_recipe")
        released = History(station.data).find("killed", draft.revision).state is State.RELEASED
        assert released == (POINTS.index(point) >= DONE_AT)
        outcomes = [outcome for _, outcome, _ in lines]
        assert outcomes == ([] if point == "before the note" else ["done"] if point == "after all" else ["cut off"])
        for name, _, detail in lines:
            assert name == "the quality"
            assert detail["sha256"] == hash_of(DRAFT)
            assert "begun" in detail or (detail["before"]["state"], detail["after"]["state"]) == (
                "release asked",
                "released",
            )
    with opened(station.data) as database:
        assert len(lines_of(database, "release_recipe")) == len(lines), "told once"


@pytest.mark.parametrize("point", POINTS)
def test_what_the_database_keeps_is_there_with_its_line_or_not_at_all(tmp_path: Path, point: str) -> None:
    station = station_in(tmp_path / "runs")
    values = {"name": "Ada", "role": "quality", "password": FIRST}
    perform_and_die(
        station.database, station, point if "note" not in point else "before it is done", "add_person", values
    )
    station.close()
    with opened(station.data) as database:
        lines = lines_of(database, "add_person")
        assert [outcome for _, outcome, _ in lines] == (["done"] if point == "after all" else [])
        with database.reading() as connection:
            there = connection.exec_driver_sql("SELECT count(*) FROM people WHERE name = 'Ada'").scalar()
        assert there == len(lines)


@pytest.mark.parametrize("action", [name for name, row in ACTIONS.items() if row.reaches_out])
def test_every_action_that_reaches_out_leaves_a_line_though_its_server_is_killed(tmp_path: Path, action: str) -> None:
    station = station_in(tmp_path / "runs")
    effect = tmp_path / "effect"
    row = ACTIONS[action]
    needs = SimpleNamespace(
        model_validate=lambda _values: row.needs.model_construct(**VALUES.get(action, {})),
        model_fields=row.needs.model_fields,
    )

    def does(*_: object) -> Outcome:
        effect.write_text("done", encoding="utf-8")
        return row.gives.model_construct()

    ACTIONS[action] = row._replace(does=does, needs=needs, sees=lambda *_: {})
    try:
        perform_and_die(station.database, station, "after it is done", action, {})
    finally:
        ACTIONS[action] = row
    assert effect.exists()
    # Whoever does the next action tells of it, be it by the command line beside the server.
    assert client_of(station, "operator").post("choose_language", {"language": "de"}).status_code == 200
    ((_, outcome, detail),) = lines_of(station.database, action)
    assert (outcome, "begun" in detail) == ("cut off", True)
    station.close()


VALUES = {
    "start_run": {"scanned": "SN-1", "retest_reason": ""},
    "save_recipe": {"text": "text"},
    "try_recipe": {"text": "text"},
    "ask_release": {"name": "n", "revision": 1, "sha256": "0" * 64},
    "release_recipe": {"name": "n", "revision": 1, "sha256": "0" * 64},
    "send_recipe_back": {"name": "n", "revision": 1, "sha256": "0" * 64, "reason": "the limit is too wide"},
    "acknowledge_fault": {"recovery": "R"},
    "begin_jog": {"model": "P1", "speed": 1.0},
    "press_device": {"down": True},
    "leave_recovery": {"recovery": "R"},
    "begin_study": {"study": "g", "kind": "gage", "parts": ["A"], "operators": ["B"], "metrics": ["lost_motion"]},
    "settle_study": {"study": "g"},
}


def test_a_refused_action_leaves_no_note(station: Station) -> None:
    for role in ("operator", "technician"):
        assert client_of(station, role).post("begin_recovery").status_code in (403, 409)
    with station.database.writing() as connection:
        assert audit.tell_cut_off(connection) == 0


def test_an_action_of_another_process_that_is_on_is_not_told_as_cut_off(station: Station) -> None:
    with station.database.writing() as connection:
        audit.begin(connection, "the admin", "start_run", {})
        connection.exec_driver_sql("UPDATE begun SET pid = 1, birth = ?", (_birth_of_first(),))
        assert audit.tell_cut_off(connection) == 0
        connection.exec_driver_sql("UPDATE begun SET birth = 'another'")
        assert audit.tell_cut_off(connection) == 1


def _birth_of_first() -> str:
    from station.records.process_birth import process_birth  # noqa: PLC0415 - of this test alone

    return process_birth(1)


CHANGES: tuple[tuple[str, str, dict, dict, dict], ...] = (
    ("admin", "add_person", {"name": "Ada", "role": "quality", "password": FIRST}, {}, {"role": "quality"}),
    ("admin", "disable_person", {"name": "Ada"}, {"disabled": False}, {"disabled": True}),
    ("admin", "reset_person", {"name": "Ada", "password": FIRST}, {"disabled": True}, {"disabled": False}),
    ("admin", "assign_badge", {"name": "the quality", "badge": "B-100042", "pin": "8305"}, {}, {}),
    ("quality", "change_pin", {"password": PASSWORD, "pin": "8306"}, {}, {}),
    ("admin", "withdraw_badge", {"name": "the quality"}, {}, {}),
    ("quality", "choose_language", {"language": "de"}, {"language": None}, {"language": "de"}),
    ("technician", "add_bypass", {"condition": "retest_reason", "reason": "why", "hours": 1.0}, {}, {"reason": "why"}),
    ("technician", "end_bypass", {"condition": "retest_reason"}, {"name": "the technician"}, {}),
    ("mes", "announce_unit", {"serial": "SN-1", "previous_step": "failed"}, {"previous_step": None}, {}),
    ("technician", "save_recipe", {"text": DRAFT.decode()}, {}, {"state": "draft", "sha256": hash_of(DRAFT)}),
    ("technician", "ask_release", {}, {"state": "draft"}, {"state": "release asked"}),
    ("quality", "release_recipe", {}, {"state": "release asked"}, {"state": "released"}),
    ("quality", "change_password", {"old_password": PASSWORD, "new_password": "good enough 7"}, {}, {}),
    ("engineer", "leave", {}, {"open": True}, {"open": False}),
)  # fmt: skip


def test_every_change_says_who_when_what_and_how_it_was_before_and_after(station: Station) -> None:
    for role, action, values, before, after in CHANGES:
        asked = {"name": "killed", "revision": 1, "sha256": hash_of(DRAFT)} if "release" in action else values
        answer = client_of(station, role).post(action, asked)
        assert answer.status_code == 200, (action, answer.text)
        name, outcome, detail = lines_of(station.database, action)[-1]
        assert (name, outcome) == (f"the {role}", "done")
        assert before.items() <= detail["before"].items(), action
        assert after.items() <= detail["after"].items(), action
        assert detail["before"] != detail["after"], action
        kept = json.dumps(detail)
        assert not any(secret in kept for secret in (FIRST, PASSWORD, "good enough 7", "8305", "8306", "B-100042"))
