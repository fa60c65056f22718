"""The page that checks a certificate: its code is scanned or typed, and the page says what the paper has to say."""

from __future__ import annotations

import asyncio
from html import escape
from urllib.parse import quote

from fastapi import Request, Response
from fastapi.responses import RedirectResponse
from nicegui import ui

from station.errors import StationError
from station.records.certificate_code import ALTERED, GENUINE, UNKNOWN, CheckedCode, attempts_of, check_code
from station.web.languages import Words
from station.web.pages.frame import (
    LONGEST_BUILD_S,
    SESSION_EVERY_S,
    bar,
    session_of_page,
    still_open,
    typed_before,
    words_for,
)
from station.web.pages.words import CIRCLE, SQUARE, TRIANGLE, Shown, attempts_said, local
from station.web.people.accounts import Session
from station.web.station import Station

STANDINGS: dict[str, Shown] = {
    GENUINE: Shown("PASS", CIRCLE, "GENUINE", "Compare the paper with what stands below."),
    ALTERED: Shown("FAIL", SQUARE, "ALTERED", "Do not trust this certificate. Call quality."),
    UNKNOWN: Shown("OPEN", TRIANGLE, "UNKNOWN", "It was not made from the records of this station."),
}
"""Style, shape, word and what to do, by what a code is."""

WHAT_FOR = (
    "The certificate of a unit carries a code, as a square and in letters. Enter it to see whether this station made "
    "the certificate, whether the record of its run is unchanged, and what must stand on the paper."
)


def add_certificates(station: Station) -> None:
    """Add the page to the running application."""

    @ui.page("/certificates", title="lostmotion: certificates", response_timeout=LONGEST_BUILD_S)
    async def page(request: Request) -> Response | None:
        if (session := await session_of_page(station, request)) is None:
            return RedirectResponse("/enter")
        _Certificates(station, session, words_for(station, session, request)).build()
        return None


class _Certificates:
    """One open page: the code that was entered last, and what it is."""

    def __init__(self, station: Station, session: Session, say: Words) -> None:
        self._station, self._session, self._words = station, session, say

    def build(self) -> None:
        """Lay the page out."""
        say = self._words
        bar(self._station, self._session, "certificates", say)
        with ui.element("main").classes("lm-page lm-certificates"):
            ui.label(say(WHAT_FOR)).classes("lm-words lm-what-for")
            with ui.element("form").classes("lm-filters").props('role="search" onsubmit="return false"'):
                self._code = ui.input(say("Code of the certificate: scan the square, or type it")).classes("lm-code")
                self._code.props("outlined dense clearable autofocus").on("keydown.enter", self._check)
                ui.button(say("Check"), on_click=self._check, color=None).props("no-caps").classes("lm-button")
            self._found = ui.html(sanitize=False).classes("lm-stack").props('role="status" aria-live="polite"')
        ui.timer(0.0, lambda: typed_before("certificates"), once=True)
        ui.timer(SESSION_EVERY_S, lambda: still_open(self._station, self._session))

    async def _check(self) -> None:
        if not await still_open(self._station, self._session):
            return
        code = (self._code.value or "").strip()
        try:
            found = await asyncio.to_thread(check_code, self._station.data, code)
        except StationError as error:
            self._found.set_content(f'<div class="lm-refused" role="alert">{escape(self._words(str(error)))}</div>')
            return
        self._found.set_content(_html(found, self._words))


def _html(found: CheckedCode, say: Words) -> str:
    shown, manifest = STANDINGS[found.standing], found.manifest
    facts = [
        (say("serial number"), found.serial),
        (say("attempt"), attempts_said(attempts_of(found).removeprefix("attempt "), say)),
        (say("verdict"), ", ".join(say(one) for one in (found.verdict, found.aside) if found.verdict and one)),
        (say("measured again since"), attempts_said("; ".join(map(str, found.since)), say)),
    ]
    if manifest is not None:
        recipe = manifest.recipe
        facts += [
            (say("model"), manifest.unit.model),
            (say("recipe"), say("{name} revision {revision}", name=recipe.name, revision=recipe.revision)),
            (say("tested"), local(manifest.started)),
        ]
    name = escape(found.run)
    run = name if manifest is None else f'<a href="/runs/{quote(found.run, safe="")}">{name}</a>'
    rows = "".join(f"<dt>{escape(title)}</dt><dd>{escape(text)}</dd>" for title, text in facts if text)
    return (
        f'<div class="lm-tile lm-wide {shown.style}">{shown.shape}<div><div class="lm-word">{say(shown.word)}</div>'
        f'<div class="lm-do">{say(shown.to_do)}</div></div></div>'
        f'<section class="lm-card"><p>{escape(say(found.text))}</p>'
        f'<dl class="lm-facts">{rows}<dt>{say("run")}</dt><dd>{run}</dd></dl></section>'
    )
