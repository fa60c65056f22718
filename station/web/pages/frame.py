"""What all pages have in common: whose page it is, and the bar at the top that leads to the others."""

from __future__ import annotations

import asyncio
import json
import secrets
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Required, TypedDict

from fastapi import Request
from nicegui import ui
from nicegui.events import GenericEventArguments
from pydantic import JsonValue

from station.web.actions.perform import perform
from station.web.actions.row import Answer
from station.web.actions.table import ACTIONS
from station.web.languages import COOKIE as LANGUAGE_COOKIE
from station.web.languages import LANGUAGES, Words, words_of
from station.web.people.accounts import COOKIE, Session, chosen_language, session_of
from station.web.station import Station

HERE = Path(__file__).parent

PAGES = {
    "bench": "/",
    "results": "/results",
    "quality": "/quality",
    "recipes": "/recipes",
    "maintenance": "/maintenance",
    "jog": "/jog",
    "certificates": "/certificates",
    "people": "/people",
}
"""The pages by their names in the bar."""

IN_ENGLISH = 'lang="en"'
"""Property of the part of a page that is English whatever the person's language is, for a screen reader."""

ACTION_EVENT = "action"
"""Event of a page's socket that asks for an action: its id, its values and, of who may ask again, its key."""

BUSY = "#2f4a5e"
"""The colour of what can be pressed, as `--busy` of the style sheet."""


class Column(TypedDict, total=False):
    """A column of a table as AG Grid takes it in the browser; `field` is the entry of a row that it shows."""

    field: Required[str]
    headerName: Required[str]
    width: int
    minWidth: int
    flex: int
    type: str
    pinned: str
    wrapText: bool
    autoHeight: bool
    cellClassRules: Mapping[str, str]


LONGEST_BUILD_S = 15.0
"""Longest time in which a page reads what it shows, on a computer that does other things."""

KEEP_SEARCH = (
    "document.addEventListener('click', event => {"
    " const link = event.target.closest('.lm-bar a[href^=\"/results\"]');"
    " if (link && location.pathname !== '/results') link.search = sessionStorage.getItem('results') || '';"
    "}, true)"
)
"""The bar leads back to what was looked for on the page of results; on that page itself it leads to all runs."""

TAKE_TYPED = (
    "(() => { const kept = sessionStorage.getItem('typed'); sessionStorage.removeItem('typed'); return kept; })()"
)
"""What was typed on the page that is loaded anew in another language, once: the browser's tab keeps it until then."""

LONGEST_PAUSE_MS = 1000
"""How long a page waits at most before it tries again to reach a server that is away."""

SESSION_EVERY_S = 2.0
"""How often an open page looks whether its session has ended."""


def session_of_token(station: Station, token: str | None) -> Session | None:
    """Return the session of a token; None where it has ended, or never was."""
    with station.database.reading() as connection:
        return session_of(connection, token)


async def session_of_page(station: Station, request: Request) -> Session | None:
    """Return the session of somebody who may see a page; None for nobody, and where a password is to be chosen."""
    return await _may_see(station, request.cookies.get(COOKIE))


async def still_open(station: Station, session: Session) -> bool:
    """Say whether the session of an open page has not ended; where it has, the page is left, and shows nothing more."""
    if await _may_see(station, session.token) is None:
        leave_page()
        return False
    return True


def leave_page() -> None:
    """Have the browser go to the page for logging in, once: each timer of a page asks for it until the page is gone."""
    ui.run_javascript("window.leavesPage || (window.leavesPage = true, location.assign('/enter'))")


async def _may_see(station: Station, token: str | None) -> Session | None:
    found = await asyncio.to_thread(session_of_token, station, token)
    return None if found is None or found.person.must_change else found


def words_for(station: Station, session: Session | None, request: Request) -> Words:
    """Return the words of a page: in the language of the person, else of the browser, else of the site."""
    chosen = None
    if session is not None:
        with station.database.reading() as connection:
            chosen = chosen_language(connection, session.person.name)
    return words_of(chosen or request.cookies.get(LANGUAGE_COOKIE) or station.settings.language)


def bar(station: Station, session: Session, here: str, say: Words) -> ui.label:
    """Build the bar in the person's language, and return the label in its middle, for a clock; here: of `PAGES`.

    A page with fields that takes them up by `typed_before` keeps what was typed while its language is chosen.
    """
    _hear_actions(station, session)
    ui.add_css((HERE / "style.css").read_text(encoding="utf-8"))
    ui.colors(primary=BUSY)  # what Quasar takes for its labels cannot be read on grey
    ui.run_javascript(f"document.documentElement.lang = {say.language!r}")
    ui.run_javascript(f"window.socket.io.reconnectionDelayMax({LONGEST_PAUSE_MS})")
    ui.run_javascript(KEEP_SEARCH)
    with ui.element("header").classes("lm-bar"):
        with ui.element("nav").classes("lm-nav"):
            for name, address in PAGES.items():
                link = ui.link(say(name.capitalize()), address)
                if name == here:
                    link.props('aria-current="page"')
        middle = ui.label()
        with ui.element("div").classes("lm-nav"):
            _languages(station, session, here, say)
            ui.label(f"{session.person.name} ({say(session.person.role)})")
    return middle


async def act(station: Station, session: Session, action: str, values: JsonValue, key: str | None = None) -> Answer:
    """Do an action for the person of an open page, or refuse it; key: of who may ask the same again."""
    key = secrets.token_hex(16) if key is None else key
    return await asyncio.to_thread(perform, station, action, session.token, session.csrf, key, values)


def _hear_actions(station: Station, session: Session) -> None:
    """Do what the scripts of a page ask for over its socket: the same function, roles and lines of the audit trail.

    A socket is no way round them: what is asked there is told by whoever has the page, button or no button.
    """

    async def asked(event: GenericEventArguments) -> None:
        told = event.args if isinstance(event.args, dict) else {}
        action, key, values = (told.get(name) for name in ("action", "key", "values"))
        if isinstance(action, str) and action in ACTIONS and (key is None or isinstance(key, str)):
            await act(station, session, action, values, key)

    ui.on(ACTION_EVENT, asked)


def _fields() -> list[ui.input | ui.number | ui.tabs]:
    """Return the fields of an open page that somebody types into, and its tabs, in their order; none for a password."""
    there = ui.context.client.elements.values()
    found = [one for one in there if isinstance(one, ui.input | ui.number | ui.tabs)]
    return [one for one in found if one.props.get("type") != "password"]


def _typed_into(field: ui.input | ui.number | ui.tabs) -> object:
    """Return what a field holds; of tabs the name of the open one, which is a tab until another is chosen."""
    return field.value.props["name"] if isinstance(field.value, ui.tab) else field.value


async def typed_before(here: str) -> None:
    """Put what was typed on this page into its fields again, where its language was chosen just now; here: of `PAGES`.

    They are told apart by their place, for their labels are of another language.
    """
    kept: object = None
    with suppress(TimeoutError, ValueError):  # of a browser that is away, or keeps nothing
        kept = json.loads(await ui.run_javascript(TAKE_TYPED) or "null")
    fields = _fields()
    match kept:
        case [str(page), list(values)] if page == here and len(values) == len(fields):
            for field, value in zip(fields, values, strict=True):
                field.set_value(value)


def _languages(station: Station, session: Session, here: str, say: Words) -> None:
    """Offer the languages; the one that is chosen is kept for the person, and for the browser's next log-in."""

    async def choose(language: str) -> None:
        await act(station, session, "choose_language", {"language": language})
        kept = f"{LANGUAGE_COOKIE}={language}; path=/; max-age=31536000; samesite=strict"
        typed = json.dumps([here, [_typed_into(one) for one in _fields()]])
        ui.run_javascript(
            f"sessionStorage.setItem('typed', {json.dumps(typed)}); document.cookie = {kept!r}; location.reload()"
        )

    for language, name in LANGUAGES.items():
        button = ui.button(name, on_click=lambda chosen=language: choose(chosen)).props("flat dense no-caps")
        button.props(f'lang="{language}" aria-pressed="{str(language == say.language).lower()}"').classes("lm-language")
