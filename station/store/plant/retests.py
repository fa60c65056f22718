"""Runs of units that were measured more than once: few, and all that yields of units as they left differ by.

Whether a unit was measured again a later run says; so what is noted with every run of a serial number is noted anew
when one of them comes, changes or goes.

Attempts keep the numbers of the chain, and one that was simulated, or had faults injected, has a number too. The first
attempt of a kind, at the real unit or on the virtual bench, is the one before which there was nothing but such ones. A
number whose run is not there, or was altered, counts as an attempt of that kind: a lost FAIL makes no unit new.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from itertools import groupby
from typing import Any

from sqlalchemy import Connection, Row, select, update

from station.store.plant.hours import FIRST_ATTEMPT, MOST_AT_ONCE
from station.store.tables import RUNS


def note_attempts(connection: Connection, chain: str, serials: Collection[str]) -> set[str]:
    """Note anew with the runs of serial numbers whether there is a retest among them, and which is the first attempt.

    Returns the hours of the runs of which it is another one that is the first.
    """
    there = sorted(serials)
    hours: set[str] = set()
    names = ("run", "serial", "attempt", "virtual", "scenario", "altered", "again", "first", "hour")
    for begin in range(0, len(there), MOST_AT_ONCE):
        asked = select(*(RUNS.c[name] for name in names)).where(RUNS.c.chain == chain)
        asked = asked.where(RUNS.c.serial.in_(there[begin : begin + MOST_AT_ONCE]))
        rows = connection.execute(asked.order_by(RUNS.c.serial, RUNS.c.attempt)).all()
        units = [list(unit) for _, unit in groupby(rows, lambda row: row.serial)]
        again = {row.run for unit in units if unit[-1].attempt > FIRST_ATTEMPT for row in unit}
        firsts = {run for unit in units for run in _first_of(unit)}
        hours.update(row.hour for row in rows if (row.run in firsts) != row.first)
        # Only where it changes: a row that is written is a row anew, with all its indexes.
        for name, noted in (("again", again), ("first", firsts)):
            for value in (True, False):
                runs = [row.run for row in rows if (row.run in noted) is value and getattr(row, name) is not value]
                for place in range(0, len(runs), MOST_AT_ONCE):
                    some = RUNS.c.run.in_(runs[place : place + MOST_AT_ONCE])
                    connection.execute(update(RUNS).where(RUNS.c.chain == chain, some).values({name: value}))
    return hours


def _first_of(unit: Iterable[Row[Any]]) -> list[str]:
    """Return the first attempts among the runs of a serial number, which stand in the order of their attempts."""
    due = {False: FIRST_ATTEMPT, True: FIRST_ATTEMPT}  # the number of a first attempt, by whether it is virtual
    found = []
    for attempt, group in groupby(unit, lambda row: row.attempt):
        rows = list(group)
        found += [row.run for row in rows if row.attempt == due[row.virtual]]
        for virtual, number in due.items():
            if attempt == number and all(_is_aside(row, virtual=virtual) for row in rows):
                due[virtual] = number + 1
    return found


def _is_aside(row: Row[Any], *, virtual: bool) -> bool:
    """Whether a run is no attempt of a kind, and its record says so as it was left."""
    return not row.altered and (row.scenario is not None or row.virtual != virtual)
