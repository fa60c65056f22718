"""The page of a jog: hold a key, press the enabling device, and see what the shaft does."""

from __future__ import annotations

import asyncio
import functools
import math
import time
from collections import OrderedDict
from typing import Any, NamedTuple

import jinja2
from fastapi import Request, Response
from fastapi.responses import RedirectResponse
from nicegui import ui
from nicegui.events import GenericEventArguments
from pydantic import JsonValue

from controller.sample import shown_torque_nm
from definitions.faults import FAULT_BY_NUMBER
from definitions.image import State
from definitions.jog import PHASE_ROWS, TOKEN_EVERY_S, JogPhase
from drivers.servo_drive.emcy import drive_said
from station.records.samples.scan_record import unpack
from station.run.screen.progress import signed
from station.web.actions.table import ACTIONS
from station.web.bench.jogging import SIGNS, Jogged
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
from station.web.people.accounts import Session
from station.web.running import STARTING
from station.web.station import Station

LOOK_EVERY_S = 0.1
OPEN_QUESTIONS = 40
"""Questions that an answer may still come to; how old one may be the jog itself decides."""

RPM_PER_RAD_S = 30.0 / math.pi
KEYS = {-1: "◀ Hold to turn −", 1: "Hold to turn + ▶"}
TOLD: tuple[str, ...] = (
    "Keep clear of the shaft, and take tools off it. The guard is closed; the emergency stop is within reach.",
    (
        "Hold a key: one of the two large buttons of this page. Then press the enabling device to its middle position: "
        "the shaft turns slowly."
    ),
    "To stop, let go of either. To turn again, let go of the enabling device, hold a key, and press it anew.",
    "The key counts while it is held, on this page, in front. Another window or a lost connection lets it go.",
)
"""What to do, in plain words."""

SHARES = {1.0: "full jog speed", 0.5: "half", 0.2: "a fifth"}
"""Shares of the largest speed of a jog that can be chosen."""

MAY_JOG = "A technician, an engineer or an admin may jog. Everybody may end a jog."
WORDS = {"PRESS": "Press the virtual enabling device", "LET_GO": "Let go of the virtual enabling device"}


class Alarm(NamedTuple):
    """One fault that came up in a jog: its number, what happened, what to do, and what the drive says of it."""

    number: int
    text: str
    next_action: str
    drive_said: str = ""


class Shown(NamedTuple):
    """What the page shows of a moment: words of the phase and what to do next, figures, whether it turns."""

    words: str
    next_action: str
    turning: bool = False
    device: str = "not known"
    pressed: bool = False
    angle: str = "–"
    torque: str = "–"
    speed: str = "–"
    most: str = ""
    alarms: tuple[Alarm, ...] = ()


NO_JOG = Shown("No jog", "Begin a jog: the devices are opened, and the drive stays off")
STARTS = Shown("Opening the bench", "Wait until the devices answer")


def add_jog(station: Station) -> None:
    """Add the page to the running application."""

    @ui.page("/jog", title="lostmotion: jog", response_timeout=LONGEST_BUILD_S)
    async def page(request: Request) -> Response | None:
        if (session := await session_of_page(station, request)) is None:
            return RedirectResponse("/enter")
        _Page(station, session, words_for(station, session, request)).build()
        return None


class _Page:
    """One open page. It asks its browser for the key again and again, and keeps nothing else."""

    def __init__(self, station: Station, session: Session, say: Words) -> None:
        self._station, self._session, self._words = station, session, say
        self._shown = ""
        self._asked_ns: OrderedDict[int, int] = OrderedDict()
        self._question = 0
        self._pressed = False
        self._mine = False

    def build(self) -> None:
        """Lay the page out."""
        say = self._words
        ui.add_body_html(f"<script>{(HERE / 'jog.js').read_text(encoding='utf-8')}</script>")
        bar(self._station, self._session, "jog", say)
        may = self._session.person.role in ACTIONS["hold_jog"].roles
        with ui.element("main").classes("lm-page lm-jog"):
            self._state = ui.html(sanitize=False).props('role="status" aria-live="polite"')
            self._refused = ui.label().classes("lm-refused").props('role="alert"')
            self._refused.set_visibility(False)
            with ui.element("div").classes("lm-keys"):
                self._keys = [self._key(direction) for direction in KEYS]
            with ui.element("section").classes("lm-card lm-begin") as self._section:
                models = [one.model for one in self._station.models.models]
                self._model = ui.select(models, value=models[0], label=say("Unit on the bench")).props("outlined dense")
                shares = {share: say(text) for share, text in SHARES.items()}
                self._speed = ui.select(shares, value=1.0, label=say("Speed")).props("outlined dense")
                self._begin = self._button(say("Begin a jog"), self._do_begin)
                self._device = self._button(say(WORDS["PRESS"]), self._do_press)
                self._end = self._button(say("End the jog"), lambda: self._do("end_jog", {}))
            with ui.element("ol").classes("lm-card lm-told"):
                for text in TOLD:
                    with ui.element("li"):
                        ui.label(say(text))
            if not may:
                ui.label(say(MAY_JOG)).classes("lm-card")
        self._may = may
        ui.on("jog_token", self._answered)
        ui.timer(TOKEN_EVERY_S, self._ask)
        ui.timer(LOOK_EVERY_S, self._look)
        ui.timer(SESSION_EVERY_S, lambda: still_open(self._station, self._session))

    @staticmethod
    def _button(text: str, does: Any) -> ui.button:
        button = ui.button(text, on_click=does, color=None).props("no-caps").classes("lm-button")
        button.set_visibility(False)
        return button

    def _key(self, direction: int) -> ui.element:
        key = ui.element("button").classes("lm-key").props(f'type="button" data-jog="{direction}" disabled')
        with key:
            ui.label(self._words(KEYS[direction]))
        return key

    def _ask(self) -> None:
        """Ask the browser whether the key is held; only who has begun the jog is asked."""
        if not self._mine:
            return
        self._question += 1
        self._asked_ns[self._question] = time.monotonic_ns()
        while len(self._asked_ns) > OPEN_QUESTIONS:
            self._asked_ns.popitem(last=False)
        ui.run_javascript(f"window.jogAsked && jogAsked({self._question})")

    def _answered(self, event: GenericEventArguments) -> None:
        """Pass on that the key is held, once for each question, with the moment at which it was asked."""
        told = event.args if isinstance(event.args, dict) else {}
        question, direction = told.get("question"), told.get("direction")
        if not isinstance(question, int) or direction not in SIGNS:
            return
        asked_ns = self._asked_ns.pop(question, None)
        if asked_ns is not None:
            self._station.jogging.token(self._session.token, int(direction), asked_ns)

    async def _look(self) -> None:
        standing = await asyncio.to_thread(self._station.jogging.standing, self._session.token)
        self._mine = standing.mine and standing.on
        shown = shown_of(standing)
        self._pressed = shown.pressed
        self._begin.set_visibility(self._may and not standing.on)
        self._model.set_visibility(self._may and not standing.on)
        self._speed.set_visibility(self._may and not standing.on)
        self._end.set_visibility(standing.on)
        self._section.set_visibility(self._may or standing.on)  # else it holds nothing
        self._device.set_visibility(self._mine and standing.embedded)
        self._device.set_text(self._words(WORDS["LET_GO" if self._pressed else "PRESS"]))
        may_hold = self._mine and standing.program is not None
        for key in self._keys:
            key.props(remove="disabled") if may_hold else key.props("disabled")
        html = str(_part()(shown, standing.said, self._words))
        if html != self._shown:
            self._shown = html
            self._state.set_content(html)

    async def _do_begin(self) -> None:
        await self._do("begin_jog", {"model": self._model.value, "speed": self._speed.value})

    async def _do_press(self) -> None:
        await self._do("press_device", {"down": not self._pressed})

    async def _do(self, action: str, values: JsonValue) -> None:
        answer = await act(self._station, self._session, action, values)
        self._refused.set_text(" ".join(self._words(one.text) for one in answer.refused))
        self._refused.set_visibility(bool(answer.refused))


def shown_of(standing: Jogged) -> Shown:
    """Return what is shown of a jog."""
    now, program = standing.now, standing.program
    if not standing.on:
        return NO_JOG
    if now.stage == STARTING or not now.record or program is None or program.jog is None:
        return STARTS
    _, image, orders = unpack(now.record)
    row = PHASE_ROWS.get(orders.phase) if orders.state == State.JOG else None
    torque_nm = shown_torque_nm(image, orders, program)
    if torque_nm is not None and program.has_torque_in and program.loading_input:
        torque_nm = image.torque_in_nm  # of the shaft that turns
    angle_rad = image.angle_in_rad if program.loading_input else image.angle_out_rad
    faults = [FAULT_BY_NUMBER[number] for number in range(1, orders.alarms.bit_length()) if orders.alarms >> number & 1]
    return Shown(
        words="Fault" if orders.state == State.FAULT else "Opening the bench" if row is None else row.words,
        next_action=faults[0].next_action if faults else "Wait" if row is None else row.next_action,
        turning=row is not None and row.phase in (JogPhase.TURNING, JogPhase.STOPPING),
        device="pressed" if image.enabling_device else "released",
        pressed=bool(image.enabling_device),
        angle=f"{signed(math.degrees(angle_rad), 1)}°",
        torque="not known" if torque_nm is None else f"{signed(torque_nm, 1)} N·m",
        speed=f"{signed(image.drive_velocity_rad_s * RPM_PER_RAD_S, 2)} rpm",
        most=f"at most {program.jog.speed_rad_s * RPM_PER_RAD_S:.3g} rpm",
        alarms=tuple(
            Alarm(one.number, one.text, one.next_action, drive_said(one.id, image.drive_emcy_code)) for one in faults
        ),
    )


@functools.cache
def _part() -> Any:
    """Return the part of the page that changes; every text in it is escaped."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(HERE), autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True
    )
    return environment.get_template("jog.html").module.state  # type: ignore[attr-defined]
