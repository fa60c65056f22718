"""All runs of a data folder as one table: a row for each run, with every side of its metrics beside one another."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from sqlalchemy import Select, select

from station.store.tables import METRICS, RUNS
from station.store.view import View

RUN_COLUMNS = (
    "run", "started", "ended", "serial", "attempt", "recipe", "revision", "bench", "operator", "clock", "virtual",
    "master", "scenario", "state", "verdict", "objection", "altered",
)  # fmt: skip
"""What a row says of its run."""

METRIC_COLUMNS = ("metric", "choices", "branch", "side", "unit")
"""What tells a column of values from the others."""


class Filters(NamedTuple):
    """Which runs are meant; None takes all. since: a moment as the runs have it, in UTC."""

    serial: str | None = None
    recipe: str | None = None
    verdict: str | None = None
    since: str | None = None


class MetricColumn(NamedTuple):
    """A metric with what was chosen of it, on one branch and side, in its unit."""

    metric: str
    choices: str
    branch: str
    side: str
    unit: str

    @property
    def name(self) -> str:
        """Return how the column is called."""
        side = "" if self.side == "both" else self.side
        return " ".join(part for part in (self.metric, self.choices, self.branch, side) if part)


class Value(NamedTuple):
    """A value with its expanded uncertainty and verdict, as far as there are any."""

    value: float | None
    uncertainty: float | None
    verdict: str | None


@dataclass
class RunTableRow:
    """A run: its entries by the names of `RUN_COLUMNS`, and its values by column.

    One that was altered, or signed by nobody whom this computer knows, has no verdict.
    """

    run: dict[str, str | int | bool | None]
    values: dict[MetricColumn, Value] = field(default_factory=dict)


def run_table(view: View, filters: Filters) -> list[RunTableRow]:
    """Return every concluded run that is meant, oldest first."""
    found: dict[str, RunTableRow] = {}
    with view.database.reading() as connection:
        columns = [RUNS.c[name] for name in (*RUN_COLUMNS, "key")]
        for *entries, key in connection.execute(_meant(select(*columns), view, filters).order_by(RUNS.c.run)).all():
            entry = dict(zip(RUN_COLUMNS, entries, strict=True))
            if not entry["altered"] and not view.trusted(key):
                entry["altered"] = f"is signed by {key}, which this computer does not know"
            entry |= {"verdict": None} if entry["altered"] else {}
            if filters.verdict is None or entry["verdict"] == filters.verdict:
                found[entry["run"]] = RunTableRow(entry)
        together = (METRICS.c.chain == RUNS.c.chain) & (METRICS.c.run == RUNS.c.run)
        of_metrics = [METRICS.c[name] for name in ("run", *METRIC_COLUMNS, *Value._fields)]
        asked = _meant(select(*of_metrics).select_from(RUNS).join(METRICS, together), view, filters)
        for run, *rest in connection.execute(asked.order_by(METRICS.c.run, METRICS.c.position)).all():
            if run in found:
                column = MetricColumn(*(text or "" for text in rest[: len(METRIC_COLUMNS)]))
                found[run].values[column] = Value(*rest[len(METRIC_COLUMNS) :])
    return list(found.values())


def columns_of(rows: Iterable[RunTableRow]) -> list[MetricColumn]:
    """Return the columns of all rows, in the order in which they come first."""
    return list(dict.fromkeys(column for row in rows for column in row.values))


def _meant(asked: Select[tuple[object, ...]], view: View, filters: Filters) -> Select[tuple[object, ...]]:
    """Return the runs of a folder's chain that pass the filters; the verdict is held against what is believed later."""
    asked = asked.where(RUNS.c.chain == view.chain.id)
    if filters.serial is not None:
        asked = asked.where(RUNS.c.serial == filters.serial)
    if filters.recipe is not None:
        asked = asked.where(RUNS.c.recipe == filters.recipe)
    if filters.since is not None:
        asked = asked.where(RUNS.c.started >= filters.since)
    return asked
