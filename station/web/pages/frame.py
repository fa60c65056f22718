"""What all pages have in common: whose page it is, and the bar at the top that leads to the others."""

from __future__ import annotations

from pathlib import Path

from fastapi import Request
from nicegui import ui

from station.web.actions import Station
from station.web.people.accounts import COOKIE, Session, session_of

HERE = Path(__file__).parent

PAGES = {"bench": "/", "results": "/results", "recipes": "/recipes"}
"""The pages by their names in the bar."""


def session_of_request(station: Station, request: Request) -> Session | None:
    """Return the session that a request comes from; None where nobody is logged in."""
    with station.database.reading() as connection:
        return session_of(connection, request.cookies.get(COOKIE))


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
