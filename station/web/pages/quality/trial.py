"""Limits on trial on the page of quality: which verdicts of the lot flip, at what risk, and the recipe as a draft."""

from __future__ import annotations

import math
from collections.abc import Callable
from html import escape

from nicegui import ui

from station.quality.limits_trial import Trial, Tried
from station.store.quality.lot import Lot
from station.web.actions.table import ACTIONS
from station.web.actions.values import RecipeChanged
from station.web.pages.frame import act
from station.web.pages.quality.made import MOST_FLIPS, page_draft, page_trial
from station.web.pages.quality.parts import card, made_beside
from station.web.pages.quality.trial_html import flips_html, risks_html, trial_words, verdicts_html
from station.web.pages.recipes.editor import address_of
from station.web.people.accounts import Session
from station.web.station import Station

NONE = "none"
"""What takes a limit away."""


class TrialCard:
    """The card; lot: says which one is chosen on the page."""

    def __init__(self, station: Station, session: Session, lot: Callable[[], Lot]) -> None:
        self._station, self._session, self._lot = station, session, lot
        self._tried: tuple[Lot, Tried] | None = None

    def build(self) -> None:
        """Lay it out."""
        with card("Limits on trial").classes("lm-whole-row lm-trial"):
            with ui.row().classes("lm-choose-row"):
                self._metric = ui.select({}, label="Metric on trial", on_change=self.forget).props("outlined dense")
                self._low, self._high, self._guard = (
                    ui.input(label, on_change=self.forget).props("outlined dense")
                    for label in ("New min", "New max", "New guard band, × U")
                )
                ui.button("Try", on_click=self._try).props("outline no-caps")
                self._save = ui.button("Save as draft", on_click=self._save_draft).props("outline no-caps")
            ui.label(
                f"An empty field keeps the present limit, {NONE!r} removes it. A guard band of 0 ignores the "
                "uncertainty. No stored verdict changes."
            ).classes("lm-words")
            self._said = ui.html("", sanitize=False).classes("lm-words").props('role="status" aria-live="polite"')
            with ui.element("div").classes("lm-side-by-side"):
                self._verdicts = ui.html("", sanitize=False)
                self._risks = ui.html("", sanitize=False)
            self._flips = ui.html("", sanitize=False).classes("lm-flips")
        self.forget()

    def set_metrics(self, names: dict[str, str], chosen: str) -> None:
        """Offer metrics."""
        self._metric.set_options(names, value=self._metric.value if self._metric.value in names else chosen)
        self.forget()

    def forget(self) -> None:
        """Show nothing: what was tried is not what is chosen any more."""
        self._tried = None
        self._save.set_visibility(False)
        for part in (self._said, self._verdicts, self._risks, self._flips):
            part.set_content("")

    def _asked(self) -> Tried | None:
        try:
            low, high = (_limit(one.value) for one in (self._low, self._high))
            guard = float(self._guard.value) if (self._guard.value or "").strip() else None
            if guard is not None and not 0.0 <= guard <= 1.0:
                raise ValueError  # noqa: TRY301 - as one that is no number
        except ValueError:
            self._said.set_content("Limits are numbers with a point for decimals; a guard band is from 0 to 1.")
            return None
        return Tried(str(self._metric.value), None, low, high, guard)

    async def _try(self) -> None:
        self.forget()
        tried = self._asked()
        if tried is None or not self._metric.value:
            return
        lot = self._lot()
        found = await made_beside(self._station, page_trial, lot, tried, said=self._tell)
        if found is not None:
            self._tried = lot, tried
            self._show(found)

    def _show(self, found: Trial) -> None:
        self._tell(trial_words(found))
        self._verdicts.set_content(verdicts_html(found))
        self._risks.set_content(risks_html(found))
        self._flips.set_content(flips_html(found, MOST_FLIPS))
        self._save.set_visibility(self._session.person.role in ACTIONS["save_recipe"].roles)

    async def _save_draft(self) -> None:
        if self._tried is None:
            return
        text = await made_beside(self._station, page_draft, *self._tried, said=self._tell)
        if text is None:
            return
        answer = await act(self._station, self._session, "save_recipe", {"text": text, "replaces": ""})
        if isinstance(answer.said, RecipeChanged):
            saved = answer.said
            self._said.set_content(
                f'Saved as draft: <a href="{address_of(saved.name, saved.revision)}">revision {saved.revision}</a>. '
                "Another person releases it."
            )
            self._save.set_visibility(False)
        else:
            self._tell(" ".join(one.text for one in answer.refused))

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
