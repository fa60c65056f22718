"""Engines of SQLAlchemy: one for each database that a process looks at, made once.

An engine keeps what statements became in the words of its database; to make that anew takes longer than to ask a small
store. The connections end with the last look that is on: a file can be another one at the next, and a server allows
few. A process that answers people all day keeps those to a server.
"""

from __future__ import annotations

import os
from collections import OrderedDict
from threading import RLock
from typing import Any

from sqlalchemy import URL, Connection, Engine, create_engine, event
from sqlalchemy.dialects import registry
from sqlalchemy.dialects.sqlite.pysqlite import SQLiteDialect_pysqlite
from sqlalchemy.engine import make_url
from sqlalchemy.exc import DisconnectionError
from sqlalchemy.pool import StaticPool
from sqlalchemy.util import LRUCache

from station.store.places import SQLITE

IN_MEMORY = "sqlite://"
BUSY_S = 3.0
"""How long another writer, or a server that does not answer, is waited for."""

KEPT, MORE = 1, 9
"""Connections to a server that are kept, and how many more there are at a time: a server allows a hundred as a rule,
and forty benches may share it."""

KEPT_S = 900
"""How old a kept connection may become: what it remembers of all partitions takes memory of the server."""

SEEN = "device and inode"
"""What a connection keeps of its file."""

MOST_ENGINES = 4
"""Engines that are kept while nobody uses them: what each has compiled takes some megabytes."""

MOST_STATEMENTS = 500
"""As many as an engine of its own keeps."""


class OneSqlite(SQLiteDialect_pysqlite):
    """The words of SQLite, which are the same for all of its files."""

    supports_statement_cache = True

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self)

    def __hash__(self) -> int:
        return hash(type(self))


registry.register("sqlite.one", __name__, OneSqlite.__name__)
IN_ONE_SQLITE = {"compiled_cache": LRUCache[Any, Any](MOST_STATEMENTS)}
"""Statements in the words of SQLite, whichever file they are for: a look in memory has a new engine each time."""


class Engines:
    """The engines of a process, by the address of their database; each is used by any number of threads."""

    def __init__(self) -> None:
        self._engines = OrderedDict[str, Engine]()
        self._users: dict[Engine, int] = {}
        self._keeps_connections = False
        self._of_parent: list[object] = []
        # Python's collector may end a look that nobody ended, at any place of the same thread.
        self._lock = RLock()

    def keep_connections(self) -> None:
        """Keep those to a database server, here on."""
        self._keeps_connections = True

    def take(self, url: str) -> Engine:
        """Return the engine of a database, which is given back by `let_go`; one in memory is always new."""
        with self._lock:
            engine = self._engines.get(url)
        made = engine or new_engine(url)
        with self._lock:
            engine = made if url == IN_MEMORY else self._engines.setdefault(url, made)
            self._users[engine] = self._users.get(engine, 0) + 1
            if url != IN_MEMORY:
                self._engines.move_to_end(url)
            return engine

    def let_go(self, engine: Engine) -> None:
        """Give an engine back; when nobody uses it any more its connections are closed, or kept."""
        over = []
        with self._lock:
            if engine not in self._users:
                return  # of a parent
            self._users[engine] -= 1
            if self._users[engine]:
                return
            del self._users[engine]
            if not self._keeps_connections or engine.dialect.name == "sqlite":
                over.append(engine)
            idle = [url for url, one in self._engines.items() if one not in self._users]
            over += [self._engines.pop(url) for url in idle[: max(0, len(self._engines) - MOST_ENGINES)]]
        for one in over:  # the last connection to a file may have much to write; others need not wait for that
            one.dispose()

    def begin_in_child(self) -> None:
        """Use none of the parent's connections in a process that was forked off, and close none of them either."""
        self._of_parent += [*self._engines.values(), *self._users]
        self._engines, self._users, self._lock = OrderedDict(), {}, RLock()


ENGINES = Engines()
os.register_at_fork(after_in_child=ENGINES.begin_in_child)


def keep_connections() -> None:
    """Keep connections to a database server from one look to the next, in a process that answers people all day.

    A new connection to PostgreSQL knows none of the partitions yet: with years of runs it takes longer to learn them
    than to find what was asked for. One that has broken since is noticed before it is used, and made anew.
    """
    ENGINES.keep_connections()


def new_engine(url: str) -> Engine:
    """Return an engine of its own; it connects when it is first used."""
    # The path of a file is one as it stands: in a URL, what is behind its ? would be options.
    file = url.removeprefix(SQLITE) if url.startswith(SQLITE) else None
    place = URL.create("sqlite+one", database=file) if url.startswith("sqlite") else make_url(url)
    if url == IN_MEMORY:
        engine = create_engine(
            place,
            poolclass=StaticPool,
            connect_args={"check_same_thread": False},
            execution_options=IN_ONE_SQLITE,
        )
    elif url.startswith("sqlite"):
        # As many as there are looks at a time: they are given back soon, and waiting for one could take half a minute.
        options = {"timeout": BUSY_S}
        engine = create_engine(place, connect_args=options, max_overflow=-1, execution_options=IN_ONE_SQLITE)
        _hold_to_file(engine, str(place.database))
    else:
        engine = create_engine(
            place,
            connect_args={"connect_timeout": int(BUSY_S)},
            pool_pre_ping=True,
            pool_recycle=KEPT_S,
            pool_size=KEPT,
            max_overflow=MORE,
        )
    if url.startswith("sqlite"):
        event.listen(engine, "connect", _set_up_sqlite)
        event.listen(engine, "begin", _begin_sqlite)
    return engine


def _set_up_sqlite(connection: Any, _record: object) -> None:
    # The driver's own transactions leave tables out, and begin late; `_begin_sqlite` begins them instead.
    connection.isolation_level = None
    cursor = connection.cursor()
    cursor.execute("PRAGMA journal_mode = WAL")
    cursor.execute("PRAGMA synchronous = NORMAL")
    cursor.close()


def _begin_sqlite(connection: Connection) -> None:
    writes = connection.get_execution_options().get("writes")
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


def _hold_to_file(engine: Engine, path: str) -> None:
    """Have a look open the file anew where another one has come in its place while looks overlapped."""

    def seen() -> tuple[int, int] | None:
        try:
            there = os.stat(path)  # noqa: PTH116 - at every look
        except OSError:
            return None
        return there.st_dev, there.st_ino

    def connect(_connection: object, record: Any) -> None:
        record.info[SEEN] = seen()

    def check_out(_connection: object, record: Any, _proxy: object) -> None:
        if record.info[SEEN] is None:
            record.info[SEEN] = seen()  # it was made by what came first over this connection
        elif record.info[SEEN] != seen():
            raise DisconnectionError

    event.listen(engine, "connect", connect)
    event.listen(engine, "checkout", check_out)
