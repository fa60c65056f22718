"""The database of a store: opened, brought to the tables of this version, and its refusals as one error."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from errno import ENOSPC
from functools import lru_cache
from json import JSONDecodeError
from pathlib import Path

from sqlalchemy import Column, Connection, Dialect, MetaData, String, Table, insert, inspect, text
from sqlalchemy.engine.mock import MockConnection
from sqlalchemy.exc import SQLAlchemyError

from station.atomic_file import NEXT_ACTIONS
from station.errors import StationError
from station.store.engines import BUSY_S, ENGINES
from station.store.places import StorePlace
from station.store.plant.months import DIVIDED, make_rest
from station.store.plant.sizes import grown, learn_sizes, tell_sizes
from station.store.tables import METADATA, RUNS

ACTION = "Check that the database is running and that this user may write to it"
REBUILD = "Run 'lostmotion store rebuild'"
MOVE_AWAY = "Move this file away: the next look makes a new one"
FREE_SPACE = NEXT_ACTIONS[ENOSPC]
FULL: dict[str, tuple[object, ...]] = {
    "sqlite_errorcode": (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR_SHMSIZE),
    "sqlstate": ("53100",),
    "errno": (ENOSPC,),
}
"""How a full disk is told: by SQLite, by PostgreSQL (`disk_full`), by the system, each by a number of its own."""

HEAD = "0010"
"""Version of the tables that this program works with; the newest one below `migrations/versions`."""

DAMAGED = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)
LACKS = ("no such table", "no such column", "table ")
"""How SQLite says that its file is damaged: by its code, or by what it misses or finds in it."""

VERSIONS = "alembic_version"
_VERSION = Table(VERSIONS, MetaData(), Column("version_num", String(32), primary_key=True))
"""The table in which Alembic keeps the version of the others."""

FEW_RUNS = 5_000
"""Runs up to which a store of an older version is brought to this one by whoever opens it: some seconds."""

ONE_AT_A_TIME = 7_362_514_220
"""Number of the advisory lock by which writers on PostgreSQL take turns."""


class StoreError(StationError):
    """The store cannot be used. No run and no verdict depends on it."""


class Database:
    """One open database."""

    def __init__(self, place: StorePlace, *, may_take_long: bool = False) -> None:
        """Open a database and bring its tables to this version.

        may_take_long: also those of an older version that hold more than `FEW_RUNS`.

        Raises:
            StoreError: it cannot be opened, is of a newer version, or is older and too big to be waited for.

        """
        self.place = place
        self._may_take_long = may_take_long
        self._is_open = True
        self._held = ExitStack()
        self._holds: Connection | None = None
        with _told(place):
            self._engine = ENGINES.take(place.url)
            try:
                self._migrate()
            except BaseException:
                self.close()
                raise

    @contextmanager
    def reading(self) -> Iterator[Connection]:
        """Yield a connection that sees one state of the store, that which is held; StoreError where it fails."""
        with _told(self.place):
            if self._holds is not None:
                yield self._holds
                return
        with _told(self.place), self._engine.connect() as plain:
            # PostgreSQL would show each statement a state of its own; SQLite never does.
            level = "REPEATABLE READ" if plain.dialect.name == "postgresql" else None
            connection = plain.execution_options(isolation_level=level) if level else plain
            with connection.begin():
                yield connection

    def hold(self) -> Connection:
        """Have all that is read from now on see the state that the store has now; StoreError where it fails.

        Until it is let go, or the database closed. Nothing is written meanwhile.
        """
        self.let_go()
        self._holds = self._held.enter_context(self.reading())
        return self._holds

    def let_go(self) -> None:
        """Have what is read see the store as it is again."""
        self._holds = None
        with suppress(StoreError):  # nothing was written, so nothing is lost with the connection
            self._held.close()

    @contextmanager
    def writing(self) -> Iterator[Connection]:
        """Yield a connection of the only writer; all that it does is kept at its end, or nothing."""
        with _told(self.place), self._engine.connect() as plain:
            connection = plain.execution_options(writes=True)
            with connection.begin():
                if connection.dialect.name == "postgresql":
                    connection.execute(text(f"SET LOCAL lock_timeout = {int(BUSY_S * 1000)}"))
                    connection.execute(text(f"SELECT pg_advisory_xact_lock({ONE_AT_A_TIME})"))
                yield connection

    def learn_sizes(self, *, anew: bool = False) -> None:
        """Have the database learn how big its tables are: those that have grown, or all; StoreError where it fails."""
        with self.reading() as connection:
            learn_sizes(connection, DIVIDED if anew else grown(connection))

    def close(self) -> None:
        """Close it, once; connections that are kept stay open."""
        if self._is_open:
            self._is_open = False
            self.let_go()
            ENGINES.let_go(self._engine)

    def _migrate(self) -> None:
        with self._engine.connect() as connection:
            if _version(connection) == HEAD:
                return
        with self.writing() as connection:
            version = _version(connection)
            if version == HEAD:
                return
            if version is None:
                _make_tables(connection)
            else:
                if not self._may_take_long:
                    _refuse_long(connection, self.place, version)
                upgrade(connection, self.place, version)
            tell_sizes(connection)


def _version(connection: Connection) -> str | None:
    if not inspect(connection).has_table(VERSIONS):
        return None
    return connection.execute(text(f"SELECT version_num FROM {VERSIONS}")).scalar()  # noqa: S608 - a constant


def _make_tables(connection: Connection) -> None:
    """Make the tables of a new store as they are now; a table that is there already is an error, and not taken over."""
    for statement in _new_tables(connection.dialect):
        connection.exec_driver_sql(statement)
    make_rest(connection)
    connection.execute(insert(_VERSION).values(version_num=HEAD))


@lru_cache(maxsize=4)
def _new_tables(dialect: Dialect) -> tuple[str, ...]:
    """Return the statements that make all tables: put into the words of a database once, not for each new store."""
    found: list[str] = []
    words = MockConnection(dialect, lambda said, *_: found.append(str(said.compile(dialect=dialect))))
    METADATA.create_all(words, checkfirst=False)
    _VERSION.create(words)
    return tuple(found)


def _refuse_long(connection: Connection, place: StorePlace, version: str) -> None:
    if not inspect(connection).has_table(RUNS.name):
        return
    beyond = text(f"SELECT 1 FROM {RUNS.name} LIMIT 1 OFFSET {FEW_RUNS}")  # noqa: S608 - constants
    if connection.execute(beyond).first() is not None:
        raise StoreError(
            f"{place.shown}: the store of runs has tables of the older version {version} and more than {FEW_RUNS} "
            f"runs. To update it to version {HEAD} takes minutes. Do that with 'lostmotion store rebuild'"
        )


def upgrade(connection: Connection, place: StorePlace, version: str | None) -> None:
    """Take the tables of an older version, None for no tables at all, through all migrations to this version.

    Raises:
        StoreError: the version is not known here.

    """
    # Here, because only a store that is older than the program needs it, and loading it takes a third of a second.
    from alembic import command  # noqa: PLC0415
    from alembic.config import Config  # noqa: PLC0415
    from alembic.script import ScriptDirectory  # noqa: PLC0415

    config = Config()
    config.set_main_option("script_location", str(Path(__file__).parent / "migrations").replace("%", "%%"))
    config.attributes["connection"] = connection
    known = {script.revision for script in ScriptDirectory.from_config(config).walk_revisions()}
    if version is not None and version not in known:
        raise StoreError(
            f"{place.shown}: the store of runs has tables of version {version}; this program knows up to {HEAD}. Use a "
            "newer lostmotion, or name another store with --store"
        )
    command.upgrade(config, "head")


@contextmanager
def _told(place: StorePlace) -> Iterator[None]:
    try:
        yield
    except (SQLAlchemyError, OSError) as error:
        cause = " ".join(str(getattr(error, "orig", None) or error).split())
        raise StoreError(
            f"{place.shown}: the store of runs cannot be used: {cause[:300]}. {_next_action(error, place)}"
        ) from error
    except JSONDecodeError as error:  # of a value in a row
        raise StoreError(f"{place.shown}: the store of runs is damaged: {error}. {REBUILD}") from error


def _next_action(error: SQLAlchemyError | OSError, place: StorePlace) -> str:
    if is_damaged(error):
        return REBUILD if place.own else MOVE_AWAY
    cause = getattr(error, "orig", None) or error
    full = any(getattr(cause, name, None) in codes for name, codes in FULL.items())
    return FREE_SPACE if full else ACTION


def is_damaged(error: BaseException | None) -> bool:
    """Whether what SQLite refused says that its file is no whole database, or lacks a table or a column."""
    cause = getattr(error, "orig", None)
    damaged = getattr(cause, "sqlite_errorcode", None) in DAMAGED
    return damaged or (isinstance(cause, sqlite3.OperationalError) and str(cause).startswith(LACKS))
