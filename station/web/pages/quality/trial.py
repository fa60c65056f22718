"""Limits on trial on the page of quality: which verdicts of the lot flip, at what risk, and the recipe as a draft.

Other limits are judged by the store at once. Another definition is evaluated run by run beside the server, and the
card shows how far that is; who comes back to the page finds it there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from html import escape

from nicegui import ui

from station.errors import StationError
from station.quality.limits_trial import Trial, Tried
from station.store.quality.lot import Lot
from station.web.actions.table import ACTIONS
from station.web.actions.values import RecipeChanged
from station.web.definition_trials import TrialState
from station.web.languages import Words
from station.web.pages.frame import act, still_open
from station.web.pages.quality.made import MOST_FLIPS, page_definitions, page_draft, page_trial
from station.web.pages.quality.parts import card, made_beside
from station.web.pages.quality.trial_html import (
    NONE,
    definition_title,
    failed_html,
    flips_html,
    progress_words,
    risks_html,
    trial_words,
    verdicts_html,
)
from station.web.pages.recipes.editor import address_of
from station.web.people.accounts import Session
from station.web.station import Station

AS_IT_IS = ""
NEWEST = (50, 200, 2000)
"""Newest first attempts that another definition can be tried on: half a minute, two minutes, a quarter of an hour."""

LOOK_EVERY_S = 1.0

KEPT = (
    "An empty field keeps the present limit, '{none}' removes it. A guard band of 0 ignores the uncertainty. No stored "
    "verdict changes."
)
EVALUATED = (
    "For another definition every run is evaluated again, about half a second each, while the bench goes on. Choose "
    "one, or type it as a recipe has it: stiffness_at torque=50% branch=load."
)
NO_NUMBERS = "Limits are numbers with a point for decimals; a guard band is from 0 to 1."


class TrialCard:
    """The card; lot: says which one is chosen on the page."""

    def __init__(self, station: Station, session: Session, lot: Callable[[], Lot], say: Words) -> None:
        self._station, self._session, self._lot, self._words = station, session, lot, say
        self._found: Trial | None = None
        self._shown: TrialState | None = None
        self._defines = session.person.role in ACTIONS["begin_study"].roles

    def build(self) -> None:
        """Lay it out."""
        say = self._words
        with card(say("Limits on trial")).classes("lm-whole-row lm-trial"):
            with ui.row().classes("lm-choose-row"):
                self._metric = ui.select({}, label=say("Metric on trial"), on_change=self._metric_chosen).props(
                    "outlined dense"
                )
                self._definition = ui.select(
                    {AS_IT_IS: say("as it is")}, value=AS_IT_IS, label=say("Defined as"), with_input=True,
                    new_value_mode="add-unique", on_change=self._definition_chosen,
                ).props("outlined dense").classes("lm-definition")  # fmt: skip
                self._low, self._high, self._guard = (
                    ui.input(label, on_change=self.forget).props("outlined dense")
                    for label in (say("New min"), say("New max"), say("New guard band, × U"))
                )
                self._newest = ui.select(
                    {number: say("newest {number}", number=number) for number in NEWEST}, value=NEWEST[0],
                    label=say("Runs"),
                    on_change=self.forget,
                ).props("outlined dense")  # fmt: skip
                ui.button(say("Try"), on_click=self._try).props("outline no-caps")
                self._save = ui.button(say("Save as draft"), on_click=self._save_draft)
                self._save.props("outline no-caps no-wrap")
            ui.label(say(KEPT, none=NONE)).classes("lm-words")
            self._explained = ui.label(say(EVALUATED)).classes("lm-words")
            with ui.row().classes("lm-choose-row") as self._progress:
                self._bar = ui.linear_progress(0.0, show_value=False).classes("lm-progress")
                self._far = ui.label().classes("lm-words").props('role="status"')
                ui.button(say("Stop"), on_click=self._stop).props("outline no-caps")
            self._said = ui.html("", sanitize=False).classes("lm-words").props('role="status" aria-live="polite"')
            with ui.element("div").classes("lm-side-by-side"):
                self._verdicts = ui.html("", sanitize=False)
                self._risks = ui.html("", sanitize=False)
            self._flips = ui.html("", sanitize=False).classes("lm-flips")
        self._definition.set_visibility(self._defines)
        self.forget()
        ui.timer(LOOK_EVERY_S, self._look)

    async def set_metrics(self, names: dict[str, str], chosen: str) -> None:
        """Offer metrics."""
        self._metric.set_options(names, value=self._metric.value if self._metric.value in names else chosen)
        await self._metric_chosen()

    async def try_asked(self, metric: str, low: str, high: str) -> None:
        """Try limits that the address of the page names."""
        if metric not in (self._metric.options or ()):
            return
        self._metric.set_value(metric)
        self._low.set_value(low)
        self._high.set_value(high)
        await self._try()

    async def _metric_chosen(self) -> None:
        self._definition.set_value(AS_IT_IS)
        self.forget()
        if not self._metric.value or not self._defines:
            return
        self._definition.disable()
        asked = (self._lot(), str(self._metric.value))
        texts = await made_beside(self._station, page_definitions, *asked, say=self._words, said=self._tell) or ()
        if asked != (self._lot(), self._metric.value):
            return  # another one was chosen meanwhile, and is asked for
        chosen = self._definition.value or AS_IT_IS
        offered = {AS_IT_IS: self._words("as it is")} | {one: definition_title(one) for one in texts}
        self._definition.set_options({chosen: chosen} | offered, value=chosen)
        self._definition.enable()

    def _definition_chosen(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Show nothing: what was tried is not what is chosen any more."""
        self._found = None
        self._save.set_visibility(False)
        other = bool(self._other())
        self._newest.set_visibility(other)
        self._explained.set_visibility(other)
        for part in (self._said, self._verdicts, self._risks, self._flips):
            part.set_content("")

    def _other(self) -> str:
        return str(self._definition.value or "").strip() if self._defines else ""

    def _asked(self) -> Tried | None:
        try:
            low, high = (_limit(one.value) for one in (self._low, self._high))
            guard = float(self._guard.value) if (self._guard.value or "").strip() else None
            if guard is not None and not 0.0 <= guard <= 1.0:
                raise ValueError  # noqa: TRY301 - as one that is no number
        except ValueError:
            self._tell(self._words(NO_NUMBERS))
            return None
        return Tried(str(self._metric.value), None, low, high, guard, self._other())

    async def _try(self) -> None:
        if not await still_open(self._station, self._session):
            return
        self.forget()
        tried = self._asked()
        if tried is None or not self._metric.value:
            return
        lot = self._lot()
        if not tried.definition:
            found = await made_beside(self._station, page_trial, lot, tried, say=self._words, said=self._tell)
            if found is not None and (lot, tried) == (self._lot(), self._asked()):
                self._show(found)  # else something else was chosen meanwhile
            return
        try:
            self._station.trials.start(self._station.data, lot._replace(newest=self._newest.value), tried)
        except StationError as error:
            self._tell(self._words(str(error)))
        self._look()

    def _look(self) -> None:
        """Show how far the definition on trial is, and what came of it once."""
        now = self._station.trials.state
        running = now is not None and now.running and self._defines
        self._progress.set_visibility(running)
        if now is None or not self._defines or now is self._shown:
            return
        before, self._shown = self._shown, now
        if now.running:
            self._bar.set_value(now.done / now.of if now.of else 0.0)
            self._far.set_text(progress_words(now, self._words))
            return
        if not self._same_lot(now):
            if before is not None:
                name = now.tried.definition
                self._tell(self._words("{definition}: the trial over another lot has ended.", definition=name))
            return
        self.forget()
        if now.found is None:
            self._tell(self._words(now.error))
        else:
            self._show(now.found)

    def _same_lot(self, now: TrialState) -> bool:
        return self._lot()._replace(newest=now.lot.newest) == now.lot

    async def _stop(self) -> None:
        if not await still_open(self._station, self._session):
            return
        self._station.trials.stop()
        self._look()

    def _show(self, found: Trial) -> None:
        self._found = found
        say = self._words
        self._tell(trial_words(found, say))
        self._verdicts.set_content(verdicts_html(found, say))
        self._risks.set_content(risks_html(found, say))
        self._flips.set_content(flips_html(found, MOST_FLIPS, say) + failed_html(found, say))
        self._save.set_visibility(self._session.person.role in ACTIONS["save_recipe"].roles)

    async def _save_draft(self) -> None:
        if self._found is None:
            return
        text = await made_beside(self._station, page_draft, self._found, say=self._words, said=self._tell)
        if text is None:
            return
        answer = await act(self._station, self._session, "save_recipe", {"text": text, "replaces": ""})
        if isinstance(answer.said, RecipeChanged):
            saved = answer.said
            named = escape(self._words("revision {revision}", revision=saved.revision))
            link = f'<a href="{address_of(saved.name, saved.revision)}">{named}</a>'
            self._said.set_content(self._words("Saved as draft: {link}. Another person releases it.", link=link))
            self._save.set_visibility(False)
        else:
            self._tell(" ".join(self._words(one.text) for one in answer.refused))

    def _tell(self, text: str) -> None:
        self._said.set_content(escape(text))


def _limit(text: str | None) -> float | None:
    """Return a limit: None keeps what is, nan takes it away. ValueError for what is neither."""
    said = (text or "").strip()
    if not said:
        return None
    if said == NONE:
        return math.nan
    found = float(said)
    if not math.isfinite(found):
        raise ValueError(said)
    return found
