"""The table of actions: everything that changes anything, with who may do it, what it needs, and what it does.

A page and a REST request do the same: they perform a row. Each that is done, and each that is refused, is a line of the
audit trail, in the same transaction as what it did.
"""

from __future__ import annotations

import hashlib
import hmac
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import Any, NamedTuple

from pydantic import JsonValue, ValidationError
from sqlalchemy import Connection, delete, insert, select

from recipes import RecipeError
from station.errors import StationError
from station.records.data_folder import Store
from station.records.recipe_revisions import History, Revision, RevisionError, ask_release, release, save_draft
from station.wall_clock import WALL_CLOCK, now_text
from station.web.action_values import (
    AccountAdded,
    AccountChanged,
    Announced,
    BypassAdded,
    BypassEnded,
    ChosenLanguage,
    Confirm,
    DryRunStarted,
    EndedBypass,
    FreshPassword,
    Named,
    NewBadge,
    NewBypass,
    NewPassword,
    NewPerson,
    NewPin,
    Nothing,
    Outcome,
    Permission,
    Reason,
    RecipeChanged,
    RecipeRevision,
    RecipeText,
    RecipeTried,
    Recovery,
    RecoveryBegun,
    RecoveryTold,
    Refused,
    RunConfirmed,
    RunStarted,
    Scanned,
    Start,
    UnitAnnounced,
    Values,
    refusal,
)
from station.web.bench.watch import BenchWatch
from station.web.bypasses import BypassError, add_bypass, bypasses_now, end_bypass
from station.web.evaluations import Evaluations
from station.web.mes.previous_step import announce, heard, previous_step
from station.web.mes.settings import MesSettings
from station.web.models import Models
from station.web.people import audit
from station.web.people.accounts import (
    MES,
    ROLES,
    AccountError,
    EntryRefusedError,
    Person,
    Session,
    add_person,
    brings_token,
    change_password,
    choose_language,
    count_wrong,
    disable_person,
    leave,
    reset_person,
    session_of,
)
from station.web.people.badges import assign_badge, change_pin, withdraw_badge
from station.web.people.database import ANSWERS, CONFIRMED, StationDatabase
from station.web.permission import Situation, Wanted, may_be_bad, refusals, situation_of, unconfirmed, unverified_note
from station.web.recipe_text.check import BadRecipeError, bench_of, encoded, refuse_unfit
from station.web.recipe_text.dry_run import DryRuns
from station.web.running import Running
from station.web.scanner import ScanError, serial_of
from station.web.scanner_test import is_tested, keep_test, misread
from station.web.settings import Settings

EVERYBODY = frozenset(ROLES)
AT_THE_BENCH = frozenset({"operator", "technician", "engineer", "admin"})
IN_CHARGE = frozenset({"technician", "engineer", "admin"})
ADMIN = frozenset({"admin"})
MAY_RELEASE = frozenset({"quality", "engineer", "admin"})

MAY_START = AT_THE_BENCH | {MES}

OK, BAD_INPUT, NOT_ENTERED, NOT_ALLOWED, NOT_NOW, NOT_READY = 200, 422, 401, 403, 409, 503
LONGEST_KEY = 64
KEPT_S = 24 * 3600.0
"""How long an answer is kept for whoever asks the same again."""


class Answer(NamedTuple):
    """What became of an action: an HTTP status, and what it answers or why it was refused."""

    status: int
    said: Outcome | Refused

    @property
    def refused(self) -> tuple[Reason, ...]:
        """Every reason of a refusal; none when it was done."""
        return self.said.refused if isinstance(self.said, Refused) else ()


class NotNowError(StationError):
    """The action is allowed, and cannot be done now; `reasons`: id and words of each."""

    def __init__(self, reasons: list[tuple[str, str]]) -> None:
        super().__init__(" ".join(words for _, words in reasons))
        self.reasons = reasons


@dataclass(frozen=True)
class Station:
    """What actions work on."""

    data: Path
    database: StationDatabase
    models: Models
    running: Running
    run_options: tuple[str, ...] = ()
    """Further options of `lostmotion run`, as the server was started with them."""
    mes: MesSettings | None = None
    """The MES of the plant; None: none is asked or told."""
    settings: Settings = field(default_factory=Settings)
    dry_runs: DryRuns = field(default_factory=DryRuns)
    evaluations: Evaluations = field(default_factory=Evaluations)
    """The process that makes reports and loops of stored runs."""
    bench: BenchWatch = field(init=False)
    """What the bench shows, and the way back from a fault."""

    def __post_init__(self) -> None:
        """Look at the bench of the same data folder."""
        object.__setattr__(self, "bench", BenchWatch(self.data, self.running, self.evaluations))

    def close(self) -> None:
        """Close what is open of it; a run that is on goes on."""
        self.running.close()
        self.dry_runs.close()
        self.evaluations.close()
        self.database.close()


@dataclass(frozen=True)
class Call:
    """One action being done: by whom, in which transaction and session."""

    station: Station
    connection: Connection
    session: Session

    @property
    def person(self) -> Person:
        """Who does it."""
        return self.session.person


class Action(NamedTuple):
    """One row: id, roles, what it needs, what it does, what that answers, and what stands in the audit trail.

    audited: which of its values. tells: what of its answer.
    """

    id: str
    text: str
    roles: frozenset[str]
    needs: type[Values]
    does: Callable[[Call, Any], Outcome]
    gives: type[Outcome]
    audited: tuple[str, ...] = ()
    with_first_password: bool = False
    tells: tuple[str, ...] = ()


def _start_run(call: Call, given: Start) -> RunStarted:
    station = call.station
    now = _situation(call, given)
    serial = now.wanted.serial
    bypasses = bypasses_now(call.connection)
    if why := refusals(now, {one.condition for one in bypasses}):
        raise NotNowError(why)
    model = now.model
    assert model is not None  # noqa: S101 - a condition of the start
    options = [*now.run_options(), "--operator", call.person.name, "--no-report", *station.run_options]
    used = {name for name, _ in refusals(now)}
    for note in (str(one) for one in bypasses if one.condition in used):
        options += ["--note", note]
    if "previous_step_passed" not in used and (unverified := unverified_note(now)) is not None:
        options += ["--note", unverified]
    options += ["--retest-reason", given.retest_reason] if given.retest_reason.strip() else []
    station.running.start(options, serial, now.likely)
    return RunStarted(serial=serial, model=model.model, recipe=model.recipe)


def _situation(call: Call, given: Start) -> Situation:
    station, serial = call.station, serial_of(given.scanned)
    step = None if station.mes is None else previous_step(call.connection, station.mes, serial)
    return situation_of(
        station.data, station.models, Wanted(serial, given.retest_reason), busy=station.running.busy(),
        confirmed=_confirmed(call.connection), previous_step=step,
        scanner_tested=is_tested(call.connection, station.settings.scanner_test),
    )  # fmt: skip


def _ask_permission(call: Call, given: Start) -> Permission:
    _note_mes(call)
    now = _situation(call, given)
    why = refusals(now, {one.condition for one in bypasses_now(call.connection)})
    return Permission(serial=now.wanted.serial, allowed=not why, reasons=Refused.because(why).refused)


def _announce_unit(call: Call, given: Announced) -> UnitAnnounced:
    _note_mes(call)
    serial = serial_of(given.serial)
    announce(call.connection, serial, given.previous_step, call.person.name)
    return UnitAnnounced(serial=serial, previous_step=given.previous_step)


def _note_mes(call: Call) -> None:
    if call.person.role == MES:
        heard(call.connection)


def _confirmed(connection: Connection) -> frozenset[str]:
    return frozenset(connection.execute(select(CONFIRMED.c.run)).scalars())


def unconfirmed_run(station: Station) -> str:
    """Return the run whose bad unit has to be put away before another is measured, '' where there is none."""
    with station.database.reading() as connection:
        return unconfirmed(station.data, _confirmed(connection))


def _stop_run(call: Call, _given: Nothing) -> Outcome:
    if not call.station.running.stop():
        raise NotNowError([("no_run", "No run is in progress.")])
    return Outcome()


def _confirm(call: Call, given: Confirm) -> RunConfirmed:
    run = Store(call.station.data).by_id(given.run)
    if run is None or not may_be_bad(run):
        raise NotNowError([("run", f"There is no run {given.run[:80]!r} of a bad unit.")])
    there = select(CONFIRMED.c.run).where(CONFIRMED.c.run == given.run)
    if call.connection.execute(there).first() is None:
        call.connection.execute(insert(CONFIRMED).values(run=given.run, name=call.person.name, at=now_text()))
    return RunConfirmed(run=given.run)


def _begin_recovery(call: Call, _given: Nothing) -> RecoveryBegun:
    way_back, standing = call.station.bench.way_back, call.station.bench.standing()
    if standing.recovery or way_back.starting():
        raise NotNowError([("recovery_on", "The way back is under way already.")])
    if standing.fault is None or standing.released:
        why = standing.why_none or "The bench was recovered: the lock is open, and the unit can be taken out."
        raise NotNowError([("no_fault", why)])
    way_back.start(call.person.name)
    return RecoveryBegun(run=standing.fault.run, cause=standing.fault.cause)


def _acknowledge_fault(call: Call, given: Recovery) -> RecoveryTold:
    seen = call.station.bench.look()
    if seen.sight is None or not (seen.live and seen.recovery and seen.sight.settled):
        raise NotNowError([("not_asked", "Nothing waits to be acknowledged now. See the steps.")])
    return _tell_recovery(call, given, go_on=True)


def _leave_recovery(call: Call, given: Recovery) -> RecoveryTold:
    return _tell_recovery(call, given, go_on=False)


def _tell_recovery(call: Call, given: Recovery, *, go_on: bool) -> RecoveryTold:
    if not call.station.bench.way_back.tell(given.recovery, go_on=go_on):
        raise NotNowError([("no_recovery", f"No recovery {given.recovery[:80]!r} is on.")])
    return RecoveryTold(recovery=given.recovery)


def _add_bypass(call: Call, given: NewBypass) -> BypassAdded:
    found = add_bypass(call.connection, given.condition, call.person.name, given.reason, given.hours)
    return BypassAdded(condition=found.condition, text=str(found))


def _end_bypass(call: Call, given: EndedBypass) -> BypassEnded:
    if not end_bypass(call.connection, given.condition):
        raise NotNowError([("no_bypass", f"The condition {given.condition!r} is not bypassed.")])
    return BypassEnded(condition=given.condition)


def _save_recipe(call: Call, given: RecipeText) -> RecipeChanged:
    try:
        found = save_draft(call.station.data, encoded(given.text), call.person.name, given.replaces)
    except RecipeError as error:
        raise BadRecipeError(str(error.problems[0])) from error
    return _changed(found)


def _ask_release(call: Call, given: RecipeRevision) -> RecipeChanged:
    _refuse_unfit(call.station, given)
    return _changed(ask_release(call.station.data, given.name, given.revision, given.sha256, call.person.name))


def _release_recipe(call: Call, given: RecipeRevision) -> RecipeChanged:
    _refuse_unfit(call.station, given)
    return _changed(release(call.station.data, given.name, given.revision, given.sha256, call.person.name))


def _try_recipe(call: Call, given: RecipeTried) -> DryRunStarted:
    content = encoded(given.text)
    header = refuse_unfit(content, call.station.models).recipe.recipe
    title = f"{header.name} revision {header.revision}"
    begun = call.station.dry_runs.start(content, title, bench_of(call.station.models, header.name))
    return DryRunStarted(name=header.name, revision=header.revision, sha256=begun.sha256)


def _refuse_unfit(station: Station, given: RecipeRevision) -> None:
    """Refuse a text that cannot be run; one that is not there is refused by whoever looks for it."""
    there = History(station.data).find(given.name, given.revision)
    if there is not None and there.sha256 == given.sha256:
        refuse_unfit(there.text(), station.models)


def _changed(found: Revision) -> RecipeChanged:
    return RecipeChanged(name=found.name, revision=found.revision, sha256=found.sha256, state=found.state.value)


def _add_person(call: Call, given: NewPerson) -> AccountAdded:
    add_person(call.connection, given.name, given.role, given.password)
    return AccountAdded(name=given.name, role=given.role)


def _disable_person(call: Call, given: Named) -> AccountChanged:
    if given.name == call.person.name:
        raise AccountError("name: nobody can close the account that they are using")
    disable_person(call.connection, given.name)
    return AccountChanged(name=given.name)


def _reset_person(call: Call, given: FreshPassword) -> AccountChanged:
    if given.name == call.person.name:
        raise AccountError("name: use change_password for your own password")
    reset_person(call.connection, given.name, given.password)
    return AccountChanged(name=given.name)


def _change_password(call: Call, given: NewPassword) -> Outcome:
    change_password(call.connection, call.person.name, given.old_password, given.new_password)
    return Outcome()


def _assign_badge(call: Call, given: NewBadge) -> AccountChanged:
    assign_badge(call.connection, given.name, given.badge, given.pin)
    return AccountChanged(name=given.name)


def _withdraw_badge(call: Call, given: Named) -> AccountChanged:
    withdraw_badge(call.connection, given.name)
    return AccountChanged(name=given.name)


def _change_pin(call: Call, given: NewPin) -> Outcome:
    change_pin(call.connection, call.person.name, given.password, given.pin)
    return Outcome()


def _test_scanner(call: Call, given: Scanned) -> Outcome:
    test = call.station.settings.scanner_test
    if test is None:
        raise NotNowError([("scanner_test", "This station has no test code. It is set in station.yaml.")])
    if (why := misread(test.code, given.scanned)) is not None:
        raise NotNowError([("scanner_test", why)])
    keep_test(call.connection, call.person.name)
    return Outcome()


def _choose_language(call: Call, given: ChosenLanguage) -> Outcome:
    choose_language(call.connection, call.person.name, given.language)
    return Outcome()


def _leave(call: Call, _given: Nothing) -> Outcome:
    leave(call.connection, call.session.token)
    return Outcome()


ACTIONS: dict[str, Action] = {
    row.id: row
    for row in (
        Action("start_run", "measure the scanned unit", MAY_START, Start, _start_run, RunStarted,
               ("scanned", "retest_reason")),
        Action("ask_permission", "say whether a unit may be measured now, and why not", MAY_START, Start,
               _ask_permission, Permission, ("scanned",)),
        Action("announce_unit", "say whether a unit passed its previous process step", frozenset({MES}), Announced,
               _announce_unit, UnitAnnounced, ("serial", "previous_step")),
        Action("stop_run", "bring the torque to zero and stop the run", EVERYBODY, Nothing, _stop_run, Outcome),
        Action("confirm_nok", "confirm that a bad unit is in the NOK box", AT_THE_BENCH, Confirm, _confirm,
               RunConfirmed, ("run",)),
        Action("begin_recovery", "begin the way back after a fault: read the devices, enable nothing", IN_CHARGE,
               Nothing, _begin_recovery, RecoveryBegun, tells=("run", "cause")),
        Action("acknowledge_fault", "acknowledge the fault: bring the torque to zero and open the lock", IN_CHARGE,
               Recovery, _acknowledge_fault, RecoveryTold, ("recovery",)),
        Action("leave_recovery", "end the way back and leave the bench as it is", IN_CHARGE, Recovery,
               _leave_recovery, RecoveryTold, ("recovery",)),
        Action("add_bypass", "set a start condition aside for some hours", IN_CHARGE, NewBypass, _add_bypass,
               BypassAdded, ("condition", "reason", "hours")),
        Action("end_bypass", "let a start condition count again", IN_CHARGE, EndedBypass, _end_bypass,
               BypassEnded, ("condition",)),
        Action("save_recipe", "save a recipe as the draft of a revision", IN_CHARGE, RecipeText, _save_recipe,
               RecipeChanged, tells=("name", "revision", "sha256")),
        Action("try_recipe", "run a recipe in virtual time with a unit of the catalogue values",
               IN_CHARGE | MAY_RELEASE, RecipeTried, _try_recipe, DryRunStarted, tells=("name", "revision", "sha256")),
        Action("ask_release", "ask that the draft of a recipe be released", IN_CHARGE, RecipeRevision,
               _ask_release, RecipeChanged, ("name", "revision", "sha256")),
        Action("release_recipe", "release a recipe that another person has written", MAY_RELEASE, RecipeRevision,
               _release_recipe, RecipeChanged, ("name", "revision", "sha256")),
        Action("add_person", "add an account", ADMIN, NewPerson, _add_person, AccountAdded, ("name", "role")),
        Action("disable_person", "close an account", ADMIN, Named, _disable_person, AccountChanged, ("name",)),
        Action("reset_person", "open an account again with a first password", ADMIN, FreshPassword,
               _reset_person, AccountChanged, ("name",)),
        Action("assign_badge", "give a person a badge with a PIN", ADMIN, NewBadge, _assign_badge, AccountChanged,
               ("name",)),
        Action("withdraw_badge", "take a person's badge away", ADMIN, Named, _withdraw_badge, AccountChanged,
               ("name",)),
        Action("change_pin", "change the PIN of your own badge", EVERYBODY, NewPin, _change_pin, Outcome),
        Action("test_scanner", "show by the test code that the scanner is read as it was printed", AT_THE_BENCH,
               Scanned, _test_scanner, Outcome),
        Action("change_password", "change your own password", EVERYBODY, NewPassword, _change_password, Outcome,
               with_first_password=True),
        Action("choose_language", "choose the language of your pages", EVERYBODY, ChosenLanguage, _choose_language,
               Outcome, ("language",)),
        Action("leave", "end the session", EVERYBODY, Nothing, _leave, Outcome, with_first_password=True),
    )
}  # fmt: skip
"""Every change of state that anybody can bring about, by its id."""

_ONE_AT_A_TIME = Lock()


def perform(  # noqa: PLR0917 - one request, as it came
    station: Station, action_id: str, token: str | None, csrf: str | None, key: str | None, values: JsonValue
) -> Answer:
    """Do an action, or refuse it and say why; a key that was answered before is given the same answer."""
    try:
        with _ONE_AT_A_TIME, station.database.writing() as connection:
            session = session_of(connection, token)
            if session is None:
                return Answer(NOT_ENTERED, refusal("not_entered", "Log in first."))
            return _performed(station, connection, session, ACTIONS[action_id], csrf, key, values)
    except StationError as error:  # its own database cannot be written: nothing was done
        return Answer(NOT_READY, refusal("station", str(error)))


def _performed(  # noqa: PLR0917 - as above
    station: Station,
    connection: Connection,
    session: Session,
    row: Action,
    csrf: str | None,
    key: str | None,
    values: JsonValue,
) -> Answer:
    if not brings_token(session, csrf):
        return _refused(connection, session, row, NOT_ALLOWED, [("csrf", "The page is out of date. Reload it.")])
    if not _is_text(values):
        return _refused(connection, session, row, BAD_INPUT, [("body", "It has characters that are no Unicode text.")])
    if not key or len(key) > LONGEST_KEY or not key.isascii() or not key.isprintable():
        words = f"The request needs the header Idempotency-Key: 1 to {LONGEST_KEY} printable ASCII characters."
        return Answer(BAD_INPUT, refusal("idempotency_key", words))
    asked = _asked(session, row, values)
    if (before := _answered(connection, row, key, session.person.name, asked)) is not None:
        return before
    answer = _done(Call(station, connection, session), row, values)
    now_s = WALL_CLOCK.now().timestamp()
    connection.execute(delete(ANSWERS).where(ANSWERS.c.at_s < now_s - KEPT_S))
    keep = {"key": key, "name": session.person.name, "asked_hmac": asked, "at_s": now_s}
    connection.execute(insert(ANSWERS).values(**keep, status=answer.status, answer=answer.said.model_dump_json()))
    return answer


def _asked(session: Session, row: Action, values: JsonValue) -> str:
    text = json.dumps([row.id, values], sort_keys=True)
    return hmac.new(session.token.encode(), text.encode(), hashlib.sha256).hexdigest()


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
            refusal("key_used", "This Idempotency-Key was used for another request. Take a new one."),
        )
    said_before: type[Outcome | Refused] = row.gives if kept.status == OK else Refused
    return Answer(kept.status, said_before.model_validate_json(kept.answer))


def _done(call: Call, row: Action, values: JsonValue) -> Answer:
    connection, session, person = call.connection, call.session, call.person
    if person.role not in row.roles:
        words = f"{person.role} may not do this ({row.text}); allowed: {', '.join(sorted(row.roles))}."
        return _refused(connection, session, row, NOT_ALLOWED, [("role", words)])
    if person.must_change and not row.with_first_password:
        words = "Change the first password, then log in again."
        return _refused(connection, session, row, NOT_ALLOWED, [("must_change", words)])
    given = None
    try:
        given = row.needs.model_validate({} if values is None else values)
        with connection.begin_nested():
            found = row.does(call, given)
    except (ValidationError, StationError) as error:
        if isinstance(error, EntryRefusedError):
            count_wrong(connection, person.name)
        return _refused(connection, session, row, *_why(error), given)
    told = given.model_dump(include=set(row.audited)) | found.model_dump(include=set(row.tells))
    audit.write(connection, person.name, row.id, audit.DONE, told)
    return Answer(OK, found.model_copy(update={"done": row.id}))


_REFUSALS: tuple[tuple[type[StationError], int, str], ...] = (
    (EntryRefusedError, NOT_ALLOWED, "password"),
    (AccountError, BAD_INPUT, "input"),
    (ScanError, BAD_INPUT, "scan"),
    (BypassError, BAD_INPUT, "input"),
    (BadRecipeError, BAD_INPUT, "recipe"),
    (RevisionError, NOT_NOW, "recipe"),
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


def _refused(  # noqa: PLR0917 - one line of the trail
    connection: Connection, session: Session, row: Action, status: int, reasons: list[tuple[str, str]],
    given: Values | None = None,
) -> Answer:  # fmt: skip
    told = {} if given is None else given.model_dump(include=set(row.audited))
    audit.write(
        connection, session.person.name, row.id, audit.REFUSED, {**told, "reasons": [name for name, _ in reasons]}
    )
    return Answer(status, Refused.because(reasons))
