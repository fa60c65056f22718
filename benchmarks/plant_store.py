"""A data folder as a plant has it after years, in SQLite or PostgreSQL, and how long questions to it take.

The newest runs have folders, sealed and signed as a bench does it; of the older ones there are the rows in the store,
multiplied from those of a real run, and below a million also lines in the chain as long as real ones: what a question
can meet of them. Models change by the day and operators by the shift, as on a line.

Beside the time stands that of the processor, the server's with it: on a computer that does other things they differ.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from datetime import timedelta
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from sqlalchemy import Connection, create_engine, insert, select, text, update

from benchmarks.many_runs import FIRST, UNITS_MEASURED_TWICE, make_runs
from benchmarks.store_size import own_server
from station.records.chain.chain_file import Chain
from station.store.engine import Database
from station.store.engines import keep_connections
from station.store.places import STORE_URL
from station.store.plant.hours import count_all_hours, hour_of
from station.store.plant.months import make_months
from station.store.tables import CHECKS, METRICS, PROJECTIONS, RUNS
from station.store.view import bring_up, opened

REAL = 500
"""Newest runs, which have folders."""

MANY = 250_000
"""Runs from which on they come every minute, and no longer every four, and have no lines in the chain."""

AT_A_TIME = 5000
MODELS = ("RV-40E-121", "RV-80E-101", "RV-20E-105")
OPERATORS = ("A. Tester", "B. Tester", "C. Tester", "D. Tester")
FIXTURES = ("F-1", "F-2")
UNDECIDED_EVERY = 30
METRICS_OF_A_RUN = 4
"""Of which each has two sides: eight values a run."""

MULTIPLIED = (
    """INSERT INTO metrics SELECT m.chain, r.run, m.position, m.side, m.main, m.meaning, m.cycles, m.value + {scatter},
       m.uncertainty, m.coverage_factor, m.limit_min, m.limit_max,
       CASE WHEN m.position = 0 THEN r.verdict ELSE 'PASS' END
       FROM runs r JOIN metrics m ON m.chain = r.chain AND m.run = :sample AND m.position < :metrics
       WHERE r.chain = :chain AND r.run < :real""",
    """INSERT INTO checks SELECT c.chain, r.run, c.id, c.figure, c."limit", c.unit,
       c.id <> 'drift' OR r.verdict <> 'NOT DECIDABLE', c.text
       FROM runs r JOIN checks c ON c.chain = r.chain AND c.run = :sample AND c.id IN ('drift', 'noise')
       WHERE r.chain = :chain AND r.run < :real""",
    """INSERT INTO alarms SELECT r.chain, r.run, 0, 'torque_over_limit', 1, 0.1, 'ramp_pos', 'unload', {true}, ''
       FROM runs r WHERE r.chain = :chain AND r.run < :real AND r.verdict = 'NOT DECIDABLE'""",
)
"""Statements that give every run the metrics and checks of one, with values that scatter."""

RUNS_BY_HOUR = """INSERT INTO run_hours SELECT chain, hour, bench, recipe, revision, model, coalesce(operator, ''),
    coalesce(key, ''), fixture, state, coalesce(verdict, ''), master, virtual, in_production, valid, first,
    count(*) FROM runs WHERE chain = :chain GROUP BY 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16
    ON CONFLICT DO NOTHING"""
METRICS_BY_HOUR = """INSERT INTO metric_hours SELECT r.chain, meaning, side, hour, bench, recipe, revision, model,
    coalesce(operator, ''), coalesce(key, ''), fixture, virtual,
    count(*) FILTER (WHERE valid), coalesce(avg(value) FILTER (WHERE valid), 0),
    coalesce(var_pop(value) FILTER (WHERE valid), 0) * count(*) FILTER (WHERE valid),
    count(*) FILTER (WHERE r.verdict = 'FAIL' AND m.verdict = 'FAIL')
    FROM runs r JOIN metrics m ON m.chain = r.chain AND m.run = r.run
    WHERE r.chain = :chain AND in_production AND first
    GROUP BY 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12 ON CONFLICT DO NOTHING"""

WORDS = {
    "sqlite": {"scatter": "(abs(random()) % 1000) * 1e-4 - 0.05", "true": "1"},
    "postgresql": {"scatter": "random() * 0.1 - 0.05", "true": "true"},
}


class Question(NamedTuple):
    """What is asked of a data folder, and how long of the processor's time it may take, in milliseconds."""

    ask: Callable[[Path], object]
    allowed_ms: float


def older_rows(sample: dict[str, Any], count: int, every: timedelta) -> Iterator[dict[str, Any]]:
    """Yield rows of runs from before the real ones, after the pattern of these."""
    for number in range(count):
        place = number % UNITS_MEASURED_TWICE
        again, failed = place == UNITS_MEASURED_TWICE - 1, place == UNITS_MEASURED_TWICE - 2
        undecided = not failed and not again and number % UNDECIDED_EVERY == 0
        serial, moment = f"U{number - again:06}", FIRST + number * every
        started = moment.isoformat(timespec="milliseconds")
        yield sample | {
            "run": f"{moment:%Y%m%dT%H%M%S}.000Z-{serial}", "serial": serial, "attempt": 1 + again,
            "started": started, "ended": started, "hour": hour_of(started), "again": again or failed,
            "first": not again, "verdict": "FAIL" if failed else "NOT DECIDABLE" if undecided else "PASS",
            "valid": not undecided,
            "objection": "measurement invalid: drift" if undecided else "",
            "model": MODELS[moment.toordinal() % len(MODELS)], "operator": OPERATORS[moment.hour // 8],
            "fixture": FIXTURES[moment.day % len(FIXTURES)], "lock_angle_deg": number * 37.7 % 360.0,
        }  # fmt: skip


def make_store(data: Path, count: int) -> None:
    """Make the folder with its chain, and its store with metrics, checks and alarms of every run."""
    many = count >= MANY
    every = timedelta(minutes=1 if many else 4)
    measured = min(REAL, count)
    make_runs(data, measured, first=(count - measured) * every // timedelta(minutes=4))
    while bring_up(data, 60.0):
        pass
    chain, database = Chain(data), opened(data)
    with database.writing() as connection:
        _begin_filling(connection)
        real = select(RUNS).where(RUNS.c.chain == chain.id).order_by(RUNS.c.run).limit(1)
        sample = dict(connection.execute(real).mappings().one())
        rows = older_rows(sample, count - measured, every)
        while some := list(islice(rows, AT_A_TIME)):
            make_months(connection, (some[0]["run"], some[-1]["run"]))
            _put(connection, some)
        given = {"sample": sample["run"], "real": sample["run"], "chain": chain.id, "metrics": METRICS_OF_A_RUN}
        for statement in MULTIPLIED:
            asked = text(statement.format(**WORDS[connection.dialect.name]))
            connection.execute(asked, {name: value for name, value in given.items() if f":{name}" in statement})
        _end_filling(connection)
        _count_hours(connection, chain.id)
        if not many:
            lines = chain.content.splitlines(keepends=True)
            content = lines[0] + (lines[1] + lines[2]) * (count - measured) + b"".join(lines[1:])
            chain.path.write_bytes(content)
            there = {"offset": len(content), "prefix_sha256": hashlib.sha256(content).hexdigest()}
            seen = Chain(data).seen_now()
            connection.execute(update(PROJECTIONS).where(PROJECTIONS.c.chain == chain.id).values(seen=seen, **there))
    _clean_up(database)
    database.close()


def _put(connection: Connection, rows: list[dict[str, Any]]) -> None:
    """Insert runs; by COPY on PostgreSQL, which takes a third of the time."""
    if connection.dialect.name == "sqlite":
        connection.execute(insert(RUNS), rows)
        return
    names = [column.name for column in RUNS.columns]
    driver: Any = connection.connection.driver_connection
    with driver.cursor() as cursor, cursor.copy(f"COPY runs ({', '.join(names)}) FROM STDIN") as copy:
        for row in rows:
            copy.write_row([row[name] for name in names])


def _count_hours(connection: Connection, chain: str) -> None:
    """Count the hours; on PostgreSQL by the database: of millions of values nobody needs the last bit here."""
    if connection.dialect.name == "sqlite":
        count_all_hours(connection)
        return
    for statement in (RUNS_BY_HOUR, METRICS_BY_HOUR):
        connection.execute(text(statement), {"chain": chain})


def _begin_filling(connection: Connection) -> None:
    if connection.dialect.name == "postgresql":
        connection.execute(text("SET LOCAL maintenance_work_mem = '1GB'"))
        connection.execute(text("SET LOCAL synchronous_commit = off"))
        for table in (RUNS, METRICS, CHECKS):
            for index in table.indexes:
                index.drop(connection)


def _end_filling(connection: Connection) -> None:
    if connection.dialect.name == "postgresql":
        for table in (RUNS, METRICS, CHECKS):
            for index in sorted(table.indexes, key=lambda one: str(one.name)):
                index.create(connection)


OWN_ROWS = "SELECT relname FROM pg_class WHERE relkind = 'r' AND relnamespace = 'public'::regnamespace ORDER BY relname"
"""Tables with rows of their own: PostgreSQL cleans up each month, and never the whole of which it is a part."""


def _clean_up(database: Database) -> None:
    """Do at once what the database does by itself some minutes after many rows came, and the station's server then."""
    if database.place.url.startswith("postgresql"):
        engine = create_engine(database.place.url, isolation_level="AUTOCOMMIT")
        with engine.connect() as connection:
            for table in connection.execute(text(OWN_ROWS)).scalars().all():
                connection.execute(text(f'VACUUM ANALYZE "{table}"'))
        engine.dispose()
        database.learn_sizes()


class Server:
    """A PostgreSQL server of this program's own, and how much of the processor it took; or none, for SQLite."""

    def __init__(self, folder: Path | None) -> None:
        self._pid = None
        if folder is not None:
            os.environ[STORE_URL] = own_server(folder)
            self._pid = int((folder / "postmaster.pid").read_text().split()[0])

    def work_s(self) -> float:
        """Return the processor time of the server with all its processes, those that are over among them."""
        if self._pid is None:
            return 0.0
        time.sleep(0.05)  # until it has seen that the process of a connection that was closed is over
        ticks = sum(_times(self._pid)[:4])
        for file in Path(f"/proc/{self._pid}/task").glob("*/children"):
            for child in map(int, file.read_text().split()):
                with suppress(OSError):  # one that has ended meanwhile
                    ticks += sum(_times(child)[:2])
        return ticks / os.sysconf("SC_CLK_TCK")


def _times(pid: int) -> list[int]:
    """Return the processor time of a process and of its children that are over, in user and system mode [ticks]."""
    return [int(one) for one in Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:15]]


def times_ms(call: Callable[[], object], tries: int, server: Server) -> tuple[float, float, float]:
    """Return how long a call takes: median, 95th percentile, and that of the processor's time, in milliseconds."""
    walls, work = [], []
    for _ in range(tries):
        there, before, started = server.work_s(), time.process_time(), time.perf_counter()
        call()
        walls.append(1e3 * (time.perf_counter() - started))
        own = time.process_time() - before
        work.append(1e3 * (own + server.work_s() - there))
    if tries == 1:
        return walls[0], walls[0], work[0]
    return statistics.median(walls), statistics.quantiles(walls, n=20)[-1], statistics.quantiles(work, n=20)[-1]


def asked_for(description: str | None, tries: int, runs: int = 200_000) -> argparse.Namespace:
    """Return what the command line of such a benchmark asks for."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--runs", type=int, default=runs)
    parser.add_argument("--tries", type=int, default=tries)
    parser.add_argument("--postgresql", action="store_true", help="on a server of its own, instead of SQLite")
    parser.add_argument("--folder", type=Path, help="keep the folder there, and use it again")
    return parser.parse_args()


def made_or_there(asked: argparse.Namespace) -> tuple[Path, Path, Server]:
    """Return the place that was asked for, the data folder in it, made if it is not there, and the server."""
    place = asked.folder or Path(tempfile.mkdtemp(prefix="lostmotion-plant-"))
    os.environ["LOSTMOTION_STATE"] = str(place / "state")
    name = "postgresql" if asked.postgresql else "sqlite"
    server = Server(place / "server" if asked.postgresql else None)
    data = place / f"runs-{asked.runs}-{name}"
    if not data.exists():
        started = time.perf_counter()
        make_store(data, asked.runs)
        print(f"made in {time.perf_counter() - started:.0f} s")
    sizes = ", ".join(f"{one.name} {one.stat().st_size / 1e6:.0f} MB" for one in data.iterdir() if one.is_file())
    print(f"{asked.runs} runs, {name}: {sizes}")
    return place, data, server


def measure(description: str | None, questions: Mapping[str, Question], *, tries: int) -> None:
    """Ask every question of a big store, and say whether all stay within their times."""
    asked = asked_for(description, tries)
    place, data, server = made_or_there(asked)
    keep_connections()  # as the server of the pages does
    print(f"{'':40} {'median':>8} {'p95':>8} {'processor p95':>14} {'allowed':>8} ms")
    slow = []
    for name, (ask, allowed_ms) in questions.items():
        ask(data)
        median, p95, work = times_ms(lambda ask=ask: ask(data), asked.tries, server)  # type: ignore[misc]
        print(f"{name:40} {median:8.0f} {p95:8.0f} {work:14.0f} {allowed_ms:8.0f}", flush=True)
        slow += [name] if work > allowed_ms else []
    if asked.folder is None:
        shutil.rmtree(place)
    if slow:
        sys.exit(f"took longer: {', '.join(slow)}")
