"""All runs of a data folder as one table: a row for each run, with every side of its metrics beside one another."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from sqlalchemy import select

from station.store.attempts import attempts_told
from station.store.plant.meanings import meanings_of
from station.store.stored_runs import COLUMNS, StoredRun, Wanted, believed, meant
from station.store.tables import METRICS, RUNS
from station.store.view import View

RUN_COLUMNS = (
    "run", "started", "ended", "serial", "attempt", "attempts", "model", "recipe", "revision", "bench", "fixture",
    "lock_angle_deg", "operator", "clock", "virtual", "master", "scenario", "state", "verdict", "objection", "altered",
)  # fmt: skip
"""What a row says of its run; `attempts`: which one it is, and what became of those before."""


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
    """A run as far as it is believed, which attempt it is in words, and its values by column."""

    run: StoredRun
    attempts: str = ""
    values: dict[MetricColumn, Value] = field(default_factory=dict)

    def cell(self, name: str) -> object:
        """Return what stands in a column of `RUN_COLUMNS`."""
        return self.attempts if name == "attempts" else getattr(self.run, name)


def run_table(view: View, wanted: Wanted) -> list[RunTableRow]:
    """Return every concluded run that is meant, oldest first; the verdict that is asked for is one that is believed."""
    found: dict[str, RunTableRow] = {}
    with view.database.reading() as connection:
        asked = meant(select(*COLUMNS), view.chain, wanted).order_by(RUNS.c.run)
        for stored in map(StoredRun._make, connection.execute(asked).all()):
            run = believed(stored, view.chain, view.trust)
            if wanted.verdict is None or run.verdict == wanted.verdict:
                found[run.run] = RunTableRow(run)
        told = attempts_told(connection, view.chain, view.trust, (row.run for row in found.values()))
        for name, text in told.items():
            found[name].attempts = text
        together = (METRICS.c.chain == RUNS.c.chain) & (METRICS.c.run == RUNS.c.run)
        of_metrics = [METRICS.c[name] for name in ("run", "meaning", "side", *Value._fields)]
        asked = meant(select(*of_metrics).select_from(RUNS).join(METRICS, together), view.chain, wanted)
        meanings = meanings_of(connection, view.chain.id)
        for name, meaning, side, *rest in connection.execute(asked.order_by(METRICS.c.run, METRICS.c.position)).all():
            if name in found:
                of, value = meanings[meaning], Value(*rest)
                column = MetricColumn(of.metric, of.choices, of.branch, side, of.unit)
                found[name].values[column] = value._replace(verdict=None) if found[name].run.altered else value
    return list(found.values())


def columns_of(rows: Iterable[RunTableRow]) -> list[MetricColumn]:
    """Return the columns of all rows, in the order in which they come first."""
    return list(dict.fromkeys(column for row in rows for column in row.values))
