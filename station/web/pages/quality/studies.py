"""The tab of guided studies on the page of quality: which unit comes next, who measures it, and the figures.

A unit is measured by the action that starts any run, under the same conditions; here it is told which study it is for.
"""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from pathlib import Path

from nicegui import ui
from pydantic import JsonValue

from analysis.trace.errors import AnalysisError
from station.documents.study import GAGE, TYPE_ONE
from station.errors import StationError
from station.quality.bench_ability import TypeOneFigure
from station.quality.guided.evaluate import Figure, evaluate, refuse_incomplete
from station.quality.guided.progress import look, ranges
from station.records.studies import study_names
from station.store.quality.lot import production
from station.web.actions.table import ACTIONS
from station.web.languages import Words
from station.web.pages.frame import act, still_open
from station.web.pages.quality.ability_text import capable_said, gage_said, indices_said, measured_said
from station.web.pages.quality.parts import NO_NUMBER, card, numbers_of
from station.web.pages.quality_figures import side_title
from station.web.pages.words import EMPTY, on_page
from station.web.people.accounts import Session
from station.web.station import Station

LOOK_EVERY_S = 2.0
MOST_ROWS = 8
KINDS = {TYPE_ONE: "Type 1: one unit of known value", GAGE: "Gage: several units, each by several operators"}
KINDS_SHORT = {TYPE_ONE: "Type 1 study", GAGE: "Gage study"}
NEXT = "Step {step} of {steps}: put unit {part} on the bench, and scan its label."
NEXT_BY = "Step {step} of {steps}: put unit {part} on the bench, by {operator}, and scan its label."
MISSING = ("missing: unit {part}: trial {trials}", "missing: unit {part}: trials {trials}")
MISSING_BY = (
    "missing: unit {part} by {operator}: trial {trials}",
    "missing: unit {part} by {operator}: trials {trials}",
)
"""What is said of one trial and of several."""

FIELDS = {
    "study": "Name of the study", "kind": "Kind", "parts": "Serial numbers", "operators": "Operators",
    "metrics": "Metrics", "references": "Known values", "tolerances": "Tolerances", "trials": "Trials",
}  # fmt: skip
"""Fields of the form by what the action calls them: how the label of each begins."""

OPTIONS = {
    "--kind": "kind", "--part": "parts", "--operator": "operators", "--metric": "metrics", "--reference": "references",
    "--tolerance": "tolerances", "--trials": "trials",
}  # fmt: skip
"""Which field of the form stands for an option of the command."""


@dataclass(frozen=True)
class StudyText:
    """A study for a person: what it is of, how far it is, what comes next, what is missing and what does not count."""

    head: str
    next: str
    rows: tuple[str, ...]
    whole: bool


def page_study(data: Path, name: str, say: Words) -> StudyText:
    """Return how a study stands, in words; StationError as `look`."""
    found = look(data, name)
    plan, steps = found.plan, len(found.plan.order)
    head = say(
        "{kind} of {metrics}: {measured} of {steps} steps measured",
        kind=say(KINDS_SHORT[plan.kind]),
        metrics=", ".join(one.id for one in plan.metrics),
        measured=len(found.measured),
        steps=steps,
    )
    now, coming = found.next, say("Every step is measured. Evaluate the study.")
    if found.running:
        coming = say("Run {run} is in progress. Wait for its end.", run=found.running)
    elif now is not None:
        step, cell = now
        coming = say(NEXT_BY if cell.operator else NEXT, step=step, steps=steps, part=cell.part, operator=cell.operator)
    rows = []
    for (part, operator), trials in found.missing_trials().items():
        texts, there = MISSING_BY if operator else MISSING, ranges(trials, "–")
        rows.append(say.counted(len(trials), *texts, part=part, operator=operator, trials=there))
    more = len(rows) - MOST_ROWS
    rows = [*rows[:MOST_ROWS], *([say("and {count} more", count=more)] if more > 0 else [])]
    for one in found.does_not_count[-MOST_ROWS:]:
        why = say(one.why)
        rows.append(say("step {step}, run {run} does not count: {why}", step=one.step, run=one.run, why=why))
    return StudyText(head, coming, tuple(rows), whole=not found.open)


def page_figures(data: Path, name: str) -> tuple[Figure, ...]:
    """Return the figures of a study; StationError, AnalysisError as `evaluate`."""
    found = look(data, name, samples=True)
    refuse_incomplete(found)
    with production(data) as view:
        return evaluate(view, found)


def figure_said(figure: Figure, say: Words) -> str:
    """Return a figure of a study in words."""
    if not isinstance(figure, TypeOneFigure):
        return say.whole(f"{gage_said(figure, say)}.")
    one, series = figure.study, figure.series
    what = side_title(series.metric, series.side, say)
    return say.whole(f"{capable_said(one, say)}: {what}: {indices_said(one, say)} {measured_said(one, say)}")


def refused_said(name: str, text: str, say: Words) -> str:
    """Return why a study was not begun, with the label of the field that it is about; name: of what was refused."""
    option, _, rest = text.partition(": ")
    field = OPTIONS.get(option, name.partition(".")[0])
    why = say(on_page(rest if option in OPTIONS else text))
    if field not in FIELDS:
        return why
    if EMPTY.fullmatch(text):
        why = say("found none; fill in this field")
    return say.whole(f"{say(FIELDS[field])}: {why}")


class GuidedStudies:
    """The tab on one open page."""

    def __init__(self, station: Station, session: Session, say: Words) -> None:
        self._station, self._session, self._words = station, session, say
        self._shown: StudyText | None = None

    def build(self) -> None:
        """Lay the tab out."""
        say = self._words
        with ui.element("div").classes("lm-filters"):
            self._study = ui.select([], label=say("Study"), on_change=self._look).props("outlined dense")
        with ui.element("div").classes("lm-quality-grid"):
            with card(say("What comes next")).classes("lm-study"):
                self._head = ui.label().classes("lm-words")
                self._next = ui.label().props('role="status" aria-live="polite"')
                with ui.row().classes("lm-choose-row"):
                    self._scanned = ui.input(say("Scanned label")).props("outlined dense")
                    self._scanned.on("keydown.enter", self._measure)
                    self._button("start_run", say("Measure"), self._measure)
                    self._button("settle_study", say("Evaluate"), self._evaluate)
                self._said = ui.label().classes("lm-words").props('role="alert"')
                self._rows = ui.html("", sanitize=False)
            if self._may("begin_study"):
                self._begin_card()
        ui.timer(0.0, self._names, once=True)
        ui.timer(LOOK_EVERY_S, self._look)

    def _begin_card(self) -> None:
        say = self._words
        with card(say("Begin a study")):
            self._name = ui.input(say("Name of the study")).props("outlined dense")
            kinds = {kind: say(text) for kind, text in KINDS.items()}
            self._kind = ui.select(kinds, value=TYPE_ONE, label=say("Kind")).props("outlined dense")
            self._parts = ui.input(say("Serial numbers, with commas")).props("outlined dense")
            self._operators = ui.input(say("Operators by their accounts, with commas")).props("outlined dense")
            self._metrics = ui.input(say("Metrics by id, with commas")).props("outlined dense")
            self._references = ui.input(say("Known values, one for each metric: 0.37; 115 (type 1)"))
            self._references.props("outlined dense")
            self._tolerances = ui.input(say("Tolerances: 0.2; 9 (empty: as in the recipe)")).props("outlined dense")
            self._trials = ui.number(say("Trials (empty: 50 for type 1, 3 for gage)"), min=1, format="%d").props(
                "outlined dense"
            )
            self._button("begin_study", say("Begin"), self._begin)
            self._begun = ui.label().classes("lm-words").props('role="alert"')

    def _may(self, action: str) -> bool:
        return self._session.person.role in ACTIONS[action].roles

    def _button(self, action: str, text: str, does: Callable[[], object]) -> None:
        if self._may(action):
            ui.button(text, on_click=does).props("outline no-caps")

    async def _names(self, chosen: str = "") -> None:
        names = await asyncio.to_thread(study_names, self._station.data)
        self._study.set_options(names, value=chosen or (names[-1] if names else None))
        if not names:
            self._next.set_text(self._words("No study was begun."))

    async def _look(self) -> None:
        name = self._study.value
        if not name or not await still_open(self._station, self._session):
            return
        try:
            found = await asyncio.to_thread(page_study, self._station.data, str(name), self._words)
        except StationError as error:
            self._next.set_text(self._words(str(error)))
            return
        if found != self._shown:
            self._shown = found
            self._head.set_text(found.head)
            self._next.set_text(found.next)
            self._rows.set_content("<br>".join(escape(one) for one in found.rows))

    async def _measure(self) -> None:
        scanned, self._scanned.value = str(self._scanned.value or ""), ""
        await self._done("start_run", {"scanned": scanned, "study": str(self._study.value or "")}, self._said)

    async def _evaluate(self) -> None:
        name = str(self._study.value or "")
        if not await self._done("settle_study", {"study": name}, self._said):
            return
        try:
            make, data = self._station.evaluations.figure, self._station.data
            figures = await asyncio.to_thread(lambda: make(page_figures, data, name))
        except (StationError, AnalysisError) as error:
            self._said.set_text(self._words(str(error)))
            return
        self._said.set_text(" ".join(figure_said(one, self._words) for one in figures))

    async def _begin(self) -> None:
        name = str(self._name.value or "").strip()
        try:
            references, tolerances = (numbers_of(one.value) for one in (self._references, self._tolerances))
        except ValueError as error:
            self._begun.set_text(self._words(NO_NUMBER, found=error))
            return
        values: dict[str, JsonValue] = {
            "study": name, "kind": str(self._kind.value), "parts": list(_texts(self._parts.value)),
            "operators": list(_texts(self._operators.value)), "metrics": list(_texts(self._metrics.value)),
            "trials": None if self._trials.value is None else int(self._trials.value),
            "references": list(references), "tolerances": list(tolerances),
        }  # fmt: skip
        if await self._done("begin_study", values, self._begun, refused_said):
            self._begun.set_text(self._words("Study {name} was begun.", name=name))
            await self._names(name)

    async def _done(
        self,
        action: str,
        values: dict[str, JsonValue],
        said: ui.label,
        why: Callable[[str, str, Words], str] = lambda _name, text, say: say(text),
    ) -> bool:
        """Do an action, and say why not; return whether it was done."""
        answer = await act(self._station, self._session, action, values)
        said.set_text(" ".join(why(one.id, one.text, self._words) for one in answer.refused))
        self._shown = None
        await self._look()
        return not answer.refused


def _texts(given: str | None) -> list[str]:
    return [one.strip() for one in re.split(r"[,;\uff0c\uff1b]", given or "") if one.strip()]
