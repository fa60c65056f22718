"""Which runs a statistic of the production is of.

Never mixed are what would make a figure that is neither: products with master parts, real units with those of the
virtual bench, whole runs with runs of injected faults, first attempts with retests. A run counts as far as it is
believed: unaltered when its files were last compared, and signed by a known key. Unlike a look at the whole folder
nothing is compared anew here, so that the answer does not wait for 200 000 folders; `lostmotion verify` does that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Connection, Select, Subquery, Table, and_, func, not_, or_, select, true

from station.errors import StationError
from station.records.chain.chain_file import Chain
from station.records.chain.walk import trust_of
from station.store.outbox import catch_up, hold_up
from station.store.plant.hours import COMPLETE, between_hours, whole_hours
from station.store.stored_runs import NO_LIMIT, is_trusted, total_of, trusted
from station.store.tables import RUN_HOURS, RUNS
from station.store.view import opened

SAID_OF_A_VALUE = ("serial", "started", "bench", "operator", "recipe", "revision", "model")
"""What is known of a value by the run it comes from."""

NEWEST = 2000
"""First attempts that values are of unless more are asked for: a chart and an index of the process as it is now."""

Columns = Callable[[Any], tuple[ColumnElement[Any], ...]]
"""Columns of a table with what is known of runs, by the table."""


class Lot(NamedTuple):
    """The runs that are meant; None takes all. since, until: moments in UTC. virtual: of the virtual bench, or real.

    newest: of values only those of so many of the newest first attempts; counts and trends are of all runs.
    """

    recipe: str | None = None
    model: str | None = None
    bench: str | None = None
    since: str | None = None
    until: str | None = None
    virtual: bool = False
    newest: int | None = NEWEST


@dataclass(frozen=True)
class Production:
    """An open look at the runs of a data folder; behind: runs of the folder that are not in the store yet."""

    chain: Chain
    connection: Connection
    keys: tuple[str, ...]
    unsigned_count: bool
    behind: int

    def of(self, asked: Select[Any], lot: Lot, *, first: bool = True) -> Select[Any]:
        """Return a statement on `RUNS` with the conditions of a lot; first: first attempts alone."""
        asked = asked.where(RUNS.c.in_production, self.trusted())
        asked = self._asked_for(asked, lot)
        return asked.where(RUNS.c.first) if first else asked

    def _asked_for(self, asked: Select[Any], lot: Lot) -> Select[Any]:
        return asked.where(RUNS.c.chain == self.chain.id, RUNS.c.virtual.is_(lot.virtual), *_meant(lot))

    def of_hours(self, asked: Select[Any], table: Table, lot: Lot) -> Select[Any]:
        """Return a statement on a table by the hour with the conditions of a lot, which is one of whole hours."""
        return self._hours_asked_for(asked, table, lot).where(table.c.key.in_(self._signed()))

    def _hours_asked_for(self, asked: Select[Any], table: Table, lot: Lot) -> Select[Any]:
        asked = asked.where(table.c.chain == self.chain.id, table.c.virtual.is_(lot.virtual))
        for name in ("recipe", "model", "bench"):
            value = getattr(lot, name)
            asked = asked if value is None else asked.where(table.c[name] == value)
        return between_hours(asked, table, lot.since, lot.until)

    def _signed(self) -> tuple[str, ...]:
        """Return the keys of runs that count as the tables by the hour name them: '' for those that name none."""
        return ("", *self.keys) if self.unsigned_count else self.keys

    def counted(self, columns: Columns, lot: Lot, *, first: bool = True, by_hours: bool = True) -> Select[Any]:
        """Return a statement for the number of runs of a lot by columns of a run, which stand before it in a row.

        columns: a function of the table that has them. first: first attempts alone. by_hours: whether the
        hours have these columns.
        """
        if not (by_hours and whole_hours(lot.since, lot.until)):
            by = columns(RUNS)
            return self.of(select(*by, func.count()).select_from(RUNS), lot, first=first).group_by(*by)
        by = columns(RUN_HOURS)
        asked = self.of_hours(select(*by, func.sum(RUN_HOURS.c.runs)).select_from(RUN_HOURS), RUN_HOURS, lot)
        asked = asked.where(RUN_HOURS.c.in_production)
        return (asked.where(RUN_HOURS.c.first) if first else asked).group_by(*by)

    def trusted(self) -> ColumnElement[bool]:
        """Return the condition that somebody known signed a run."""
        return trusted(self.keys, unsigned_count=self.unsigned_count)

    def one_recipe(self, lot: Lot) -> Lot:
        """Return the lot with its recipe named: values of several recipes are not of one kind.

        Raises:
            StationError: the lot has runs of several recipes, or none.

        """
        self.refuse_empty(lot)
        if lot.recipe is not None:
            return lot
        recipes = list(self.connection.execute(self.counted(lambda runs: (runs.c.recipe,), lot)).scalars())
        if len(recipes) > 1:
            raise StationError(
                f"{self.chain.data}: the chosen lot has runs of the recipes {', '.join(sorted(recipes))}; only runs of "
                "one recipe are comparable. Choose one with --recipe NAME"
            )
        return lot._replace(recipe=recipes[0]) if recipes else lot

    def chosen(
        self,
        lot: Lot,
        *conditions: ColumnElement[bool],
        newest: int | None = None,
        said: Sequence[str] = SAID_OF_A_VALUE,
    ) -> Subquery:
        """Return the first attempts of a lot that fulfil conditions, as a table of their ids to join others with.

        newest: only so many of the newest. said: what is known of each besides its id. The limit, which is none where
        all are meant, keeps a database from looking for these runs once for each row of the other table.
        """
        columns = (RUNS.c.chain, RUNS.c.run, *(RUNS.c[name] for name in said))
        asked = self.of(select(*columns), lot).where(*conditions)
        asked = asked.order_by(RUNS.c.run.desc()) if newest is not None else asked
        return asked.limit(NO_LIMIT if newest is None else newest).subquery()

    def oldest_of(self, lot: Lot, *conditions: ColumnElement[bool], newest: int | None) -> str:
        """Return the oldest of the newest first attempts that `chosen` returns, '' where all are meant.

        Said of the rows that are joined with them, it leaves a database the months that it needs not look into.
        """
        if newest is None:
            return ""
        asked = self.of(select(RUNS.c.run), lot).where(*conditions).order_by(RUNS.c.run.desc())
        return str(self.connection.execute(asked.offset(newest - 1).limit(1)).scalar() or "")

    def measured(self, lot: Lot, serial: str | None = None) -> list[str]:
        """Return the complete runs of a lot as a study counts them, of one unit or all.

        All attempts count, and master parts and the runs of guided studies too; runs of injected faults do not.
        """
        asked = self._asked_for(select(RUNS.c.run), lot)
        asked = asked.where(RUNS.c.state == COMPLETE, RUNS.c.altered == "", RUNS.c.scenario.is_(None), self.trusted())
        asked = asked if serial is None else asked.where(RUNS.c.serial == serial)
        return list(self.connection.execute(asked.order_by(RUNS.c.run)).scalars())

    def disbelieved(self, lot: Lot, serial: str | None = None) -> int:
        """Return how many runs of a lot, of one unit or all, no figure counts because their records are not believed.

        They were altered since they were sealed, or are signed by a key that this computer does not know. What an
        altered run says of itself, as that it is of a master part or of a virtual unit, takes it out of no lot.
        """
        # of a record whose start cannot be read nobody can say that it is not meant
        meant = or_(RUNS.c.started.is_(None), and_(true(), *_meant(lot)))
        altered = select(func.count()).select_from(RUNS).where(RUNS.c.chain == self.chain.id, meant)
        altered = altered.where(~RUNS.c.in_production, RUNS.c.altered != "")  # the index has the few that are not
        altered = altered if serial is None else altered.where(RUNS.c.serial == serial)
        return int(self.connection.execute(altered).scalar_one()) + self._signed_by_unknown_keys(lot, serial)

    def _signed_by_unknown_keys(self, lot: Lot, serial: str | None) -> int:
        if serial is not None or not whole_hours(lot.since, lot.until):
            asked = self._asked_for(select(func.count()).select_from(RUNS), lot)
            asked = asked.where(RUNS.c.in_production, not_(self.trusted()))
            asked = asked if serial is None else asked.where(RUNS.c.serial == serial)
        else:
            number = select(func.coalesce(func.sum(RUN_HOURS.c.runs), 0)).select_from(RUN_HOURS)
            asked = self._hours_asked_for(number, RUN_HOURS, lot).where(RUN_HOURS.c.in_production)
            asked = asked.where(RUN_HOURS.c.key.not_in(self._signed()))
        return int(self.connection.execute(asked).scalar_one())

    def choices(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return all recipes and models of the folder."""
        total = total_of(self.connection, self.chain)
        return total.recipes, total.models

    def refuse_empty(self, lot: Lot) -> None:
        """Refuse a lot without a run, saying whether there are runs of the other kind.

        Raises:
            StationError: no run is meant.

        """
        if self._number(lot):
            return
        count = self._number(lot._replace(virtual=not lot.virtual))
        kinds = ("virtual", "real") if lot.virtual else ("real", "virtual")
        hint = " Choose another lot" if not count else (
            f" Of {kinds[1]} units there are {count}: "
            + ("leave out --virtual" if lot.virtual else "choose them with --virtual")
        )  # fmt: skip
        disbelieved = self.disbelieved(lot)
        if disbelieved:
            hint += (
                f". Not counted, because their records are not believed: {disbelieved}. 'lostmotion verify' says why"
            )
        raise StationError(f"{self.chain.data}: the chosen lot has no run of a {kinds[0]} unit.{hint}")

    def _number(self, lot: Lot) -> int:
        rows = self.connection.execute(self.counted(lambda runs: (runs.c.virtual,), lot, first=False))
        return sum(number for _, number in rows)


def _meant(lot: Lot) -> list[ColumnElement[bool]]:
    """Return the conditions of a lot on `RUNS`, but for whether its units are virtual."""
    named = {name: getattr(lot, name) for name in ("recipe", "model", "bench")}
    meant = [RUNS.c[name] == value for name, value in named.items() if value is not None]
    meant += [] if lot.since is None else [RUNS.c.started >= lot.since]
    return meant + ([] if lot.until is None else [RUNS.c.started < lot.until])


@contextmanager
def production(data: Path, *, most_s: float | None = None) -> Iterator[Production]:
    """Yield a look at a data folder that sees one state of its store.

    most_s: longest time for putting runs into the store that have come since; None: until all are there.

    Raises:
        StationError: no such folder. StoreError, RecordError: the store cannot be used, or the chain not be read.

    """
    if not data.is_dir():
        raise StationError(f"--data {data}: there is no such folder; name the one that 'lostmotion run' wrote to")
    chain = Chain(data)
    database = opened(data)
    try:
        behind = catch_up(database, chain, most_s=most_s) or hold_up(database, chain, most_s=most_s)
        trust = trust_of(chain)
        with database.reading() as connection:
            yield Production(chain, connection, tuple(trust.keys), is_trusted(None, chain, trust), behind)
    finally:
        database.close()
