"""What an action changes, as it is seen before and after it: both stand in its line of the audit trail.

Of a secret it is only seen that it became another: by a mark, the beginning of the hash of what is kept of it.
"""

from __future__ import annotations

import hashlib
from datetime import UTC, datetime

from sqlalchemy import select

from recipes import RecipeError
from station.documents.entries import Plain
from station.records.revisions.history import History, header_of
from station.records.studies import read_study, study_names
from station.web.actions.row import Call
from station.web.actions.values import (
    Announced,
    Confirm,
    EndedBypass,
    FreshPassword,
    Named,
    NamedStudy,
    NewBadge,
    NewBypass,
    NewPerson,
    RecipeRevision,
    RecipeText,
    RecipeTried,
    Values,
)
from station.web.aqdef.outbox import refused
from station.web.bypasses import bypasses_now
from station.web.labels.outbox import awaited
from station.web.people.accounts import chosen_language, session_of
from station.web.people.database import BADGES, CONFIRMED, MES_UNITS, PEOPLE, SCANNER_TESTS
from station.web.recipe_text.check import encoded
from station.web.scanner import serial_of

MARK_DIGITS = 8


def bench(call: Call, _given: Values) -> Plain:
    """What the bench does, with which unit."""
    now = call.station.running.now()
    return {"stage": now.stage, "serial": now.serial}


def recovery(call: Call, _given: Values) -> Plain:
    """Whether the recovery is on, and which recovery was the last."""
    way_back = call.station.bench.way_back
    now = way_back.now()
    return {"stage": "starting" if way_back.starting() and now.stage != "running" else now.stage, "recovery": now.run}


def jog(call: Call, _given: Values) -> Plain:
    """Whether the bench is jogged, in which record, and which key is held."""
    standing = call.station.jogging.standing()
    return {"on": standing.on, "jog": standing.now.run, "held": standing.held}


def study(call: Call, given: NamedStudy) -> Plain:
    """How many runs the file of a study has taken; None while there is no such study."""
    there = given.study in study_names(call.station.data)
    return {"taken": len(read_study(call.station.data, given.study).taken) if there else None}


def dry_run(call: Call, _given: RecipeTried) -> Plain:
    """Which text is tried, and how far that is."""
    now = call.station.dry_runs.now()
    return {"stage": now.stage, "sha256": now.sha256}


def bypass(call: Call, given: NewBypass | EndedBypass) -> Plain:
    """Whether a start condition is set aside: by whom, why, until when."""
    found = next((one for one in bypasses_now(call.connection) if one.condition == given.condition), None)
    return {} if found is None else {"name": found.name, "reason": found.reason, "until": _moment(found.until_s)}


def previous_step(call: Call, given: Announced) -> Plain:
    """What became of a unit in the process step before."""
    kept = select(MES_UNITS.c.previous_step).where(MES_UNITS.c.serial == serial_of(given.serial))
    return {"previous_step": call.connection.execute(kept).scalar()}


def put_away(call: Call, given: Confirm) -> Plain:
    """Whether somebody has put the unit of a run away."""
    kept = select(CONFIRMED.c.name).where(CONFIRMED.c.run == given.run)
    return {"put_away_by": call.connection.execute(kept).scalar()}


def label(call: Call, _given: Values) -> Plain:
    """Which label is awaited, and how far it is."""
    labels = call.station.labels
    found = None if labels is None else awaited(call.connection, labels)
    return {} if found is None else {"run": found.run, "serial": found.serial, "stage": found.stage}


def aqdef(call: Call, _given: Values) -> Plain:
    """How many runs are in no AQDEF file without anybody knowing."""
    return {"refused": refused(call.connection)}


def scanner_test(call: Call, _given: Values) -> Plain:
    """When the scanner was tested last."""
    newest = select(SCANNER_TESTS.c.at_s).order_by(SCANNER_TESTS.c.number.desc()).limit(1)
    at_s = call.connection.execute(newest).scalar()
    return {"tested": None if at_s is None else _moment(at_s)}


def revision(call: Call, given: RecipeRevision | RecipeText) -> Plain:
    """State and text of a revision of a recipe."""
    if isinstance(given, RecipeText):
        try:
            header = header_of(encoded(given.text))
        except RecipeError:
            return {}  # the action refuses it, and says why
        name, number = header.name, header.revision
    else:
        name, number = given.name, given.revision
    found = History(call.station.data).find(name, number)
    return {} if found is None else {"state": str(found.state), "sha256": found.sha256}


def account(call: Call, given: NewPerson | Named | FreshPassword) -> Plain:
    """Role and standing of an account."""
    return _account(call, given.name)


def own_account(call: Call, _given: Values) -> Plain:
    """Role and standing of the person's own account."""
    return _account(call, call.person.name)


def badge(call: Call, given: NewBadge | Named) -> Plain:
    """Which badge a person has."""
    return _badge(call, given.name)


def own_badge(call: Call, _given: Values) -> Plain:
    """Which badge the person has, and with which PIN."""
    return _badge(call, call.person.name)


def language(call: Call, _given: Values) -> Plain:
    """In which language the person sees the pages."""
    return {"language": chosen_language(call.connection, call.person.name)}


def session(call: Call, _given: Values) -> Plain:
    """Whether the person's session is open."""
    return {"open": session_of(call.connection, call.session.token) is not None}


def _account(call: Call, name: str) -> Plain:
    row = call.connection.execute(select(PEOPLE).where(PEOPLE.c.name == name)).first()
    if row is None:
        return {}
    return {
        "role": row.role, "disabled": row.disabled, "must_change": row.must_change,
        "locked": row.locked_until_s is not None, "password": _mark(row.password),
    }  # fmt: skip


def _badge(call: Call, name: str) -> Plain:
    row = call.connection.execute(select(BADGES).where(BADGES.c.name == name)).first()
    return {} if row is None else {"badge": _mark(row.digest), "pin": _mark(row.pin)}


def _mark(kept: str) -> str:
    return hashlib.sha256(kept.encode()).hexdigest()[:MARK_DIGITS]


def _moment(at_s: float) -> str:
    return datetime.fromtimestamp(at_s, UTC).isoformat(timespec="seconds")
