"""The page of maintenance: what the bench shows now, what stands in the way, and the recovery after a fault."""

from __future__ import annotations

import asyncio
import functools
import time
from typing import Any

import jinja2
from fastapi import Request, Response
from fastapi.responses import RedirectResponse
from nicegui import ui
from pydantic import JsonValue

from station.errors import StationError
from station.run.screen.progress import signed
from station.wall_clock import WALL_CLOCK
from station.web.actions.table import ACTIONS
from station.web.bench.changes import Since, since_it_worked
from station.web.bench.due import due_on
from station.web.bench.sight import Sight
from station.web.bench.watch import Seen
from station.web.bench.way_back import DONE, IN_HAND, IN_THE_WAY, TO_COME, Standing, steps
from station.web.pages.frame import (
    HERE,
    LONGEST_BUILD_S,
    SESSION_EVERY_S,
    act,
    bar,
    session_of_page,
    still_open,
)
from station.web.people.accounts import Session
from station.web.station import Station

LOOK_EVERY_S = 0.2
SLOW_EVERY_S = 10.0
"""How often it is looked what is due and what has changed: the records are read for that, where the run is another."""

MARKS = {DONE: "✓", IN_HAND: "▶", TO_COME: "○", IN_THE_WAY: "■"}
"""Shape of each standing of a step: colour alone tells nobody who does not see it."""

BEGIN, ACKNOWLEDGE, LEAVE = "begin_recovery", "acknowledge_fault", "leave_recovery"
BUTTONS = {
    BEGIN: "Begin the recovery",
    ACKNOWLEDGE: "All is checked: acknowledge",
    LEAVE: "Leave the bench as it is",
}
"""The actions of the recovery, as the page offers them."""

NOBODY_SAW = (
    "What the bench did after the end of the record is not known. Treat the unit as wound up: keep clear of its shafts."
)


def add_maintenance(station: Station) -> None:
    """Add the page to the running application."""

    @ui.page("/maintenance", title="lostmotion: maintenance", response_timeout=LONGEST_BUILD_S)
    async def page(request: Request) -> Response | None:
        if (session := await session_of_page(station, request)) is None:
            return RedirectResponse("/enter")
        _Maintenance(station, session).build()
        return None


class _Maintenance:
    """One open page. It shows what the bench does, and keeps nothing."""

    def __init__(self, station: Station, session: Session) -> None:
        self._station, self._session = station, session
        self._shown: dict[str, str] = {}
        self._recovery = ""
        self._compared, self._slow_s = "", 0.0

    def build(self) -> None:
        """Lay the page out."""
        bar(self._station, self._session, "maintenance")
        with ui.element("main").classes("lm-maintenance"):
            with ui.element("div").classes("lm-column").props('tabindex="0"'):
                self._head = self._part("lm-stack", 'role="status"')
                self._title("Recovery after a fault")
                with ui.element("section").classes("lm-card"):
                    self._why = ui.label()
                    self._steps = self._part()
                    self._refused = ui.label().classes("lm-refused").props('role="alert"')
                    self._refused.set_visibility(False)
                    with ui.element("div").classes("lm-buttons"):
                        self._buttons = {name: self._button(name) for name in BUTTONS}
                self._title("Alarms")
                self._alarms = self._part("lm-stack")
            with ui.element("div").classes("lm-column").props('tabindex="0"'):
                self._title("Inputs and outputs")
                self._devices = self._part("lm-devices")
            with ui.element("div").classes("lm-column").props('tabindex="0"'):
                self._title("Interlocks, nearest first")
                self._limits = self._part("lm-card")
                self._title("What changed since it last worked")
                self._since = self._part("lm-card")
                self._title("Calibrations and master parts")
                self._due = self._part("lm-card")
        ui.timer(LOOK_EVERY_S, self._look)
        ui.timer(SESSION_EVERY_S, lambda: still_open(self._station, self._session))

    @staticmethod
    def _title(text: str) -> None:
        with ui.element("h2").classes("lm-title"):
            ui.label(text)

    @staticmethod
    def _part(classes: str = "", props: str = "") -> ui.html:
        return ui.html(sanitize=False).classes(classes).props(props)

    def _button(self, name: str) -> ui.button:
        button = ui.button(BUTTONS[name], on_click=lambda: self._do(name), color=None).props("no-caps")
        button.classes("lm-button lm-second" if name == LEAVE else "lm-button")
        button.set_visibility(False)
        return button

    async def _look(self) -> None:
        seen, standing = await asyncio.to_thread(self._look_at)
        sight = seen.sight
        torque = "" if sight is None else _torque(sight)
        wound_up = standing.fault is not None and not (seen.live or standing.released)
        self._show(self._head, "head", seen, sight, _ago(seen), torque, wound_up)
        self._show(self._alarms, "alarms", () if sight is None else sight.alarms)
        self._show(self._devices, "devices", *((), ()) if sight is None else (sight.devices, sight.outputs))
        self._show(self._limits, "limits", () if sight is None else sight.limits)
        self._show_way_back(standing, sight)
        if time.monotonic() - self._slow_s > SLOW_EVERY_S or (not seen.live and seen.run != self._compared):
            self._slow_s, self._compared = time.monotonic(), seen.run
            since, due = await asyncio.to_thread(self._look_slowly)
            self._show(self._since, "since", since)
            self._show(self._due, "due", due)

    def _look_at(self) -> tuple[Seen, Standing]:
        return self._station.bench.look(), self._station.bench.standing()

    def _look_slowly(self) -> tuple[Since, Any]:
        try:
            since = since_it_worked(self._station.data)
        except StationError as error:
            since = Since(why_none=str(error))
        return since, due_on(self._station.data, self._station.models, WALL_CLOCK.now())

    def _show_way_back(self, standing: Standing, sight: Sight | None) -> None:
        self._recovery = standing.recovery
        fault = standing.fault
        if fault is None:
            text = standing.why_none
        else:
            left = NOBODY_SAW if fault.left is None else f"It was {fault.left.text}. Next: {fault.left.next_action}."
            text = f"Run {fault.run} on bench {fault.bench} ended: {fault.state}. {fault.cause} {left}"
            text = f"Recovered. {text}" if standing.released else text
            text += f" The last try did not release the unit: {standing.said}" if standing.said else ""
        self._why.set_text(text)
        self._show(self._steps, "steps", steps(standing, sight) if fault is not None else (), MARKS)
        asked = bool(standing.recovery) and sight is not None and sight.settled
        offered = {
            BEGIN: fault is not None and not (standing.recovery or standing.released),
            ACKNOWLEDGE: asked,
            LEAVE: asked,
        }
        for name, button in self._buttons.items():
            button.set_visibility(offered[name] and self._session.person.role in ACTIONS[name].roles)

    async def _do(self, name: str) -> None:
        values: JsonValue = {} if name == BEGIN else {"recovery": self._recovery}
        answer = await act(self._station, self._session, name, values)
        self._refused.set_text(" ".join(one.text for one in answer.refused))
        self._refused.set_visibility(bool(answer.refused))

    def _show(self, part: ui.html, name: str, *values: Any) -> None:
        """Show a part anew where it is another: most of what is looked at stays as it is."""
        html = str(getattr(_parts(), name)(*values))
        if html != self._shown.get(name):
            self._shown[name] = html
            part.set_content(html)


def _torque(sight: Sight) -> str:
    return "not known: no fresh sample" if sight.torque_nm is None else f"{signed(sight.torque_nm, 1)} N·m"


def _ago(seen: Seen) -> str:
    for unit, length in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seen.ago_s >= 2 * length:
            return f", {seen.ago_s / length:.0f} {unit} ago"
    return f", {max(seen.ago_s, 0.0):.0f} s ago"


@functools.cache
def _parts() -> Any:
    """Return the parts of the page; every text of a record is escaped by them."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(HERE), autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True
    )
    return environment.get_template("maintenance.html").module
