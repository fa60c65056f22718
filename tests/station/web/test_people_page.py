"""The page of people in a real browser: an admin gives a person a badge with a PIN, and the person logs in with it."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from browser import Enter, needs_browser, playwright
from served import Served, prepared, served
from station_support import PASSWORD

pytestmark = [pytest.mark.wires, pytest.mark.long, needs_browser]

BADGE, PIN, OWN_PIN, FIRST = "B-100077", "8305", "2749", "a first password"
ROW = "table.lm tr:has(td:text-is('{}'))"


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(prepared(tmp_path_factory.mktemp("people") / "runs")) as found:
        yield found


@pytest.fixture(scope="module")
def page(station: Served, enter: Enter) -> playwright.Page:
    page = enter("admin")
    page.goto(f"{station.url}/people")
    page.wait_for_selector(ROW.format("the operator"))
    return page


def choose(page: playwright.Page, card: str, name: str) -> None:
    page.get_by_role("region", name=card, exact=True).get_by_label("Person").click()
    page.get_by_role("option", name=name, exact=True).click()


def enter_by_badge(page: playwright.Page, url: str, pin: str) -> None:
    page.goto(f"{url}/enter")
    page.evaluate("text => document.dispatchEvent(new CustomEvent('scan', {detail: {text, caps: false}}))", BADGE)
    page.wait_for_selector("#pin:visible")
    page.fill("#pin", pin)
    page.keyboard.press("Enter")


def test_an_admin_gives_a_badge_and_its_pin_opens_the_bench(
    station: Served, page: playwright.Page, enter: Enter
) -> None:
    choose(page, "Badge", "the operator")
    page.get_by_label("Badge number: scan it, or type it").type(BADGE)
    page.keyboard.press("Enter")  # as a scanner does: the next key is the first of the PIN
    page.keyboard.type("1234")
    page.get_by_role("button", name="Give the badge").click()
    page.wait_for_selector("[role=alert] >> text=easy to guess")
    page.get_by_label("PIN, 4 to 12 digits", exact=True).fill(PIN)
    page.get_by_role("button", name="Give the badge").click()
    page.wait_for_selector("[role=status] >> text=The badge belongs to the operator now.")
    assert page.locator(ROW.format("the operator")).inner_text().split()[-1] == "yes"
    assert page.get_by_label("PIN, 4 to 12 digits", exact=True).input_value() == "", "nothing of it is left"
    other = enter("operator")
    enter_by_badge(other, station.url, PIN)
    other.wait_for_selector(".lm-word")

    other.goto(f"{station.url}/people")
    other.get_by_role("region", name="Your PIN").get_by_label("Your password").fill(PASSWORD)
    other.get_by_label("New PIN, 4 to 12 digits").fill(OWN_PIN)
    other.get_by_role("button", name="Change PIN").click()
    other.wait_for_selector("[role=status] >> text=The PIN is changed.")
    assert other.get_by_role("button", name="Give the badge").count() == 0, "that is an admin's"
    other.get_by_role("button", name="Log out").click()
    other.wait_for_url("**/enter")
    enter_by_badge(other, station.url, OWN_PIN)
    other.wait_for_selector(".lm-word")

    page.get_by_role("button", name="Take the badge away").click()
    page.wait_for_selector("[role=status] >> text=the operator has no badge any more.")
    other.context.clear_cookies()
    enter_by_badge(other, station.url, OWN_PIN)
    other.wait_for_selector("#why:has-text('wrong')")
    other.context.close()


def test_an_admin_adds_closes_and_opens_an_account(station: Served, page: playwright.Page) -> None:
    page.get_by_label("Name", exact=True).fill("Ada <b>")
    page.get_by_role("region", name="New person").get_by_label("First password").fill(FIRST)
    page.get_by_role("button", name="Add the account").click()
    page.wait_for_selector(f"{ROW.format('Ada <b>')} >> text=first password not changed yet")
    choose(page, "Account", "Ada <b>")
    page.get_by_role("button", name="Close the account").click()
    page.wait_for_selector(f"{ROW.format('Ada <b>')} >> text=closed")
    answer = station.http.post("/api/enter", json={"name": "Ada <b>", "password": FIRST})
    assert answer.status_code == 401
    page.get_by_role("region", name="Account", exact=True).get_by_label("First password").fill(f"{FIRST} again")
    page.get_by_role("button", name="Open again with this password").click()
    page.wait_for_selector(f"{ROW.format('Ada <b>')} >> text=first password not changed yet")
    answer = station.http.post("/api/enter", json={"name": "Ada <b>", "password": f"{FIRST} again"})
    assert (answer.status_code, answer.json()["must_change"]) == (200, True)


def test_each_step_is_a_line_of_the_trail_and_no_secret_is(station: Served) -> None:
    with closing(sqlite3.connect(Path(station.data) / "station.sqlite3")) as database:
        lines = database.execute("SELECT name, action, outcome, detail FROM audit").fetchall()
    done = [(name, action) for name, action, outcome, _ in lines if outcome == "done"]
    by_admin = ["assign_badge", "withdraw_badge", "add_person", "disable_person", "reset_person"]
    assert [action for name, action in done if name == "the admin" and action in by_admin] == by_admin
    assert ("the operator", "change_pin") in done
    for secret in (BADGE, PIN, OWN_PIN, FIRST):
        assert secret not in json.dumps(lines)
