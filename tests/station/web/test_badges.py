"""Badges: a number and a PIN, never the number alone but for operators where the site says so; both kept as hashes."""

from __future__ import annotations

import pytest
from sqlalchemy import select, update
from station_support import PASSWORD, client_of

from station.web.people import audit, badges
from station.web.people.accounts import WRONG_TRIES
from station.web.people.database import BADGE_SALT, BADGES, PEOPLE
from station.web.settings import Settings
from station.web.station import Station

BADGE, PIN = "B-100042", "8305"
OF_THE_STATION = (badges.PASSES, badges.MEMORY_KIB, badges.LANES)


@pytest.fixture(autouse=True)
def quick_digests(monkeypatch: pytest.MonkeyPatch) -> None:
    """A number is looked up at each entry: how slowly is not what these tests are about."""
    monkeypatch.setattr(badges, "MEMORY_KIB", 8 * badges.LANES)


def test_a_number_is_hashed_as_slowly_as_is_recommended() -> None:
    """OWASP, Argon2id with the least memory."""
    assert OF_THE_STATION == (2, 19_456, 1)


def with_badge(station: Station, role: str = "operator") -> None:
    values = {"name": f"the {role}", "badge": f" {BADGE}\r", "pin": PIN}
    assert client_of(station, "admin").post("assign_badge", values).status_code == 200


def entered(station: Station, badge: str = BADGE, secret: str = PIN) -> tuple[int, str]:
    answer = client_of(station).http.post("/api/enter_badge", json={"badge": badge, "secret": secret})
    body = answer.json()
    return answer.status_code, body["name"] if answer.status_code == 200 else body["refused"][0]["id"]


def test_a_badge_with_its_pin_or_the_password_lets_in(station: Station) -> None:
    with_badge(station, "technician")
    assert entered(station) == (200, "the technician")
    assert entered(station, secret=PASSWORD) == (200, "the technician")
    assert entered(station, BADGE, "8306") == (401, "entry")
    assert entered(station, badge="B-100043") == (401, "entry")
    line = newest(station)
    assert (line["action"], line["outcome"], line["name"]) == ("enter_badge", "refused", "?")


def newest(station: Station) -> dict[str, str]:
    with station.database.reading() as connection:
        line = audit.lines_of(connection, 1)[0]
    return line if isinstance(line, dict) else {name: getattr(line, name) for name in ("action", "outcome", "name")}


def test_a_badge_alone_lets_in_operators_only_and_only_where_the_site_says_so(station: Station) -> None:
    with_badge(station)
    assert entered(station, secret="") == (401, "pin")
    assert entered(station, badge="of nobody", secret="") == (401, "pin"), "nobody learns which badges there are"
    object.__setattr__(station, "settings", Settings(operator_by_badge_alone=True))
    assert entered(station, secret="") == (200, "the operator")
    for role in ("technician", "quality", "engineer", "admin", "mes"):
        with station.database.writing() as connection:
            connection.execute(update(BADGES).values(name=f"the {role}"))
        assert entered(station, secret="") == (401, "pin")


def test_wrong_pins_lock_the_account_and_its_password(station: Station) -> None:
    with_badge(station)
    for _ in range(WRONG_TRIES):
        assert entered(station, BADGE, "0000") == (401, "entry")
    assert entered(station) == (401, "entry")
    assert newest(station)["name"] == "the operator"
    answer = client_of(station).http.post("/api/enter", json={"name": "the operator", "password": PASSWORD})
    assert "locked" in answer.json()["refused"][0]["text"]


def test_no_number_and_no_pin_stands_in_the_file(station: Station) -> None:
    with_badge(station)
    content = b"".join(path.read_bytes() for path in station.data.glob("station.sqlite3*"))
    assert BADGE.encode() not in content
    with station.database.reading() as connection:
        row = connection.execute(select(BADGES)).one()
        salt = connection.execute(select(BADGE_SALT.c.salt)).scalar_one()
    assert row.pin.startswith("$argon2id$")
    assert len(row.digest) == 64
    assert len(salt) == 32


def test_a_badge_is_of_one_person_and_may_be_withdrawn(station: Station) -> None:
    with_badge(station)
    admin = client_of(station, "admin")
    taken = admin.post("assign_badge", {"name": "the quality", "badge": BADGE, "pin": PIN})
    assert "the operator" in taken.json()["refused"][0]["text"]
    assert admin.post("withdraw_badge", {"name": "the operator"}).status_code == 200
    assert admin.post("withdraw_badge", {"name": "the operator"}).status_code == 422
    assert entered(station) == (401, "entry")
    assert admin.post("assign_badge", {"name": "the quality", "badge": BADGE, "pin": PIN}).status_code == 200
    assert entered(station) == (200, "the quality")


@pytest.mark.parametrize("pin", ["", "123", "1234", "7777", "12a4", "1" * 13, "٣٤٥٦"])
def test_a_pin_that_anybody_guesses_is_refused(station: Station, pin: str) -> None:
    values = {"name": "the operator", "badge": BADGE, "pin": pin}
    assert client_of(station, "admin").post("assign_badge", values).status_code == 422


def test_one_changes_ones_own_pin_with_the_password(station: Station) -> None:
    with_badge(station)
    operator = client_of(station, "operator")
    assert operator.post("change_pin", {"password": "wrong one", "pin": "2580"}).status_code == 403
    assert operator.post("change_pin", {"password": PASSWORD, "pin": "2580"}).status_code == 200
    assert entered(station) == (401, "entry")
    assert entered(station, BADGE, "2580") == (200, "the operator")


def test_a_closed_account_and_one_with_its_first_password_stay_out(station: Station) -> None:
    with_badge(station)
    for change in ({"disabled": True}, {"disabled": False, "must_change": True}):
        with station.database.writing() as connection:
            connection.execute(update(PEOPLE).where(PEOPLE.c.name == "the operator").values(**change))
        assert entered(station) == (401, "entry")


def test_a_badge_is_known_with_the_identifier_of_its_symbology_and_without(station: Station) -> None:
    settings = Settings(badge="B-[0-9]{6}")
    assert all(badges.is_badge(settings, one) for one in (BADGE, f"]C0{BADGE}", f" ]C0{BADGE}\r"))
    assert not any(badges.is_badge(settings, one) for one in ("SN-1", "]C0SN-1", "B-1"))
    assert not badges.is_badge(Settings(), BADGE)
    assert badges.is_badge(Settings(badge="]C0B-[0-9]{6}"), f"]C0{BADGE}")
    with_badge(station)
    assert entered(station, f"]C0{BADGE}") == (200, "the operator"), "it was typed, or its scanner sends none"
    given = {"name": "the quality", "badge": f"]C0{BADGE}", "pin": PIN}
    assert client_of(station, "admin").post("assign_badge", given).status_code == 422, "it is the operator's"
    assert client_of(station, "admin").post("assign_badge", given | {"name": "the operator"}).status_code == 200
    assert entered(station) == entered(station, f"]C0{BADGE}") == (200, "the operator")


def test_a_badge_that_was_given_with_the_identifier_goes_on_to_let_in(station: Station) -> None:
    with_badge(station)
    with station.database.writing() as connection:
        salt = bytes.fromhex(connection.execute(select(BADGE_SALT.c.salt)).scalar_one())
        connection.execute(update(BADGES).values(digest=badges.digest_with(salt, f"]C0{BADGE}")))
    assert entered(station, f"]C0{BADGE}") == (200, "the operator")
    given = {"name": "the quality", "badge": f"]C0{BADGE}", "pin": PIN}
    assert client_of(station, "admin").post("assign_badge", given).status_code == 422, "it is the operator's"


@pytest.mark.parametrize("action", ["start_run", "ask_permission"])
@pytest.mark.parametrize("sent", [BADGE, f"]C0{BADGE}"])
def test_the_number_of_a_badge_in_the_place_of_a_unit_is_kept_nowhere(station: Station, action: str, sent: str) -> None:
    object.__setattr__(station, "settings", Settings(badge="B-[0-9]{6}"))
    answer = client_of(station, "admin").post(action, {"scanned": sent})
    assert (answer.status_code, answer.json()["refused"][0]["id"]) == (422, "scan")
    assert BADGE not in answer.text
    with station.database.reading() as connection:
        assert not any(BADGE in str(line) for line in audit.lines_of(connection, 100))
