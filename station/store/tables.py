"""The tables of the store. Every row belongs to one data folder, named by its chain.

All but `projections` can be made again from the run folders and the note on their archive; nothing else is kept here.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    Column,
    ColumnElement,
    Double,
    Index,
    Integer,
    MetaData,
    Table,
    TextClause,
    false,
    literal_column,
    text,
)
from sqlalchemy import Text as AnyText

METADATA = MetaData()

Row = dict[str, object]
"""A row for the database, by the names of its columns, whose types stand in this module."""

Rows = dict[Table, list[Row]]

Text = AnyText().with_variant(AnyText(collation="C"), "postgresql")
"""Texts are ordered by their characters, as Python does it, whatever the language of a server: months rely on it."""


BY_MONTH = {"postgresql_partition_by": "RANGE (run)"}
"""Of a table that PostgreSQL keeps in months: see `plant.months`."""


def _of_a_chain(name: str, *columns: Column[Any] | Index, **options: Any) -> Table:
    # On SQLite the rows lie in the order of their key, so that those of a chain are read in one go.
    key = Column("chain", Text, primary_key=True)
    return Table(name, METADATA, key, *columns, sqlite_with_rowid=False, **options)


def _key(name: str, kind: Any = Text) -> Column[Any]:
    return Column(name, kind, primary_key=True, autoincrement=False)


OF_AGAIN: ColumnElement[bool] = literal_column("again")
"""That a unit was measured again: the same word in the index and in what asks for it, or the index is not used."""

PROJECTIONS = _of_a_chain(
    "projections",
    Column("offset", BigInteger, nullable=False),
    Column("counter", Integer, nullable=False),
    Column("sha256", Text, nullable=False),
    Column("prefix_sha256", Text, nullable=False),
    Column("problems", JSON, nullable=False),
    Column("keys", JSON, nullable=False),
    Column("seen", Text, nullable=False, server_default=""),
)
"""How far each chain is in the store: bytes of its file, last entry, hash of all before, and what was wrong there.

`seen`: size, times and inode of the file when all of it was there; '' where some was not.
"""

RECIPES = _of_a_chain(
    "recipes",
    _key("sha256"),
    Column("name", Text, nullable=False),
    Column("revision", Integer),
)

BENCHES = _of_a_chain(
    "benches",
    _key("sha256"),
    Column("name", Text, nullable=False),
    Column("revision", Integer),
    Column("embedded", Boolean),
    Column("public_key", Text),
)

UNITS = _of_a_chain("units", _key("serial"), _key("model"), _key("virtual"))
"""Units under test; `virtual` is the unit on the virtual bench, '' for a real one. See `shared_rows`."""

ATTEMPTS = _of_a_chain(
    "attempts",
    _key("run"),
    Column("counter", Integer),
    Column("serial", Text, nullable=False),
    Column("attempt", Integer, nullable=False),
    Column("recipe_sha256", Text, nullable=False),
    Column("bench_sha256", Text, nullable=False),
    Column("created", Text),
    Column("key", Text),
    Index("attempts_serial", "chain", "serial", "attempt"),
    Index("attempts_recipe", "chain", "recipe_sha256"),
)
"""Every run that was begun. A run from before the chain has no counter and no key."""

RUNS = _of_a_chain(
    "runs",
    _key("run"),
    Column("counter", Integer),
    Column("entry_sha256", Text),
    Column("key", Text),
    Column("sha256", Text),
    Column("state", Text, nullable=False),
    Column("verdict", Text),
    Column("serial", Text, nullable=False),
    Column("attempt", Integer, nullable=False),
    Column("model", Text, nullable=False, server_default=""),
    Column("recipe", Text, nullable=False),
    Column("revision", Integer),
    Column("bench", Text, nullable=False),
    Column("started", Text),
    Column("ended", Text),
    Column("operator", Text),
    Column("scenario", Text),
    Column("clock", Text),
    Column("virtual", Boolean, nullable=False),
    Column("master", Text, nullable=False, server_default=""),
    Column("torque_source", Text, nullable=False),
    Column("objection", Text, nullable=False),
    Column("records", Integer),
    Column("altered", Text, nullable=False),
    Column("seen", Text, nullable=False),
    Column("seen_files", Text, nullable=False),
    Column("in_production", Boolean, nullable=False, server_default=false()),
    Column("valid", Boolean, nullable=False, server_default=false()),
    Column("hour", Text, nullable=False, server_default=""),
    Index("runs_hour", "chain", "hour"),
    Column("again", Boolean, nullable=False, server_default=false()),
    Column("fixture", Text, nullable=False, server_default=""),
    Column("lock_angle_deg", Double),
    Column("first", Boolean, nullable=False, server_default=false()),
    Index(
        "runs_again",
        "chain",
        "in_production",
        "virtual",
        "serial",
        "run",
        "attempt",
        "key",
        "state",
        "verdict",
        "recipe",
        "revision",
        "model",
        "bench",
        "operator",
        "started",
        "hour",
        "fixture",
        "lock_angle_deg",
        "first",
        sqlite_where=OF_AGAIN,
        postgresql_where=OF_AGAIN,
    ),
    Index("runs_recipe", "chain", "recipe"),
    Index("runs_serial", "chain", "serial"),
    Index("runs_model", "chain", "model"),
    Index("runs_search", "chain", "run", "serial", "model", "recipe", "verdict", "operator", "started", "master"),
    Index(
        "runs_quality",
        "chain",
        "in_production",
        "virtual",
        "run",
        "attempt",
        "key",
        "state",
        "verdict",
        "valid",
        "serial",
        "recipe",
        "revision",
        "model",
        "bench",
        "operator",
        "started",
        "hour",
        "fixture",
        "lock_angle_deg",
        "first",
    ),
    **BY_MONTH,
)
"""Every run that was concluded. `altered` has a line for each alteration, and is '' for none.

`master`: of a master part, the verdict that it should have; '' for a product.

`in_production`: unaltered, of a product, without injected faults, of no guided study. `valid`: unaltered, complete, its
measurement valid.
`hour`: of its start, in UTC, as in 2026-01-31T06. `again`: its unit was measured more than once; see `plant.retests`.
`first`: the first attempt at its unit that is of its kind; see `plant.retests`.
`fixture`: its name in the bench file, '' where that gives none. `lock_angle_deg`: of the locked shaft when the lock had
closed, from 0 to 360; none where the record says none.

`seen`, `seen_files`: size, times and inode of the files that were compared. `runs_quality` holds all that statistics of
a production ask of a run. The index `runs_search` holds all that runs
are looked for by, so that a search and its count read none of the rows that are not shown.
"""

MEANINGS = _of_a_chain(
    "meanings",
    _key("meaning", BigInteger),
    *(
        Column(name, Text, nullable=False)
        for name in ("metric", "choices", "branch", "definition", "estimator", "band", "torque_nm", "unit")
    ),
)
"""What metrics mean, by a number that is made of the texts: all that must be the same for values to be of one kind.

`band` and `torque_nm` are JSON as text: a number or two. `choices` is the words of the choices.
"""

METRICS = _of_a_chain(
    "metrics",
    _key("run"),
    _key("position", Integer),
    _key("side"),
    Column("main", Boolean, nullable=False),
    Column("meaning", BigInteger, nullable=False),
    Column("cycles", Integer),
    Column("value", Double),
    Column("uncertainty", Double),
    Column("coverage_factor", Double),
    Column("limit_min", Double),
    Column("limit_max", Double),
    Column("verdict", Text),
    Index("metrics_meaning", "chain", "meaning", "run", "side", "main", "position", "value"),
    **BY_MONTH,
)
"""Every side of every metric, with its limits, its expanded uncertainty and its own verdict.

`main` is the side that the metric goes by. The verdict of a metric is the worst of its sides': see `plant.hours`.
"""

CHECKS = _of_a_chain(
    "checks",
    _key("run"),
    _key("id"),
    Column("figure", Double),
    Column("limit", Double),
    Column("unit", Text),
    Column("passed", Boolean),
    Column("text", Text),
    **BY_MONTH,
)
"""Validity checks."""

ALARMS = _of_a_chain(
    "alarms",
    _key("run"),
    _key("position", Integer),
    Column("id", Text),
    Column("scan", Integer),
    Column("t_s", Double),
    Column("state", Text),
    Column("reaction", Text),
    Column("first", Boolean),
    Column("text", Text),
)

CALIBRATIONS = _of_a_chain(
    "calibrations",
    _key("run"),
    _key("quadrant"),
    Column("id", Text),
    Column("model", Text),
    Column("made", Text),
    Column("slope", Double),
    Column("offset_nm", Double),
    Column("u_slope", Double),
    Column("u_offset_nm", Double),
    Column("residual_sd_nm", Double),
    Column("points", Integer),
)
"""Torque ratios that runs measured, one row for each quadrant."""

ARCHIVED = _of_a_chain(
    "archived",
    _key("run"),
    Column("sha256", Text, nullable=False),
    Column("url", Text, nullable=False),
    Column("object", Text, nullable=False),
    Column("object_sha256", Text, nullable=False),
    Column("row_group", Integer, nullable=False),
    Column("trace_object", Text),
    Column("trace_row_group", Integer),
    Column("trace_sha256", Text),
    Column("verified", Text, nullable=False),
)
"""Where archived runs are: made again from `archive.jsonl` of the data folder. `sha256` is that of run.json."""

REMOVALS = _of_a_chain(
    "removals",
    _key("run"),
    Column("rule", Text, nullable=False),
    Column("key", Text, nullable=False),
)
"""Runs whose records a rule of retention has removed: by which rule, and who signed the line that says so."""

RUN_HOURS = _of_a_chain(
    "run_hours",
    *(_key(name) for name in ("hour", "bench", "recipe")),
    _key("revision", Integer),
    *(_key(name) for name in ("model", "operator", "key", "fixture", "state", "verdict", "master")),
    *(_key(name, Boolean) for name in ("virtual", "in_production", "valid", "first")),
    Column("runs", Integer, nullable=False),
)
"""How many runs began in an hour that have all of this in common; '' and -1 stand for what a run does not say.

`first`: first attempts, as in the runs. `run_hours` and `metric_hours` are counted from the runs: see `plant.hours`.
"""

METRIC_HOURS = _of_a_chain(
    "metric_hours",
    _key("meaning", BigInteger),
    *(_key(name) for name in ("side", "hour", "bench", "recipe")),
    _key("revision", Integer),
    *(_key(name) for name in ("model", "operator", "key", "fixture")),
    _key("virtual", Boolean),
    Column("number", Integer, nullable=False),
    Column("mean", Double, nullable=False),
    Column("squares", Double, nullable=False),
    Column("failed", Integer, nullable=False),
    Index("metric_hours_hour", "chain", "hour"),
)
"""Values of one side of a metric in the first attempts of the production that began in an hour.

`number`, `mean`, `squares`: of the values of valid runs, the last one the sum of squared differences from the mean.
`failed`: of runs that failed, how often this failed in them.
"""

CAUSE_HOURS = _of_a_chain(
    "cause_hours",
    *(_key(name) for name in ("kind", "hour", "bench", "recipe")),
    _key("revision", Integer),
    *(_key(name) for name in ("model", "operator", "key")),
    _key("virtual", Boolean),
    _key("name"),
    Column("runs", Integer, nullable=False),
    Index("cause_hours_hour", "chain", "hour"),
)
"""How many runs of the production that began in an hour an alarm came in, or have no verdict by a cause of a kind."""

OF_A_RUN = (ATTEMPTS, RUNS, METRICS, CHECKS, ALARMS, CALIBRATIONS)
"""Tables with rows of single runs."""


@cache
def putting(table: Table, *, renew: bool = False) -> TextClause:
    """Return the statement that puts whole rows into a table where none is that has their key.

    renew: one that is there gets the other values of the new one.

    Both databases have the same words for it. SQLAlchemy would find its own anew at each use.
    """
    names = [f'"{column.name}"' for column in table.columns]
    values = [f":{column.name}" for column in table.columns]
    keys = [f'"{column.name}"' for column in table.primary_key]
    said = [f"{name} = excluded.{name}" for name in names if name not in keys]
    then = f"({', '.join(keys)}) DO UPDATE SET {', '.join(said)}" if renew and said else "DO NOTHING"
    into = f"INSERT INTO {table.name} ({', '.join(names)}) VALUES ({', '.join(values)})"  # noqa: S608 - constants
    return text(f"{into} ON CONFLICT {then}")
