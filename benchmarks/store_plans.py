"""How PostgreSQL answers the commonest questions of a plant: `python -m benchmarks.store_plans [--runs N]`.

Two million runs with sixteen million values of metrics, and of every statement that the product itself sends for a
question the plan as it was carried out. Refused is a plan that reads a table of many rows from one end to the other.
See `benchmarks.plant_store` for what is there.
"""

from __future__ import annotations

import json
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from sqlalchemy import Connection, Engine, event

from benchmarks.plant_store import asked_for, made_or_there
from benchmarks.quality_speed import FIGURES, on_a_page
from benchmarks.search_speed import SEARCHES, page_of
from station.store.engine import Database
from station.store.plant.months import DIVIDED
from station.store.view import another_recipe, opened

RUNS = 2_000_000
MANY_ROWS = 10_000
"""Rows from which on a table is not to be read as a whole."""

OF_RUNS = ("runs", "attempts", "metrics", "checks", "alarms")
"""Tables that grow with every run. Those by the hour are made to be read: they have some rows an hour."""

MOST_OF_A_TABLE = 0.15
"""Share of a table's rows, in all months together, that a plan may read in whichever way: by an index or a month's own.

Of units measured again, one in twenty, a yield reads both runs.
"""

TEN = ("nothing asked", "one unit", "FAIL of a model, an operator, a week")
"""Searches among the ten commonest questions."""

QUESTIONS: dict[str, Callable[[Path], object]] = {
    **{f"search: {name}": partial(page_of, *SEARCHES[name]) for name in TEN},
    **{
        name: partial(on_a_page, FIGURES[name])
        for name in ("yield by month", "Pareto", "capability of all metrics", "control chart", "trend by month",
                     "limits on trial", "runs that are not believed")
    },
    "start of a run: another recipe": lambda data: another_recipe(data, "small", 1, "another", most_s=1.0),
}  # fmt: skip


class Statement(NamedTuple):
    """A statement as the product sent it, with its parameters."""

    text: str
    given: Any


class Scan(NamedTuple):
    """A node of a plan that reads rows; rows: all that it looked at, in all its loops."""

    kind: str
    table: str
    index: str
    rows: int


class Sizes(NamedTuple):
    """Rows of every table and month, and the table that a month is of."""

    rows: Mapping[str, int]
    whole: Mapping[str, str]


@contextmanager
def statements_sent() -> Iterator[list[Statement]]:
    """Record what the product asks of its database."""
    sent: list[Statement] = []

    def note(_connection: Any, _cursor: Any, text: str, given: Any, _context: Any, _many: bool) -> None:  # noqa: FBT001
        if text.lstrip().upper().startswith("SELECT") and "FROM" in text.upper() and "pg_catalog" not in text:
            sent.append(Statement(text, given))

    event.listen(Engine, "before_cursor_execute", note)
    try:
        yield sent
    finally:
        event.remove(Engine, "before_cursor_execute", note)


def plan_of(connection: Connection, statement: Statement, *, analyze: bool = True) -> dict[str, Any]:
    """Return the plan of a statement, as it was carried out where `analyze` asks for that."""
    options = "ANALYZE, FORMAT JSON" if analyze else "FORMAT JSON"
    found = connection.exec_driver_sql(f"EXPLAIN ({options}) {statement.text}", statement.given).scalar_one()
    (whole,) = json.loads(found) if isinstance(found, str) else found
    return dict(whole)


def scans_of(node: Mapping[str, Any]) -> Iterator[Scan]:
    """Yield every node of a plan that reads rows of a table, or would."""
    if "Relation Name" in node or ("Index Name" in node and "Scan" in node["Node Type"]):
        loops = node.get("Actual Loops", 1)
        read = node.get("Actual Rows", 0) + sum(node.get(name, 0) for name in REMOVED)
        yield Scan(node["Node Type"], node.get("Relation Name", ""), node.get("Index Name", ""), round(read * loops))
    for below in node.get("Plans", ()):
        yield from scans_of(below)


REMOVED = ("Rows Removed by Filter", "Rows Removed by Index Recheck")


def sizes_of(connection: Connection) -> Sizes:
    """Return how many rows tables have, as the database estimates it."""
    counted = connection.exec_driver_sql(
        "SELECT c.relname, CAST(greatest(c.reltuples, 0) AS bigint), coalesce(p.relname, c.relname) FROM pg_class c "
        "LEFT JOIN pg_inherits i ON i.inhrelid = c.oid LEFT JOIN pg_class p ON p.oid = i.inhparent "
        "WHERE c.relkind IN ('r', 'p') AND c.relnamespace = 'public'::regnamespace"
    ).all()
    rows = {name: int(number) for name, number, _ in counted}
    return Sizes(rows, {name: whole for name, _, whole in counted})


def full_scans(plan: Mapping[str, Any], sizes: Sizes) -> list[str]:
    """Return what a plan reads as a whole of tables with many rows, in words; nothing where it does not."""
    read: dict[str, int] = {}
    found = set()
    for scan in scans_of(plan["Plan"]):
        whole = sizes.whole.get(scan.table, scan.table)
        if whole not in OF_RUNS:
            continue
        if scan.kind.endswith("Seq Scan") and whole not in DIVIDED and sizes.rows[whole] >= MANY_ROWS:
            found.add(f"all of {whole}")
        read[whole] = read.get(whole, 0) + scan.rows
    for whole, rows in read.items():
        months = [number for name, number in sizes.rows.items() if sizes.whole[name] == whole and name != whole]
        there = sum(months) or sizes.rows[whole]
        if there >= MANY_ROWS and rows > MOST_OF_A_TABLE * there:
            found.add(f"{rows} of {there} rows of {whole}")
    return sorted(found)


def shown(plan: Mapping[str, Any], sizes: Sizes) -> str:
    """Return a plan's ways of reading in a line: what is read how, in how many months, and how many rows."""
    groups: dict[tuple[str, str], list[int]] = {}
    for scan in scans_of(plan["Plan"]):
        groups.setdefault((scan.kind, sizes.whole.get(scan.table, scan.index)), []).append(scan.rows)
    return "; ".join(
        f"{kind} {table} ×{len(rows)}: {sum(rows)} rows" for (kind, table), rows in groups.items()
    )  # fmt: skip


def ask_all(data: Path, database: Database) -> list[str]:
    """Print the plans of all questions; return what is wrong."""
    wrong = []
    for name, ask in QUESTIONS.items():
        ask(data)
        started = time.perf_counter()
        with statements_sent() as sent:
            ask(data)
        took_ms = 1e3 * (time.perf_counter() - started)
        print(f"\n{name}: {took_ms:.0f} ms, statements {len(sent)}")
        with database.reading() as connection:
            sizes = sizes_of(connection)
            for statement in dict.fromkeys((one.text, json.dumps(one.given, default=str)) for one in sent):
                one = next(each for each in sent if each.text == statement[0])
                plan = plan_of(connection, one)
                bad = full_scans(plan, sizes)
                took = plan["Planning Time"] + plan["Execution Time"]
                print(f"  {took:7.1f} ms  {shown(plan, sizes)}{'  REFUSED: ' + ', '.join(bad) if bad else ''}")
                wrong += [f"{name}: {each}" for each in bad]
    return list(dict.fromkeys(wrong))


def main() -> None:
    """Make the store, ask, and say whether a plan is refused."""
    asked = asked_for(__doc__, 1, runs=RUNS)
    asked.postgresql = True
    place, data, _server = made_or_there(asked)
    database = opened(data)
    with database.reading() as connection:
        rows = sizes_of(connection)
    for table in ("runs", "metrics", "checks", "run_hours", "metric_hours"):
        there = [number for name, number in rows.rows.items() if rows.whole[name] == table and name != table]
        print(f"{table}: {sum(there) or rows.rows[table]} rows, months {len(there)}")
    wrong = ask_all(data, database)
    database.close()
    if asked.folder is None:
        shutil.rmtree(place)
    if wrong:
        sys.exit("\n".join(["", "plans that read a big table as a whole:", *wrong]))
    print("\nno plan reads a big table as a whole")


if __name__ == "__main__":
    main()
