"""The tab of the page of quality that asks whether the bench can measure: what is due, master parts, type 1 study."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape

from nicegui import ui

from station.quality.bench_ability import Part
from station.web.languages import Words
from station.web.pages.quality.ability_text import capable_said, indices_said, measured_said
from station.web.pages.quality.made import page_due, page_part, page_type_one
from station.web.pages.quality.parts import NO_NUMBER, card, draw, made_beside, numbers_of
from station.web.pages.quality_figures import due_html, part_options
from station.web.station import Station

NO_PART = "No master part was measured. Name master parts in the bench file, and measure one."

MEASURED = ("{serial} ({count} run)", "{serial} ({count} runs)")
"""How a master part is offered that was measured once, and one that was measured several times."""


class BenchTab:
    """The tab; virtual: says whether units of the virtual bench are meant."""

    def __init__(self, station: Station, virtual: Callable[[], bool], say: Words) -> None:
        self._station, self._virtual, self._words = station, virtual, say
        self._filling = False

    def build(self) -> None:
        """Lay it out."""
        say = self._words
        with ui.element("div").classes("lm-filters"):
            self._part = ui.select({}, label=say("Master part"), on_change=self.show_part).props("outlined dense")
            self._metric = ui.select({}, label=say("Metric"), on_change=self.show_part).props("outlined dense")
        with ui.element("div").classes("lm-quality-grid"):
            with card(say("What is due")):
                self._due = ui.html("", sanitize=False)
            with card(say("Type 1 study: is this bench good enough for the tolerance?")):
                with ui.row().classes("lm-choose-row"):
                    self._reference = ui.input(say("Known value")).props("outlined dense")
                    self._tolerance = ui.input(say("Tolerance (empty: recipe)"))
                    self._tolerance.props("outlined dense")
                    ui.button(say("Judge"), on_click=self._judge).props("outline no-caps")
                self._type_one = ui.html("", sanitize=False).props('role="status"')
            with card(say("Master part over time")).classes("lm-whole-row"):
                self._said = ui.label().classes("lm-words").props('role="status"')
                self._figure = ui.echart({}).classes("lm-picture lm-tall")

    def set_parts(self, parts: Sequence[tuple[str, int]]) -> None:
        """Offer master parts, with how often each was measured."""
        self._filling = True
        offered = {serial: self._words.counted(number, *MEASURED, serial=serial) for serial, number in parts}
        self._part.set_options(offered, value=parts[0][0] if parts else None)
        self._filling = False

    def set_metrics(self, names: dict[str, str], chosen: str) -> None:
        """Offer metrics."""
        self._filling = True
        self._metric.set_options(names, value=chosen)
        self._filling = False

    async def show_due(self) -> None:
        """Show what is due on each bench."""
        due = await made_beside(
            self._station, page_due, self._station.models, say=self._words, said=self._said.set_text
        )
        if due is not None:
            nothing = self._words("Nothing: the bench files name no master part and no date.")
            self._due.set_content(due_html(due, self._words) if due else nothing)

    def _asked(self) -> Part | None:
        if not (self._part.value and self._metric.value):
            return None
        return Part(str(self._part.value), str(self._metric.value), virtual=self._virtual())

    async def show_part(self) -> None:
        """Show the master part over time."""
        if self._filling:
            return
        part = self._asked()
        if part is None:
            self._said.set_text(self._words(NO_PART))
            return
        found = await made_beside(self._station, page_part, part, say=self._words, said=self._said.set_text)
        if part != self._asked():
            return  # another one was chosen meanwhile, and is asked for
        self._figure.set_visibility(found is not None)
        if found is not None:
            say = self._words
            said = say(found.why)
            if found.trend is not None:
                said = "; ".join(say(one.text) for one in found.trend.signals) or say("In control.")
            runs = say.counted(len(found.series.values), "{count} run.", "{count} runs.")
            self._said.set_text(say.whole(f"{runs} {said}"))
            draw(self._figure, part_options(found))

    async def _judge(self) -> None:
        try:
            references, tolerances = (numbers_of(one.value) for one in (self._reference, self._tolerance))
        except ValueError as error:
            self._tell(self._words(NO_NUMBER, found=error))
            return
        part = self._asked()
        if part is None or len(references) != 1 or len(tolerances) > 1:
            self._tell(self._words("Choose a master part and its metric, and give its known value."))
            return
        asked = (part, references[0], tolerances[0] if tolerances else None)
        found = await made_beside(self._station, page_type_one, *asked, say=self._words, said=self._tell)
        if found is not None:
            one, say = found.study, self._words
            self._type_one.set_content(
                f'<b class="{"" if one.capable else "lm-bad"}">{capable_said(one, say)}</b>: '
                f"{escape(indices_said(one, say))}<br>{escape(measured_said(one, say))}"
            )

    def _tell(self, text: str) -> None:
        self._type_one.set_content(escape(text))
