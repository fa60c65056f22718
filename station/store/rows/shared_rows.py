"""Rows that several runs share: recipes and benches by their hash, units by their serial number.

What a file is called stands in the file. So a recipe's and a bench's row is read in the copy of a run that still has
the hash with which the run began: whichever run it comes from, it is the same row, and an altered run.json has no say.
What a unit is stands in run.json alone: only one that was sealed and is as it was then gives a row.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

from sqlalchemy import Column, ColumnElement, Connection, Table, delete, select

from definitions.number_formats import LARGEST_COUNT
from recipes.text.problems import RecipeError
from recipes.text.yaml_source import parse_source, read_bytes
from station.documents.manifest import Manifest
from station.records.chain.chain_file import Chain
from station.records.run_record import BENCH_COPY, RECIPE_COPY, RunRecord
from station.store.tables import ATTEMPTS, BENCHES, RECIPES, RUNS, UNITS, Row, Rows, putting

REFERENCES: Mapping[Table, tuple[Column[Any], Column[Any]]] = {
    RECIPES: (RECIPES.c.sha256, ATTEMPTS.c.recipe_sha256),
    BENCHES: (BENCHES.c.sha256, ATTEMPTS.c.bench_sha256),
    UNITS: (UNITS.c.serial, ATTEMPTS.c.serial),
}
"""By which column the rows of a table are named, and in which one attempts name them."""

AT_ONCE = 500
"""Runs or rows that one statement names."""

KEPT_HEADS = 64
"""Files whose head is kept: a data folder has runs by a few recipes on a few benches."""

Named = dict[Table, set[str]]
"""Names of shared rows, by table."""


class Head(NamedTuple):
    """What a recipe or a bench is called by its file; embedded, public_key: of a bench."""

    name: str
    revision: int
    embedded: bool
    public_key: str | None


def file_rows(run: RunRecord, chain: Chain, recipe_sha256: str, bench_sha256: str) -> Rows:
    """Return the rows of the recipe and the bench that a run began with; none where its copy is another one now."""
    recipe = _head(_content(run, RECIPE_COPY), recipe_sha256, "recipe")
    bench = _head(_content(run, BENCH_COPY), bench_sha256, "bench")
    found: Rows = {}
    if recipe is not None:
        found[RECIPES] = [
            {"chain": chain.id, "sha256": recipe_sha256, "name": recipe.name, "revision": recipe.revision}
        ]
    if bench is not None:
        found[BENCHES] = [{"chain": chain.id, "sha256": bench_sha256, **bench._asdict()}]
    return found


def unit_rows(chain: Chain, manifest: Manifest) -> Rows:
    """Return the row of the unit of a run that was sealed and is as it was then."""
    unit = manifest.unit
    return {UNITS: [{"chain": chain.id, "serial": manifest.serial, "model": unit.model, "virtual": unit.virtual or ""}]}


def put_shared(connection: Connection, table: Table, content: Iterable[Row]) -> None:
    """Put shared rows where they are not there yet; one that an older version took from an altered run.json goes."""
    keys = [column.name for column in table.primary_key]
    rows = {tuple(row[key] for key in keys): row for row in content}
    if rows:
        connection.execute(putting(table, renew=True), list(rows.values()))


def shared_by(connection: Connection, chain: Chain, runs: Sequence[str]) -> dict[str, Row]:
    """Return what stored runs name, and whether they gave a unit's row, for `drop_unnamed` when they are put anew."""
    together = (RUNS.c.chain == ATTEMPTS.c.chain) & (RUNS.c.run == ATTEMPTS.c.run)
    names = (ATTEMPTS.c.run, ATTEMPTS.c.serial, ATTEMPTS.c.recipe_sha256, ATTEMPTS.c.bench_sha256)
    asked = select(*names, RUNS.c.sha256, RUNS.c.altered).select_from(ATTEMPTS).outerjoin(RUNS, together)
    found: dict[str, Row] = {}
    for begin in range(0, len(runs), AT_ONCE):
        some = asked.where(ATTEMPTS.c.chain == chain.id, ATTEMPTS.c.run.in_(runs[begin : begin + AT_ONCE]))
        found |= {str(row["run"]): dict(row) for row in connection.execute(some).mappings()}
    return found


def drop_unnamed(
    connection: Connection,
    chain: Chain,
    before: Mapping[str, Row],
    now: Mapping[str, Rows],
    rows_of_run: Callable[[RunRecord], Rows],
) -> None:
    """Remove the shared rows that runs gave before and that no stored run gives any more.

    Args:
        connection: that of the transaction in which the rows of the runs were replaced.
        chain: of the data folder.
        before: what `shared_by` said of the runs.
        now: the rows that they have instead; none of a run that was removed.
        rows_of_run: returns the rows of any run.

    """
    for table, names in _no_longer_given(before, now).items():
        own, named = REFERENCES[table]
        for name in _there(connection, chain, own, names):
            connection.execute(delete(table).where(table.c.chain == chain.id, own == name))
            for run in _runs(connection, chain, named == name):
                rows = rows_of_run(RunRecord(chain.data / run)).get(table, [])
                put_shared(connection, table, rows)
                if rows and table is not UNITS:  # every copy of a file says the same
                    break


def _no_longer_given(before: Mapping[str, Row], now: Mapping[str, Rows]) -> Named:
    found: Named = {table: set() for table in REFERENCES}
    for run, was in before.items():
        rows = now.get(run, {})
        for table, name in ((RECIPES, was["recipe_sha256"]), (BENCHES, was["bench_sha256"])):
            if name not in [row["sha256"] for row in rows.get(table, [])]:
                found[table].add(str(name))
        sealed = [row["sha256"] for row in rows.get(RUNS, [])] if UNITS in rows else []
        same = was["sha256"] is not None and was["sha256"] in sealed
        if was["altered"] == "" and not same:
            found[UNITS].add(str(was["serial"]))
    return found


def _there(connection: Connection, chain: Chain, own: Column[Any], names: Collection[str]) -> list[str]:
    """Return which of these names the table has."""
    wanted, found = sorted(names), set[str]()
    for begin in range(0, len(wanted), AT_ONCE):
        some = own.in_(wanted[begin : begin + AT_ONCE])
        found.update(connection.execute(select(own).where(own.table.c.chain == chain.id, some)).scalars())
    return sorted(found)


def _runs(connection: Connection, chain: Chain, condition: ColumnElement[bool]) -> Iterator[str]:
    """Yield the attempts of a condition, in order; of the first few no more than these are read."""
    last = ""
    asked = select(ATTEMPTS.c.run).where(ATTEMPTS.c.chain == chain.id, condition).order_by(ATTEMPTS.c.run)
    while found := connection.execute(asked.where(ATTEMPTS.c.run > last).limit(AT_ONCE)).scalars().all():
        yield from found
        last = found[-1]


def _content(run: RunRecord, name: str) -> bytes:
    try:
        return read_bytes(run.folder / name)
    except RecipeError:
        return b""


@lru_cache(KEPT_HEADS)
def _head(content: bytes, sha256: str, section: str) -> Head | None:
    """Return the head of a recipe or bench file of this hash; None where it is another file, or has no such head."""
    if hashlib.sha256(content).hexdigest() != sha256:
        return None
    try:
        document = parse_source(content, section).data
    except RecipeError:
        return None
    head = document.get(section) if isinstance(document, dict) else None
    if not isinstance(head, dict) or not isinstance(head.get("name"), str):
        return None
    revision, key = head.get("revision"), head.get("public_key")
    if type(revision) is not int or not 0 <= revision <= LARGEST_COUNT:
        return None
    return Head(head["name"], revision, head.get("embedded") is True, key if isinstance(key, str) else None)
