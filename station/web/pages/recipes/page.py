"""The page of recipes: every revision with its state, and a file taken in as a draft."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from functools import partial
from html import escape
from typing import TypedDict
from urllib.parse import quote

from fastapi import Request, Response
from fastapi.responses import RedirectResponse
from nicegui import events, ui

from recipes.text.yaml_source import LARGEST_FILE
from station.errors import StationError
from station.records.revisions.history import History
from station.records.revisions.revision import Revision, State
from station.web.actions.table import ACTIONS
from station.web.actions.values import RecipeChanged
from station.web.languages import Words
from station.web.pages.frame import SESSION_EVERY_S, Column, act, bar, session_of_page, still_open, words_for
from station.web.pages.recipes.editor import add_editor, address_of
from station.web.pages.recipes.load_curve import LINE_INK
from station.web.pages.recipes.revisions import STATES
from station.web.pages.words import local
from station.web.people.accounts import Session
from station.web.station import Station

COLUMNS: tuple[Column, ...] = (
    {"field": "name", "headerName": "Recipe", "width": 280},
    {"field": "revision", "headerName": "Revision", "width": 120, "type": "rightAligned"},
    {
        "field": "state",
        "headerName": "State",
        "width": 250,
        "cellClassRules": {"lm-open": "data.open", "lm-waits": "data.waits"},
    },
    {"field": "saved", "headerName": "Saved", "width": 190},
    {"field": "current", "headerName": "Current", "width": 100},
    {"field": "authors", "headerName": "Written by", "flex": 1, "minWidth": 180},
    {"field": "released", "headerName": "Released by", "flex": 1, "minWidth": 220},
    {"field": "links", "headerName": "Text", "width": 170, "pinned": "right"},
)


def add_recipe_pages(station: Station) -> None:
    """Add the pages to the running application."""
    add_editor(station)

    @ui.page("/recipes", title="lostmotion: recipes")
    async def recipes(request: Request) -> Response | None:
        if (session := await session_of_page(station, request)) is None:
            return RedirectResponse("/enter")
        await _Recipes(station, session, words_for(station, session, request)).build()
        return None


class _Recipes:
    """One open page."""

    def __init__(self, station: Station, session: Session, say: Words) -> None:
        self._station, self._session, self._words = station, session, say

    async def build(self) -> None:
        """Lay the page out, and show every revision."""
        say = self._words
        ui.colors(primary=LINE_INK)
        bar(self._station, self._session, "recipes", say)
        with ui.element("main").classes("lm-page"):
            self._said = ui.label().classes("lm-bypasses").props('role="alert"')
            self._said.set_visibility(False)
            if self._session.person.role in ACTIONS["save_recipe"].roles:
                too_long = say("This file is too long for a recipe.")
                file = ui.upload(
                    on_upload=self._take, auto_upload=True,
                    max_file_size=LARGEST_FILE, on_rejected=lambda: self._tell(too_long),
                ).props("accept=.yaml,.yml flat").classes("lm-import")  # fmt: skip
                # Quasar's own button is one within another, which a screen reader cannot say.
                pick = ui.button(say("Import a file as a draft"), on_click=lambda: file.run_method("pickFiles"))
                pick.props("no-caps")
            links = next(place for place, one in enumerate(COLUMNS) if one["field"] == "links")
            options = {
                "columnDefs": [one | {"headerName": say(one["headerName"])} for one in COLUMNS],
                "rowData": [],
                "defaultColDef": {"sortable": False, "resizable": True},
                "suppressMovableColumns": True,
                ":getRowId": "params => params.data.id",
            }
            ui.timer(SESSION_EVERY_S, partial(still_open, self._station, self._session))
            self._grid = ui.aggrid(options, html_columns=[links]).classes("lm-grid")
        try:
            history = await asyncio.to_thread(History, self._station.data)
        except StationError as error:
            self._tell(say(str(error)))
            return
        self._grid.options["rowData"] = [row_of(history, one, say) for one in waiting_first(history.all())]
        self._grid.update()
        if history.problems:
            self._tell(" ".join(map(say, history.problems[:3])))

    def _tell(self, text: str) -> None:
        self._said.set_text(text)
        self._said.set_visibility(bool(text))

    async def _take(self, event: events.UploadEventArguments) -> None:
        try:
            text = (await event.file.read()).decode()
        except UnicodeDecodeError:
            self._tell(self._words("The file is no text in UTF-8. Save it with that encoding."))
            return
        answer = await act(self._station, self._session, "save_recipe", {"text": text})
        if isinstance(answer.said, RecipeChanged):
            ui.navigate.to(address_of(answer.said.name, answer.said.revision))
        else:
            self._tell(" ".join(self._words(one.text) for one in answer.refused))


class RevisionRow(TypedDict):
    """What the table shows of a revision: its columns by their fields."""

    id: str
    name: str
    revision: int
    state: str
    open: bool
    waits: bool
    saved: str
    current: str
    authors: str
    released: str
    links: str


def waiting_first(revisions: Iterable[Revision]) -> list[Revision]:
    """Return revisions with those first that wait for somebody to release them; the others stay in their order."""
    return sorted(revisions, key=lambda one: one.state is not State.ASKED)


def row_of(history: History, one: Revision, say: Words) -> RevisionRow:
    """Return what the table shows of a revision; all but the links is text, and stays text whatever it holds."""
    address, what = address_of(one.name, one.revision), {"name": one.name, "revision": one.revision}
    file = f"/api/recipes/{quote(one.name, safe='')}/{one.revision}.yaml"
    released = say("the program") if one.shipped else f"{one.released_by}, {local(one.released)}"
    opened, exported = (
        say("open {name} revision {revision}", **what),
        say("export {name} revision {revision}", **what),
    )
    return {
        "id": f"{one.name} {one.revision}",
        "name": one.name,
        "revision": one.revision,
        "state": say("○ draft, sent back") if one.sent_back_by else say(STATES[one.state]),
        "open": one.state is not State.RELEASED,
        "waits": one.state is State.ASKED,
        "saved": local(one.saved) if one.saved else "",
        "current": say("yes") if history.newest_released(one.name) == one else "",
        "authors": ", ".join(one.authors),
        "released": released if one.state is State.RELEASED else "",
        "links": f'<a href="{address}" aria-label="{escape(opened)}">{say("Open")}</a> '
        f'<a href="{file}" aria-label="{escape(exported)}">{say("Export")}</a>',
    }
