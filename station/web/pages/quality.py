"""The page of quality: a lot is chosen, and each figure of it is made beside the server, as the commands make it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from datetime import date, datetime, timedelta
from pathlib import Path
from typing import TypeVar

from fastapi import Request, Response
from fastapi.responses import RedirectResponse
from nicegui import ui

from analysis.line.run_rules import RULE_SETS
from analysis.trace.errors import AnalysisError
from recipes import RecipeError, default_bench, load_bench, load_recipe
from recipes.schema.bench_schema import Bench
from station.errors import StationError
from station.quality.bench_ability import (
    Due,
    Part,
    PartFigure,
    TypeOneFigure,
    due_on,
    part_trend,
    parts_of,
    type_one_of,
)
from station.quality.figures import (
    CapabilityFigure,
    CausesFigure,
    ChartFigure,
    TrendFigure,
    YieldFigure,
    capability_of,
    causes_of,
    chart_of,
    trend_of,
    yield_of,
)
from station.records.data_folder import Store
from station.store.quality.lot import Lot, production
from station.wall_clock import WALL_CLOCK
from station.web.models import Models
from station.web.pages.frame import LONGEST_BUILD_S, SESSION_EVERY_S, bar, session_of_page, still_open
from station.web.pages.guided_studies import GuidedStudies
from station.web.pages.quality_figures import (
    LINE,
    Options,
    capability_html,
    causes_html,
    chart_options,
    chart_words,
    due_html,
    part_options,
    share_html,
    signals_html,
    title_of,
    trend_options,
    trend_words,
    yield_options,
)
from station.web.people.accounts import Session
from station.web.rest.runs import begin_of
from station.web.station import Station

CATCH_UP_S = 0.1
"""Longest time for putting runs into the store that have come since, for each figure."""

BY_DAY_UP_TO = timedelta(days=62)
"""Yield is shown by day for a lot of up to so many days, else by month."""

TREND_BY = ("shift", "bench", "operator", "revision", "day", "month")
SHARE = 0.2

CAUSES = {"failed": "Metric that failed", "undecided": "No verdict", "alarms": "Alarm, any attempt"}
"""Causes by their name in the figure, and what stands above them."""

Found = TypeVar("Found")


@dataclass(frozen=True)
class Choices:
    """What can be chosen: recipes and models of the folder, master parts with their runs, and what is behind."""

    recipes: tuple[str, ...]
    models: tuple[str, ...]
    real: bool
    parts: tuple[tuple[str, int], ...]
    behind: int


def choices(data: Path) -> Choices:
    """Return what can be chosen in a data folder."""
    with production(data, most_s=CATCH_UP_S) as look:
        recipes, models = look.choices()
        real = True
        try:
            look.refuse_empty(Lot())
        except StationError:
            real = False
        return Choices(
            tuple(one for one in recipes if one), models, real, parts_of(look, virtual=not real), look.behind
        )


def page_yield(data: Path, lot: Lot, by: str) -> YieldFigure:
    """Return the yield of a lot over time."""
    with production(data, most_s=CATCH_UP_S) as look:
        return yield_of(look, lot, by)


def page_causes(data: Path, lot: Lot) -> CausesFigure:
    """Return what hindered a lot."""
    with production(data, most_s=CATCH_UP_S) as look:
        return causes_of(look, lot)


def page_capability(data: Path, lot: Lot) -> CapabilityFigure:
    """Return the capability of every metric with a limit."""
    with production(data, most_s=CATCH_UP_S) as look:
        return capability_of(look, lot)


def page_chart(data: Path, lot: Lot, metric: str, rules: tuple[str, ...], subgroup: int) -> ChartFigure:
    """Return the control chart of a metric."""
    with production(data, most_s=CATCH_UP_S) as look:
        return chart_of(look, lot, metric, rules, subgroup=subgroup)


def page_trend(data: Path, lot: Lot, metric: str, by: str) -> TrendFigure:
    """Return a metric by groups."""
    with production(data, most_s=CATCH_UP_S) as look:
        return trend_of(look, lot, metric, by)


def page_part(data: Path, part: Part) -> PartFigure:
    """Return a master part over time."""
    with production(data, most_s=CATCH_UP_S) as look:
        return part_trend(look, part)


def page_type_one(data: Path, part: Part, reference: float, tolerance: float | None) -> TypeOneFigure:
    """Return the type 1 study of a part."""
    with production(data, most_s=CATCH_UP_S) as look:
        return type_one_of(look, part, reference, tolerance, SHARE)


def page_due(data: Path, models: Models) -> tuple[Due, ...]:
    """Return what is due on each bench of the table of models."""
    benches: dict[str, Bench] = {}
    found: list[Due] = []
    for one in models.models:
        try:
            bench = load_bench(one.bench) if one.bench else default_bench(load_recipe(one.recipe))[1]
        except RecipeError as error:
            found.append(Due(one.bench or one.model, "bench file", in_order=False, text=str(error).splitlines()[0]))
            continue
        benches[bench.bench.name] = bench
    for bench in benches.values():
        found += due_on(Store(data), bench, WALL_CLOCK.now())
    return tuple(found)


def add_quality_page(station: Station) -> None:
    """Add the page to the running application."""

    @ui.page("/quality", title="lostmotion: quality", response_timeout=LONGEST_BUILD_S)
    async def quality(request: Request) -> Response | None:
        if (session := await session_of_page(station, request)) is None:
            return RedirectResponse("/enter")
        await _Quality(station, session).build()
        return None


class _Quality:
    """One open page: the lot that is chosen, and what is shown of it."""

    def __init__(self, station: Station, session: Session) -> None:
        self._station, self._session = station, session
        self._filling = False
        self._behind = ""

    async def build(self) -> None:
        """Lay the page out; the figures come one after another."""
        ui.colors(primary=LINE)
        bar(self._station, self._session, "quality")
        ui.timer(SESSION_EVERY_S, lambda: still_open(self._station, self._session))
        with ui.element("main").classes("lm-page lm-quality"):
            with ui.tabs().props("dense no-caps align=left inline-label") as tabs:
                lot = ui.tab("Production")
                bench = ui.tab("Can this bench measure?")
                studies = ui.tab("Guided studies")
            with ui.tab_panels(tabs, value=lot).classes("lm-panels"):
                with ui.tab_panel(lot):
                    self._production()
                with ui.tab_panel(bench):
                    self._bench()
                with ui.tab_panel(studies):
                    GuidedStudies(self._station, self._session).build()
        ui.timer(0.0, self._first, once=True)

    def _production(self) -> None:
        with ui.element("form").classes("lm-filters").props('role="search" onsubmit="return false"'):
            self._recipe = ui.select([], label="Recipe", on_change=self._again).props("outlined dense")
            self._model = ui.select({"": "any"}, value="", label="Model", on_change=self._again).props("outlined dense")
            self._since = ui.input("From day", on_change=self._again).props("outlined dense type=date stack-label")
            self._until = ui.input("To day", on_change=self._again).props("outlined dense type=date stack-label")
            units = {False: "real units", True: "virtual bench"}
            self._virtual = ui.select(units, value=False, label="Units", on_change=self._again).props("outlined dense")
        self._said = ui.label().classes("lm-bypasses").props('role="status" aria-live="polite"')
        self._said.set_visibility(False)
        with ui.element("div").classes("lm-quality-grid"):
            with _card("Yield"), ui.element("div").classes("lm-side-by-side"):
                self._shares = ui.html("", sanitize=False).classes("lm-shares")
                self._yield = ui.echart({}).classes("lm-picture")
            with _card("What hindered it"), ui.element("div").classes("lm-side-by-side"):
                self._causes = {name: ui.html("", sanitize=False).classes("lm-causes") for name in CAUSES}
            with _card("Capability of the newest 2000 first attempts"):
                self._capability = ui.html("", sanitize=False).classes("lm-capability")
            with _card("By group"):
                with ui.row().classes("lm-choose-row"):
                    self._by = ui.select(list(TREND_BY), value="shift", label="By", on_change=self._trend).props(
                        "outlined dense"
                    )
                    self._trend_said = ui.label().classes("lm-words")
                self._trend_chart = ui.echart({}).classes("lm-picture")
            with _card("Control chart").classes("lm-whole-row"):
                with ui.row().classes("lm-choose-row"):
                    self._metric = ui.select({}, label="Metric", on_change=self._metric_chosen).props("outlined dense")
                    self._rules = ui.select(
                        list(RULE_SETS), value="shewhart", label="Rules", on_change=self._chart
                    ).props("outlined dense")
                    self._subgroup = ui.select(
                        {1: "single values", 3: "3", 5: "5", 10: "10"}, value=5, label="Subgroup",
                        on_change=self._chart,
                    ).props("outlined dense")  # fmt: skip
                    self._chart_said = ui.label().classes("lm-words").props('role="status"')
                with ui.element("div").classes("lm-side-by-side"):
                    self._chart_figure = ui.echart({}).classes("lm-picture lm-tall")
                    self._signals = ui.html("", sanitize=False).classes("lm-signals")

    def _bench(self) -> None:
        with ui.element("div").classes("lm-filters"):
            self._part = ui.select({}, label="Master part", on_change=self._part_chart).props("outlined dense")
            self._part_metric = ui.select({}, label="Metric", on_change=self._part_chart).props("outlined dense")
        with ui.element("div").classes("lm-quality-grid"):
            with _card("What is due"):
                self._due = ui.html("", sanitize=False)
            with _card("Type 1 study: is this bench good enough for the tolerance?"):
                with ui.row().classes("lm-choose-row"):
                    self._reference = ui.number("Known value").props("outlined dense")
                    self._tolerance = ui.number("Tolerance (empty: as in the recipe)").props("outlined dense")
                    ui.button("Judge", on_click=self._judge).props("outline no-caps")
                self._type_one = ui.html("", sanitize=False).props('role="status"')
            with _card("Master part over time").classes("lm-whole-row"):
                self._part_said = ui.label().classes("lm-words").props('role="status"')
                self._part_figure = ui.echart({}).classes("lm-picture lm-tall")

    async def _first(self) -> None:
        found = await self._made(choices, self._station.data, said=self._say)
        if found is None:
            return
        self._filling = True
        self._recipe.set_options(list(found.recipes), value=found.recipes[-1] if found.recipes else None)
        self._model.set_options({"": "any"} | {name: name for name in found.models})
        self._virtual.set_value(not found.real)
        self._part.set_options({serial: f"{serial} ({number} runs)" for serial, number in found.parts},
                               value=found.parts[0][0] if found.parts else None)  # fmt: skip
        self._filling = False
        if found.behind:
            self._behind = f"{found.behind} runs are not in the store yet. They are being added: look again soon."
        await self._again()
        due = await self._made(page_due, self._station.data, self._station.models, said=self._part_said.set_text)
        if due is not None:
            self._due.set_content(due_html(due) if due else "Nothing: the bench files name no master part and no date.")
        await self._part_chart()

    def _lot(self) -> Lot:
        return Lot(
            recipe=self._recipe.value or None,
            model=self._model.value or None,
            since=begin_of(_day(self._since.value)),
            until=begin_of(_day(self._until.value), after=True),
            virtual=bool(self._virtual.value),
        )

    async def _again(self) -> None:
        if self._filling or not await still_open(self._station, self._session):
            return
        self._say(self._behind)
        await self._show_yield()
        await self._show_causes()
        found = await self._made(page_capability, self._station.data, self._lot(), said=self._say)
        self._capability.set_content("" if found is None else capability_html(found))
        if found is None:
            return
        worst = min(found.rows, key=lambda row: 0.0 if row.found is None else row.found.overall.nearest)
        names = {row.metric.name: title_of(row.metric.metric, row.metric.choices) for row in found.rows}
        self._filling = True
        kept = self._metric.value if self._metric.value in names else worst.metric.name
        self._metric.set_options(names, value=kept)
        self._part_metric.set_options(names, value=kept)
        self._filling = False
        await self._chart()
        await self._trend()

    async def _show_yield(self) -> None:
        lot = self._lot()
        known = lot.since is not None and lot.until is not None
        days = datetime.fromisoformat(lot.until or "") - datetime.fromisoformat(lot.since or "") if known else None
        by = "day" if days is not None and days <= BY_DAY_UP_TO else "month"
        found = await self._made(page_yield, self._station.data, lot, by, said=self._say)
        if found is not None:
            whole = found.whole
            self._shares.set_content(
                share_html("First pass", whole.first_pass, "units") + share_html("Final", whole.final, "units")
            )
            _draw(self._yield, yield_options(found))

    async def _show_causes(self) -> None:
        found = await self._made(page_causes, self._station.data, self._lot(), said=self._say)
        if found is None:
            return
        for name, head in CAUSES.items():
            self._causes[name].set_content(causes_html(head, getattr(found, name)))

    async def _metric_chosen(self) -> None:
        await self._chart()
        await self._trend()

    async def _chart(self) -> None:
        if self._filling or not self._metric.value:
            return
        rules = RULE_SETS[str(self._rules.value)]
        asked = (self._lot(), self._metric.value, rules, self._subgroup.value)
        found = await self._made(page_chart, self._station.data, *asked, said=self._chart_said.set_text)
        if found is not None:
            self._chart_said.set_text(chart_words(found))
            signals = signals_html(found)
            self._signals.set_content(signals)
            self._signals.set_visibility(bool(signals))
            _draw(self._chart_figure, chart_options(found))

    async def _trend(self) -> None:
        if self._filling or not self._metric.value:
            return
        asked = (self._lot(), self._metric.value, self._by.value)
        found = await self._made(page_trend, self._station.data, *asked, said=self._trend_said.set_text)
        self._trend_chart.set_visibility(found is not None)
        if found is not None:
            title = title_of(found.metric.metric, found.metric.choices, found.side)
            self._trend_said.set_text(f"{title}. {trend_words(found)}")
            _draw(self._trend_chart, trend_options(found))

    def _asked_part(self) -> Part | None:
        if not (self._part.value and self._part_metric.value):
            return None
        return Part(str(self._part.value), str(self._part_metric.value), virtual=bool(self._virtual.value))

    async def _part_chart(self) -> None:
        part = self._asked_part()
        if self._filling:
            return
        if part is None:
            self._part_said.set_text(
                "No master part was measured. Name master parts in the bench file, and measure one."
            )
            return
        found = await self._made(page_part, self._station.data, part, said=self._part_said.set_text)
        self._part_figure.set_visibility(found is not None)
        if found is not None:
            said = (
                found.why
                if found.trend is None
                else "; ".join(one.text for one in found.trend.signals) or "In control."
            )
            self._part_said.set_text(f"{len(found.series.values)} runs. {said}")
            _draw(self._part_figure, part_options(found))

    async def _judge(self) -> None:
        part = self._asked_part()
        if part is None or self._reference.value is None:
            self._type_one.set_content("Choose a master part and its metric, and give its known value.")
            return
        asked = (part, float(self._reference.value), self._tolerance.value)
        found = await self._made(page_type_one, self._station.data, *asked, said=self._type_one.set_content)
        if found is not None:
            one = found.study
            word = "● capable" if one.capable else "■ NOT CAPABLE"
            self._type_one.set_content(
                f'<b class="{"" if one.capable else "lm-bad"}">{word}</b>: Cg {one.cg:.2f} ({one.cg_low:.2f} … '
                f"{one.cg_high:.2f}), Cgk {one.cgk:.2f} ({one.cgk_low:.2f} … {one.cgk_high:.2f}); 1.33 is needed.<br>"
                f"{one.measurements} measurements, bias {one.bias:.3g}, standard deviation {one.sd:.3g}, tolerance "
                f"{one.tolerance:.4g}. The smallest tolerance that this bench measures so is {one.least_tolerance:.3g}."
            )

    async def _made(self, make: Callable[..., Found], *asked: object, said: Callable[[str], object]) -> Found | None:
        """Return what is made beside the server; None where it cannot be made, which is said."""
        try:
            return await asyncio.to_thread(self._station.evaluations.figure, make, *asked)
        except (StationError, AnalysisError) as error:
            said(str(error).replace(f"{self._station.data}: ", ""))
            return None

    def _say(self, text: str) -> None:
        self._said.set_text(text)
        self._said.set_visibility(bool(text))


def _card(head: str) -> ui.element:
    card = ui.element("section").classes("lm-card lm-quality-card")
    with card:
        ui.html(f"<h2>{head}</h2>", sanitize=False)
    return card


def _draw(chart: ui.echart, options: Options) -> None:
    chart.options.clear()
    chart.options.update(options)
    chart.update()


def _day(text: str | None) -> date | None:
    try:
        return date.fromisoformat(text or "")
    except ValueError:
        return None
