"""Actions about a run: may a unit be measured, measure it, stop, confirm that a bad one was put away."""

from __future__ import annotations

from typing import NamedTuple

from sqlalchemy import Connection, insert, select

from station.wall_clock import now_text
from station.web.actions.labels import awaited_label
from station.web.actions.row import Call, NotNowError
from station.web.actions.values import (
    Announced,
    Confirm,
    Nothing,
    Outcome,
    Permission,
    Refused,
    RunConfirmed,
    RunStarted,
    Scanned,
    Start,
    UnitAnnounced,
)
from station.web.bad_units import may_be_bad, unconfirmed
from station.web.bypasses import bypasses_now
from station.web.mes.previous_step import announce, heard, previous_step
from station.web.people.accounts import MES
from station.web.people.badges import refuse_badge
from station.web.people.database import CONFIRMED
from station.web.permission import CLOCK, Situation, Wanted, refusals, situation_of, unverified_note
from station.web.running import STARTING
from station.web.scanner import serial_of
from station.web.scanner_test import is_tested, keep_test, misread
from station.web.station import Station


def start_run(call: Call, given: Start) -> RunStarted:
    """Start the run of the scanned unit; NotNowError: a start condition is not met."""
    station = call.station
    now = _situation(call, given)
    serial = now.wanted.serial
    bypasses = bypasses_now(call.connection)
    if why := refusals(now, {one.condition for one in bypasses}):
        raise NotNowError(why)
    model = now.model
    assert model is not None  # noqa: S101 - a condition of the start
    options = [*now.run_options(), *station.run_options]
    options += ["--operator", call.operator] if call.operator else []
    used = {name for name, _ in refusals(now)}
    for note in (str(one) for one in bypasses if one.condition in used):
        options += ["--note", note]
    if "previous_step_passed" not in used and (unverified := unverified_note(now)) is not None:
        options += ["--note", unverified]
    for one in bypasses:
        if one.condition == CLOCK and CLOCK in used:  # what is later in the chain is set aside for good
            options += [f"--clock-is-right={one.reason}"]
    options += ["--study", given.study] if given.study else []
    options += ["--retest-reason", given.retest_reason] if given.retest_reason.strip() else []
    station.running.start(options, serial, now.likely)
    return RunStarted(serial=serial, model=model.model, recipe=model.recipe)


def _situation(call: Call, given: Start) -> Situation:
    station = call.station
    refuse_badge(station.settings, given.scanned)
    serial = serial_of(given.scanned)
    step = None if station.mes is None else previous_step(call.connection, station.mes, serial)
    wanted = Wanted(serial, given.retest_reason, given.study, call.operator or "")
    return situation_of(
        station.data, station.read_models(), wanted, busy=station.running.busy(),
        confirmed=_confirmed(call.connection), previous_step=step,
        scanner_tested=is_tested(call.connection, station.settings.scanner_test), label=awaited_label(call),
    )  # fmt: skip


def ask_permission(call: Call, given: Start) -> Permission:
    """Say whether a unit may be measured now, and every reason against it."""
    _note_mes(call)
    now = _situation(call, given)
    why = refusals(now, {one.condition for one in bypasses_now(call.connection)})
    return Permission(serial=now.wanted.serial, allowed=not why, reasons=Refused.because(why).refused)


def announce_unit(call: Call, given: Announced) -> UnitAnnounced:
    """Keep what became of a unit in its previous process step."""
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


class BadUnit(NamedTuple):
    """A run whose unit may be bad; by and at: who has put it into its box, and when: '' while nobody has."""

    run: str
    by: str = ""
    at: str = ""


def bad_unit(station: Station, run: str) -> BadUnit | None:
    """Return whether the bad unit of a run that has ended is put away; None where its unit is not bad."""
    if not may_be_bad(station.data, run):
        return None
    with station.database.reading() as connection:
        found = connection.execute(select(CONFIRMED.c.name, CONFIRMED.c.at).where(CONFIRMED.c.run == run)).first()
    return BadUnit(run) if found is None else BadUnit(run, *found)


def stop_run(call: Call, _given: Nothing) -> Outcome:
    """Stop the run that is on, once; NotNowError: none is, or it only starts."""
    if call.station.running.stop():
        return Outcome()
    if call.station.running.now().stage == STARTING:
        raise NotNowError([("no_run", "The run is starting and nothing moves yet. Stop it again in a moment.")])
    raise NotNowError([("no_run", "No run is in progress.")])


def confirm(call: Call, given: Confirm) -> RunConfirmed:
    """Keep that a bad unit was put away; NotNowError: there is no such run."""
    if not may_be_bad(call.station.data, given.run):
        raise NotNowError([("run", f"There is no run {given.run[:80]!r} of a bad unit.")])
    there = select(CONFIRMED.c.run).where(CONFIRMED.c.run == given.run)
    if call.connection.execute(there).first() is None:
        call.connection.execute(insert(CONFIRMED).values(run=given.run, name=call.person.name, at=now_text()))
    return RunConfirmed(run=given.run)


def test_scanner(call: Call, given: Scanned) -> Outcome:
    """Keep that the scanner is read as the test code was printed; NotNowError: it is not."""
    test = call.station.settings.scanner_test
    if test is None:
        raise NotNowError([("scanner_test", "This station has no test code. It is set in station.yaml.")])
    if (why := misread(test.code, given.scanned)) is not None:
        raise NotNowError([("scanner_test", why)])
    keep_test(call.connection, call.person.name)
    return Outcome()
