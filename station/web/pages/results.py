"""The page of results: runs looked for by serial number, model, recipe, verdict, operator and day."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Sequence
from datetime import date
from html import escape
from typing import NamedTuple, TypedDict
from urllib.parse import quote, urlencode

from fastapi import Request, Response
from fastapi.responses import RedirectResponse
from nicegui import ui

from station.errors import StationError
from station.results.export import LOCALES
from station.store.run_search import Page, search
from station.store.stored_runs import StoredRun, Wanted
from station.web.languages import Words
from station.web.pages.frame import (
    LONGEST_BUILD_S,
    SESSION_EVERY_S,
    Column,
    bar,
    session_of_page,
    still_open,
    words_for,
)
from station.web.pages.words import SHAPES, attempts_said, local, verdict_text
from station.web.people.accounts import Session
from station.web.rest.runs import begin_of
from station.web.station import Station

ROWS = 50
"""Runs on one page of the table."""

MOST_FIRST = 10**9
"""No folder has as many runs; a larger number in an address is none that a database can count to."""

COLUMNS: tuple[Column, ...] = (
    {
        "field": "verdict",
        "headerName": "Verdict",
        "width": 230,
        "cellClassRules": {"lm-bad": "data.judged.includes('FAIL')", "lm-open": "!/PASS|FAIL/.test(data.judged)"},
    },
    {"field": "open", "headerName": "Serial number", "width": 170},
    {"field": "attempt", "headerName": "Attempt", "width": 100, "type": "rightAligned"},
    {"field": "notes", "headerName": "To know", "flex": 1, "minWidth": 330, "wrapText": True, "autoHeight": True},
    {"field": "started", "headerName": "Started", "width": 200},
    {"field": "model", "headerName": "Model", "width": 160},
    {"field": "recipe", "headerName": "Recipe", "width": 210},
    {"field": "operator", "headerName": "Operator", "width": 140},
    {"field": "report", "headerName": "Report", "width": 150, "pinned": "right"},
)

LINKS = ("open", "report")
"""Columns that hold links; everything else is text."""


def add_results(station: Station) -> None:
    """Add the page to the running application."""

    @ui.page("/results", title="lostmotion: results", response_timeout=LONGEST_BUILD_S)
    async def results(  # noqa: PLR0917 - what is looked for is named in the address
        request: Request,
        serial: str = "",
        model: str = "",
        recipe: str = "",
        verdict: str = "",
        operator: str = "",
        since: str = "",
        until: str = "",
        first: int = 0,
    ) -> Response | None:
        if (session := await session_of_page(station, request)) is None:
            return RedirectResponse("/enter")
        asked = Asked(serial, model, recipe, verdict, operator, since, until, min(max(0, first), MOST_FIRST))
        await _Results(station, session, words_for(station, session, request), asked).build()
        return None


class Asked(NamedTuple):
    """What is looked for, as the address of the page names it: it is there again after Back and from the bar."""

    serial: str = ""
    model: str = ""
    recipe: str = ""
    verdict: str = ""
    operator: str = ""
    since: str = ""
    until: str = ""
    first: int = 0

    @property
    def query(self) -> str:
        """Return it as the address has it, '' where nothing is looked for."""
        fields = urlencode({name: value for name, value in self._asdict().items() if value})
        return f"?{fields}" if fields else ""


class _Results:
    """One open page: what is looked for, and which part of it is shown."""

    def __init__(self, station: Station, session: Session, say: Words, asked: Asked) -> None:
        self._station, self._session, self._words, self._asked = station, session, say, asked
        self._first = asked.first
        self._searches = self._runs_behind = 0

    async def build(self) -> None:
        """Lay the page out, and show the newest runs."""
        say, asked = self._words, self._asked
        bar(self._station, self._session, "results", say)
        with ui.element("main").classes("lm-page"):
            with ui.element("form").classes("lm-filters").props('role="search" onsubmit="return false"'):
                self._serial = ui.input(say("Serial number begins with"), value=asked.serial).props(
                    "outlined dense clearable autofocus"
                )
                self._model = ui.select(any_or(asked.model, say), value=asked.model, label=say("Model")).props(
                    "outlined dense"
                )
                self._recipe = ui.select(any_or(asked.recipe, say), value=asked.recipe, label=say("Recipe")).props(
                    "outlined dense"
                )
                choices = {"": say("any")} | {one: say(one) for one in SHAPES}
                chosen = asked.verdict if asked.verdict in choices else ""
                self._verdict = ui.select(choices, value=chosen, label=say("Verdict")).props("outlined dense")
                self._operator = ui.input(say("Operator"), value=asked.operator).props("outlined dense clearable")
                self._since = ui.input(say("From day"), value=asked.since).props("outlined dense type=date stack-label")
                self._until = ui.input(say("To day"), value=asked.until).props("outlined dense type=date stack-label")
            for one in (
                self._serial,
                self._model,
                self._recipe,
                self._verdict,
                self._operator,
                self._since,
                self._until,
            ):
                one.on_value_change(self._again)
            with ui.element("div").classes("lm-pager"):
                self._newer = ui.button(say("Newer"), on_click=lambda: self._turn(-ROWS)).props("outline no-caps")
                self._said = ui.label().props('role="status" aria-live="polite"')
                self._older = ui.button(say("Older"), on_click=lambda: self._turn(ROWS)).props("outline no-caps")
                self._csv = ui.link(say("These runs with their metrics, as CSV"), "/api/runs.csv")
            options = {
                "columnDefs": [one | {"headerName": say(one["headerName"])} for one in COLUMNS],
                "rowData": [],
                "defaultColDef": {"sortable": False, "resizable": True},
                "suppressMovableColumns": True,
                ":getRowId": "params => params.data.run",
                "overlayNoRowsTemplate": say("No run fits."),
            }
            links = [place for place, one in enumerate(COLUMNS) if one["field"] in LINKS]
            self._grid = ui.aggrid(options, html_columns=links).classes("lm-grid")
            self._behind = ui.label().classes("lm-bypasses").props('role="status"')
            self._behind.set_visibility(False)
        ui.timer(SESSION_EVERY_S, self._look_again)
        await self._look()

    async def _look_again(self) -> None:
        """Look whether the session is open, and anew for runs that were not in the search yet."""
        if self._runs_behind:
            await self._look()
        else:
            await still_open(self._station, self._session)

    async def _again(self) -> None:
        self._first = 0
        await self._look()

    async def _turn(self, by: int) -> None:
        self._first = max(0, self._first + by)
        await self._look()

    async def _look(self) -> None:
        if not await still_open(self._station, self._session):
            return
        self._csv.props(f'href="{self._address_of_csv()}"')
        self._keep_in_address()
        wanted = Wanted(
            begins=(self._serial.value or "").strip() or None,
            model=self._model.value or None,
            recipe=self._recipe.value or None,
            verdict=self._verdict.value or None,
            operator=(self._operator.value or "").strip() or None,
            since=begin_of(_day(self._since.value)),
            until=begin_of(_day(self._until.value), after=True),
        )
        self._searches += 1
        number = self._searches
        try:
            page = await asyncio.to_thread(search, self._station.data, wanted, first=self._first, count=ROWS)
        except StationError as error:
            self._said.set_text(str(error))
            self._runs_behind = 1  # a store that is being brought up is there in a moment: it is looked again
            return
        if number != self._searches:
            return  # something else is looked for by now
        if not page.rows and 0 < page.total <= self._first:  # an address of when there were more
            self._first = (page.total - 1) // ROWS * ROWS
            self._searches -= 1  # it goes on
            await self._look()
        else:
            self._show(page)

    def _keep_in_address(self) -> None:
        """Put what is looked for into the address, and keep it for the bar of the pages that are opened next."""
        names = (self._serial, self._model, self._recipe, self._verdict, self._operator, self._since, self._until)
        serial, model, recipe, verdict, operator, since, until = (str(one.value or "").strip() for one in names)
        self._asked = Asked(serial, model, recipe, verdict, operator, since, until, self._first)
        query = json.dumps(self._asked.query)
        ui.run_javascript(
            f"history.replaceState(history.state, '', '/results' + {query}); sessionStorage.setItem('results', {query})"
        )

    def _address_of_csv(self) -> str:
        """Return where the runs that are looked for are one table."""
        asked = {
            "serial": (self._serial.value or "").strip(), "model": self._model.value, "recipe": self._recipe.value,
            "verdict": self._verdict.value, "operator": (self._operator.value or "").strip(),
            "since": _day(self._since.value), "until": _day(self._until.value),
            "locale": self._words.language if self._words.language in LOCALES else "",
        }  # fmt: skip
        return f"/api/runs.csv?{urlencode({name: value for name, value in asked.items() if value})}"

    def _show(self, page: Page) -> None:
        for one, names in ((self._recipe, page.recipes), (self._model, page.models)):
            one.set_options(any_or(one.value or "", self._words) | {name: name for name in names})
        self._behind.set_text(self._words(f"{page.behind} runs are not in the search yet. They are being added."))
        self._behind.set_visibility(page.behind > 0)
        self._runs_behind = page.behind
        last = self._first + len(page.rows)
        told = f"{self._first + 1} to {last} of {page.total} runs" if page.rows else "No run fits."
        self._said.set_text(self._words(told))
        self._newer.set_enabled(self._first > 0)
        self._older.set_enabled(last < page.total)
        rows = [
            row_of(one, page.attempts.get(one.run, ""), self._words, page.not_passed.get(one.run, ()))
            for one in page.rows
        ]
        if self._searches == 1:
            self._grid.options["rowData"] = rows
        else:  # by their ids: a row that stays keeps its elements, so that a click on it is not lost
            self._grid.run_grid_method("setGridOption", "rowData", rows)


def any_or(chosen: str, say: Words) -> dict[str, str]:
    """Return the choices of a field of which nothing is known yet but what is chosen, '' for any."""
    return {"": say("any")} | ({chosen: chosen} if chosen else {})


class RunRow(TypedDict):
    """What the table shows of a run: its columns by their fields; `judged`: the verdict in English, for its colour."""

    run: str
    judged: str
    verdict: str
    open: str
    attempt: int | None
    started: str
    model: str
    recipe: str
    operator: str
    notes: str
    report: str


def row_of(one: StoredRun, attempts: str, say: Words, not_passed: Sequence[str] = ()) -> RunRow:
    """Return what the table shows of a run; all but the links is text, and stays text whatever it holds.

    attempts: which one it is and what became of those before, in words. not_passed: metrics
    that failed, or left it not decidable.
    """
    name, what = quote(one.run, safe=""), f"of {escape(one.serial)}, attempt {one.attempt}"
    judged = verdict_text(one)
    shape, _, word = judged.partition(" ")
    return {
        "run": one.run,
        "judged": judged,
        "verdict": f"{shape} {say(word)}",
        "open": f'<a href="/runs/{name}" aria-label="run {what}">{escape(one.serial)}</a>',
        "attempt": one.attempt,
        "started": local(one.started),
        "model": one.model,
        "recipe": one.recipe if one.revision is None else f"{one.recipe} r{one.revision}",
        "operator": one.operator or "",
        "notes": " ".join(_notes(one, attempts, say, not_passed)),
        # A record that is not as it was left has no report.
        "report": ""
        if one.altered
        else f'<a href="/api/runs/{name}/report.html" aria-label="report {what}">{escape(say("page"))}</a> '
        f'<a href="/api/runs/{name}/report.pdf" aria-label="report as PDF {what}">PDF</a>',
    }


def _notes(one: StoredRun, attempts: str, say: Words, not_passed: Sequence[str]) -> list[str]:
    notes = [say(f"No verdict: {text}.") for text in one.altered.splitlines()[:1]]
    if not_passed and one.verdict:
        names = ", ".join(not_passed)
        notes += [
            say("Failed: {names}.", names=names)
            if one.verdict == "FAIL"
            else say("Not decidable: {names}.", names=names)
        ]
    said = attempts_said(attempts, say)
    notes += [f"{said[:1].upper()}{said[1:]}."] if one.attempt > 1 and attempts else []
    notes += [say("Faults were injected.")] if one.scenario else []
    notes += [say("Virtual bench.")] if one.virtual else []
    return notes + ([say("Master part.")] if one.master else [])


def _day(text: str | None) -> date | None:
    """Return the day of a field; None while it is empty or only half typed."""
    try:
        return date.fromisoformat(text or "")
    except ValueError:
        return None
