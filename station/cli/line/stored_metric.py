"""One metric of one stored run: whether the run counts, which of its metrics is meant, and its value on a side."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime
from operator import attrgetter
from typing import NamedTuple

from station.errors import StationError
from station.store.metric_rows import SAID, MetricRow, Place, RunThatDoesNotCount
from station.store.plant.hours import COMPLETE
from station.store.plant.meanings import Meaning
from station.store.stored_runs import is_trusted
from station.store.view import View

MISSING, ALTERED, DAMAGED = "whose folder is missing", "altered", "damaged"
"""Why a run is left out of which nobody knows any more what it was."""


class Kind(NamedTuple):
    """What a run was measured by: recipe, its revision, where the output torque comes from ('' where no stage says)."""

    recipe: str
    revision: int
    torque: str


@dataclass(frozen=True)
class Ask:
    """Which values are meant: metric, and what tells it from others of its id; None takes what there is.

    metric: an id, followed by what was chosen otherwise than its definition does: `spring_constant three_region`.
    studies: whether the runs of guided studies count; they do in a gage study. said: what else is read of a run, of
    SAID; what of it is not read cannot be asked of a value.
    """

    metric: str
    side: str | None = None
    branch: str | None = None
    recipe: str | None = None
    serial: str | None = None
    attempts: str = "all"
    studies: bool = False
    said: tuple[str, ...] = SAID


def asked_of(
    metric: str | None,
    side: str | None = None,
    branch: str | None = None,
    recipe: str | None = None,
    serial: str | None = None,
    *,
    attempts: str = "all",
    said: tuple[str, ...] = SAID,
) -> Ask | None:
    """Return what a command line asks of the stored runs; None without a metric: a file is meant."""
    return None if metric is None else Ask(metric, side, branch, recipe, serial, attempts, said=said)


class StoredValue(NamedTuple):
    """One run's value of a metric, and the row that says what it is a value of.

    What else is known of the run is read from its row where it is asked for: of 20 000 runs most is never looked at.
    """

    metric: MetricRow
    value: float

    @property
    def run_id(self) -> str:
        """Id of the run."""
        return self.metric.run

    @property
    def serial(self) -> str:
        """Serial number of the unit."""
        return self.metric.serial

    @property
    def started(self) -> datetime:
        """When the run was started."""
        return datetime.fromisoformat(_said(self.metric.started))

    @property
    def bench(self) -> str:
        """Name of the bench."""
        return _said(self.metric.bench)

    @property
    def operator(self) -> str:
        """Who ran it; '' where the run names nobody."""
        return self.metric.operator or ""


def _said(text: str | None) -> str:
    if text is None:
        raise TypeError("Ask.said does not name what is asked of a value")
    return text


def kinds_of(metrics: Iterable[MetricRow]) -> Counter[Kind]:
    """Count the runs by how they were measured."""
    counts = Counter(map(attrgetter("recipe", "revision", "torque_source"), metrics))
    return Counter({Kind._make(kind): count for kind, count in counts.items()})


def read_metric(rows: list[MetricRow], meanings: Mapping[int, Meaning], ask: Ask) -> MetricRow | str:
    """Return the metric of a run that is asked for, whatever the side, or why the run is left out, in words.

    Args:
        rows: of the run and the metric that is asked for.
        meanings: what they mean, by number.
        ask: which value is meant.

    Raises:
        StationError: the metric stands in the run more than once.

    """
    return _metric(rows, meanings, ask) or f"without {ask.metric}"


def value_of(metric: MetricRow, ask: Ask, beside: Mapping[Place, float | None]) -> StoredValue | str:
    """Return the value of the side that is asked for, or why there is none, in words.

    beside: values of that side where the verdict goes by another one.
    """
    value = metric.value
    if ask.side is not None and ask.side != metric.side:
        place = metric.run, metric.position
        if place not in beside:
            return f"without side {ask.side} of {ask.metric} (there is {metric.side})"
        value = beside[place]
    return "whose value could not be evaluated" if value is None else StoredValue(metric, value)


def why_left_out(view: View, run: RunThatDoesNotCount) -> str:
    """Return why a run does not count, in words."""
    if not run.recipe:
        return DAMAGED
    if run.state != COMPLETE:
        return f"that ended as {run.state}"
    if run.run in view.missing:
        return MISSING
    if run.altered or not is_trusted(run.key, view.chain, view.trust):
        return ALTERED
    if run.objection:
        return "whose measurement was invalid"
    return "of a master part" if run.master else "of a guided study"


def _metric(rows: list[MetricRow], meanings: Mapping[int, Meaning], ask: Ask) -> MetricRow | None:
    """Return the metric that is asked for; of several with its id, the one with no other choices."""
    if len(rows) == 1 and ask.branch is None and " " not in ask.metric:
        return rows[0] if rows[0].position is not None else None
    name, *words = ask.metric.split() or [""]
    there = [(row, meanings[row.meaning]) for row in rows if row.position is not None]
    wanted = [(row, of) for row, of in there if ask.branch in (None, of.branch)]
    if len(wanted) == 1 and not words:
        return wanted[0][0]
    found = [(row, of) for row, of in wanted if set(words) <= set(of.choices.split())]
    exact = [(row, of) for row, of in found if set(words) == set(of.choices.split())]
    if len(found) > 1 and len(exact) != 1:
        named = ", ".join(" ".join(f"{name} {of.choices} ({of.branch})".split()) for _, of in found)
        raise StationError(
            f"--metric: run {rows[0].run} has {len(found)} values of {ask.metric}: {named}. Choose one with --branch, "
            "or name its options behind the metric, in quotes"
        )
    chosen = exact or found
    return chosen[0][0] if chosen else None
