"""An action is done or refused: each is a line of the audit trail, in the same transaction as what it did."""

from __future__ import annotations

import hashlib
import json
from threading import Lock

from pydantic import JsonValue, ValidationError
from sqlalchemy import Connection, delete, insert, select

from station.documents.entries import Plain
from station.errors import StationError
from station.records.revisions.revision import RevisionError
from station.records.studies import StudyError
from station.wall_clock import WALL_CLOCK
from station.web.actions.row import (
    BAD_INPUT,
    NOT_ALLOWED,
    NOT_ENTERED,
    NOT_NOW,
    NOT_READY,
    OK,
    Action,
    Answer,
    Call,
    NotNowError,
)
from station.web.actions.table import ACTIONS
from station.web.actions.values import Outcome, Refused, Values, refusal
from station.web.bypasses import BypassError
from station.web.people import audit
from station.web.people.accounts import AccountError, EntryRefusedError, Session, brings_token, count_wrong, session_of
from station.web.people.badges import digest_with, is_badge
from station.web.people.database import ANSWERS
from station.web.recipe_text.check import BadRecipeError
from station.web.scanner import ScanError
from station.web.station import Station

LONGEST_KEY = 64
KEPT_S = 24 * 3600.0
"""How long an answer is kept for whoever asks the same again."""

A_BADGE = "a badge"
"""Stands in the audit trail in the place of the number of a badge."""

_ONE_AT_A_TIME = Lock()


def perform(  # noqa: PLR0917 - one request, as it came
    station: Station, action_id: str, token: str | None, csrf: str | None, key: str | None, values: JsonValue
) -> Answer:
    """Do an action, or refuse it and say why; a key that was answered before is given the same answer."""
    row = ACTIONS[action_id]
    try:
        with _ONE_AT_A_TIME:
            note = _noted(station, row, token, csrf, values) if row.reaches_out else None
            with station.database.writing() as connection:
                audit.tell_cut_off(connection, but=note)
                session = session_of(connection, token)
                if session is None:
                    answer = Answer(NOT_ENTERED, refusal("not_entered", "Log in first."))
                else:
                    answer = _performed(Call(station, connection, session), row, csrf, key, values)
                if note is not None:
                    audit.end(connection, note)
            return answer
    except StationError as error:  # its own database cannot be written: nothing was done
        return Answer(NOT_READY, refusal("station", str(error)))


def perform_here(station: Station, session: Session, action_id: str, values: JsonValue) -> Answer:
    """Do an action, or refuse it, for whoever stands at the bench's own terminal: `session_here`.

    Nobody else can be taken for them, so neither log-in nor key is asked; what becomes of it is a line of the trail.
    """
    row = ACTIONS[action_id]
    try:
        with _ONE_AT_A_TIME:
            note = None
            if row.reaches_out:
                with station.database.writing() as connection:
                    note = _note_of(Call(station, connection, session), row, values)
            with station.database.writing() as connection:
                audit.tell_cut_off(connection, but=note)
                answer = _done(Call(station, connection, session), row, values)
                if note is not None:
                    audit.end(connection, note)
            return answer
    except StationError as error:  # as above
        return Answer(NOT_READY, refusal("station", str(error)))


def refuse_here(
    station: Station, session: Session, action_id: str, values: JsonValue, reasons: list[tuple[str, str]]
) -> None:
    """Write that an action was refused before it was tried; reasons: id and words of each.

    Raises:
        StationError: the trail cannot be written.

    """
    row = ACTIONS[action_id]
    with _ONE_AT_A_TIME, station.database.writing() as connection:
        call = Call(station, connection, session)
        _refused(call, row, NOT_NOW, reasons, row.needs.model_validate(values))


def _noted(station: Station, row: Action, token: str | None, csrf: str | None, values: JsonValue) -> int | None:
    """Note that an action is done next; None where it will be refused, as that changes nothing."""
    if not _is_text(values):
        return None
    with station.database.writing() as connection:
        session = session_of(connection, token)
        if session is None or not brings_token(session, csrf) or session.person.role not in row.roles:
            return None
        return _note_of(Call(station, connection, session), row, values)


def _note_of(call: Call, row: Action, values: JsonValue) -> int | None:
    try:
        given = row.needs.model_validate({} if values is None else values)
    except ValidationError:
        return None
    return audit.begin(call.connection, call.person.name, row.id, _told(call, row, given))


def _told(call: Call, row: Action, given: Values) -> Plain:
    """Return what stands in the audit trail of what an action is asked with; of a long text its hash.

    The number of a badge that was scanned in the place of a unit does not stand there.
    """
    told: Plain = given.model_dump(include=set(row.audited))
    told |= {"at": call.session.place} if call.session.place else {}
    if is_badge(call.station.settings, str(told.get("scanned", ""))):
        told["scanned"] = A_BADGE
    text = getattr(given, "text", None)
    return told if text is None else told | {"text_sha256": hashlib.sha256(text.encode()).hexdigest()}


def _performed(call: Call, row: Action, csrf: str | None, key: str | None, values: JsonValue) -> Answer:
    connection, session = call.connection, call.session
    if not brings_token(session, csrf):
        return _refused(call, row, NOT_ALLOWED, [("csrf", "The page is out of date. Reload it.")])
    if not _is_text(values):
        return _refused(call, row, BAD_INPUT, [("body", "It has characters that are no Unicode text.")])
    if not key or len(key) > LONGEST_KEY or not key.isascii() or not key.isprintable():
        words = f"The request needs the header Idempotency-Key: 1 to {LONGEST_KEY} printable ASCII characters."
        return Answer(BAD_INPUT, refusal("idempotency_key", words))
    asked = _asked(session.person.name, row, key, values)
    if (before := _answered(connection, row, key, session.person.name, asked)) is not None:
        return before
    answer = _done(call, row, values)
    now_s = WALL_CLOCK.now().timestamp()
    connection.execute(delete(ANSWERS).where(ANSWERS.c.at_s < now_s - KEPT_S))
    keep = {"key": key, "name": session.person.name, "asked_hmac": asked, "at_s": now_s}
    connection.execute(insert(ANSWERS).values(**keep, status=answer.status, answer=answer.said.model_dump_json()))
    return answer


def _asked(name: str, row: Action, key: str, values: JsonValue) -> str:
    """Return by what a request is known again, from any session of its account; a secret in it is slow to guess."""
    text = json.dumps([name, row.id, values], sort_keys=True)
    asked = hashlib.sha256(text.encode()).hexdigest()
    if not row.is_secret:
        return asked
    return digest_with(hashlib.sha256(json.dumps([name, key]).encode()).digest(), asked)


def _is_text(values: JsonValue) -> bool:
    """Say whether all of it can be written down: JSON may name half of a character."""
    try:
        json.dumps(values, ensure_ascii=False).encode()
    except UnicodeEncodeError:
        return False
    return True


def _answered(connection: Connection, row: Action, key: str, name: str, asked: str) -> Answer | None:
    kept = connection.execute(select(ANSWERS).where(ANSWERS.c.key == key)).first()
    if kept is None:
        return None
    if kept.name != name or kept.asked_hmac != asked:
        return Answer(
            NOT_NOW,
            refusal("key_used", "This Idempotency-Key was used for another request. Send a new key."),
        )
    said_before: type[Outcome | Refused] = row.gives if kept.status == OK else Refused
    return Answer(kept.status, said_before.model_validate_json(kept.answer))


def _done(call: Call, row: Action, values: JsonValue) -> Answer:
    connection, person = call.connection, call.person
    if person.role not in row.roles:
        words = f"{person.role} may not do this ({row.text}); allowed: {', '.join(sorted(row.roles))}."
        return _refused(call, row, NOT_ALLOWED, [("role", words)])
    if person.must_change and not row.with_first_password:
        words = "Change the first password, then log in again."
        return _refused(call, row, NOT_ALLOWED, [("must_change", words)])
    given = None
    try:
        given = row.needs.model_validate({} if values is None else values)
        before = _seen(row, call, given)
        with connection.begin_nested():
            found = row.does(call, given)
    except (ValidationError, StationError) as error:
        if isinstance(error, EntryRefusedError):
            count_wrong(connection, person.name)
        return _refused(call, row, *_why(error), given)
    told = _told(call, row, given) | found.model_dump(include=set(row.tells))
    told |= {"before": before, "after": _seen(row, call, given)}
    audit.write(connection, person.name, row.id, audit.DONE, told)
    return Answer(OK, found.model_copy(update={"done": row.id}))


def _seen(row: Action, call: Call, given: Values) -> Plain:
    """Return what an action changes as it is now; a look that fails neither refuses what is asked nor undoes it."""
    try:
        return row.sees(call, given)
    except StationError as error:
        return {"not_seen": str(error)}


_REFUSALS: tuple[tuple[type[StationError], int, str], ...] = (
    (EntryRefusedError, NOT_ALLOWED, "password"),
    (AccountError, BAD_INPUT, "input"),
    (ScanError, BAD_INPUT, "scan"),
    (BypassError, BAD_INPUT, "input"),
    (BadRecipeError, BAD_INPUT, "recipe"),
    (RevisionError, NOT_NOW, "recipe"),
    (StudyError, NOT_NOW, "study"),
)
"""Status and id of a refusal, by what was raised; of anything else the station cannot do it now."""


def _why(error: ValidationError | StationError) -> tuple[int, list[tuple[str, str]]]:
    """Return the status of a refusal, and id and words of each reason."""
    if isinstance(error, ValidationError):
        return BAD_INPUT, [(".".join(map(str, one["loc"])) or "body", one["msg"]) for one in error.errors()]
    if isinstance(error, NotNowError):
        return NOT_NOW, error.reasons
    found = ((one, name) for kind, one, name in _REFUSALS if isinstance(error, kind))
    status, name = next(found, (NOT_NOW, "station"))
    return status, [(name, str(error))]


def _refused(
    call: Call, row: Action, status: int, reasons: list[tuple[str, str]], given: Values | None = None
) -> Answer:
    told = {} if given is None else _told(call, row, given)
    told |= {"reasons": [name for name, _ in reasons]}
    audit.write(call.connection, call.person.name, row.id, audit.REFUSED, told)
    return Answer(status, Refused.because(reasons))
