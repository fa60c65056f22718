"""The page of one run: why it passed or failed, its loop with other runs drawn over it, and its files."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from fastapi import Request, Response
from fastapi.responses import RedirectResponse
from nicegui import ui

from definitions.metrics import METRICS, WIDTH
from definitions.units import ARCMINUTES, STIFFNESS
from station.documents.result import MetricValue
from station.errors import StationError
from station.records.data_folder import Store
from station.reports.content import LOOP_CSV
from station.store.run_search import search
from station.store.stored_runs import StoredRun, Wanted
from station.web.languages import Words
from station.web.pages.frame import LONGEST_BUILD_S, SESSION_EVERY_S, bar, session_of_page, still_open, words_for
from station.web.pages.loop_figure import OTHERS, Drawn, Marked, loop_figure, stiffness_figure
from station.web.pages.run_text import RunText, metric_title, run_text
from station.web.pages.words import local, verdict_text
from station.web.people.accounts import Session
from station.web.rest.runs import FILES
from station.web.station import Station

MOST_ATTEMPTS = 20
MOST_FOUND = 8
MARKED = ("FAIL", "NOT DECIDABLE")

FILE_WORDS = {
    "report.pdf": "Report (PDF)", "report.html": "Report (page)", LOOP_CSV: "Loop (CSV)",
    "run.parquet": "All samples (Parquet)",
}  # fmt: skip
"""The files of a run as the page offers them."""


def _labelled(text: str) -> str:
    """Return the property of an element that names it; what is said of it is a text of the catalogues."""
    return f'aria-label="{text}"'


def allowed_width(metric: MetricValue) -> float | None:
    """Return how wide the loop may be where the metric reads its width [arcmin]; None for one that is no such width."""
    row = METRICS.get(metric.id)
    read_across = row is not None and row.branches == WIDTH and row.magnitude and row.kind == ARCMINUTES
    return metric.limits.max if read_across else None


def add_run_page(station: Station) -> None:
    """Add the page to the running application."""

    @ui.page("/runs/{run}", title="lostmotion: run", response_timeout=LONGEST_BUILD_S)
    async def page(request: Request, run: str) -> Response | None:
        if (session := await session_of_page(station, request)) is None:
            return RedirectResponse("/enter")
        await _RunPage(station, session, run, words_for(station, session, request)).build()
        return None


@dataclass(frozen=True)
class Beside:
    """Runs that may be drawn over this one: those of the same unit, newest first, and of good master parts."""

    attempts: tuple[StoredRun, ...]
    golden: tuple[StoredRun, ...]


def beside(data: Path, run: str, serial: str, model: str) -> Beside:
    """Return the runs that are offered beside a run of a unit and its model.

    Raises:
        StationError: the store cannot be used.

    """
    same = search(data, Wanted(serial=serial), count=MOST_ATTEMPTS).rows
    golden = search(data, Wanted(model=model, master="PASS", verdict="PASS"), count=1).rows
    return Beside(tuple(one for one in same if one.run != run), tuple(one for one in golden if one.serial != serial))


class _RunPage:
    """One open page: a run, and those that are drawn over it."""

    def __init__(self, station: Station, session: Session, run: str, say: Words) -> None:
        self._station, self._session, self._name, self._words = station, session, run, say
        self._own: Drawn | None = None
        self._chosen: set[str] = set()
        self._others: dict[str, Drawn] = {}
        self._marked: list[Marked] = []
        self._close = False
        self._loop: ui.plotly | None = None
        self._stiffness: ui.plotly | None = None

    async def build(self) -> None:
        """Lay the page out: first what is written down, then what has to be evaluated."""
        say = self._words
        bar(self._station, self._session, "results", say)
        ui.timer(SESSION_EVERY_S, lambda: still_open(self._station, self._session))
        record = await asyncio.to_thread(Store(self._station.data).by_id, self._name)
        with ui.element("main").classes("lm-run"):
            if record is None:
                ui.label(say("There is no such run.")).classes("lm-refused").props('role="alert"')
                return
            try:
                shown = await asyncio.to_thread(run_text, record, say)
                model = (await asyncio.to_thread(record.manifest)).unit.model
            except StationError as error:
                ui.label(f"{say('NO VERDICT')}. {error}").classes("lm-refused").props('role="alert"')
                return
            with ui.element("div").classes("lm-run-text"):
                ui.html(shown.html, sanitize=False)
            with ui.element("div").classes("lm-run-pictures"):
                if shown.drawn:
                    self._files(shown)
                self._status = ui.label().classes("lm-status").props('role="status" aria-live="polite"')
                self._say(
                    say("The loop is being evaluated.")
                    if shown.drawn
                    else say("No loop: the run has no result that counts.")
                )
                if shown.drawn:
                    self._pictures()
        if shown.drawn:
            self._shown, self._model = shown, model
            ui.timer(0.0, self._load, once=True)

    def _files(self, shown: RunText) -> None:
        address = f"/api/runs/{quote(shown.run, safe='')}"
        with ui.element("nav").classes("lm-card lm-files").props(_labelled(self._words("Files of this run"))):
            for name in FILES:
                if name != LOOP_CSV or shown.rows:  # a run that was not evaluated has no branches
                    ui.link(self._words(FILE_WORDS[name]), f"{address}/{name}")

    def _pictures(self) -> None:
        say = self._words
        with ui.element("div").classes("lm-choose"):
            self._look = ui.switch(say("Close to what failed"), on_change=self._closer).props("dense")
            self._look.set_visibility(False)
            self._choices = (
                ui.element("div").classes("lm-choices").props(f'role="group" {_labelled(say("Draw other runs"))}')
            )
            self._find = ui.input(say("Draw another run: serial number begins with")).props("outlined dense clearable")
            self._find.on_value_change(self._search)
            self._found = ui.element("div").classes("lm-choices")
        self._above = ui.element("div")
        self._below = ui.element("div")

    async def _load(self) -> None:
        own = await self._drawn(f"{self._words('this run')}, {self._words(self._shown.verdict)}", self._name)
        if own is None:
            return
        self._own = own
        rows = self._shown.rows
        self._marked = [
            Marked(metric_title(row), verdict, place.spans_nm, row.unit == STIFFNESS.shown, allowed_width(row))
            for place in own.curves.places
            if (row := rows[place.row]) and (verdict := row.verdict or "") in MARKED
        ]
        self._look.set_visibility(bool(self._marked))
        self._say("" if own.curves.loop else self._words("Nothing was measured that could be drawn."))
        self._draw()
        try:
            found = await asyncio.to_thread(beside, self._station.data, self._name, self._shown.serial, self._model)
        except StationError as error:
            self._say(str(error))
            return
        with self._choices:
            for one in found.attempts:
                self._offer(one, self._words("attempt {number}", number=one.attempt))
            for one in found.golden:
                self._offer(one, self._words("golden unit {serial}", serial=one.serial))

    def _offer(self, run: StoredRun, what: str) -> None:
        """Offer a run to be drawn; one whose record is not as it was left cannot be."""
        say, shape, word = self._words, *verdict_text(run).split(" ", 1)
        verdict = f"{shape} {say(word)}"
        words = f"{what}: {verdict}, {local(run.started)}"
        with ui.element("span").classes("lm-offer"):
            box = ui.checkbox(words, value=run.run in self._chosen).props("dense")
            name = f"{what}, {verdict}"
            box.on_value_change(lambda event: self._choose(run.run, name, on=bool(event.value)))
            box.set_enabled(not run.altered)
            link = ui.link(say("open the run"), f"/runs/{quote(run.run, safe='')}")
            link.props["aria-label"] = f"{say('open the run')}: {what}"

    async def _choose(self, run: str, name: str, *, on: bool) -> None:
        if not await still_open(self._station, self._session):
            return
        if not on:
            self._chosen.discard(run)
            self._others.pop(run, None)
        elif len(self._chosen) >= len(OTHERS):
            self._say(self._words("{count} other runs can be drawn at once. Take one away first.", count=len(OTHERS)))
            return
        else:
            self._chosen.add(run)
            self._say(self._words("{name} is being evaluated.", name=name))
            found = await self._drawn(name, run)
            if found is None:
                return
            self._say("")
            if run in self._chosen:  # and was not taken away meanwhile
                self._others[run] = found
        self._draw()

    async def _search(self) -> None:
        if not await still_open(self._station, self._session):
            return
        begins = (self._find.value or "").strip()
        self._found.clear()
        if not begins:
            return
        try:
            page = await asyncio.to_thread(search, self._station.data, Wanted(begins=begins), count=MOST_FOUND)
        except StationError as error:
            self._say(str(error))
            return
        with self._found:
            for one in page.rows:
                if one.run != self._name:
                    self._offer(one, f"{one.serial} {self._words('attempt {number}', number=one.attempt)}")
            if page.total > len(page.rows):
                ui.label(self._words("and {count} more", count=page.total - len(page.rows))).classes("lm-quiet")

    async def _drawn(self, name: str, run: str) -> Drawn | None:
        """Return a run as it is drawn; None, and why, where its record does not allow that."""
        record = await asyncio.to_thread(Store(self._station.data).by_id, run)
        if record is None:
            self._say(self._words("{run}: its folder is missing.", run=run))
            return None
        try:
            return Drawn(name, await asyncio.to_thread(self._station.evaluations.loop, record))
        except StationError as error:
            self._say(str(error))
            return None

    def _closer(self) -> None:
        self._close = bool(self._look.value)
        self._draw()

    def _draw(self) -> None:
        if self._own is None or not self._own.curves.loop:
            return
        others = list(self._others.values())
        if self._loop is None:  # axes without a loop would show torques and angles that nobody has measured
            with self._above:
                self._loop = ui.plotly({"data": [], "layout": {}}).classes("lm-loop").props('role="figure"')
        self._loop.update_figure(loop_figure(self._own, others, self._marked, self._words, close=self._close))
        named = ", ".join(one.name for one in [self._own, *others])
        where = f"; {self._words('marked:')} " + ", ".join(one.name for one in self._marked) if self._marked else ""
        self._loop.props["aria-label"] = self._words("Wind-up over torque of {runs}", runs=named) + where
        if not self._own.curves.stiffness:
            return
        if self._stiffness is None:  # not before there is something to show: what is hidden has no size to be drawn in
            with self._below:
                self._stiffness = ui.plotly({"data": [], "layout": {}}).classes("lm-stiffness").props('role="figure"')
        self._stiffness.update_figure(stiffness_figure(self._own, others, self._marked, self._words))
        self._stiffness.props["aria-label"] = self._words("Local stiffness over torque of {runs}", runs=named)

    def _say(self, text: str) -> None:
        self._status.set_text(text)
        self._status.set_visibility(bool(text))
