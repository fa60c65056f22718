"""Units of a lot that were measured again: each later attempt with its verdict, and what became of those before."""

from __future__ import annotations

from typing import NamedTuple

from sqlalchemy import select

from station.records.chain.walk import trust_of
from station.store.attempts import attempts_told
from station.store.quality.lot import Lot, Production
from station.store.stored_runs import COLUMNS, StoredRun
from station.store.tables import RUNS


class Retest(NamedTuple):
    """A run of a unit that was measured before; attempts: which one it is and what became of the others, in words."""

    run: StoredRun
    attempts: str


def retests_of(look: Production, lot: Lot) -> tuple[Retest, ...]:
    """Return the later attempts of a lot, oldest first."""
    asked = look.of(select(*COLUMNS), lot, first=False).where(~RUNS.c.first).order_by(RUNS.c.run)
    rows = [StoredRun._make(row) for row in look.connection.execute(asked).all()]
    told = attempts_told(look.connection, look.chain, trust_of(look.chain), rows)
    return tuple(Retest(row, told[row.run]) for row in rows)
