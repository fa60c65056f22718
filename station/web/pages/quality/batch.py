"""The batch report on the page of quality: its files, made of the chosen lot when they are asked for."""

from __future__ import annotations

from collections.abc import Callable
from urllib.parse import urlencode

from nicegui import ui

from station.store.quality.lot import Lot
from station.web.languages import Words
from station.web.pages.quality.parts import card
from station.web.rest.batch import ADDRESS, LOOPS, address_fields

ONE_FILE = (
    "One ZIP file: the report as a page and as PDF, and each table as CSV. Each loop is evaluated again, about a "
    "second each."
)


class BatchCard:
    """The card; lot: says which one is chosen on the page."""

    def __init__(self, lot: Callable[[], Lot], say: Words) -> None:
        self._lot, self._words = lot, say

    def build(self) -> None:
        """Lay it out."""
        say = self._words
        with card(say("Batch report")).classes("lm-whole-row lm-trial"):
            with ui.row().classes("lm-choose-row"):
                loops = {number: say("{count} newest", count=number) if number else say("none") for number in LOOPS}
                self._loops = ui.select(loops, value=LOOPS[1], label=say("Loops to draw"), on_change=self.show).props(
                    "outlined dense"
                )
                styles = {"en": say("English spreadsheet"), "de": say("German spreadsheet")}
                self._locale = ui.select(styles, value="en", label=say("CSV for"), on_change=self.show).props(
                    "outlined dense"
                )
                self._link = ui.link(say("Make and download"), ADDRESS)
            ui.label(say(ONE_FILE)).classes("lm-words")

    def show(self) -> None:
        """Lead the link to the report of the lot that is chosen now."""
        fields = {**address_fields(self._lot()), "loops": self._loops.value, "locale": self._locale.value}
        self._link.props["href"] = f"{ADDRESS}?{urlencode(fields)}"
        self._link.update()
