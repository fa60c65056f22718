"""The page of results: runs looked for by serial number, recipe, verdict, operator and day, each with its report."""

from __future__ import annotations

import asyncio
from datetime import date, datetime
from html import escape
from typing import Any
from urllib.parse import quote

from fastapi import Request, Response
from fastapi.responses import RedirectResponse
from nicegui import ui

from station.errors import StationError
from station.store.run_search import Page, RunRow, Wanted, search
from station.web.actions import Station
from station.web.pages.frame import bar, session_of_request
from station.web.people.accounts import Session
from station.web.rest_runs import begin_of

ROWS = 50
"""Runs on one page of the table."""

SHAPES = {"PASS": "●", "FAIL": "■", "NOT DECIDABLE": "▲"}
"""Shape of each verdict, as on the operator's page: colour alone tells nobody who does not see it."""

NO_VERDICT = "–"

COLUMNS: tuple[dict[str, Any], ...] = (
    {
        "field": "verdict",
        "headerName": "Verdict",
        "width": 190,
        "cellClassRules": {"lm-bad": "data.verdict.includes('FAIL')", "lm-open": "!/PASS|FAIL/.test(data.verdict)"},
    },
    {"field": "serial", "headerName": "Serial number", "width": 200},
    {"field": "attempt", "headerName": "Attempt", "width": 110, "type": "rightAligned"},
    {"field": "started", "headerName": "Started", "width": 200},
    {"field": "recipe", "headerName": "Recipe", "width": 230},
    {"field": "operator", "headerName": "Operator", "width": 160},
    {"field": "notes", "headerName": "To know", "flex": 1, "minWidth": 220, "wrapText": True, "autoHeight": True},
    {"field": "report", "headerName": "Report", "width": 150, "pinned": "right"},
)


def add_results(station: Station) -> None:
    """Add the page to the running application."""

    @ui.page("/results", title="lostmotion: results")
    async def results(request: Request) -> Response | None:
        session = await asyncio.to_thread(session_of_request, station, request)
        if session is None or session.person.must_change:
            return RedirectResponse("/enter")
        await _Results(station, session).build()
        return None


class _Results:
    """One open page: what is looked for, and which part of it is shown."""

    def __init__(self, station: Station, session: Session) -> None:
        self._station, self._session = station, session
        self._first = 0

    async def build(self) -> None:
        """Lay the page out, and show the newest runs."""
        bar(self._session, "results")
        with ui.element("main").classes("lm-page"):
            with ui.element("form").classes("lm-filters").props('role="search" onsubmit="return false"'):
                self._serial = ui.input("Serial number begins with").props("outlined dense clearable autofocus")
                self._recipe = ui.select({"": "any"}, value="", label="Recipe").props("outlined dense")
                choices = {"": "any"} | {one: one for one in SHAPES}
                self._verdict = ui.select(choices, value="", label="Verdict").props("outlined dense")
                self._operator = ui.input("Operator").props("outlined dense clearable")
                self._since = ui.input("From day").props("outlined dense type=date stack-label")
                self._until = ui.input("To day").props("outlined dense type=date stack-label")
            for one in (self._serial, self._recipe, self._verdict, self._operator, self._since, self._until):
                one.on_value_change(self._again)
            with ui.element("div").classes("lm-pager"):
                self._newer = ui.button("Newer", on_click=lambda: self._turn(-ROWS)).props("outline no-caps")
                self._said = ui.label().props('role="status" aria-live="polite"')
                self._older = ui.button("Older", on_click=lambda: self._turn(ROWS)).props("outline no-caps")
            options = {
                "columnDefs": list(COLUMNS),
                "rowData": [],
                "defaultColDef": {"sortable": False, "resizable": True},
                "suppressMovableColumns": True,
                ":getRowId": "params => params.data.run",
                "overlayNoRowsTemplate": "No run fits.",
            }
            report = next(place for place, one in enumerate(COLUMNS) if one["field"] == "report")
            self._grid = ui.aggrid(options, html_columns=[report]).classes("lm-grid")
        await self._look()

    async def _again(self) -> None:
        self._first = 0
        await self._look()

    async def _turn(self, by: int) -> None:
        self._first = max(0, self._first + by)
        await self._look()

    async def _look(self) -> None:
        wanted = Wanted(
            serial=(self._serial.value or "").strip() or None,
            recipe=self._recipe.value or None,
            verdict=self._verdict.value or None,
            operator=(self._operator.value or "").strip() or None,
            since=begin_of(_day(self._since.value)),
            until=begin_of(_day(self._until.value), after=True),
        )
        try:
            page = await asyncio.to_thread(search, self._station.data, wanted, first=self._first, count=ROWS)
        except StationError as error:
            self._said.set_text(str(error))
            return
        self._show(page)

    def _show(self, page: Page) -> None:
        self._recipe.set_options({"": "any"} | {name: name for name in page.recipes})
        last = self._first + len(page.rows)
        self._said.set_text(f"{self._first + 1} to {last} of {page.total} runs" if page.rows else "No run fits.")
        self._newer.set_enabled(self._first > 0)
        self._older.set_enabled(last < page.total)
        self._grid.options["rowData"] = [row_of(one) for one in page.rows]
        self._grid.update()


def row_of(one: RunRow) -> dict[str, Any]:
    """Return what the table shows of a run; all but the links is text, and stays text whatever it holds."""
    address = f"/api/runs/{quote(one.run, safe='')}/report"
    what = f"of {escape(one.serial)}, attempt {one.attempt}"
    return {
        "run": one.run,
        "verdict": verdict_text(one),
        "serial": one.serial,
        "attempt": one.attempt,
        "started": _local(one.started),
        "recipe": one.recipe if one.revision is None else f"{one.recipe} r{one.revision}",
        "operator": one.operator or "",
        "notes": " ".join(_notes(one)),
        "report": f'<a href="{address}.html" aria-label="report {what}">page</a> '
        f'<a href="{address}.pdf" aria-label="report as PDF {what}">PDF</a>',
    }


def verdict_text(one: RunRow) -> str:
    """Return the verdict with its shape; how the run ended where it has none."""
    if one.doubt:
        return f"{NO_VERDICT} NO VERDICT"
    if one.state != "complete":
        return f"{NO_VERDICT} {one.state.upper()}"
    return f"{SHAPES.get(one.verdict or '', NO_VERDICT)} {one.verdict or 'NO VERDICT'}"


def _notes(one: RunRow) -> list[str]:
    notes = [one.doubt] if one.doubt else []
    notes += ["Faults were injected."] if one.scenario else []
    return [*notes, "Virtual bench."] if one.virtual else notes


def _local(moment: str | None) -> str:
    """Return a moment by the computer's time zone."""
    if moment is None:
        return ""
    try:
        return datetime.fromisoformat(moment).astimezone().strftime("%Y-%m-%d %H:%M:%S")
    except ValueError:
        return moment


def _day(text: str | None) -> date | None:
    """Return the day of a field; None while it is empty or only half typed."""
    try:
        return date.fromisoformat(text or "")
    except ValueError:
        return None
