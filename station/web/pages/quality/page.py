"""The page of quality: a lot is chosen, and each figure of it is made beside the server, as the commands make it."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta
from typing import NamedTuple

from fastapi import Request, Response
from fastapi.responses import RedirectResponse
from nicegui import ui

from analysis.line.run_rules import RULE_SETS
from station.store.quality.lot import Lot
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
from station.web.pages.quality.batch import BatchCard
from station.web.pages.quality.bench import BenchTab
from station.web.pages.quality.made import (
    choices,
    page_capability,
    page_causes,
    page_chart,
    page_disbelieved,
    page_trend,
    page_yield,
)
from station.web.pages.quality.parts import card, day_of, draw, made_beside
from station.web.pages.quality.studies import GuidedStudies
from station.web.pages.quality.trial import TrialCard
from station.web.pages.quality_figures import (
    LINE,
    capability_html,
    causes_html,
    chart_options,
    chart_words,
    share_html,
    side_title,
    signals_html,
    title_of,
    trend_options,
    trend_words,
    yield_options,
)
from station.web.people.accounts import Session
from station.web.rest.runs import begin_of
from station.web.station import Station

BY_DAY_UP_TO = timedelta(days=62)
"""Yield is shown by day for a lot of up to so many days, else by month."""

TREND_BY = {
    "shift": "shift", "bench": "bench", "fixture": "fixture", "lock-angle": "lock angle", "operator": "operator",
    "revision": "revision", "day": "day", "month": "month",
}  # fmt: skip
"""What a metric is shown by, and how that is called."""

CAUSES = {"failed": "Metric that failed", "undecided": "No verdict", "alarms": "Alarm, any attempt"}
"""Causes by their name in the figure, and what stands above them."""

BEHIND = (
    "Not in the store yet: {count} run. The store is catching up: look again soon.",
    "Not in the store yet: {count} runs. The store is catching up: look again soon.",
)
"""What is said of one run, and of several, that the figures do not have yet."""

DISBELIEVED = (
    "Not counted: {count} run whose record is not believed. 'lostmotion verify' says why.",
    "Not counted: {count} runs whose records are not believed. 'lostmotion verify' says why.",
)
"""What is said of one run, and of several, that no figure counts."""


class Asked(NamedTuple):
    """What the address of the page names: a lot, and limits that are tried on it at once."""

    recipe: str = ""
    virtual: bool = False
    metric: str = ""
    low: str = ""
    high: str = ""


def add_quality_page(station: Station) -> None:
    """Add the page to the running application."""

    @ui.page("/quality", title="lostmotion: quality", response_timeout=LONGEST_BUILD_S)
    async def quality(  # noqa: PLR0917 - what the address may name
        request: Request,
        recipe: str = "",
        virtual: bool = False,  # noqa: FBT001, FBT002 - as above
        metric: str = "",
        min: str = "",  # noqa: A002 - as above
        max: str = "",  # noqa: A002 - as above
    ) -> Response | None:
        if (session := await session_of_page(station, request)) is None:
            return RedirectResponse("/enter")
        asked = Asked(recipe, virtual, metric, min, max)
        await _Quality(station, session, asked, words_for(station, session, request)).build()
        return None


class _Quality:
    """One open page: the lot that is chosen, and what is shown of it."""

    def __init__(self, station: Station, session: Session, asked: Asked, say: Words) -> None:
        self._station, self._session, self._asked, self._words = station, session, asked, say
        self._filling = False
        self._behind = ""
        self._bench = BenchTab(station, lambda: bool(self._virtual.value), say)
        self._trial = TrialCard(station, session, self._lot, say)
        self._report = BatchCard(self._lot, say)

    async def build(self) -> None:
        """Lay the page out; the figures come one after another."""
        say = self._words
        ui.colors(primary=LINE)
        bar(self._station, self._session, "quality", say)
        ui.timer(SESSION_EVERY_S, lambda: still_open(self._station, self._session))
        with ui.element("main").classes("lm-page lm-quality"):
            with ui.tabs().props("dense no-caps align=left inline-label") as tabs:
                lot = ui.tab(name="lot", label=say("Production"))
                bench = ui.tab(name="bench", label=say("Can this bench measure?"))
                studies = ui.tab(name="studies", label=say("Guided studies"))
            with ui.tab_panels(tabs, value=lot).classes("lm-panels"):
                with ui.tab_panel(lot):
                    self._production()
                with ui.tab_panel(bench):
                    self._bench.build()
                with ui.tab_panel(studies):
                    GuidedStudies(self._station, self._session, say).build()
        ui.timer(0.0, self._first, once=True)

    def _production(self) -> None:
        say = self._words
        with ui.element("form").classes("lm-filters").props('role="search" onsubmit="return false"'):
            self._recipe = ui.select([], label=say("Recipe"), on_change=self._again)
            self._model = ui.select({"": say("any")}, value="", label=say("Model"), on_change=self._again)
            self._since = ui.input(say("From day"), on_change=self._again).props("type=date stack-label")
            self._until = ui.input(say("To day"), on_change=self._again).props("type=date stack-label")
            units = {False: say("real units"), True: say("virtual bench")}
            self._virtual = ui.select(units, value=False, label=say("Units"), on_change=self._again)
            for one in (self._recipe, self._model, self._since, self._until, self._virtual):
                one.props("outlined dense")
        self._said = ui.label().classes("lm-bypasses").props('role="status" aria-live="polite"')
        self._said.set_visibility(False)
        with ui.element("div").classes("lm-quality-grid"):
            with card(say("Yield")), ui.element("div").classes("lm-side-by-side"):
                self._shares = ui.html("", sanitize=False).classes("lm-shares")
                self._yield = ui.echart({}).classes("lm-picture")
            with card(say("What hindered it")), ui.element("div").classes("lm-side-by-side"):
                self._causes = {name: ui.html("", sanitize=False).classes("lm-causes") for name in CAUSES}
            with card(say("Capability of the newest 2000 first attempts")):
                self._capability = ui.html("", sanitize=False).classes("lm-capability")
            with card(say("By group")):
                with ui.row().classes("lm-choose-row"):
                    groups = {by: say(text) for by, text in TREND_BY.items()}
                    self._by = ui.select(groups, value="shift", label=say("By"), on_change=self._trend)
                    self._by.props("outlined dense")
                    self._trend_said = ui.label().classes("lm-words")
                self._trend_chart = ui.echart({}).classes("lm-picture")
            with card(say("Control chart")).classes("lm-whole-row"):
                with ui.row().classes("lm-choose-row"):
                    self._metric = ui.select({}, label=say("Metric"), on_change=self._metric_chosen)
                    self._metric.props("outlined dense")
                    self._rules = ui.select(
                        list(RULE_SETS), value="shewhart", label=say("Rules"), on_change=self._chart
                    ).props("outlined dense")
                    self._subgroup = ui.select(
                        {1: say("single values"), 3: "3", 5: "5", 10: "10"}, value=5, label=say("Subgroup"),
                        on_change=self._chart,
                    ).props("outlined dense")  # fmt: skip
                    self._chart_said = ui.label().classes("lm-words").props('role="status"')
                with ui.element("div").classes("lm-side-by-side"):
                    self._chart_figure = ui.echart({}).classes("lm-picture lm-tall")
                    self._signals = ui.html("", sanitize=False).classes("lm-signals")
            self._trial.build()
            self._report.build()

    async def _first(self) -> None:
        self._filling = True
        await typed_before("quality")
        found = await made_beside(self._station, choices, say=self._words, said=self._say)
        if found is None:
            self._filling = False
            return
        asked = self._asked
        chosen = asked.recipe if asked.recipe in found.recipes else (found.recipes or (None,))[-1]
        self._recipe.set_options(list(found.recipes), value=chosen)
        self._model.set_options({"": self._words("any")} | {name: name for name in found.models})
        self._virtual.set_value(asked.virtual if asked.recipe else not found.real)
        self._filling = False
        self._bench.set_parts(found.parts)
        if found.behind:
            self._behind = self._words.counted(found.behind, *BEHIND)
        await self._again()
        if asked.metric:
            await self._trial.try_asked(asked.metric, asked.low, asked.high)
        await self._bench.show_due()

    def _lot(self) -> Lot:
        return Lot(
            recipe=self._recipe.value or None,
            model=self._model.value or None,
            since=begin_of(day_of(self._since.value)),
            until=begin_of(day_of(self._until.value), after=True),
            virtual=bool(self._virtual.value),
        )

    async def _again(self) -> None:
        if self._filling or not await still_open(self._station, self._session):
            return
        lot = self._lot()
        self._say(self._behind)
        self._trial.forget()
        self._report.show()
        disbelieved = await made_beside(self._station, page_disbelieved, lot, say=self._words, said=self._say)
        if disbelieved and lot == self._lot():
            self._say(" ".join(filter(None, (self._behind, self._words.counted(disbelieved, *DISBELIEVED)))))
        await self._show_yield()
        await self._show_causes()
        found = await made_beside(self._station, page_capability, lot, say=self._words, said=self._say)
        if lot != self._lot():
            return  # another one was chosen meanwhile, and is shown by whoever chose it
        self._capability.set_content("" if found is None else capability_html(found, self._words))
        if found is None:
            await self._bench.show_part()
            return
        worst = min(found.rows, key=lambda row: 0.0 if row.found is None else row.found.overall.nearest)
        names = {row.metric.name: title_of(row.metric.metric, row.metric.choices) for row in found.rows}
        self._filling = True
        kept = self._metric.value if self._metric.value in names else worst.metric.name
        self._metric.set_options(names, value=kept)
        self._filling = False
        self._bench.set_metrics(names, kept)
        await self._bench.show_part()
        await self._trial.set_metrics(names, kept)
        await self._chart()
        await self._trend()

    async def _show_yield(self) -> None:
        lot = self._lot()
        known = lot.since is not None and lot.until is not None
        days = datetime.fromisoformat(lot.until or "") - datetime.fromisoformat(lot.since or "") if known else None
        by = "day" if days is not None and days <= BY_DAY_UP_TO else "month"
        found = await made_beside(self._station, page_yield, lot, by, say=self._words, said=self._say)
        if found is not None and lot == self._lot():
            whole, say = found.whole, self._words
            self._shares.set_content(
                share_html(say("First pass"), whole.first_pass, say) + share_html(say("Final"), whole.final, say)
            )
            draw(self._yield, yield_options(found, say))

    async def _show_causes(self) -> None:
        lot = self._lot()
        found = await made_beside(self._station, page_causes, lot, say=self._words, said=self._say)
        if found is None or lot != self._lot():
            return
        for name, head in CAUSES.items():
            self._causes[name].set_content(causes_html(self._words(head), getattr(found, name), self._words))

    async def _metric_chosen(self) -> None:
        await self._chart()
        await self._trend()

    async def _chart(self) -> None:
        if self._filling or not self._metric.value:
            return
        asked = self._chart_asked()
        found = await made_beside(self._station, page_chart, *asked, say=self._words, said=self._chart_said.set_text)
        if found is not None and asked == self._chart_asked():
            self._chart_said.set_text(chart_words(found, self._words))
            signals = signals_html(found, self._words)
            self._signals.set_content(signals)
            self._signals.set_visibility(bool(signals))
            draw(self._chart_figure, chart_options(found, self._words))

    def _chart_asked(self) -> tuple[Lot, str, Sequence[str], int]:
        return self._lot(), self._metric.value, RULE_SETS[str(self._rules.value)], self._subgroup.value

    async def _trend(self) -> None:
        if self._filling or not self._metric.value:
            return
        asked = self._trend_asked()
        found = await made_beside(self._station, page_trend, *asked, say=self._words, said=self._trend_said.set_text)
        if asked != self._trend_asked():
            return
        self._trend_chart.set_visibility(found is not None)
        if found is not None:
            title = side_title(found.metric, found.side, self._words)
            self._trend_said.set_text(self._words.whole(f"{title}. {trend_words(found, self._words)}"))
            draw(self._trend_chart, trend_options(found, self._words))

    def _trend_asked(self) -> tuple[Lot, str, str]:
        return self._lot(), self._metric.value, self._by.value

    def _say(self, text: str) -> None:
        self._said.set_text(text)
        self._said.set_visibility(bool(text))
