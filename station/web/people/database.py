"""The station's own database: accounts, sessions, answered requests, confirmations, labels, audit.

None of it can be made again from the runs, so it is no part of the store. It stands beside the runs, for its owner
alone, and one server at a time holds it.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sqlalchemy import (
    URL,
    Boolean,
    Column,
    Connection,
    Engine,
    Float,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Table,
    Text,
    create_engine,
    event,
)
from sqlalchemy.exc import SQLAlchemyError

from station.errors import StationError
from station.store.places import network_type

FILE = "station.sqlite3"
LOCK = "station.lock"
CACHE_KIB = 512
"""Pages that a connection keeps: each thread of the server has one, and the system keeps the file for all of them."""

BUSY_S = 5.0
ONLY_READS = "lostmotion_only_reads"
METADATA = MetaData()

PEOPLE = Table(
    "people", METADATA,
    Column("name", String(64), primary_key=True),
    Column("role", String(16), nullable=False),
    Column("password", Text, nullable=False),
    Column("must_change", Boolean, nullable=False),
    Column("failed", Integer, nullable=False),
    Column("locked_until_s", Float),
    Column("disabled", Boolean, nullable=False),
)  # fmt: skip
BADGES = Table(
    "badges", METADATA,
    Column("name", String(64), primary_key=True),
    Column("digest", String(64), nullable=False, unique=True),
    Column("pin", Text, nullable=False),
)  # fmt: skip
"""Badges by their owners: the hash of the number, and of the PIN."""

BADGE_SALT = Table(
    "badge_salt", METADATA, Column("number", Integer, primary_key=True), Column("salt", String(64), nullable=False)
)
"""One row: the salt of all hashes of badge numbers."""

SCANNER_TESTS = Table(
    "scanner_tests", METADATA,
    Column("number", Integer, primary_key=True),
    Column("name", String(64), nullable=False),
    Column("at_s", Float, nullable=False),
)  # fmt: skip
"""When the test code of the scanner was read as it was printed."""

CHOICES = Table(
    "choices", METADATA, Column("name", String(64), primary_key=True), Column("language", String(8), nullable=False)
)
"""The language that a person has chosen."""

SESSIONS = Table(
    "sessions", METADATA,
    Column("token_sha256", String(64), primary_key=True),
    Column("name", String(64), nullable=False),
    Column("csrf", String(64), nullable=False),
    Column("ends_s", Float, nullable=False),
)  # fmt: skip
ANSWERS = Table(
    "answers", METADATA,
    Column("key", String(64), primary_key=True),
    Column("name", String(64), nullable=False),
    Column("asked_hmac", String(64), nullable=False),
    Column("status", Integer, nullable=False),
    Column("answer", Text, nullable=False),
    Column("at_s", Float, nullable=False),
)  # fmt: skip
"""Answers by the key of their request: who asks again is told again, and nothing is done twice.

What was asked may hold a password, so where it may its hash is as slow to guess as that of a badge number.
"""

CONFIRMED = Table(
    "confirmed", METADATA,
    Column("run", String(200), primary_key=True),
    Column("name", String(64), nullable=False),
    Column("at", String(40), nullable=False),
)  # fmt: skip
"""Runs whose bad unit somebody has put into the box for bad units."""

BYPASSES = Table(
    "bypasses", METADATA,
    Column("number", Integer, primary_key=True),
    Column("condition", String(40), nullable=False),
    Column("name", String(64), nullable=False),
    Column("reason", Text, nullable=False),
    Column("until_s", Float, nullable=False),
)  # fmt: skip
"""Start conditions that somebody has set aside; one that was ended has its end in `until_s`."""

AUDIT = Table(
    "audit", METADATA,
    Column("number", Integer, primary_key=True, autoincrement=False),
    Column("at", String(40), nullable=False),
    Column("name", String(64), nullable=False),
    Column("action", String(40), nullable=False),
    Column("outcome", String(16), nullable=False),
    Column("detail", Text, nullable=False),
    Column("before_sha256", String(64), nullable=False),
    Column("sha256", String(64), nullable=False),
)  # fmt: skip

BEGUN = Table(
    "begun", METADATA,
    Column("number", Integer, primary_key=True),
    Column("at", String(40), nullable=False),
    Column("name", String(64), nullable=False),
    Column("action", String(40), nullable=False),
    Column("detail", Text, nullable=False),
    Column("pid", Integer, nullable=False),
    Column("birth", String(40), nullable=False),
)  # fmt: skip
"""Actions that are being done, and by which process: one whose process ended in it is told in the audit trail."""

MES_UNITS = Table(
    "mes_units", METADATA,
    Column("serial", String(200), primary_key=True),
    Column("previous_step", String(16), nullable=False),
    Column("name", String(64), nullable=False),
    Column("at", String(40), nullable=False),
)  # fmt: skip
"""What the MES has announced: units, and whether their previous process step passed."""

MES_CONTACT = Table(
    "mes_contact", METADATA, Column("number", Integer, primary_key=True), Column("heard_s", Float, nullable=False)
)
"""One row: when the MES was heard last."""

WEBHOOKS = Table(
    "webhooks", METADATA,
    Column("number", Integer, primary_key=True),
    Column("key", String(300), nullable=False, unique=True),
    Column("serial", String(200), nullable=False, index=True),
    Column("body", Text, nullable=False),
    Column("tries", Integer, nullable=False),
    Column("next_s", Float, nullable=False),
    Column("last_error", Text, nullable=False, default=""),
    Column("delivered_at", String(40), index=True),
)  # fmt: skip
"""Messages for the MES in the order in which their runs were sealed; one that was delivered has its moment."""

WEBHOOKS_READ = Table(
    "webhooks_read", METADATA, Column("number", Integer, primary_key=True), Column("offset", Integer, nullable=False)
)
"""One row: up to which byte the chain of runs was put into the outbox."""

LABELS = Table(
    "labels", METADATA,
    Column("number", Integer, primary_key=True),
    Column("run", String(200), nullable=False, unique=True),
    Column("serial", String(200), nullable=False),
    Column("label", Text, nullable=False),
    Column("reads_as", Text, nullable=False, index=True),
    Column("copy", Integer, nullable=False),
    Column("next_s", Float, nullable=False),
    Column("trouble", Text, nullable=False),
    Column("sent_at", String(40)),
    Column("printed_at", String(40)),
    Column("done_at", String(40), index=True),
    Column("done_by", String(64), nullable=False),
    Column("why", Text, nullable=False),
)  # fmt: skip
"""Labels in the order in which their runs were sealed, and how far each came: sent, printed, read back or set aside.

One that was sent and is not printed may be either: nobody knows it, and it is not sent again by itself.
"""

LABELS_READ = Table(
    "labels_read", METADATA, Column("number", Integer, primary_key=True), Column("offset", Integer, nullable=False)
)
"""One row: up to which byte the chain of runs was looked at for labels."""

AQDEF_FILES = Table(
    "aqdef_files", METADATA,
    Column("number", Integer, primary_key=True),
    Column("per", String(8), nullable=False),
    Column("part", Text, nullable=False),
    Column("hour", String(16), nullable=False),
    Column("units", Integer, nullable=False),
    Column("last_s", Float, nullable=False),
    Column("stage", String(16), nullable=False, index=True),
    Column("name", String(255), nullable=False, default=""),
    Column("content", LargeBinary),
    Column("sha256", String(64), nullable=False, default=""),
    Column("tries", Integer, nullable=False, default=0),
    Column("next_s", Float, nullable=False, default=0.0),
    Column("last_error", Text, nullable=False, default=""),
    Column("written_at", String(40)),
)  # fmt: skip
"""AQDEF files in the order in which their first runs were sealed, and how far each came.

One that is made has its name and bytes, which are written as they are however often it takes.
"""

AQDEF_RUNS = Table(
    "aqdef_runs", METADATA,
    Column("run", String(200), primary_key=True),
    Column("file", Integer, nullable=False, index=True),
    Column("why", Text, nullable=False),
)  # fmt: skip
"""Runs by the file that they are in; one that is in none says why: its file is 0, or the one that left it out."""

AQDEF_KNOWN = Table(
    "aqdef_known", METADATA,
    Column("run", String(200), primary_key=True),
    Column("name", String(64), nullable=False),
    Column("at", String(40), nullable=False),
    Column("reason", Text, nullable=False),
)  # fmt: skip
"""Runs that are in no AQDEF file of which somebody has said that this is known."""

AQDEF_READ = Table(
    "aqdef_read", METADATA, Column("number", Integer, primary_key=True), Column("offset", Integer, nullable=False)
)
"""One row: up to which byte the chain of runs was looked at for AQDEF files."""


STEPS = ("DROP TABLE IF EXISTS requests",)
"""What brings an older file up to date, one statement a version. The first: it kept plain hashes of what was asked."""


class StationDatabase:
    """The open database of a data folder. Everything that is written is on disk when `writing` ends, or not at all."""

    def __init__(self, data: Path, *, serving: bool = False) -> None:
        """Open it, and make it where it is missing; `serving`: hold it against other servers.

        Raises:
            StationError: the folder is on a network mount or cannot be written, or another server holds it.

        """
        self.path = data / FILE
        kind = network_type(data)
        if kind:
            raise StationError(f"{data}: is on a network mount ({kind}). Name a folder on a local disk with --data")
        try:
            data.mkdir(parents=True, exist_ok=True)
            self._lock = _held(data / LOCK) if serving else None
            os.close(os.open(self.path, os.O_CREAT | os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600))
        except OSError as error:
            raise StationError(
                f"{self.path}: cannot be opened: {error.strerror}. Choose another folder with --data"
            ) from error
        self._engine = create_engine(URL.create("sqlite", database=str(self.path)), connect_args={"timeout": BUSY_S})
        event.listen(self._engine, "connect", _set_up)
        event.listen(self._engine, "begin", _begin)
        self._readers = self._engine.execution_options(**{ONLY_READS: True})
        with self.writing() as connection:
            self._bring_up_to_date(connection)
            METADATA.create_all(connection)

    def _bring_up_to_date(self, connection: Connection) -> None:
        version = int(connection.exec_driver_sql("PRAGMA user_version").scalar_one())
        if version > len(STEPS):
            raise StationError(f"{self.path}: was written by a newer lostmotion (version {version}). Use that version")
        for statement in STEPS[version:]:
            connection.exec_driver_sql(statement)
        connection.exec_driver_sql(f"PRAGMA user_version = {len(STEPS)}")

    @contextmanager
    def writing(self) -> Iterator[Connection]:
        """Yield the connection of the only writer; all that it does is kept at its end, or nothing."""
        with self._connected(self._engine) as connection:
            yield connection

    @contextmanager
    def reading(self) -> Iterator[Connection]:
        """Yield a connection that reads what is there now; it waits for no writer, and none for it."""
        with self._connected(self._readers) as connection:
            yield connection

    @contextmanager
    def _connected(self, engine: Engine) -> Iterator[Connection]:
        try:
            with engine.begin() as connection:
                yield connection
        except SQLAlchemyError as error:
            cause = " ".join(str(getattr(error, "orig", None) or error).split())
            raise StationError(f"{self.path}: cannot be used: {cause[:200]}. Check the disk") from error

    def close(self) -> None:
        """Close it and let others serve."""
        self._engine.dispose()
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None


def _held(path: Path) -> int:
    handle = os.open(path, os.O_CREAT | os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(handle)
        raise StationError(
            f"{path.parent}: another 'lostmotion serve' serves this folder. Stop it, or name another folder with --data"
        ) from error
    return handle


def _begin(connection: Connection) -> None:
    only_reads = connection.get_execution_options().get(ONLY_READS, False)
    connection.exec_driver_sql("BEGIN" if only_reads else "BEGIN IMMEDIATE")


def _set_up(connection: Any, _record: object) -> None:
    connection.isolation_level = None  # transactions are begun above
    cursor = connection.cursor()
    cursor.execute("PRAGMA journal_mode = WAL")
    cursor.execute("PRAGMA synchronous = FULL")
    cursor.execute(f"PRAGMA cache_size = -{CACHE_KIB}")
    cursor.execute("PRAGMA secure_delete = ON")  # what is deleted here was somebody's password or session
    cursor.close()
