"""A start condition that is set aside: by whom, which ones, for how long, and that every run under it says so."""

from __future__ import annotations

from datetime import timedelta
from typing import Any

import pytest
from sqlalchemy import update
from station_support import client_of

from station.records.data_folder import Store, check_note
from station.records.seal import seal
from station.wall_clock import WALL_CLOCK
from station.web.bypasses import ALLOWED, bypasses_now
from station.web.people.database import BYPASSES
from station.web.permission import CLOCK, CONDITIONS
from station.web.station import Station


def started(station: Station, monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    runs: list[list[str]] = []
    monkeypatch.setattr(station.running, "start", lambda options, *_: runs.append(options))
    return runs


def measured_before(station: Station, setup: Any) -> None:
    seal(Store(station.data).create("SN-1", setup, {}), state="complete", verdict="PASS")


def test_a_run_under_a_bypass_says_so_and_another_one_does_not(
    station: Station, monkeypatch: pytest.MonkeyPatch
) -> None:
    from station_samples import SETUP  # noqa: PLC0415 - of the folder above

    measured_before(station, SETUP)
    runs = started(station, monkeypatch)
    operator, technician = client_of(station, "operator"), client_of(station, "technician")
    assert operator.post("start_run", {"scanned": "SN-1"}).json()["refused"][0]["id"] == "retest_reason"
    asked = {"condition": "retest_reason", "reason": "trial of the fixture", "hours": 2.0}
    assert technician.post("add_bypass", asked).status_code == 200
    assert operator.post("start_run", {"scanned": "SN-1"}).status_code == 200
    assert operator.post("start_run", {"scanned": "SN-2"}).status_code == 200
    (note,) = [word for word in runs[0] if "trial of the fixture" in word]
    assert "the technician" in note
    assert check_note(note) == note
    assert "--note" not in runs[1], "nothing was bypassed for a new unit"
    assert "trial of the fixture" in operator.http.get("/api/now").json()["bypasses"][0]
    assert technician.post("end_bypass", {"condition": "retest_reason"}).status_code == 200
    assert technician.post("end_bypass", {"condition": "retest_reason"}).status_code == 409
    assert operator.post("start_run", {"scanned": "SN-1"}).status_code == 409


def test_who_bypasses_the_clock_says_for_good_that_it_is_right(
    station: Station, monkeypatch: pytest.MonkeyPatch
) -> None:
    from station_samples import SETUP  # noqa: PLC0415 - of the folder above

    with monkeypatch.context() as wrong:
        wrong.setattr(WALL_CLOCK, "_jumped", timedelta(days=400))
        measured_before(station, SETUP)
    runs = started(station, monkeypatch)
    operator, technician = client_of(station, "operator"), client_of(station, "technician")
    for _ in range(2):
        assert [one["id"] for one in operator.post("start_run", {"scanned": "SN-2"}).json()["refused"]] == [CLOCK]
        measured_before(station, SETUP)  # the folder does not forget it by a run
    technician.post("add_bypass", {"condition": CLOCK, "reason": "set by the time server", "hours": 2.0})
    assert operator.post("start_run", {"scanned": "SN-2"}).status_code == 200
    assert "--clock-is-right=set by the time server" in runs[0]


def test_a_bypass_ends_by_itself(station: Station) -> None:
    technician = client_of(station, "technician")
    technician.post("add_bypass", {"condition": "attempts_left", "reason": "r", "hours": 1.0})
    technician.post("add_bypass", {"condition": "attempts_left", "reason": "another reason", "hours": 1.0})
    with station.database.writing() as connection:
        (one,) = bypasses_now(connection)
        assert one.reason == "another reason"
        connection.execute(update(BYPASSES).values(until_s=0.0))
        assert bypasses_now(connection) == ()


@pytest.mark.parametrize(
    "wrong",
    [
        *({"condition": one.id} for one in CONDITIONS if not one.may_be_bypassed),
        {"condition": "none"}, {"reason": ""}, {"reason": " "}, {"reason": "a\u202eb"}, {"reason": "x" * 121},
        {"hours": 0.0}, {"hours": 25.0}, {"hours": -1.0}, {"hours": "nan"},
    ],
)  # fmt: skip
def test_what_cannot_be_bypassed(shared_station: Station, wrong: dict[str, Any]) -> None:
    asked = {"condition": ALLOWED[0], "reason": "r", "hours": 1.0} | wrong
    assert client_of(shared_station, "engineer").post("add_bypass", asked).status_code == 422
    with shared_station.database.reading() as connection:
        assert bypasses_now(connection) == ()
