"""What all pages have in common: whose page it is, and the bar at the top that leads to the others."""

from __future__ import annotations

import asyncio
from pathlib import Path

from fastapi import Request
from nicegui import ui

from station.web.actions import Station
from station.web.people.accounts import COOKIE, Session, session_of

HERE = Path(__file__).parent

PAGES = {
    "bench": "/",
    "results": "/results",
    "quality": "/quality",
    "recipes": "/recipes",
    "maintenance": "/maintenance",
    "certificates": "/certificates",
}
"""The pages by their names in the bar."""

LONGEST_BUILD_S = 15.0
"""Longest time in which a page reads what it shows, on a computer that does other things."""

SESSION_EVERY_S = 2.0
"""How often an open page looks whether its session has ended."""


def session_of_request(station: Station, request: Request) -> Session | None:
    """Return the session that a request comes from; None where nobody is logged in."""
    return session_of_token(station, request.cookies.get(COOKIE))


def session_of_token(station: Station, token: str | None) -> Session | None:
    """Return the session of a token; None where it has ended, or never was."""
    with station.database.reading() as connection:
        return session_of(connection, token)


async def still_open(station: Station, session: Session) -> bool:
    """Say whether the session of an open page has not ended; where it has, the page is left, and shows nothing more."""
    found = await asyncio.to_thread(session_of_token, station, session.token)
    if found is None or found.person.must_change:
        ui.navigate.to("/enter")
        return False
    return True


def bar(session: Session, here: str) -> ui.label:
    """Build the bar, and return the label in its middle, for a clock; here: a name of `PAGES`."""
    ui.add_css((HERE / "style.css").read_text(encoding="utf-8"))
    with ui.element("header").classes("lm-bar"):
        with ui.element("nav").classes("lm-nav"):
            for name, address in PAGES.items():
                link = ui.link(name.capitalize(), address)
                if name == here:
                    link.props('aria-current="page"')
        middle = ui.label()
        ui.label(f"{session.person.name} ({session.person.role})")
    return middle
