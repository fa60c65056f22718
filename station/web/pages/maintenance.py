"""The page of maintenance: what the bench shows now, what stands in the way, and the recovery after a fault."""

from __future__ import annotations

import asyncio
import functools
import time
from html import escape
from typing import Any

import jinja2
from fastapi import Request, Response
from fastapi.responses import RedirectResponse
from nicegui import ui
from pydantic import JsonValue

from definitions.faults import FAULTS
from station.errors import StationError
from station.run.screen.progress import signed
from station.wall_clock import WALL_CLOCK
from station.web.actions.table import ACTIONS
from station.web.bench.changes import Since, since_it_worked
from station.web.bench.due import due_on
from station.web.bench.sight import Sight
from station.web.bench.watch import Seen
from station.web.bench.way_back import DONE, IN_HAND, IN_THE_WAY, TO_COME, Fault, Standing, steps
from station.web.languages import Words
from station.web.pages.frame import (
    HERE,
    LONGEST_BUILD_S,
    SESSION_EVERY_S,
    act,
    bar,
    session_of_page,
    still_open,
    words_for,
)
from station.web.pages.words import left_said
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

LOADING = "Being read."
"""What a part says until it was looked at for the first time."""

SAID = frozenset({"yes", "no", "none", "never", "never came", "never heard", "no sensor", "not a number", "not known",
                  "listed as alarms"})  # fmt: skip
"""Words of a reading that stand in every language. States of drive and bus are called as CiA 402 and CiA 301 do."""

NOBODY_SAW = (
    "What the bench did after the end of the record is not known. Treat the unit as wound up: keep clear of its shafts."
)


def add_maintenance(station: Station) -> None:
    """Add the page to the running application."""

    @ui.page("/maintenance", title="lostmotion: maintenance", response_timeout=LONGEST_BUILD_S)
    async def page(request: Request) -> Response | None:
        if (session := await session_of_page(station, request)) is None:
            return RedirectResponse("/enter")
        _Maintenance(station, session, words_for(station, session, request)).build()
        return None


class _Maintenance:
    """One open page. It shows what the bench does, and keeps nothing."""

    def __init__(self, station: Station, session: Session, say: Words) -> None:
        self._station, self._session, self._words = station, session, say
        self._shown: dict[str, str] = {}
        self._recovery = ""
        self._compared, self._slow_s = "", 0.0

    def build(self) -> None:
        """Lay the page out."""
        say = self._words
        bar(self._station, self._session, "maintenance", say)
        with ui.element("main").classes("lm-maintenance"):
            with ui.element("div").classes("lm-column").props('tabindex="0"'):
                self._head = self._part("lm-stack", 'role="status"')
                self._title(say("Recovery after a fault"))
                with ui.element("section").classes("lm-card"):
                    self._why = ui.label(say(LOADING))
                    self._steps = self._part()
                    self._refused = ui.label().classes("lm-refused").props('role="alert"')
                    self._refused.set_visibility(False)
                    with ui.element("div").classes("lm-buttons"):
                        self._buttons = {name: self._button(name) for name in BUTTONS}
                self._title(say("Alarms"))
                self._alarms = self._part("lm-stack")
            with ui.element("div").classes("lm-column").props('tabindex="0"'):
                self._title(say("Inputs and outputs"))
                self._devices = self._part("lm-devices")
            with ui.element("div").classes("lm-column").props('tabindex="0"'):
                self._title(say("Interlocks, nearest first"))
                self._limits = self._part("lm-card")
                self._title(say("What changed since it last worked"))
                self._since = self._part("lm-card")
                self._title(say("Calibrations and master parts"))
                self._due = self._part("lm-card")
        ui.timer(LOOK_EVERY_S, self._look)
        ui.timer(SESSION_EVERY_S, lambda: still_open(self._station, self._session))

    @staticmethod
    def _title(text: str) -> None:
        with ui.element("h2").classes("lm-title"):
            ui.label(text)

    def _part(self, classes: str = "", props: str = "") -> ui.html:
        loading = f'<div class="lm-quiet lm-loading">{escape(self._words(LOADING))}</div>'
        return ui.html(loading, sanitize=False).classes(classes).props(props)

    def _button(self, name: str) -> ui.button:
        button = ui.button(self._words(BUTTONS[name]), on_click=lambda: self._do(name), color=None).props("no-caps")
        button.classes("lm-button lm-second" if name == LEAVE else "lm-button")
        button.set_visibility(False)
        return button

    async def _look(self) -> None:
        seen, standing = await asyncio.to_thread(self._look_at)
        sight = seen.sight
        say = self._words
        torque = "" if sight is None else _torque(sight, say)
        wound_up = standing.fault is not None and not (seen.live or standing.released)
        self._show(self._head, "head", seen, sight, _ago(seen, say), torque, wound_up, say)
        self._show(self._alarms, "alarms", () if sight is None else sight.alarms, say)
        read = ((), ()) if sight is None else (sight.devices, sight.outputs)
        self._show(self._devices, "devices", *read, say, self._reading)
        self._show(self._limits, "limits", () if sight is None else sight.limits, say, self._reading)
        self._show_way_back(standing, sight)
        if time.monotonic() - self._slow_s > SLOW_EVERY_S or (not seen.live and seen.run != self._compared):
            self._slow_s, self._compared = time.monotonic(), seen.run
            since, due = await asyncio.to_thread(self._look_slowly)
            self._show(self._since, "since", since, say)
            self._show(self._due, "due", due, say)

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
        text = self._words(standing.why_none) if fault is None else fault_said(standing, fault, self._words)
        self._why.set_text(text)
        rows = steps(standing, sight) if fault is not None else ()
        self._show(self._steps, "steps", rows, MARKS, self._words, self._sentences)
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
        self._refused.set_text(" ".join(self._words(one.text) for one in answer.refused))
        self._refused.set_visibility(bool(answer.refused))

    def _show(self, part: ui.html, name: str, *values: Any) -> None:
        """Show a part anew where it is another: most of what is looked at stays as it is."""
        html = str(getattr(_parts(), name)(*values))
        if html != self._shown.get(name):
            self._shown[name] = html
            part.set_content(html)

    def _reading(self, value: str) -> str:
        """Return a value in words of this language, where it has any; a figure is taken as it stands."""
        if not any(one.isalpha() for one in value):
            return value
        return ", ".join(self._words(part) if part in SAID else part for part in value.split(", "))

    def _sentences(self, text: str) -> str:
        return " ".join(self._words(one) for one in text.replace(". ", ".\n").split("\n"))


def fault_said(standing: Standing, fault: Fault, say: Words) -> str:
    """Return after what a bench is to be recovered, how it was left, and what became of the last try."""
    ended = say("Run {run} on bench {bench} ended: {state}.", run=fault.run, bench=fault.bench, state=say(fault.state))
    said = [say("Recovered.")] if standing.released else []
    said += [ended, _cause_said(fault.cause, say)]
    said += [say(NOBODY_SAW)] if fault.left is None else [left_said(fault.left, say)]
    said += [say("The last try did not release the unit: {said}", said=standing.said)] if standing.said else []
    return " ".join(one for one in said if one)


def _cause_said(cause: str, say: Words) -> str:
    """Return the first cause with what to do about it; what a drive said of itself stays as it is."""
    for fault in FAULTS:
        begin = f"{fault.text}. {fault.next_action}."
        if cause.startswith(begin):
            return f"{say(fault.text)}. {say(fault.next_action)}.{cause[len(begin) :]}"
    return cause


def _torque(sight: Sight, say: Words) -> str:
    return say("not known: no fresh sample") if sight.torque_nm is None else f"{signed(sight.torque_nm, 1)} N·m"


def _ago(seen: Seen, say: Words) -> str:
    for unit, length in (("{number} d", 86400.0), ("{number} h", 3600.0), ("{number} min", 60.0)):
        if seen.ago_s >= 2 * length:
            return say(unit, number=f"{seen.ago_s / length:.0f}")
    return say("{number} s", number=f"{max(seen.ago_s, 0.0):.0f}")


@functools.cache
def _parts() -> Any:
    """Return the parts of the page; every text of a record is escaped by them."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(HERE), autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True
    )
    return environment.get_template("maintenance.html").module
