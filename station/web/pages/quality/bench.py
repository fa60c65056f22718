"""The tab of the page of quality that asks whether the bench can measure: what is due, master parts, type 1 study."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from nicegui import ui

from station.counted import counted
from station.quality.bench_ability import Part
from station.web.pages.quality.made import page_due, page_part, page_type_one
from station.web.pages.quality.parts import card, draw, made_beside
from station.web.pages.quality_figures import due_html, part_options
from station.web.station import Station

NO_PART = "No master part was measured. Name master parts in the bench file, and measure one."


class BenchTab:
    """The tab; virtual: says whether units of the virtual bench are meant."""

    def __init__(self, station: Station, virtual: Callable[[], bool]) -> None:
        self._station, self._virtual = station, virtual
        self._filling = False

    def build(self) -> None:
        """Lay it out."""
        with ui.element("div").classes("lm-filters"):
            self._part = ui.select({}, label="Master part", on_change=self.show_part).props("outlined dense")
            self._metric = ui.select({}, label="Metric", on_change=self.show_part).props("outlined dense")
        with ui.element("div").classes("lm-quality-grid"):
            with card("What is due"):
                self._due = ui.html("", sanitize=False)
            with card("Type 1 study: is this bench good enough for the tolerance?"):
                with ui.row().classes("lm-choose-row"):
                    self._reference = ui.number("Known value").props("outlined dense")
                    self._tolerance = ui.number("Tolerance (empty: as in the recipe)").props("outlined dense")
                    ui.button("Judge", on_click=self._judge).props("outline no-caps")
                self._type_one = ui.html("", sanitize=False).props('role="status"')
            with card("Master part over time").classes("lm-whole-row"):
                self._said = ui.label().classes("lm-words").props('role="status"')
                self._figure = ui.echart({}).classes("lm-picture lm-tall")

    def set_parts(self, parts: Sequence[tuple[str, int]]) -> None:
        """Offer master parts, with how often each was measured."""
        self._filling = True
        self._part.set_options({serial: f"{serial} ({counted(number, 'run')})" for serial, number in parts},
                               value=parts[0][0] if parts else None)  # fmt: skip
        self._filling = False

    def set_metrics(self, names: dict[str, str], chosen: str) -> None:
        """Offer metrics."""
        self._filling = True
        self._metric.set_options(names, value=chosen)
        self._filling = False

    async def show_due(self) -> None:
        """Show what is due on each bench."""
        due = await made_beside(self._station, page_due, self._station.models, said=self._said.set_text)
        if due is not None:
            self._due.set_content(due_html(due) if due else "Nothing: the bench files name no master part and no date.")

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
            self._said.set_text(NO_PART)
            return
        found = await made_beside(self._station, page_part, part, said=self._said.set_text)
        if part != self._asked():
            return  # another one was chosen meanwhile, and is asked for
        self._figure.set_visibility(found is not None)
        if found is not None:
            said = (
                found.why
                if found.trend is None
                else "; ".join(one.text for one in found.trend.signals) or "In control."
            )
            self._said.set_text(f"{counted(len(found.series.values), 'run')}. {said}")
            draw(self._figure, part_options(found))

    async def _judge(self) -> None:
        part = self._asked()
        if part is None or self._reference.value is None:
            self._type_one.set_content("Choose a master part and its metric, and give its known value.")
            return
        asked = (part, float(self._reference.value), self._tolerance.value)
        found = await made_beside(self._station, page_type_one, *asked, said=self._type_one.set_content)
        if found is not None:
            one = found.study
            word = "● capable" if one.capable else "■ NOT CAPABLE"
            self._type_one.set_content(
                f'<b class="{"" if one.capable else "lm-bad"}">{word}</b>: Cg {one.cg:.2f} ({one.cg_low:.2f} … '
                f"{one.cg_high:.2f}), Cgk {one.cgk:.2f} ({one.cgk_low:.2f} … {one.cgk_high:.2f}); 1.33 is needed.<br>"
                f"{one.measurements} measurements, bias {one.bias:.3g}, standard deviation {one.sd:.3g}, tolerance "
                f"{one.tolerance:.4g}. The smallest tolerance that this bench measures so is {one.least_tolerance:.3g}."
            )
