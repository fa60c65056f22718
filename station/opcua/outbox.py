"""Results that wait for clients that are away: what each client is owed, in the station's database.

The chain of runs is the source, as it is for webhooks: each entry that seals a run becomes one row, and one more for
each client that is owed it, in the transaction that notes how far the chain was read. So a kill at any moment loses
none and makes none twice. What a client has acknowledged is on disk before it is told so, and never comes again.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from sqlalchemy import (
    Column,
    Connection,
    ForeignKey,
    Integer,
    MetaData,
    String,
    Table,
    Text,
    UniqueConstraint,
    delete,
    func,
    insert,
    literal,
    select,
    update,
)

from station.atomic_file import read_file
from station.documents.result import Result
from station.errors import StationError
from station.opcua.settings import FILE, Client
from station.records.chain.chain_file import Chain
from station.records.chain.entries import Fields
from station.records.run_record import RESULT, RunRecord
from station.results.sealed_runs import chain_end, result_of, sealed_since
from station.wall_clock import now_text
from station.web.people.database import StationDatabase

METADATA = MetaData()

RESULTS = Table(
    "opcua_results", METADATA,
    Column("number", Integer, primary_key=True),
    Column("run", String(200), nullable=False, index=True),
    Column("sha256", String(64), nullable=False),
    Column("meta", Text, nullable=False),
    UniqueConstraint("run", "sha256"),
)  # fmt: skip
"""Every sealed run since the server was set up, in the order of the chain; with numbers below 1 those before it."""

CLIENTS = Table(
    "opcua_clients", METADATA,
    Column("name", String(64), primary_key=True),
    Column("since", String(40), nullable=False),
    Column("acknowledged", Integer, nullable=False),
    Column("heard", String(40)),
)  # fmt: skip
"""Clients that are owed results: since when, how many they have acknowledged, and when they last did."""

OWED = Table(
    "opcua_owed", METADATA,
    Column("client", String(64), ForeignKey(CLIENTS.c.name), primary_key=True),
    Column("number", Integer, ForeignKey(RESULTS.c.number), primary_key=True),
)  # fmt: skip
"""What each client has not acknowledged yet."""

READ = Table(
    "opcua_read", METADATA, Column("number", Integer, primary_key=True), Column("offset", Integer, nullable=False)
)
"""One row: up to which byte the chain of runs was put into the outbox."""


BEFORE_ALL = -(1 << 62)


@dataclass(frozen=True)
class ResultMeta:
    """What is said of a result before its content.

    `simulated`: of the virtual bench; `altered`: why no content is told. `verdict`: None where there is none, as of a
    run that was stopped. `reasons`: of the verdict, or of the alarm.
    """

    run: str
    serial: str
    attempt: int
    state: str
    verdict: str | None
    reasons: tuple[str, ...]
    sha256: str
    sealed_at: str
    started: str = ""
    recipe: str = ""
    recipe_sha256: str = ""
    bench: str = ""
    model: str = ""
    simulated: bool = False
    altered: tuple[str, ...] = ()


class Kept(NamedTuple):
    """A result in its place of the order in which the runs were sealed."""

    number: int
    meta: ResultMeta


class ClientRow(NamedTuple):
    """How a client stands: since when it is known, what it is owed, what it took, and when it was last heard."""

    name: str
    since: str
    waiting: int
    acknowledged: int
    heard: str | None


class Outbox:
    """The outbox of one data folder."""

    def __init__(self, database: StationDatabase, data: Path) -> None:
        """Open it, and make its tables where they are missing; results from now on are kept."""
        self._database, self._data = database, data
        with database.writing() as connection:
            METADATA.create_all(connection)

    def set_up(self, clients: Sequence[Client]) -> None:
        """Know these clients from now on. One that is no longer named goes on being owed, until it is forgotten."""
        with self._database.writing() as connection:
            if connection.execute(select(READ.c.offset)).first() is None:
                all_of_them = bool(clients) and all(client.from_first for client in clients)
                connection.execute(insert(READ).values(number=1, offset=0 if all_of_them else chain_end(self._data)))
            known = set(connection.execute(select(CLIENTS.c.name)).scalars())
        if any(client.from_first and client.name not in known for client in clients):
            self._keep_earlier()
        with self._database.writing() as connection:
            for client in clients:
                if client.name in known:
                    continue
                connection.execute(insert(CLIENTS).values(name=client.name, since=now_text(), acknowledged=0))
                if client.from_first:
                    every = select(literal(client.name), RESULTS.c.number)
                    connection.execute(insert(OWED).from_select(["client", "number"], every))

    def _keep_earlier(self) -> None:
        """Keep the results from before the server was set up, with numbers below those that there are."""
        with self._database.reading() as connection:
            offset = connection.execute(select(READ.c.offset)).scalar() or 0
            known = set(connection.execute(select(RESULTS.c.run, RESULTS.c.sha256)).tuples())
            lowest = connection.execute(select(func.min(RESULTS.c.number))).scalar()
        sealed, _ = sealed_since(self._data, 0, offset)
        missing = {(one["run"], one["sha256"]): one for one in sealed if (one["run"], one["sha256"]) not in known}
        rows = [_row(self._meta(fields)) for fields in missing.values()]
        first = (1 if lowest is None else lowest) - len(rows)
        with self._database.writing() as connection:
            for number, row in enumerate(rows, first):
                connection.execute(insert(RESULTS).values(number=number, **row))

    def collect(self) -> int:
        """Keep each run that was sealed since the last look, and owe it to each client; return how many.

        Raises:
            StationError: the chain or the database cannot be read.

        """
        with self._database.reading() as connection:
            offset = connection.execute(select(READ.c.offset)).scalar() or 0
        sealed, end = sealed_since(self._data, offset)
        if end == offset:
            return 0
        metas = [self._meta(fields) for fields in sealed]
        with self._database.writing() as connection:
            if not connection.execute(update(READ).where(READ.c.offset == offset).values(offset=end)).rowcount:
                return 0
            for meta in metas:
                same = (RESULTS.c.run == meta.run) & (RESULTS.c.sha256 == meta.sha256)
                if connection.execute(select(RESULTS.c.number).where(same)).first() is None:
                    self._keep(connection, meta)
        return len(metas)

    @staticmethod
    def _keep(connection: Connection, meta: ResultMeta) -> None:
        row = connection.execute(insert(RESULTS).values(**_row(meta)))
        (number,) = row.inserted_primary_key or (0,)
        owed = select(CLIENTS.c.name, literal(number))
        connection.execute(insert(OWED).from_select(["client", "number"], owed))

    def _meta(self, fields: Fields) -> ResultMeta:
        altered, result = result_of(self._data, fields["run"])
        manifest = None
        try:
            manifest = RunRecord(self._data / fields["run"]).manifest()
        except StationError as error:
            altered = () if self._removed(fields["run"]) else altered or (str(error),)
        meta = ResultMeta(
            run=fields["run"], serial=fields["serial"], attempt=fields["attempt"], state=fields["state"],
            verdict=fields["verdict"], sha256=fields["sha256"], sealed_at=fields["time"], reasons=_reasons(result),
            altered=tuple(altered),
        )  # fmt: skip
        if manifest is None:
            return meta
        return replace(
            meta,
            started=manifest.started,
            recipe=f"{manifest.recipe.name} r{manifest.recipe.revision}",
            recipe_sha256=manifest.recipe.sha256,
            bench=manifest.bench.name,
            model=manifest.unit.model,
            simulated=manifest.bench.embedded or manifest.unit.virtual is not None,
        )

    def _removed(self, run: str) -> bool:
        """Whether the record of a run was removed by a rule of the plant, which a signed line says."""
        return not (self._data / run).exists() and run in Chain(self._data).removed()

    def as_now(self, kept: Kept) -> Kept:
        """Return a result with what is altered of its record now, whatever was found when it was kept."""
        altered, result = result_of(self._data, kept.meta.run, samples=True)
        if altered and self._removed(kept.meta.run):
            return kept
        reasons = kept.meta.reasons if result is None else _reasons(result)
        return kept._replace(meta=replace(kept.meta, altered=tuple(altered), reasons=reasons))

    def owed(self, client: str, most: int) -> list[Kept]:
        """Return the oldest results that a client has not acknowledged."""
        chosen = select(RESULTS).join(OWED, OWED.c.number == RESULTS.c.number).where(OWED.c.client == client)
        return self._rows(chosen.order_by(RESULTS.c.number).limit(most))

    def after(self, number: int, most: int) -> list[Kept]:
        """Return the results behind a number, oldest first; `BEFORE_ALL` is before every one."""
        return self._rows(select(RESULTS).where(RESULTS.c.number > number).order_by(RESULTS.c.number).limit(most))

    def latest(self) -> Kept | None:
        """Return the newest result, None where there is none."""
        return next(iter(self._rows(select(RESULTS).order_by(RESULTS.c.number.desc()).limit(1))), None)

    def by_run(self, run: str) -> Kept | None:
        """Return the result of a run, None where it is not known here."""
        chosen = select(RESULTS).where(RESULTS.c.run == run).order_by(RESULTS.c.number.desc())
        return next(iter(self._rows(chosen.limit(1))), None)

    def _rows(self, chosen: Any) -> list[Kept]:
        with self._database.reading() as connection:
            rows = connection.execute(chosen).all()
        return [Kept(row.number, _read_meta(row.meta)) for row in rows]

    def content(self, meta: ResultMeta) -> str | None:
        """Return result.json as it was sealed; None where the run has none, or where it was altered or removed."""
        altered, result = result_of(self._data, meta.run)
        if altered or result is None:
            return None
        return read_file(self._data / meta.run / RESULT).decode()

    def acknowledge(self, client: str, runs: Sequence[str]) -> list[bool]:
        """Note durably that a client has these results; say of each whether there is such a result.

        To acknowledge twice is no error: the answer to the first may have been lost.
        """
        with self._database.writing() as connection:
            chosen = select(RESULTS.c.number, RESULTS.c.run).where(RESULTS.c.run.in_(set(runs)))
            known = connection.execute(chosen).all()
            mine = (OWED.c.client == client) & OWED.c.number.in_([row.number for row in known])
            taken = connection.execute(delete(OWED).where(mine)).rowcount
            told = {"acknowledged": CLIENTS.c.acknowledged + taken, "heard": now_text()}
            connection.execute(update(CLIENTS).where(CLIENTS.c.name == client).values(**told))
        there = {row.run for row in known}
        return [run in there for run in runs]

    def clients(self) -> list[ClientRow]:
        """Return how every client stands, by name."""
        waiting = select(OWED.c.client, func.count().label("waiting")).group_by(OWED.c.client).subquery()
        chosen = select(CLIENTS, func.coalesce(waiting.c.waiting, 0).label("waiting"))
        chosen = chosen.outerjoin(waiting, waiting.c.client == CLIENTS.c.name).order_by(CLIENTS.c.name)
        with self._database.reading() as connection:
            rows = connection.execute(chosen).all()
        return [ClientRow(row.name, row.since, row.waiting, row.acknowledged, row.heard) for row in rows]

    def forget(self, client: str) -> int:
        """Forget a client and what it is owed; return how much that was. StationError where there is none."""
        with self._database.writing() as connection:
            owed = connection.execute(delete(OWED).where(OWED.c.client == client)).rowcount
            if not connection.execute(delete(CLIENTS).where(CLIENTS.c.name == client)).rowcount:
                known = ", ".join(connection.execute(select(CLIENTS.c.name)).scalars()) or "none"
                raise StationError(f"there is no OPC UA client {client[:40]!r}. Known clients: {known} ({FILE})")
        return owed


def _row(meta: ResultMeta) -> dict[str, str]:
    return {"run": meta.run, "sha256": meta.sha256, "meta": json.dumps(vars(meta), ensure_ascii=False)}


def _reasons(result: Result | None) -> tuple[str, ...]:
    if result is None:
        return ()
    cause = result.first_cause
    return tuple(result.reasons) or ((cause.text,) if cause is not None else ())


def _read_meta(text: str) -> ResultMeta:
    fields = json.loads(text)
    return ResultMeta(**{**fields, "reasons": tuple(fields["reasons"]), "altered": tuple(fields["altered"])})
