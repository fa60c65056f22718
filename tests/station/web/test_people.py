"""Accounts and sessions, and the chain of the audit trail."""

from __future__ import annotations

import hashlib
import json
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import pytest
from argon2.exceptions import VerifyMismatchError
from lostmotion_command import here
from sqlalchemy import delete, select, update
from station_support import FIRST, OF_THE_STATION, PASSWORD, client_of, station_in

from station.errors import StationError
from station.web.people import accounts, audit
from station.web.people.accounts import (
    WRONG_TRIES,
    EntryRefusedError,
    TooManyEntriesError,
    enter,
    first_password,
    session_of,
)
from station.web.people.database import ANSWERS, AUDIT, PEOPLE, SESSIONS, StationDatabase
from station.web.station import Station


@pytest.fixture
def database(tmp_path: Path) -> StationDatabase:
    return StationDatabase(tmp_path / "runs")


def entered(database: StationDatabase, name: str, password: str) -> accounts.Session | EntryRefusedError:
    return enter(database, name, password)


def test_a_password_is_hashed_as_slowly_as_is_recommended() -> None:
    """RFC 9106, Argon2id with little memory: 3 passes over 64 MiB."""
    kept = OF_THE_STATION.hash(PASSWORD)
    assert kept.startswith("$argon2id$v=19$m=65536,t=3,p=4$")
    assert len(kept.split("$")[-1]) >= 43, "of 32 bytes"
    code = "from station.web.people import accounts as a; print(a._HASHER.hash('x'), a.NOBODY)"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert [one.rsplit("$", 2)[0] for one in told] == [kept.rsplit("$", 2)[0]] * 2, "a process that no test has changed"
    with pytest.raises(VerifyMismatchError):  # compared, and not refused before that takes its time
        OF_THE_STATION.verify(told[1], PASSWORD)


def test_the_first_start_makes_one_account_whose_password_is_to_be_changed(database: StationDatabase) -> None:
    with database.writing() as connection:
        password = first_password(connection)
        assert first_password(connection) is None
    found = entered(database, "admin", password)
    assert (found.person.role, found.person.must_change) == ("admin", True)
    with database.writing() as connection:
        with pytest.raises(StationError):
            accounts.change_password(connection, "admin", password, "short")
        with pytest.raises(EntryRefusedError):
            accounts.change_password(connection, "admin", "not this", "good enough 2")
        accounts.change_password(connection, "admin", password, "good enough 2")
        assert session_of(connection, found.token) is None, "sessions of the old password have ended"
    assert not entered(database, "admin", "good enough 2").person.must_change
    assert (database.path.stat().st_mode & 0o777) == 0o600
    assert b"good enough" not in database.path.read_bytes()


def test_wrong_passwords_lock_an_account_for_a_while(database: StationDatabase) -> None:
    with database.writing() as connection:
        accounts.add_person(connection, "Ada", "operator", FIRST)
    told = {str(entered(database, name, "wrong one")) for name in ("Ada", "nobody")}
    assert len(told) == 1, "nobody learns which names there are"
    for _ in range(WRONG_TRIES):
        entered(database, "Ada", "wrong one")
    assert "locked" in str(entered(database, "Ada", FIRST))
    with database.writing() as connection:
        connection.execute(update(PEOPLE).values(locked_until_s=time.time() - 1.0))
    assert entered(database, "Ada", FIRST).person.name == "Ada"


def test_wrong_old_passwords_lock_an_account_too_and_the_admin_opens_it_again(station: Station) -> None:
    found = client_of(station, "quality")
    wrong = {"old_password": "wrong one", "new_password": "good enough 3"}
    for _ in range(WRONG_TRIES):
        assert found.post("change_password", wrong).status_code == 403
    right = wrong | {"old_password": PASSWORD}
    assert "locked" in found.post("change_password", right).json()["refused"][0]["text"]
    admin = client_of(station, "admin")
    assert admin.post("disable_person", {"name": "the quality"}).status_code == 200
    assert admin.post("reset_person", {"name": "the quality", "password": FIRST}).status_code == 200
    assert entered(station.database, "the quality", FIRST).person.must_change
    assert admin.post("reset_person", {"name": "the admin", "password": FIRST}).status_code == 422


def test_who_guesses_keeps_nobody_waiting(database: StationDatabase, monkeypatch: pytest.MonkeyPatch) -> None:
    with database.writing() as connection:
        accounts.add_person(connection, "Ada", "operator", FIRST)
    monkeypatch.setattr(accounts, "LONGEST_WAIT_S", 0.01)
    checked = accounts.fits

    def slow(kept: str, password: str) -> bool:
        with database.writing():  # what others do meanwhile
            pass
        if password == "first":  # noqa: S105
            assert accounts.CHECKS.acquire(timeout=0.0), "a second check may go beside"
            with pytest.raises(TooManyEntriesError):
                enter(database, "Ada", FIRST)
            accounts.CHECKS.release()
        return checked(kept, password)

    monkeypatch.setattr(accounts, "fits", slow)
    assert isinstance(entered(database, "Ada", "first"), EntryRefusedError)
    assert entered(database, "Ada", FIRST).person.name == "Ada"


def test_no_hash_of_what_was_asked_is_left_to_guess_from(station: Station) -> None:
    found = client_of(station, "admin")
    asked = {"name": "Ada", "role": "quality", "password": FIRST}
    found.post("add_person", asked, **{"Idempotency-Key": "A"})
    plain = {
        hashlib.sha256(json.dumps(one, sort_keys=True).encode()).hexdigest() for one in (asked, ["add_person", asked])
    }
    with station.database.writing() as connection:
        kept = connection.execute(select(ANSWERS)).all()
        assert len(kept) == 1
        assert not plain & {kept[0].asked_hmac}
        connection.execute(update(ANSWERS).values(at_s=0.0))
    found.post("leave")
    with station.database.reading() as connection:
        assert "A" not in connection.execute(select(ANSWERS.c.key)).scalars().all(), "old answers go"


def test_an_older_file_is_brought_up_to_date_and_a_newer_one_refused(tmp_path: Path) -> None:
    path = tmp_path / "station.sqlite3"
    with closing(sqlite3.connect(path)) as old, old:
        old.execute("CREATE TABLE requests (key TEXT, asked_sha256 TEXT)")
    StationDatabase(tmp_path).close()
    with closing(sqlite3.connect(path)) as now, now:
        names = {name for (name,) in now.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        assert "requests" not in names
        now.execute("PRAGMA user_version = 99")
    with pytest.raises(StationError, match="newer"):
        StationDatabase(tmp_path)


def test_a_session_ends_with_its_time_its_account_and_by_leaving(station: Station) -> None:
    for how in ("time", "account", "leaving"):
        found = client_of(station, "quality")
        assert found.http.get("/api/me").status_code == 200
        with station.database.writing() as connection:
            if how == "time":
                connection.execute(update(SESSIONS).values(ends_s=time.time() - 1.0))
            elif how == "account":
                accounts.disable_person(connection, "the quality")
                connection.execute(update(PEOPLE).values(disabled=False))
        if how == "leaving":
            assert found.post("leave").status_code == 200
        assert found.http.get("/api/me").status_code == 401


def test_with_the_first_password_nothing_can_be_done_but_changing_it(station: Station) -> None:
    admin = client_of(station, "admin")
    assert admin.post("add_person", {"name": "Ada", "role": "operator", "password": FIRST}).status_code == 200
    new = client_of(station)
    me = new.http.post("/api/enter", json={"name": "Ada", "password": FIRST}).json()
    new.csrf = me["csrf"]
    assert me["must_change"]
    assert new.post("start_run", {"scanned": "SN-1"}).json()["refused"][0]["id"] == "must_change"
    for address in ("/api/now", "/api/bench", "/api/runs"):
        answer = new.http.get(address)
        assert (answer.status_code, answer.json()["refused"][0]["id"]) == (403, "must_change"), address
    assert new.post("change_password", {"old_password": FIRST, "new_password": PASSWORD}).status_code == 200
    again = client_of(station).http.post("/api/enter", json={"name": "Ada", "password": PASSWORD})
    assert not again.json()["must_change"]
    assert "httponly" in again.headers["set-cookie"].lower()
    assert "samesite=strict" in again.headers["set-cookie"].lower()


@pytest.mark.parametrize("name", ["ÅSA STRASSE", "A\u030asa Straße", "Åsa Ｓtraße", "Åsa Straße"])
def test_a_name_that_looks_like_that_of_an_account_is_refused(station: Station, name: str) -> None:
    admin = client_of(station, "admin")
    new = {"name": "Åsa Straße", "role": "operator", "password": FIRST}
    assert admin.post("add_person", new).status_code == 200
    answer = admin.post("add_person", new | {"name": name})
    assert answer.status_code == 422
    assert answer.json()["refused"][0]["text"] == (
        f"name: {name} is taken. Choose another name" if name == new["name"]
        else f"name: {name} looks like Åsa Straße, who has an account. Choose another name"
    )  # fmt: skip
    assert admin.post("add_person", new | {"name": "Åsa Strase"}).status_code == 200


def lines(database: StationDatabase, count: int) -> None:
    with database.writing() as connection:
        for number in range(count):
            audit.write(connection, "Ada", "start_run", audit.DONE, {"scanned": f"SN-{number}"})


@pytest.mark.parametrize("how", ["changed", "removed", "added", "exchanged"])
def test_a_line_that_was_tampered_with_is_named(database: StationDatabase, how: str) -> None:
    lines(database, 6)
    with database.writing() as connection:
        assert audit.problems_of(connection) == []
        if how == "changed":
            connection.execute(update(AUDIT).where(AUDIT.c.number == 3).values(name="Bea"))
        elif how == "removed":
            connection.execute(delete(AUDIT).where(AUDIT.c.number == 3))
        elif how == "added":
            connection.execute(update(AUDIT).where(AUDIT.c.number == 6).values(number=7))
        else:
            connection.execute(update(AUDIT).where(AUDIT.c.number == 3).values(number=100))
            connection.execute(update(AUDIT).where(AUDIT.c.number == 4).values(number=3))
            connection.execute(update(AUDIT).where(AUDIT.c.number == 100).values(number=4))
        problems = audit.problems_of(connection)
    assert problems
    assert problems[0].startswith("line 3" if how != "added" else "line 6")
    ran = here("audit", "verify", "--data", str(database.path.parent), "--json")
    assert (ran.exit_code, ran.json["problems"]) == (1, problems)


def test_the_trail_in_order_says_its_head(database: StationDatabase) -> None:
    lines(database, 3)
    with database.writing() as connection:
        head = audit.head_of(connection)
    ran = here("audit", "verify", "--data", str(database.path.parent))
    assert ran.exit_code == 0
    assert head.head_sha256 in ran.out
    assert here("audit", "verify", "--data", str(database.path.parent / "none")).exit_code == 2


def test_one_server_serves_a_folder(tmp_path: Path) -> None:
    first = StationDatabase(tmp_path, serving=True)
    with pytest.raises(StationError, match="another"):
        StationDatabase(tmp_path, serving=True)
    first.close()
    StationDatabase(tmp_path, serving=True).close()


def test_refused_starts_stand_in_the_trail(tmp_path: Path) -> None:
    station = station_in(tmp_path / "runs")
    client_of(station, "operator").post("start_run", {"scanned": "of no model"})
    with station.database.writing() as connection:
        (line,) = audit.lines_of(connection, 1)
    assert (line.outcome, line.name) == ("refused", "the operator")
    assert "model_known" in line.detail
    assert "of no model" in line.detail
