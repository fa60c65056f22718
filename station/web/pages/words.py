"""The words and the shapes of the operator's page: each verdict and stage has a word, a colour and a shape."""

from __future__ import annotations

import re
from datetime import datetime
from typing import NamedTuple

from station.documents.events import LeftState
from station.documents.manifest import INJECTED, SIMULATED, STATES
from station.records import run_record
from station.run.screen.progress import signed
from station.store.attempts import ALTERED
from station.store.stored_runs import StoredRun
from station.web.languages import Words

CIRCLE = (
    '<svg viewBox="0 0 100 100" aria-hidden="true"><circle cx="50" cy="50" r="46" fill="none" stroke="white" '
    'stroke-width="8"/><path d="M26 52 L44 70 L76 32" fill="none" stroke="white" stroke-width="11"/></svg>'
)
SQUARE = (
    '<svg viewBox="0 0 100 100" aria-hidden="true"><rect x="6" y="6" width="88" height="88" fill="none" stroke="white" '
    'stroke-width="8"/><path d="M28 28 L72 72 M72 28 L28 72" stroke="white" stroke-width="11"/></svg>'
)
TRIANGLE = (
    '<svg viewBox="0 0 100 100" aria-hidden="true"><path d="M50 6 L96 92 L4 92 Z" fill="none" stroke="white" '
    'stroke-width="8"/><path d="M50 38 L50 64 M50 72 L50 82" stroke="white" stroke-width="11"/></svg>'
)


SHAPES = {"PASS": "●", "FAIL": "■", "NOT DECIDABLE": "▲"}
"""Shape of each verdict in a line of text, as on the tile: colour alone tells nobody who does not see it."""

STYLES = {"PASS": "PASS", "FAIL": "FAIL", "NOT DECIDABLE": "OPEN"}
"""Style of each verdict."""

NO_VERDICT = "–"

OUTCOMES = ("PASS", "FAIL", "NOT DECIDABLE", *STATES, run_record.NOT_CONCLUDED, ALTERED)
"""What may have become of an earlier attempt."""

ATTEMPT = re.compile(
    rf"attempt (?P<number>\d+)(?: (?P<aside>{SIMULATED}|{INJECTED}))?(?: (?P<outcome>{'|'.join(OUTCOMES)}))?"
    r"(?: (?P<failed>.+))?"
)
"""An attempt as a record says it."""


def verdict_text(one: StoredRun) -> str:
    """Return the verdict of a run with its shape; how the run ended where it has none."""
    if one.altered:
        return f"{NO_VERDICT} NO VERDICT"
    if one.state != "complete":
        return f"{NO_VERDICT} {one.state.upper()}"
    return f"{SHAPES.get(one.verdict or '', NO_VERDICT)} {one.verdict or 'NO VERDICT'}"


TOLD_ATTEMPTS = re.compile(r"This unit was measured .*?\((?P<told>attempt .+)\)[.;] .+")
"""A refused retest, which tells of the attempts before it."""

TOLD = "{told}"

MEASURED_AGAIN = "measured again: "

LIMIT_REASON = re.compile(
    r"(?P<found>.+) is (?P<where>above|below|too near to) the limit of (?P<limit>.+?)"
    r"(?: for its uncertainty of (?P<uncertainty>.+?))?: (?P<meaning>.+)"
)
"""The reason of a metric out of its limits or too near to one, as the evaluation writes it."""

SPREAD_REASON = re.compile("; (?=standard deviation over the cycles |a standard deviation needs )")
"""Where the reason of a metric goes on with that of its standard deviation."""

PLACES = re.compile(r"(?<=a ramp was interrupted \().+(?=\); )")
"""Where ramps were interrupted, in the reason of a k of its own."""

FURTHER_REASONS = re.compile(r"; (?=and [0-9]+ further reasons?$)")
"""Where the reason of a run is followed by how many it has besides."""

ON_PAGE = {
    "choose them with --virtual": "choose the virtual bench as Units",
    "leave out --virtual": "choose real units as Units",
    "Add --virtual for units of the virtual bench": "Choose the virtual bench as Units for its units",
    "give it with --tolerance": "enter it as Tolerance",
    "for each --metric": "for each metric",
    "Leave this option out": "Leave this field empty",
}
"""What a message says of an option of a command, and what a page says of its own field instead."""

EMPTY = re.compile("List should have at least 1 item .*")
"""What is said of a field that was left empty and holds several things."""


def on_page(text: str) -> str:
    """Return a message with the fields of the page in place of the options of a command."""
    for option, field in ON_PAGE.items():
        text = text.replace(option, field)
    return text


def attempts_said(text: str, say: Words) -> str:
    """Return which attempt a run is and what became of those before in a language, from the words of a record.

    The titles of metrics, and a reason that a person gave, stay as they are.
    """
    return "; ".join(_attempt_said(part, say) for part in text.split("; "))


def refusal_said(text: str, say: Words) -> str:
    """Return why a scan was refused in a language, with the attempts that it tells of."""
    found = TOLD_ATTEMPTS.fullmatch(text)
    if found is None:
        return say(text)
    # What is told of attempts has its own words, so it is kept from being looked up with the rest.
    return say(text.replace(found["told"], TOLD)).replace(TOLD, attempts_said(found["told"], say))


def _attempt_said(part: str, say: Words) -> str:
    found = ATTEMPT.fullmatch(part)
    if found is None and part.startswith(MEASURED_AGAIN):
        return say("measured again: {reason}", reason=say(part.removeprefix(MEASURED_AGAIN)))
    if found is None:
        return say(part)
    said = say("attempt {number}", number=found["number"])
    of_it = (say(found[name] or "") for name in ("aside", "outcome"))
    return " ".join(word for word in (said, *of_it, found["failed"]) if word)


def reason_said(text: str, say: Words) -> str:
    """Return a reason of a verdict in a language: figures and the name of the metric stay, what it means does not."""
    return "; ".join(_limit_said(part, say) for part in SPREAD_REASON.split(text))


def _limit_said(text: str, say: Words) -> str:
    found = LIMIT_REASON.fullmatch(text)
    if found is None:
        return say(text)
    doubt = "" if found["uncertainty"] is None else " for its uncertainty of {uncertainty}"
    said = f"{{found}} is {found['where']} the limit of {{limit}}{doubt}: {{meaning}}"
    meaning = say(PLACES.sub(lambda places: "; ".join(map(say, places[0].split("; "))), found["meaning"]))
    return say(said, **{**found.groupdict(), "meaning": meaning})


def left_said(left: LeftState, say: Words) -> str:
    """Return how a bench was left, and what a person does before touching the unit."""
    torque = say("torque at the output not known")
    if left.torque_nm is not None:
        torque = say("{torque} N·m at the output", torque=signed(left.torque_nm, 1))
    parts = ((torque, left.torque_known), (say(f"lock {left.lock}"), left.lock_known),
             (say(f"drive {left.drive}"), left.drive_known))  # fmt: skip
    how = ", ".join(text if known else f"{text} ({say('last known')})" for text, known in parts)
    return say("It was left with {how}. Next: {action}.", how=how, action=say(left.next_action))


def local(moment: str | None) -> str:
    """Return a moment by the computer's time zone."""
    if moment is None:
        return ""
    try:
        return datetime.fromisoformat(moment).astimezone().strftime("%Y-%m-%d %H:%M:%S")
    except ValueError:
        return moment


class Shown(NamedTuple):
    """What a tile shows: style, shape, word, and what to do with the unit."""

    style: str
    shape: str
    word: str
    to_do: str


VERDICTS: dict[str, Shown] = {
    "PASS": Shown("PASS", CIRCLE, "PASS", "Put the unit with the good ones. Scan the next."),
    "FAIL": Shown("FAIL", SQUARE, "FAIL", "Put the unit into the NOK box."),
    "NOT DECIDABLE": Shown("OPEN", TRIANGLE, "NOT DECIDABLE", "Keep the unit. See the reason, then test it again."),
}
"""By the verdict of a run that came to its end."""

BENCH_FAULT = Shown("OPEN", TRIANGLE, "BENCH FAULT", "Do not touch the unit. Call the technician.")
STOPPED = Shown("OPEN", TRIANGLE, "STOPPED", "The unit has no verdict. Test it again.")
NOT_BELIEVED = Shown("OPEN", TRIANGLE, "NO VERDICT", "The record was changed. Call the technician.")
NOT_CONCLUDED = Shown("BUSY", "", "NOT CONCLUDED", "There is no verdict yet.")
READY = Shown("", "", "READY", "Scan the unit.")
STARTING = Shown("BUSY", "", "STARTING", "Keep your hands off the bench.")
RUNNING = Shown("BUSY", "", "TESTING", "Keep your hands off the bench.")
ENDINGS: dict[str, Shown] = {"fault": BENCH_FAULT, "stopped": STOPPED}
"""By the state of a run that did not come to its end; any other is a bench fault."""
