"""Runs of units that were measured more than once: few, and all that yields of units as they left differ by.

Whether a unit was measured again a later run says; so what is noted with every run of a serial number is noted anew
when one of them comes, changes or goes.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

from sqlalchemy import Connection, exists, select, update

from station.store.plant.hours import FIRST_ATTEMPT, MOST_AT_ONCE
from station.store.tables import RUNS


def serials_of(connection: Connection, chain: str, runs: Sequence[str]) -> set[str]:
    """Return the serial numbers of stored runs."""
    found: set[str] = set()
    for begin in range(0, len(runs), MOST_AT_ONCE):
        named = RUNS.c.run.in_(runs[begin : begin + MOST_AT_ONCE])
        found.update(connection.execute(select(RUNS.c.serial).where(RUNS.c.chain == chain, named)).scalars())
    return found


def note_retests(connection: Connection, chain: str, serials: Collection[str]) -> None:
    """Note anew with the runs of serial numbers whether there is a retest among them."""
    there, other = sorted(serials), RUNS.alias("other")
    again = exists().where(other.c.chain == RUNS.c.chain, other.c.serial == RUNS.c.serial)
    again = again.where(other.c.attempt > FIRST_ATTEMPT)
    for begin in range(0, len(there), MOST_AT_ONCE):
        named = RUNS.c.serial.in_(there[begin : begin + MOST_AT_ONCE])
        # Only where it changes: a row that is written is a row anew, with all its indexes.
        for value, condition in ((True, again), (False, ~again)):
            changes = update(RUNS).where(RUNS.c.chain == chain, named, RUNS.c.again.is_not(value), condition)
            connection.execute(changes.values(again=value))
