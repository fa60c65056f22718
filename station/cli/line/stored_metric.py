"""One metric of one stored run: whether the run counts, which of its metrics is meant, its value and its kind."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from itertools import groupby
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

from station.errors import StationError
from station.records.run_record import RunRecord
from station.store.metric_rows import MetricRow
from station.store.view import View


class Kind(NamedTuple):
    """What a run was measured by: recipe, its revision, where the output torque comes from ('' where no stage says)."""

    recipe: str
    revision: int
    torque: str


@dataclass(frozen=True)
class Ask:
    """Which values are meant: metric, and what tells it from others of its id; None takes what there is.

    metric: an id, followed by what was chosen otherwise than its definition does: `spring_constant three_region`.
    """

    metric: str
    side: str | None = None
    branch: str | None = None
    recipe: str | None = None
    serial: str | None = None
    attempts: str = "all"


def asked_of(
    metric: str | None,
    side: str | None = None,
    branch: str | None = None,
    recipe: str | None = None,
    serial: str | None = None,
    *,
    attempts: str = "all",
) -> Ask | None:
    """Return what a command line asks of the stored runs; None without a metric: a file is meant."""
    return None if metric is None else Ask(metric, side, branch, recipe, serial, attempts)


class StoredValue(NamedTuple):
    """One run's value of a metric, with the run it came from; operator: '' where the run has none."""

    data: Path
    run_id: str
    serial: str
    started: datetime
    bench: str
    value: float
    virtual: bool
    operator: str = ""
    faults: bool = False

    @property
    def run(self) -> RunRecord:
        """Folder of the run."""
        return RunRecord(self.data / self.run_id)


class StoredMetric(NamedTuple):
    """What a run that counts has of the metric: its value, the row that it stands in, the kind of the run."""

    value: StoredValue
    metric: MetricRow
    kind: Kind


def read_metric(view: View, rows: list[MetricRow], ask: Ask) -> StoredMetric | str:
    """Return what a run has of the metric, or why it is left out, in words.

    Args:
        view: the data folder.
        rows: of the run and the metric that is asked for.
        ask: which value is meant.

    Raises:
        RecordError: the record is damaged.
        StationError: the metric stands in the run more than once.

    """
    run = rows[0]
    reason = _left_out(view, run) or ("of a master part" if run.master and ask.serial is None else "")
    if reason:
        return reason
    metric = _metric(rows, ask)
    if metric is None:
        return f"without {ask.metric}"
    sides = {row.side: row.value for row in metric}
    side = metric[0].side if ask.side is None else ask.side
    if side not in sides:
        return f"without side {side} of {ask.metric} (there is {' and '.join(sorted(sides))})"
    value = sides[side]
    if value is None:
        return "whose value could not be evaluated"
    started = datetime.fromisoformat(run.started)
    who, faults = run.operator or "", bool(run.scenario)
    found = StoredValue(view.data, run.run, run.serial, started, run.bench, value, run.virtual, who, faults)
    return StoredMetric(found, metric[0], Kind(run.recipe, run.revision, run.torque_source))


def _left_out(view: View, run: MetricRow) -> str:
    """Return why a run does not count; '' where it does."""
    if not run.recipe:
        return "damaged"
    if run.state != "complete":
        return f"that ended as {run.state}"
    if view.missing and run.run in view.missing:
        return "whose folder is missing"
    if run.altered or not view.trusted(run.key):
        return "altered"
    return "whose measurement was invalid" if run.objection else ""


def _metric(rows: list[MetricRow], ask: Ask) -> list[MetricRow] | None:
    """Return the rows of the metric that is asked for; of several with its id, the one with no other choices."""
    if len(rows) == 1 and ask.branch is None and " " not in ask.metric:
        return rows if rows[0].position is not None else None
    name, *words = ask.metric.split() or [""]
    wanted = [row for row in rows if row.position is not None and ask.branch in (None, row.branch)]
    of_id = [list(group) for _, group in groupby(wanted, key=attrgetter("position"))]
    found = [one for one in of_id if set(words) <= set(one[0].choices.split())]
    exact = [one for one in found if set(words) == set(one[0].choices.split())]
    if len(found) > 1 and len(exact) != 1:
        there = ", ".join(" ".join(f"{name} {one[0].choices} ({one[0].branch})".split()) for one in found)
        raise StationError(
            f"--metric: {ask.metric} stands {len(found)} times in run {rows[0].run}: {there}. Choose with --branch, or "
            "name the choice with the metric in quotes"
        )
    chosen = exact or found
    return chosen[0] if chosen else None
