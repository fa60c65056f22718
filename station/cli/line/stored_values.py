"""One metric over many stored runs: which runs count, which were left out and why, and that they are comparable."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from analysis.metrics.former_wordings import wording_of_today
from station.cli.line.stored_metric import (
    ALTERED,
    DAMAGED,
    MISSING,
    Ask,
    Kind,
    StoredValue,
    kinds_of,
    read_metric,
    value_of,
    why_left_out,
)
from station.documents.result import Limits
from station.errors import RecordError, StationError
from station.records.run_record import RunRecord
from station.store.metric_rows import (
    MetricRow,
    Place,
    limits_of,
    metric_rows,
    runs_that_do_not_count,
    sides_of,
    values_beside,
)
from station.store.plant.meanings import Meaning
from station.store.view import View, look_at

ATTEMPTS = ("first", "last", "all")
"""Which runs of a serial number count: a retest must not count twice where each unit counts once."""

SAME = ("unit", "definition", "branch", "estimator", "band", "torque_nm")
"""What must be the same of a metric in every run, or the numbers are not of one kind."""


ELSEWHERE = frozenset({"not_in_chain", "lost_line", "copied", "renamed"})
"""Kinds of folder that are no run of this data folder, whatever they say."""


@dataclass(frozen=True)
class FromRuns:
    """Where the values of a study come from, for JSON: a metric of stored runs, and what was left out by its reason."""

    metric: str
    definition: str
    unit: str
    side: str | None
    recipe: str | None
    runs: list[str]
    left_out: Mapping[str, int]
    virtual_runs: int
    runs_with_faults: int


@dataclass(frozen=True)
class StoredValues:
    """Values of one metric in order of time, its limits in the newest run, and what was left out (reason, count)."""

    data: Path
    ask: Ask
    unit: str
    name: str
    definition: str
    limits: Limits
    values: list[StoredValue]
    left_out: Counter[str] = field(default_factory=Counter)
    kinds: Counter[Kind] = field(default_factory=Counter)

    def runs(self) -> list[RunRecord]:
        """Return the runs that the values are of."""
        return [RunRecord(self.data / one.run_id) for one in self.values]

    def notes(self) -> list[str]:
        """Return what a reader must know of the runs behind the figures."""
        virtual = sum(one.metric.virtual for one in self.values)
        notes = [f"VIRTUAL: {virtual} of {len(self.values)} runs are of the virtual bench"] if virtual else []
        faults = sum(bool(one.metric.scenario) for one in self.values)
        notes += [f"FAULTS INJECTED: in {faults} of {len(self.values)} runs"] if faults else []
        for what in ("revision", "torque"):
            counts = _counts(self.kinds, what)
            notes += [f"MIXED: {_listing(counts, what)}"] if len(counts) > 1 else []
        return notes + [f"left out: {count} {reason}" for reason, count in self.left_out.items()]

    def head(self) -> FromRuns:
        """Return what was taken."""
        return FromRuns(
            metric=self.ask.metric,
            definition=self.definition,
            unit=self.unit,
            side=self.ask.side,
            recipe=self.ask.recipe,
            runs=[one.run_id for one in self.values],
            left_out=self.left_out,
            virtual_runs=sum(one.metric.virtual for one in self.values),
            runs_with_faults=sum(bool(one.metric.scenario) for one in self.values),
        )


def stored_values(data: Path, ask: Ask, only: Collection[str] | None = None) -> StoredValues:
    """Collect one metric over the complete, unaltered runs of a data folder.

    only: ids of the runs that are asked for; None: all.

    Raises:
        StationError: no such folder, no value at all (with what was left out), a metric that stands in a run more than
            once, runs whose definitions of the metric differ, or, while no recipe is asked for, runs of several
            recipes or with the output torque from different sensors.

    """
    with _looked_at(data, ask) as view:
        return _collected(view, ask, [ask.side], only)[0]


def values_of_sides(data: Path, ask: Ask, only: Collection[str] | None = None) -> tuple[StoredValues, ...]:
    """Collect a metric as `stored_values` does, once for each side that the newest run has; raises as that does.

    One side where one is asked for, or where the metric has no sides.
    """
    with _looked_at(data, ask) as view:
        there = () if ask.side is not None else sides_of(view, _name(ask), ask.recipe, ask.serial)
        sides = [side for side in there if side != "both"]
        return _collected(view, ask, sides or [ask.side], only)


@contextmanager
def _looked_at(data: Path, ask: Ask) -> Iterator[View]:
    if not data.is_dir():
        raise StationError(f"--data {data}: there is no such folder; name the one that 'lostmotion run' wrote to")
    if ask.attempts not in ATTEMPTS:
        raise StationError(f"--attempts: found {ask.attempts!r}; allowed are {', '.join(ATTEMPTS)}")
    with look_at(data) as view:
        yield view


def _name(ask: Ask) -> str:
    """Return the id of the metric, without what was chosen otherwise."""
    return (ask.metric.split() or [""])[0]


def _collected(
    view: View, ask: Ask, sides: Sequence[str | None], only: Collection[str] | None
) -> tuple[StoredValues, ...]:
    """Return the values of each side; the runs and what they have of the metric are read once for all of them."""
    metrics, left_out = _read(view, ask, only)
    runs = [one.run for one in metrics.rows]
    beside = values_beside(view, metrics.meanings, [side for side in sides if side is not None], runs)
    return tuple(
        _of_side(view, replace(ask, side=side), metrics, beside.get(side or "", {}), left_out.copy()) for side in sides
    )


class _Metrics(NamedTuple):
    """The metric in every run that counts, oldest first, and what is meant by it, by number."""

    rows: list[MetricRow]
    meanings: Mapping[int, Meaning]
    lost: Mapping[str, Sequence[str]]
    """Runs that are missing, altered or damaged, by serial number."""


def _of_side(
    view: View, ask: Ask, metrics: _Metrics, beside: Mapping[Place, float | None], left_out: Counter[str]
) -> StoredValues:
    rows: list[StoredValue] = []
    for one in metrics.rows:
        found = value_of(one, ask, beside)
        if isinstance(found, str):
            left_out[found] += 1
        else:
            rows.append(found)
    rows = _attempts(rows, ask.attempts, metrics.lost, left_out)
    if not rows:
        what = ", ".join(f"{count} {reason}" for reason, count in left_out.items()) or "no runs"
        raise StationError(
            f"folder {view.data}: no run has a usable value of {ask.metric}; found {what}. See 'lostmotion list' for "
            "all runs"
        )
    metric = rows[-1].metric
    meaning = _same(rows, metrics.meanings, _name(ask))
    pooled = kinds_of(row.metric for row in rows)
    if ask.recipe is None:
        _check_one_kind(ask.metric, pooled)
    side = ask.side or metric.side
    name = ask.metric if side == "both" else f"{ask.metric} side {side.replace('-', '−')}"
    lower, upper = limits_of(view, metric)
    limits = Limits(min=lower, max=upper)
    return StoredValues(view.data, ask, meaning.unit, name, meaning.definition, limits, rows, left_out, pooled)


def _read(view: View, ask: Ask, only: Collection[str] | None) -> tuple[_Metrics, Counter[str]]:
    """Return the metric in every run that counts, oldest first, and why the other runs do not count."""
    left_out: Counter[str] = Counter()
    metrics: list[MetricRow] = []
    lost: defaultdict[str, list[str]] = defaultdict(list)
    missing = set(view.missing)
    studies = ask.studies or only is not None  # a run that is named is meant
    there = metric_rows(view, _name(ask), ask.recipe, ask.serial, ask.said, studies=studies)
    for rows in there.runs:
        run = rows[0].run
        if only is not None and run not in only:
            continue
        found = MISSING if run in missing else read_metric(rows, there.meanings, ask)
        if isinstance(found, str):
            left_out[found] += 1
            lost[rows[0].serial] += [run] if found == MISSING else []
        else:
            metrics.append(found)
    for one in runs_that_do_not_count(view, ask.recipe, ask.serial, studies=studies):
        if only is None or one.run in only:
            reason = why_left_out(view, one)
            left_out[reason] += 1
            lost[one.serial] += [one.run] if reason in (MISSING, ALTERED, DAMAGED) else []
    for run in view.open:
        reason = _why_open(RunRecord(view.data / run), ask) if only is None or run in only else ""
        if reason:
            left_out[reason] += 1
    left_out[ALTERED] += sum(problem.kind in ELSEWHERE for problem in view.problems)
    return _Metrics(metrics, there.meanings, lost), +left_out


def _why_open(run: RunRecord, ask: Ask) -> str:
    """Return why a run that was not concluded does not count; '' for one that was not asked for."""
    try:
        manifest = run.manifest()
        asked = ask.recipe in (None, manifest.recipe.name) and ask.serial in (None, manifest.serial)
        return f"that ended as {run.state()}" if asked else ""
    except RecordError:
        return DAMAGED


def _counts(kinds: Counter[Kind], what: str) -> Counter[Any]:
    """Count the runs by one field of their kind; those where nothing is known of it are not counted."""
    found: Counter[Any] = Counter()
    for kind, count in kinds.items():
        if getattr(kind, what) != "":
            found[getattr(kind, what)] += count
    return found


def _listing(counts: Counter[Any], what: str) -> str:
    named = "" if what == "torque" else f"{what} "
    return ", ".join(f"{count} {'run' if count == 1 else 'runs'} of {named}{key}" for key, count in counts.items())


def _check_one_kind(metric: str, kinds: Counter[Kind]) -> None:
    """Refuse runs whose spread is that of the recipes or of the torque sensors, and not of what was measured."""
    recipes, torques = _counts(kinds, "recipe"), _counts(kinds, "torque")
    if len(recipes) > 1:
        raise StationError(
            f"{metric}: found {_listing(recipes, 'recipe')}; only runs of one recipe can be compared. Choose "
            "the recipe with --recipe NAME"
        )
    if len(torques) > 1:
        raise StationError(
            f"{metric}: found {_listing(torques, 'torque')}; errors of different torque sensors differ. Keep these "
            f"runs in separate data folders, or take them together all the same with --recipe {next(iter(recipes))}"
        )


def _attempts(
    rows: list[StoredValue], which: str, lost: Mapping[str, Sequence[str]], left_out: Counter[str]
) -> list[StoredValue]:
    """Return one value of each unit. Where its first run is lost, the second is none the less a retest."""
    if which == "all":
        return rows
    kept: dict[str, StoredValue] = {}
    for row in rows if which == "first" else reversed(rows):
        kept.setdefault(row.metric.serial, row)
    if len(rows) > len(kept):
        left_out[f"that are not the {which} of their unit"] += len(rows) - len(kept)
    found = [*kept.values()]
    if lost:
        found = [row for row in found if not _is_before(row, which, lost.get(row.serial, ()))]
    if len(kept) > len(found):
        left_out[f"of units whose {which} run is missing, altered or damaged"] += len(kept) - len(found)
    return found if which == "first" else found[::-1]


def _is_before(row: StoredValue, which: str, lost: Sequence[str]) -> bool:
    """Whether a lost run of the same unit would count instead of this one."""
    return any((run < row.run_id) if which == "first" else (run > row.run_id) for run in lost)


def _same(rows: list[StoredValue], meanings: Mapping[int, Meaning], name: str) -> Meaning:
    """Return what the newest run means by the metric; StationError when another run means something else by it."""
    newest = rows[-1].metric
    meaning = meanings[newest.meaning]
    differ = {
        number: differs
        for number in {row.metric.meaning for row in rows}
        if (differs := _differs(meanings[number], meaning))
    }
    other = next((row.metric for row in rows if row.metric.meaning in differ), None) if differ else None
    if other is not None:
        what = differ[other.meaning][0]
        raise StationError(
            f"runs {other.run} and {newest.run} define {name} differently: option {what} is "
            f"{_shown(meanings[other.meaning], what)} in one and {_shown(meaning, what)} in the other. Choose runs of "
            "one recipe with --recipe"
        )
    return meaning


def _differs(one: Meaning, other: Meaning) -> list[str]:
    """Return what two metrics do not mean alike, in whatever words it is said."""
    return [key for key in SAME if wording_of_today(getattr(one, key)) != wording_of_today(getattr(other, key))]


def _shown(meaning: Meaning, field: str) -> str:
    value = getattr(meaning, field)
    return str(value) if field in ("band", "torque_nm") else repr(value)
