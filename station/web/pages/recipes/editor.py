"""The page of one revision: text with the messages of `check`, load as a picture, forms, dry run, release."""

from __future__ import annotations

import asyncio
import time
from functools import partial
from html import escape
from typing import Any
from urllib.parse import quote

from fastapi import Request, Response
from fastapi.responses import HTMLResponse, RedirectResponse
from nicegui import ui
from pydantic import JsonValue

from recipes import RecipeError
from recipes.editing import Group, changed, limits_of, load_of
from recipes.text.problems import OptionPath
from recipes.text.yaml_source import parse_source
from station.errors import StationError
from station.records.revisions.history import History
from station.records.revisions.revision import Revision, State, hash_of
from station.web.actions.row import Answer
from station.web.actions.table import ACTIONS
from station.web.actions.values import RecipeChanged
from station.web.languages import Words
from station.web.pages.frame import IN_ENGLISH, SESSION_EVERY_S, act, bar, session_of_page, still_open, words_for
from station.web.pages.quality.made import page_text_trial
from station.web.pages.quality.parts import made_beside
from station.web.pages.recipes.diff import diff_html
from station.web.pages.recipes.dry_run_html import dry_run_html, text_trial_html
from station.web.pages.recipes.load_curve import LINE_INK, chart_options, load_text
from station.web.pages.recipes.revisions import history_html, state_said, title_said
from station.web.people.accounts import Session
from station.web.recipe_text.check import LookedAt, look_at
from station.web.recipe_text.dry_run import IDLE, TRIED, TRYING, DryRun
from station.web.station import Station

LOOK_EVERY_S = 0.15
QUIET_S = 0.35
"""For how long nobody has typed when the text is checked."""

WHY_BACK = "What shall be changed"
NOT_SENT_BACK = "Nothing was sent back. Write what its authors shall change into the field '{field}'."
TEXT_LABEL = "text of the recipe"


def address_of(name: str, revision: int) -> str:
    """Return the address of a revision's page."""
    return f"/recipes/{quote(name, safe='')}/{revision}"


def add_editor(station: Station) -> None:
    """Add the page to the running application."""

    @ui.page("/recipes/{name}/{revision}", title="lostmotion: recipe")
    async def recipe(request: Request, name: str, revision: int, new: int = 0) -> Response | None:
        if (session := await session_of_page(station, request)) is None:
            return RedirectResponse("/enter")
        say = words_for(station, session, request)
        try:
            history = await asyncio.to_thread(History, station.data)
            found = history.find(name, revision)
            text = None if found is None else await asyncio.to_thread(found.text)
        except StationError as error:
            return HTMLResponse(escape(say(str(error))), 409)
        if found is None or text is None:
            return HTMLResponse(escape(say("There is no such revision.")), 404)
        await _Editor(station, session, history, found, text.decode()).build(say, as_new=bool(new))
        return None


class _Editor:
    """One open page: a text, what was said of it last, and the revision that it was opened as."""

    def __init__(self, station: Station, session: Session, history: History, found: Revision, text: str) -> None:
        self._station, self._session, self._history = station, session, history
        self._found: Revision | None = found
        self._name = found.name
        self._kept = self._text = text
        self._changed_at: float | None = time.monotonic()
        self._looked: LookedAt | None = None
        self._fields: dict[OptionPath, ui.input] = {}
        self._dry: tuple[str, str] = ("", "")
        self._asks = False
        self._told: tuple[Revision | None, bool, bool] | None = None

    async def build(self, say: Words, *, as_new: bool) -> None:
        """Lay the page out; as_new: the text becomes the draft of the next revision."""
        assert self._found is not None  # noqa: S101 - the page was asked for by it
        self._words, opened, refused = say, self._found, list[str]()
        if as_new and opened.state is State.RELEASED:
            number = max(one.revision for one in self._history.all() if one.name == opened.name) + 1
            try:
                self._text = changed(self._text.encode(), ("recipe", "revision"), str(number)).decode()
            except RecipeError as error:  # a text of before, in which a sign stood that is refused today
                refused = [say(str(error))]
            self._kept, self._found = self._text, None
        ui.colors(primary=LINE_INK)
        bar(self._station, self._session, "recipes", say)
        with ui.element("main").classes("lm-page"):
            self._head = ui.element("div").classes("lm-recipe-head")
            self._refused = ui.label().classes("lm-refused").props('role="alert"')
            self._refused.set_visibility(False)
            with ui.element("div").classes("lm-recipe"):
                self._editor = ui.codemirror(
                    self._text, language="YAML", theme="githubLight", indent="  ", on_change=self._typed
                )
                self._editor.classes("lm-recipe-text")
                with ui.element("section").classes("lm-recipe-side"):
                    self._load = ui.label().classes("lm-recipe-load").props('role="status"')
                    self._chart = ui.echart(chart_options(say)).classes("lm-recipe-chart")
                    self._build_tabs(opened)
        self._editor.set_enabled(self._may_write())
        # What cannot be written has no cursor to scroll with.
        ui.run_javascript(f"getHtmlElement({self._editor.id}).querySelector('.cm-scroller').tabIndex = 0")
        ui.run_javascript(f"document.querySelector('.cm-content')?.setAttribute('aria-label', {say(TEXT_LABEL)!r})")
        self._show_head()
        self._say(refused)
        ui.timer(LOOK_EVERY_S, self._look)
        ui.timer(SESSION_EVERY_S, partial(still_open, self._station, self._session))

    def _build_tabs(self, opened: Revision) -> None:
        say = self._words
        with ui.tabs().props("dense no-caps align=left") as tabs:
            messages, limits, load = (ui.tab(text) for text in (say("Messages"), say("Limits"), say("Load")))
            changes, tried, events = (ui.tab(text) for text in (say("Changes"), say("Dry run"), say("History")))
        first = changes if opened.state is State.ASKED else messages
        with ui.tab_panels(tabs, value=first, keep_alive=True).classes("lm-recipe-panels"):
            with ui.tab_panel(messages):
                self._messages = ui.element("div").props('aria-live="polite"')
            with ui.tab_panel(limits):
                self._limits = ui.element("div").classes("lm-form")
            with ui.tab_panel(load):
                self._steps = ui.element("div").classes("lm-form")
            with ui.tab_panel(changes):
                others = [one for one in self._history.all() if one.name == opened.name]
                choices = {
                    one.revision: say("revision {number} ({state})", number=one.revision, state=state_said(one, say))
                    for one in others
                }
                before = self._before(others, opened)
                self._against = ui.select(
                    choices, value=before, label=say("Compared with"), on_change=self._show_changes
                ).props("outlined dense")
                self._changes = ui.html(sanitize=False)
            with ui.tab_panel(tried):
                self._try = ui.button(say("Try on the virtual bench"), on_click=self._start_dry_run)
                self._try.props("no-caps outline")
                self._tried = ui.html(sanitize=False).props('aria-live="polite"')
            with ui.tab_panel(events):
                ui.html(history_html(self._history, opened.name, say), sanitize=False)

    def _before(self, others: list[Revision], opened: Revision) -> int:
        """Return the revision that a text is compared with at first: the newest released one below it."""
        if self._found is None:
            return opened.revision
        below = [one.revision for one in others if one.revision < opened.revision and one.state is State.RELEASED]
        return max(below, default=opened.revision)

    def _may(self, action: str) -> bool:
        return self._session.person.role in ACTIONS[action].roles

    def _may_write(self) -> bool:
        there = self._found is None or self._found.state is not State.RELEASED
        return there and self._may("save_recipe")

    def _is_saved(self) -> bool:
        return self._found is not None and self._text == self._kept

    def _show_head(self) -> None:
        """Show what the revision is, and what this person can do with it now."""
        found, saved = self._found, self._is_saved()
        in_order = self._looked is not None and self._looked.job is not None
        goes_on = saved and in_order and found is not None and found.state is not State.RELEASED
        told = (found, saved, goes_on)
        if told == self._told:
            return  # a button that is made anew under the finger loses the click
        self._told, say = told, self._words
        self._head.clear()
        with self._head:
            with ui.element("h1").classes("lm-recipe-title"):
                ui.label(say("{name}, new draft", name=self._name) if found is None else title_said(found, say))
            state = say("not saved") if found is None else state_said(found, say)
            changed_too = not saved and found is not None
            shown = say("{state}, changed and not saved", state=state) if changed_too else state
            ui.label(shown).classes("lm-recipe-state")
            if found is not None and found.state is State.RELEASED and self._may("save_recipe"):
                ui.button(
                    say("Copy to a new revision"),
                    on_click=lambda: ui.navigate.to(f"{address_of(found.name, found.revision)}?new=1"),
                ).props("no-caps outline")
            if self._may_write():
                ui.button(say("Save"), on_click=self._save).props("no-caps").set_enabled(not saved)
            if found is not None and found.state is State.DRAFT and self._may("ask_release"):
                button = ui.button(say("Ask for release"), on_click=partial(self._release, "ask_release"))
                button.props("no-caps").set_enabled(goes_on)
            if found is not None and found.state is State.ASKED and self._may("release_recipe"):
                button = ui.button(say("Release"), on_click=partial(self._release, "release_recipe"))
                button.props("no-caps").set_enabled(goes_on)
                why = ui.input(say(WHY_BACK)).props("outlined dense maxlength=200").classes("lm-why-back")
                send = ui.button(say("Send back"), on_click=lambda: self._send_back(str(why.value or "")))
                send.props("no-caps outline")
            if found is not None and found.sent_back_by:
                why_back = say("Sent back by {person}: {reason}", person=found.sent_back_by, reason=found.reason)
                ui.label(why_back).classes("lm-sent-back")

    def _typed(self, event: Any) -> None:
        self._text = str(event.value or "")
        self._changed_at = time.monotonic()
        if self._asks != (self._text != self._kept):
            self._asks = not self._asks
            ui.run_javascript(f"window.onbeforeunload = {'() => true' if self._asks else 'null'}")

    async def _look(self) -> None:
        self._show_dry_run(self._station.dry_runs.now())
        if self._changed_at is None or time.monotonic() - self._changed_at < (QUIET_S if self._looked else 0.0):
            return
        self._changed_at, text = None, self._text
        looked = await asyncio.to_thread(look_at, text.encode(), self._station.models)
        if text != self._text:
            return  # somebody has typed on meanwhile: it is looked at again
        self._looked = looked
        self._show_messages(looked)
        self._show_load(looked)
        self._show_forms(text)
        self._show_changes()
        self._show_head()

    def _show_messages(self, looked: LookedAt) -> None:
        lines = self._text.count("\n") + 1
        wrong = {one.line: one.text for one in looked.messages if 0 < one.line <= lines}
        self._editor.decorations = [{"kind": "line", "line": line, "class": "lm-wrong"} for line in wrong]
        self._editor.line_tooltips = wrong
        self._messages.clear()
        with self._messages:
            if looked.job is not None:
                ui.label(self._words("✓ No errors found.")).classes("lm-in-order")
            for one in looked.messages:
                with ui.element("div").classes("lm-warning" if one.is_warning else "lm-problem"):
                    if one.line:
                        ui.button(
                            f"✕ {self._words(one.where)}", on_click=partial(self._editor.reveal_line, one.line)
                        ).props("flat dense no-caps")
                    ui.label(one.text).props(IN_ENGLISH)

    def _show_load(self, looked: LookedAt) -> None:
        self._load.set_text(load_text(looked, self._words))
        series = self._chart.options["series"][0]
        series["data"] = [list(point) for point in looked.load_profile]
        rated = [looked.rated_nm, -looked.rated_nm] if looked.job is not None else []
        series["markLine"]["data"] = [{"yAxis": one} for one in rated]
        self._chart.update()

    def _show_forms(self, text: str) -> None:
        """Show the options of the text in the forms; fields that are there already only get their values."""
        try:
            source = parse_source(text.encode(), "recipe")
        except RecipeError:
            return
        limits, load = limits_of(source), load_of(source)
        there = {field.option: field.value for group in (*limits, *load) for field in group.fields}
        if list(there) != list(self._fields):
            self._fields = {}
            self._build_form(self._limits, limits)
            self._build_form(self._steps, load)
        for option, value in there.items():
            self._fields[option].value = value

    def _build_form(self, place: ui.element, groups: list[Group]) -> None:
        place.clear()
        with place:
            for group in groups:
                with ui.element("fieldset").classes("lm-fields"):
                    with ui.element("legend"):
                        ui.label(group.title)
                    for field in group.fields:
                        made = ui.input(field.name, value=field.value).props("outlined dense")
                        made.props["aria-label"] = f"{group.title}: {field.name}"
                        made.props["readonly"] = not self._may_write()
                        made.on("change", partial(self._put, field.option))
                        made.on("keydown.enter", partial(self._put, field.option))
                        self._fields[field.option] = made

    def _put(self, option: OptionPath, _event: Any) -> None:
        """Put a value of a form into the text."""
        value = str(self._fields[option].value or "")
        try:
            text = changed(self._text.encode(), option, value).decode()
        except RecipeError as error:
            self._say([self._words(str(error))])
            return
        self._say([])
        if text != self._text:
            self._editor.set_value(text)

    def _show_changes(self) -> None:
        other = self._history.find(self._name, int(self._against.value))
        try:
            before = "" if other is None else other.text().decode()
        except StationError as error:
            self._changes.set_content(escape(self._words(str(error))))
            return
        self._changes.set_content(diff_html(before, self._text, self._words))

    async def _perform(self, action: str, values: dict[str, JsonValue]) -> Answer:
        answer = await act(self._station, self._session, action, values)
        self._say([self._words(one.text) for one in answer.refused])
        return answer

    def _say(self, refused: list[str]) -> None:
        self._refused.set_text(" ".join(refused))
        self._refused.set_visibility(bool(refused))

    async def _save(self) -> None:
        found = self._found
        replaces = "" if found is None else found.sha256
        answer = await self._perform("save_recipe", {"text": self._text, "replaces": replaces})
        self._leave_to(answer)

    async def _release(self, action: str, **more: JsonValue) -> None:
        assert self._found is not None  # noqa: S101 - the button is there for a revision only
        found = self._found
        values: dict[str, JsonValue] = {"name": found.name, "revision": found.revision, "sha256": found.sha256}
        answer = await self._perform(action, values | more)
        self._leave_to(answer)

    async def _send_back(self, why: str) -> None:
        if not why.strip():
            self._say([self._words(NOT_SENT_BACK, field=self._words(WHY_BACK))])
            return
        await self._release("send_recipe_back", reason=why)

    @staticmethod
    def _leave_to(answer: Answer) -> None:
        """Go to the revision that was changed; stay where it was refused."""
        if isinstance(answer.said, RecipeChanged):
            ui.run_javascript("window.onbeforeunload = null")
            ui.navigate.to(address_of(answer.said.name, answer.said.revision))

    async def _start_dry_run(self) -> None:
        await self._perform("try_recipe", {"text": self._text})

    def _show_dry_run(self, now: DryRun) -> None:
        mine = now.sha256 == hash_of(self._text.encode())
        shown = (now.stage if mine or now.stage == TRYING else IDLE, now.said)
        self._try.set_enabled(now.stage != TRYING and self._may("try_recipe"))
        if shown != self._dry:
            self._dry = shown
            self._tried.set_content(dry_run_html(now, shown[0], self._words))
            if shown[0] == TRIED and now.result is not None:
                ui.timer(0.0, self._try_limits, once=True)

    async def _try_limits(self) -> None:
        """Say beside a dry run what the limits of its text do to the runs that are there."""
        told, text = list[str](), self._text
        found = await made_beside(self._station, page_text_trial, text.encode(), say=self._words, said=told.append)
        now = self._station.dry_runs.now()
        if now.stage == TRIED and now.sha256 == hash_of(text.encode()) == hash_of(self._text.encode()):
            said = f"<p>{escape(' '.join(told))}</p>"
            said = said if found is None else text_trial_html(found, self._words)
            self._tried.set_content(dry_run_html(now, TRIED, self._words) + said)
