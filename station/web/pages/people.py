"""The page of people: one's own password and PIN, and for an admin the accounts and badges of all."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from html import escape

from fastapi import Request, Response
from fastapi.responses import RedirectResponse
from nicegui import ui
from pydantic import JsonValue

from station.web.actions.row import OK
from station.web.actions.table import ACTIONS
from station.web.languages import Words
from station.web.pages.frame import LONGEST_BUILD_S, SESSION_EVERY_S, act, bar, session_of_page, still_open, words_for
from station.web.people.accounts import ROLES, Session
from station.web.people.listed import OPEN, Account, accounts_of
from station.web.station import Station

COLUMNS = ("Name", "Role", "Account", "Badge")
DONE = {
    "add_person": "The account was added. Its owner replaces the first password at the first log-in.",
    "disable_person": "The account is closed.",
    "reset_person": "The account is open again. Its owner replaces the first password at the next log-in.",
    "assign_badge": "The badge belongs to {name} now.",
    "withdraw_badge": "{name} has no badge any more.",
    "change_pin": "The PIN is changed.",
    "change_password": "The password is changed. Log in again.",
}
"""What is said of an action that was done here."""


def add_people(station: Station) -> None:
    """Add the page to the running application."""

    @ui.page("/people", title="lostmotion: people", response_timeout=LONGEST_BUILD_S)
    async def page(request: Request) -> Response | None:
        if (session := await session_of_page(station, request)) is None:
            return RedirectResponse("/enter")
        await _People(station, session, words_for(station, session, request)).build()
        return None


class _People:
    """One open page: who was chosen, and what became of what was asked."""

    def __init__(self, station: Station, session: Session, say: Words) -> None:
        self._station, self._session, self._words = station, session, say
        self._admin = session.person.role in ACTIONS["assign_badge"].roles

    async def build(self) -> None:
        """Lay the page out."""
        bar(self._station, self._session, "people", self._words)
        with ui.element("main").classes("lm-page lm-people"):
            self._said = ui.label().props('role="status" aria-live="polite"').classes("lm-card")
            self._refused = ui.label().props('role="alert"').classes("lm-refused")
            self._said.set_visibility(False)
            self._refused.set_visibility(False)
            if self._admin:
                self._table = ui.html(sanitize=False).classes("lm-card")
                with ui.element("div").classes("lm-people-forms"):
                    self._build_badge()
                    self._build_account()
                    self._build_new()
            with ui.element("div").classes("lm-people-forms"):
                self._build_own()
        if self._admin:
            await self._fill()
        ui.timer(SESSION_EVERY_S, lambda: still_open(self._station, self._session))

    def _build_badge(self) -> None:
        with self._card("Badge"):
            self._owner = self._chosen()
            self._badge = self._input("Badge number: scan it, or type it")
            self._pin = self._input("PIN, 4 to 12 digits", secret=True).classes("lm-pin")
            # In the browser: a scanner ends with Enter, and what is typed next is the PIN, however slow the server is.
            self._badge.on("keydown.enter", js_handler="() => document.querySelector('.lm-pin input').focus()")
            self._button("Give the badge", self._give)
            self._button("Take the badge away", self._take, second=True)

    def _build_account(self) -> None:
        with self._card("Account"):
            self._whose = self._chosen()
            self._fresh = self._input("First password, 8 characters or more", secret=True)
            self._button("Open again with this password", self._reset)
            self._button("Close the account", self._close, second=True)

    def _build_new(self) -> None:
        with self._card("New person"):
            self._name = self._input("Name")
            roles = {role: self._words(role) for role in ROLES}
            self._role = ui.select(roles, value=ROLES[0], label=self._words("Role")).props("outlined dense")
            self._first = self._input("First password, 8 characters or more", secret=True)
            self._button("Add the account", self._add)

    def _build_own(self) -> None:
        with self._card("Your password"):
            self._old = self._input("Password that you have now", secret=True)
            self._new = self._input("New password, 8 characters or more", secret=True)
            self._button("Change password", self._change_password)
        with self._card("Your PIN"):
            self._password = self._input("Your password", secret=True)
            self._own_pin = self._input("New PIN, 4 to 12 digits", secret=True)
            self._button("Change PIN", self._change_pin)
        with self._card("Your session"):
            self._button("Log out", lambda: self._do("leave", {}))

    def _card(self, title: str) -> ui.element:
        card = ui.element("section").classes("lm-card lm-stack").props(f'aria-label="{escape(self._words(title))}"')
        with card:
            ui.label(self._words(title)).classes("lm-title").props('role="heading" aria-level="2"')
        return card

    def _chosen(self) -> ui.select:
        return ui.select([], label=self._words("Person")).props("outlined dense")

    def _input(self, label: str, *, secret: bool = False) -> ui.input:
        found = ui.input(self._words(label), password=secret).props("outlined dense")
        return found.props('autocomplete="new-password"' if secret else 'autocomplete="off"')

    def _button(self, text: str, does: Callable[[], Awaitable[None]], *, second: bool = False) -> None:
        button = ui.button(self._words(text), on_click=does, color=None).props("no-caps").classes("lm-button")
        if second:
            button.classes("lm-second")

    async def _give(self) -> None:
        values: dict[str, JsonValue] = {"name": self._owner.value or "", "badge": self._badge.value or ""}
        await self._do("assign_badge", values | {"pin": self._pin.value or ""}, self._badge, self._pin)

    async def _take(self) -> None:
        await self._do("withdraw_badge", {"name": self._owner.value or ""})

    async def _reset(self) -> None:
        values: dict[str, JsonValue] = {"name": self._whose.value or "", "password": self._fresh.value or ""}
        await self._do("reset_person", values, self._fresh)

    async def _close(self) -> None:
        await self._do("disable_person", {"name": self._whose.value or ""})

    async def _add(self) -> None:
        values: dict[str, JsonValue] = {"name": self._name.value or "", "role": self._role.value}
        await self._do("add_person", values | {"password": self._first.value or ""}, self._name, self._first)

    async def _change_password(self) -> None:
        values: dict[str, JsonValue] = {"old_password": self._old.value or "", "new_password": self._new.value or ""}
        await self._do("change_password", values, self._old, self._new)

    async def _change_pin(self) -> None:
        values: dict[str, JsonValue] = {"password": self._password.value or "", "pin": self._own_pin.value or ""}
        await self._do("change_pin", values, self._password, self._own_pin)

    async def _do(self, action: str, values: dict[str, JsonValue], *emptied: ui.input) -> None:
        """Do an action and say what became of it; emptied: fields of which nothing is to be left."""
        answer = await act(self._station, self._session, action, values)
        done = answer.status == OK
        self._refused.set_text(" ".join(self._words(one.text) for one in answer.refused))
        self._refused.set_visibility(not done)
        said = DONE.get(action, "")
        self._said.set_text(self._words(said, name=values.get("name", "")) if "{" in said else self._words(said))
        self._said.set_visibility(done and bool(said))
        if done:
            for field in emptied:
                field.set_value("")
        if await still_open(self._station, self._session) and self._admin:
            await self._fill()

    async def _fill(self) -> None:
        """Show the accounts as they are now."""
        rows = await asyncio.to_thread(self._accounts)
        self._table.set_content(_html(rows, self._words))
        names = [one.name for one in rows]
        for chosen in (self._owner, self._whose):
            chosen.set_options(names, value=chosen.value if chosen.value in names else None)

    def _accounts(self) -> list[Account]:
        with self._station.database.reading() as connection:
            return accounts_of(connection)


def _html(rows: list[Account], say: Words) -> str:
    head = "".join(f"<th>{escape(say(one))}</th>" for one in COLUMNS)
    body = "".join(_row(one, say) for one in rows)
    return f'<table class="lm"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'


def _row(one: Account, say: Words) -> str:
    told = (one.name, say(one.role), say(one.standing), say("yes" if one.badge else "no"))
    cells = "".join(f"<td>{escape(text)}</td>" for text in told)
    return f'<tr class="{"" if one.standing == OPEN else "OPEN"}">{cells}</tr>'
