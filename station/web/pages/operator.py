"""The operator's page: scan a unit, see the loop grow, see the verdict. Nothing has to be clicked for a good unit."""

from __future__ import annotations

import asyncio
import json
import re
import secrets
import time
from html import escape
from typing import Any, NamedTuple

from fastapi import Request, Response
from fastapi.responses import HTMLResponse, RedirectResponse
from nicegui import ui
from pydantic import JsonValue

from station.run.screen.progress import clock, signed
from station.wall_clock import WALL_CLOCK
from station.web.actions.row import BAD_INPUT, OK, Answer
from station.web.actions.runs import BadUnit, bad_unit, unconfirmed_run
from station.web.actions.values import LabelTold, refusal
from station.web.bypasses import Bypass, bypasses_now
from station.web.labels.outbox import Awaited, awaited, is_label
from station.web.languages import LANGUAGES, Words, messages
from station.web.pages.frame import HERE, act, bar, leave_page, session_of_page, words_for
from station.web.pages.live import GrowingLoop, Looks
from station.web.pages.operator_text import badge_line, named, shown_of, why_text
from station.web.pages.quality_figures import Options
from station.web.pages.words import VERDICTS, attempts_said, local, refusal_said
from station.web.people.accounts import Session, session_of
from station.web.people.badges import is_badge
from station.web.running import ENDED
from station.web.running import RUNNING as IS_RUNNING
from station.web.scanner import is_nok
from station.web.scanner_test import is_test_code
from station.web.station import Station

KEPT_FOR_S = 30.0
"""How long a page whose connection was lost finds itself as it was; after that the browser loads it anew.

A browser that is held up for some seconds must not lose what is being scanned.
"""

SHORTEST_S = 0.05
"""Between two looks of a page, also of one whose session has ended."""

SESSION_EVERY_S = 2.0
SAME_SCAN_S = 2.0
"""A code that comes twice within this is one scan, unless the first was refused."""

CAPS_LOCK_ON = "Caps Lock is on: it changes what the scanner sends. Switch it off, then scan the unit again."
SCANNER_TESTED = "The scanner works. Scan the unit."
PUT_AWAY = "The bad unit is in the NOK box"
CONFIRMED_BY = "In the NOK box: confirmed by {name}, {at}."
SCAN_NEXT = "Scan the next unit."
SCAN_AGAIN = "The bad unit is in the NOK box. Scan unit {serial} again."
NO_BAD_UNIT = "No bad unit waits for the NOK box."
NOT_TAKEN = "Not taken: {scanned}"
TYPED = "This was typed by hand, or is too short for a code. A unit starts only by its scan: scan the unit."
LABEL_READ = "The label of unit {serial} is on it. Scan the next unit."
LABEL_FIRST = "Put the label on the unit and scan it."
PRINT_AGAIN = "Print the label again"
STOP = "Stop the run"
STOPPING = "The run is being stopped: the torque goes to zero."
RETEST_REASONS = ("seating of the unit", "result not decidable", "technician asked for it")


def add_pages(station: Station) -> None:
    """Add the pages to the running application."""
    looks = Looks(station)

    @ui.page("/enter")
    def enter(request: Request) -> Response:
        return HTMLResponse(enter_page(words_for(station, None, request)))

    @ui.page("/", title="lostmotion", reconnect_timeout=KEPT_FOR_S)
    async def operator(request: Request) -> Response | None:
        if (session := await session_of_page(station, request)) is None:
            return RedirectResponse("/enter")
        _Page(station, session, words_for(station, session, request), looks).build()
        return None


def enter_page(say: Words) -> str:
    """Return the page for logging in, in a language."""
    scan, page = ((HERE / name).read_text(encoding="utf-8") for name in ("scan.js", "enter.html"))
    offered = " ".join(f'<button type="button" lang="{one}">{name}</button>' for one, name in LANGUAGES.items())
    said = re.sub(r"\{\{(.+?)\}\}", lambda found: escape(say(found[1])), page)
    told = json.dumps(messages(say.language), ensure_ascii=False).replace("<", "\\u003c")
    parts = {"/* scan.js */": scan, "<!-- languages -->": offered, "/* messages */": f"const told = {told};"}
    for place, part in (*parts.items(), ('lang="en"', f'lang="{say.language}"')):
        said = said.replace(place, part, 1)
    return said


class _Seen(NamedTuple):
    """Whose page it is, which start conditions do not count now, and which label is awaited."""

    session: Session | None
    bypasses: tuple[Bypass, ...]
    label: Awaited | None


def _seen(station: Station, token: str) -> _Seen:
    with station.database.reading() as connection:
        label = None if station.labels is None else awaited(connection, station.labels)
        return _Seen(session_of(connection, token), bypasses_now(connection), label)


def _is_label(station: Station, text: str) -> bool:
    """Say whether what was scanned is a label that this station has printed."""
    if station.labels is None:
        return False
    with station.database.reading() as connection:
        return is_label(connection, text.strip())


class _Page:
    """One open page. It shows what the bench does, and keeps nothing but what was scanned last."""

    def __init__(self, station: Station, session: Session, say: Words, looks: Looks) -> None:
        self._station, self._session, self._words, self._looks = station, session, say, looks
        self._shown: tuple[Any, ...] = ()
        self._scan = ("", 0.0, "")
        self._session_seen = 0.0
        self._awaited = ""
        """The run whose label is awaited."""
        self._bad: BadUnit | None = None
        self._bad_of = ("", "")
        """Stage and run by which it was looked whether the unit is bad."""
        self._waits = ""
        """The unit whose scan was refused because a bad one is not put away yet."""
        self._refused_for: Awaited | None = None
        """The label for which a scan was refused: the one that a person has printed again."""

    def build(self) -> None:
        """Lay the page out."""
        for name in ("scan.js", "live.js"):
            ui.add_body_html(f"<script>{(HERE / name).read_text(encoding='utf-8')}</script>")
        self._clock = bar(self._station, self._session, "bench", self._words)
        with ui.element("main").classes("lm-main"):
            with ui.element("section").classes("lm-left"):
                self._tile = ui.html(sanitize=False).classes("lm-tile").props('role="status" aria-live="polite"')
                self._nok = ui.button(self._words(PUT_AWAY), on_click=self._put_away).classes("lm-button lm-nok")
                self._nok.set_visibility(False)
                self._stop = ui.button(self._words(STOP), on_click=self._stop_run, color=None)
                self._stop.classes("lm-button lm-second lm-stop").set_visibility(False)
                self._refused = ui.element("div").classes("lm-refused").props('role="alert"')
                self._refused.set_visibility(False)
                self._bypasses = ui.label().classes("lm-bypasses")
                self._bypasses.set_visibility(False)
                self._label = ui.label().classes("lm-bypasses").props('role="status"')
                self._label.set_visibility(False)
                self._why = ui.html(sanitize=False).classes("lm-why").props('tabindex="0"')
            with ui.element("section").classes("lm-right") as self._right:
                self._figures = ui.html(sanitize=False).classes("lm-figures")
                chart = ui.echart(_chart_options(self._words)).style("flex: 1 1 auto; height: 60vh")
                self._loop = GrowingLoop(chart)
        ui.on("scan", self._scanned)
        ui.on("typed", self._typed)
        ui.timer(SHORTEST_S, self._look)  # the look that it waits for keeps the time

    async def _look(self) -> None:
        if time.monotonic() - self._session_seen > SESSION_EVERY_S:
            session, bypasses, label = await asyncio.to_thread(_seen, self._station, self._session.token)
            if session is None:
                leave_page()  # nobody sees the bench after the end of a session
                return
            self._bypasses.set_text(" ".join(self._words(str(one)) for one in bypasses))
            self._bypasses.set_visibility(bool(bypasses))
            self._awaited = "" if label is None else label.run
            self._label.set_text("" if label is None else self._words(str(label)))
            self._label.set_visibility(label is not None)
            self._bad_of = ("", "")  # it may have been put away by another page
            self._session_seen = time.monotonic()
        now, loop = await self._looks.next()
        if self._bad_of != (now.stage, now.run):
            self._bad = await asyncio.to_thread(bad_unit, self._station, now.run) if now.stage == ENDED else None
            self._bad_of = (now.stage, now.run)
        self._nok.set_visibility(self._bad is not None and not self._bad.by)
        self._stop.set_visibility(now.stage == IS_RUNNING and not now.stopping)
        self._clock.set_text(WALL_CLOCK.now().astimezone().strftime("%H:%M:%S"))
        self._loop.show(now.run, loop)
        # Axes without a loop beside a verdict would look as if nothing had been measured.
        self._right.classes(**{"add" if now.stage == ENDED and not loop else "remove": "lm-not-drawn"})
        view = now.view
        left = "" if view is None or now.stage != IS_RUNNING else clock(view.left_s)
        what = (now.stage, now.run, now.serial, now.refused, left, view and view.state, self._awaited, self._bad)
        if view is not None and now.stage == IS_RUNNING:
            torque, windup = signed(view.torque_nm, 1), signed(view.windup_arcmin, 3)
            torque, windup = map(self._words.number, (torque, windup))
            figures = (("torque", f"{torque} N·m"), ("wind-up", f"{windup} ′"), ("time left", left))
            self._figures.set_content(
                "".join(f"<div><span>{escape(self._words(name))}</span>{text}</div>" for name, text in figures)
            )
        if what == self._shown:
            return
        if now.stage != IS_RUNNING:
            self._figures.set_content("")
        if self._shown and now.stage != self._shown[0] and time.monotonic() - self._scan[1] > SAME_SCAN_S:
            self._refused.set_visibility(False)  # it was said of what is over now
        self._shown = what
        shown = shown_of(now)
        put_away = self._bad is not None and bool(self._bad.by)
        self._tile.classes(remove="PASS FAIL OPEN BUSY lm-put-away", add=shown.style)
        self._tile.classes(add="lm-put-away" if put_away else "")
        to_do = shown.to_do
        if shown in VERDICTS.values():
            to_do = LABEL_FIRST if now.run and self._awaited == now.run else now.to_do or shown.to_do
        if put_away and shown is VERDICTS["FAIL"]:
            to_do = SCAN_NEXT
        state = view.words if view is not None and now.stage == IS_RUNNING else ""
        recipe = now.recipe if now.stage == IS_RUNNING else ""
        about = " · ".join(part for part in (now.serial, attempts_said(now.attempt, self._words), recipe) if part)
        self._tile.set_content(
            f'{shown.shape}<div class="lm-word">{escape(self._words(shown.word))}</div>'
            f'<div class="lm-serial">{escape(about)}</div>'
            f"{badge_line(now, self._words)}{self._confirmed()}"
            f'<div class="lm-do">{escape(self._words(state or to_do))}</div>'
        )
        self._why.set_content(why_text(now, self._words))

    def _confirmed(self) -> str:
        """Return who has put the bad unit away, and when; nothing while nobody has."""
        if self._bad is None or not self._bad.by:
            return ""
        at, today = local(self._bad.at)[:16], WALL_CLOCK.now().astimezone().strftime("%Y-%m-%d ")
        said = self._words(CONFIRMED_BY, name=self._bad.by, at=at.removeprefix(today))
        return f'<div class="lm-confirmed">{escape(said)}</div>'

    async def _scanned(self, event: Any) -> None:
        text, settings = str(event.args.get("text", "")), self._station.settings
        if is_badge(settings, text):
            # Kept by the browser for the page of the log-in alone: an address would keep it in its history.
            ui.run_javascript(f"sessionStorage.setItem('badge', {json.dumps(text)}); location.href = '/enter'")
            return
        if settings.scanner_test is not None and is_test_code(settings.scanner_test.code, text):
            answer = await self._perform("test_scanner", {"scanned": text}, secrets.token_hex(16))
            self._say(answer, text)
            if answer.status == OK:
                self._tell(SCANNER_TESTED)
            return
        if is_nok(text):
            await self._scanned_nok(text)
            return
        if event.args.get("caps"):
            self._say(Answer(BAD_INPUT, refusal("scan", CAPS_LOCK_ON)), text)
            return
        if await asyncio.to_thread(_is_label, self._station, text):
            answer = await self._perform("read_label", {"scanned": text}, secrets.token_hex(16))
            self._say(answer, text)
            self._session_seen = 0.0  # what stood there of the label is over
            if isinstance(answer.said, LabelTold):
                self._tell(LABEL_READ, serial=answer.said.serial)
            return
        before, at, key = self._scan
        if text != before or time.monotonic() - at > SAME_SCAN_S:
            at, key = time.monotonic(), secrets.token_hex(16)
            self._scan = (text, at, key)
        await self._start(text, "", key)

    async def _start(self, scanned: str, reason: str, key: str) -> None:
        answer = await self._perform("start_run", {"scanned": scanned, "retest_reason": reason}, key)
        if answer.status != OK:
            self._scan = (
                "",
                time.monotonic(),
                "",
            )  # what was refused may be allowed now: scanned again it is asked again
            self._refused_for = (await asyncio.to_thread(_seen, self._station, self._session.token)).label
        self._say(answer, scanned)

    async def _perform(self, action: str, values: dict[str, JsonValue], key: str) -> Answer:
        return await act(self._station, self._session, action, values, key)

    def _say(self, answer: Answer, scanned: str) -> None:
        """Show why a scan was refused, with what can be done about it here; nothing where it was not."""
        self._refused.clear()
        refused, self._waits = answer.refused, ""
        self._refused.set_visibility(bool(refused))
        names = {one.id for one in refused}
        with self._refused:
            if refused and scanned:
                ui.label(self._words(NOT_TAKEN, scanned=named(scanned))).classes("lm-scanned")
            for one in refused:
                ui.label(refusal_said(one.text, self._words)).classes("lm-refusal")
        with self._refused, ui.element("div").classes("lm-answers"):
            if "bad_unit_put_away" in names:
                self._waits = named(scanned)
                if not self._nok.visible:  # the run that this page shows is another one
                    ui.button(self._words(PUT_AWAY), on_click=self._put_newest_away).classes("lm-button")
            elif "label_read" in names:
                # One key: whoever clicks twice asks once.
                label, key = self._refused_for, secrets.token_hex(16)
                again = ui.button(self._words(PRINT_AGAIN), on_click=lambda: self._print_again(scanned, label, key))
                again.classes("lm-button")
            elif "retest_reason" in names:
                for reason in RETEST_REASONS:
                    why = ui.button(self._words(reason), on_click=lambda why=reason: self._again(scanned, why))
                    why.classes("lm-button lm-reason")
            if refused:
                ui.button(self._words("Cancel"), on_click=self._cancel, color=None).classes(
                    "lm-button lm-second lm-cancel"
                )

    def _cancel(self) -> None:
        """Leave the unit alone whose scan was refused."""
        self._waits = ""
        self._refused.clear()
        self._refused.set_visibility(False)

    def _typed(self, event: Any) -> None:
        """Say that what came is no scan; what already stands there about one goes."""
        text = str(event.args)[:60]
        if not is_badge(self._station.settings, text):  # half of a log-in: it stands on no screen
            self._say(Answer(BAD_INPUT, refusal("scan", TYPED)), text)

    def _tell(self, text: str, **values: object) -> None:
        """Show what a scan that starts no run has done."""
        self._scan = ("", time.monotonic(), "")
        self._refused.clear()
        with self._refused:
            ui.label(self._words(text, **values))
        self._refused.set_visibility(True)

    async def _print_again(self, scanned: str, label: Awaited | None, key: str) -> None:
        """Have the label printed again for which a scan was refused, unless it was read meanwhile."""
        seen = await asyncio.to_thread(_seen, self._station, self._session.token)
        if label is None or seen.label is None or seen.label.run != label.run:
            self._refused.set_visibility(False)
            return
        self._say(await self._perform("print_label", {"run": label.run}, key), scanned)

    async def _scanned_nok(self, scanned: str) -> None:
        if await asyncio.to_thread(unconfirmed_run, self._station):
            await self._put_newest_away()
        else:
            self._say(Answer(BAD_INPUT, refusal("run", NO_BAD_UNIT)), scanned)

    async def _put_newest_away(self) -> None:
        await self._confirm(await asyncio.to_thread(unconfirmed_run, self._station))

    async def _put_away(self) -> None:
        if self._bad is not None:
            await self._confirm(self._bad.run)

    async def _confirm(self, run: str) -> None:
        """Keep that the bad unit of a run is in its box. Nothing starts by it: a unit starts by its scan alone."""
        waits = self._waits
        answer = await self._perform("confirm_nok", {"run": run}, secrets.token_hex(16))
        self._say(answer, "")
        self._bad_of = ("", "")
        if answer.status == OK and waits:
            self._tell(SCAN_AGAIN, serial=waits)

    async def _stop_run(self) -> None:
        """Stop the run that is on, by one click: who wants it stopped is not asked whether they are sure."""
        answer = await self._perform("stop_run", {}, secrets.token_hex(16))
        self._say(answer, "")
        if answer.status == OK:
            self._tell(STOPPING)
            self._scan = ("", 0.0, "")  # it goes with the run

    async def _again(self, scanned: str, reason: str) -> None:
        await self._start(scanned, reason, secrets.token_hex(16))


def _chart_options(say: Words) -> Options:
    ink = "#23282b"
    sign = say.number("0.0").strip("0")
    axis = {
        "type": "value",
        "nameLocation": "middle",
        "nameTextStyle": {"fontSize": 18, "color": ink},
        "axisLabel": {"fontSize": 15, "color": ink, ":formatter": f"value => String(value).replace('.', '{sign}')"},
        "splitLine": {"lineStyle": {"color": "#c2c7ca"}},
    }
    return {
        "animation": False,
        "grid": {"left": 90, "right": 30, "top": 20, "bottom": 60},
        "xAxis": {**axis, "name": say("torque at the output in N·m"), "nameGap": 36},
        "yAxis": {**axis, "name": say("wind-up in arcmin"), "nameGap": 62},
        "series": [{"type": "line", "data": [], "showSymbol": False, "lineStyle": {"width": 3, "color": "#2f4a5e"}}],
    }
