"""What the pages of recipes say of a revision: its title, where it is in its life, and what people did to it."""

from __future__ import annotations

from html import escape

from station.records.chain.entries import RECIPE_ASKED, RECIPE_RELEASED, RECIPE_SAVED, RECIPE_SENT_BACK
from station.records.revisions.history import History
from station.records.revisions.revision import Revision, State
from station.web.languages import Words
from station.web.pages.words import local

STATES = {State.DRAFT: "○ draft", State.ASKED: "◐ release asked", State.RELEASED: "● released"}
"""Each state with its shape."""

DID = {
    RECIPE_SAVED: "{person} saved a text",
    RECIPE_ASKED: "{person} asked for the release",
    RECIPE_SENT_BACK: "{person} sent it back",
    RECIPE_RELEASED: "{person} released it",
}


def title_said(one: Revision, say: Words) -> str:
    """Return a revision by its name and number."""
    return say("{name} revision {revision}", name=one.name, revision=one.revision)


def state_said(one: Revision, say: Words) -> str:
    """Return the state of a revision in words, without its shape."""
    return say(STATES[one.state]).partition(" ")[2]


def history_html(history: History, name: str, say: Words) -> str:
    """Return what people did to the revisions of a recipe here, newest first."""
    rows = "".join(
        f"<tr><td>{local(one.time)}</td><td>{escape(say('revision {revision}', revision=one.revision))}</td>"
        f"<td>{escape(say(DID[one.kind], person=one.person) + (f': {one.reason}' if one.reason else ''))}</td>"
        f"<td><code>{one.sha256[:12]}</code></td></tr>"
        for one in reversed(history.events(name))
    )
    return f'<table class="lm">{rows}</table>' if rows else f"<p>{say('Nobody has changed this recipe here.')}</p>"
