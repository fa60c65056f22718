"""Runs of a store as an AQDEF file: one part, its characteristics, a row for each run, checked before it is written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import groupby
from typing import Any

from sqlalchemy import Row, select

from analysis.metrics.former_wordings import wording_of_today
from definitions.metrics import METRICS as METRICS_DEFINED
from station.errors import StationError
from station.quality.dfq.check import DfqError, checked_dfq, serial_problems
from station.quality.dfq.fields import (
    ENCODING,
    END_OF_LINE,
    INSTEAD,
    LIMITS,
    MOMENT,
    NATURAL,
    NEXT_CHARACTERISTIC,
    NEXT_ENTRY,
    NO_LIMIT,
    NOT_MEASURED,
    SPECIFIED,
    VALID,
)
from station.store.plant.hours import COMPLETE
from station.store.plant.meanings import Meaning, meaning_of_metrics
from station.store.quality.lot import Lot, Production
from station.store.quality.values import Characteristic, metrics_of_run, newest_run
from station.store.tables import MEANINGS, METRICS, RUNS

COLUMNS = (
    "run", "serial", "started", "first", "verdict", "objection", "state", "model", "recipe", "revision", "bench",
    "virtual",
)  # fmt: skip
OF_A_FILE = ("model", "recipe", "revision", "bench")
"""What a file says once for all its runs, besides definitions and limits."""

NOTHING = "no run of the chosen lot has a value of a metric that has a limit. Choose other runs, such as with --since"
WITHOUT_THEM = (
    "A serial number is never cut. Choose runs without this one, such as with --since and --until, and give the unit "
    "a label that fits"
)
DIGITS = 12


@dataclass(frozen=True, slots=True)
class Written:
    """An AQDEF file: its bytes, the runs and characteristics in it, and the runs that have none of these.

    what: model, recipe with its revision, and bench of all its runs.
    """

    content: bytes
    runs: int
    characteristics: int
    left_out: int
    what: str = ""


@dataclass(frozen=True, slots=True)
class WrittenLot:
    """A lot as files, that of the oldest run first; left_out: runs of the lot without any metric."""

    files: tuple[Written, ...]
    left_out: int


def dfq_of_lot(production: Production, lot: Lot, program: str) -> WrittenLot:
    """Return the newest runs of a lot, first attempts and retests, as few files as hold them.

    A file states bench, model, recipe revision, definitions and limits once for all its values, so runs that differ in
    one of these are in files of their own, as in the outbox.

    Raises:
        StationError: the lot has runs of several recipes, or no valid one. DfqError: what a run says has no place in
            the format, such as a serial number that is too long.

    """
    lot = production.one_recipe(lot)
    newest_run(production, lot)
    asked = production.of(select(RUNS.c.run).select_from(RUNS), lot, first=False).where(RUNS.c.state == COMPLETE)
    runs = list(production.connection.execute(asked.order_by(RUNS.c.run.desc()).limit(lot.newest)).scalars())
    rows = _rows(production, sorted(runs))
    files = tuple(
        _file(of_file, metrics_of_run(production, model), program) for model, of_file in _files_of(rows).items()
    )
    if not files:
        raise StationError(NOTHING)
    return WrittenLot(files, len(runs) - sum(one.runs for one in files))


def _files_of(rows: Sequence[Row[Any]]) -> dict[str, list[Row[Any]]]:
    """Return rows by the newest run that has all metrics of their file, the file of the oldest run first.

    A run that lacks metrics of another one and is else alike is in its file: it has no value of these there.
    """
    runs = [list(group) for _, group in groupby(rows, key=lambda row: row.run)]
    alike: dict[Any, list[list[Row[Any]]]] = {}
    for of_run in runs:
        said = frozenset((*_meaning(row), row.side, row.limit_min, row.limit_max) for row in of_run)
        alike.setdefault(((*(getattr(of_run[0], name) for name in OF_A_FILE),), said), []).append(of_run)
    found: dict[Any, list[list[Row[Any]]]] = {}
    for (part, said), group in sorted(alike.items(), key=lambda item: -len(item[0][1])):
        home = next(((other, more) for other, more in found if other == part and said <= more), (part, said))
        found.setdefault(home, []).extend(group)
    newest = {alike[key][-1][0].run: sorted(group, key=lambda one: one[0].run) for key, group in found.items()}
    first = sorted(newest.items(), key=lambda item: item[1][0][0].run)
    return {run: [row for one in group for row in one] for run, group in first}


def dfq_of_run(production: Production, run: str, program: str) -> Written:
    """Return one run as a file.

    Raises:
        StationError: the run is not in the store, was altered, or did not come to its end. DfqError as `dfq_of_lot`.

    """
    asked = select(RUNS.c.run).where(RUNS.c.chain == production.chain.id, RUNS.c.run == run)
    asked = asked.where(RUNS.c.state == COMPLETE, RUNS.c.altered == "", production.trusted())
    if production.connection.execute(asked).scalar() is None:
        raise StationError(
            f"run {run}: its values cannot be exported: the run is incomplete, altered, or not in the store of runs. "
            "Choose another run"
        )
    return _file(_rows(production, [run]), metrics_of_run(production, run), program)


@dataclass(frozen=True, slots=True)
class Alike:
    """Runs that a file can hold together: they mean the same by their metrics, and have the same limits."""

    runs: tuple[str, ...]
    there: tuple[Characteristic, ...]


def alike(production: Production, runs: Sequence[str], *, virtual: bool) -> list[Alike]:
    """Return those of the runs that count, as few files as hold them, each in the order of its runs.

    A run counts as for `dfq_of_lot`: complete, unaltered, of a product, and signed by nobody or somebody known.
    """
    if not runs:
        return []
    asked = production.of(select(RUNS.c.run).select_from(RUNS), Lot(virtual=virtual), first=False)
    asked = asked.where(RUNS.c.state == COMPLETE, RUNS.c.run >= min(runs), RUNS.c.run <= max(runs))
    wanted = set(runs)
    found: dict[tuple[Characteristic, ...], list[str]] = {}
    for run in production.connection.execute(asked.order_by(RUNS.c.run)).scalars():
        if run in wanted:
            there = metrics_of_run(production, run)
            # in one order: which side judged differs from run to run
            found.setdefault(tuple(one._replace(sides=tuple(sorted(one.sides))) for one in there), []).append(run)
    return [Alike(tuple(of_file), there) for there, of_file in found.items()]


def dfq_of_runs(production: Production, group: Alike, program: str) -> Written:
    """Return runs that are alike as a file; StationError where none has a metric, DfqError as `dfq_of_lot`."""
    return _file(_rows(production, group.runs), group.there, program)


def _meaning(row: Row[Any]) -> tuple[str, ...]:
    return tuple(wording_of_today(getattr(row, name)) for name in Meaning._fields)


def _file(rows: Sequence[Row[Any]], there: Sequence[Characteristic], program: str) -> Written:
    places = {(*one.meaning, side): None for one in there for side in one.sides}
    numbers = {key: number for number, key in enumerate(places)}
    lines, left_out, unfit = [], 0, list[str]()
    for _, group in groupby(rows, key=lambda row: row.run):
        of_run = list(group)
        cells = {(*_meaning(row), row.side): row for row in of_run}
        if not any(key in cells for key in numbers):
            left_out += 1
            continue
        lines.append(NEXT_CHARACTERISTIC.join(_value(of_run[0], cells.get(key)) for key in numbers))
        run, serial = of_run[0].run, of_run[0].serial
        unfit += [f"run {run}, serial number '{serial}': {problem}" for problem in serial_problems(serial)]
        lines.append(f"K0014/0 {serial}")
    if not lines:
        raise StationError(NOTHING)
    if unfit:
        raise DfqError(unfit, WITHOUT_THEM)
    head = _head(rows[-1], len(numbers), program)
    for one in there:
        for side in one.sides:
            head += _characteristic(one, side, numbers[(*one.meaning, side)] + 1)
    text = END_OF_LINE.join([*head, *lines]) + END_OF_LINE
    try:
        content = text.encode(ENCODING)
    except UnicodeEncodeError as error:
        sign = text[error.start]
        raise DfqError(
            [f"the sign '{sign}' cannot be written in {ENCODING}; it stands in {_near(text, error.start)}"]
        ) from error
    checked_dfq(content)
    newest = rows[-1]
    what = f"{newest.model}, {newest.recipe} revision {newest.revision}"
    what += f", bench {newest.bench}" if newest.bench else ""
    return Written(content, len(lines) // 2, len(numbers), left_out, what)


def _near(text: str, place: int) -> str:
    return text[text.rfind("\n", 0, place) + 1 : place][:30].strip() + " …"


def _rows(production: Production, runs: Sequence[str]) -> list[Row[Any]]:
    """Return every side of every metric of the runs, run by run."""
    of_runs = select(RUNS).where(RUNS.c.chain == production.chain.id)
    of_runs = of_runs.where(RUNS.c.run >= runs[0], RUNS.c.run <= runs[-1]) if runs else of_runs.where(RUNS.c.run == "")
    table = of_runs.subquery()
    columns = [table.c[name] for name in COLUMNS]
    columns += [MEANINGS.c[name] for name in Meaning._fields]
    columns += [METRICS.c.side, METRICS.c.value, METRICS.c.limit_min, METRICS.c.limit_max]
    columns += [METRICS.c.verdict.label("judged")]
    together = (METRICS.c.chain == table.c.chain) & (METRICS.c.run == table.c.run)
    asked = select(*columns).select_from(table).join(METRICS, together).join(MEANINGS, meaning_of_metrics())
    asked = asked.order_by(table.c.run, METRICS.c.position)
    wanted = set(runs)
    return [row for row in production.connection.execute(asked) if row.run in wanted]


def _head(newest: Row[Any], count: int, program: str) -> list[str]:
    remark = f"{program}; simulated unit of the virtual bench" if newest.virtual else program
    lines = [f"K0100 {count}", f"K1001/1 {newest.model}", f"K1002/1 {newest.recipe} revision {newest.revision}"]
    return [*lines, *([f"K1081/1 {newest.bench}"] if newest.bench else []), f"K1900/1 {remark}"]


def _characteristic(one: Characteristic, side: str, number: int) -> list[str]:
    words = " ".join(
        part for part in (one.metric, one.choices, one.branch, "" if side == "both" else f"side {side}") if part
    )
    lines = {"K2001": str(number), "K2002": words, "K2004": "0"}
    naturals = natural_limits(one)
    for value, natural, (limit, kind) in zip((one.limit_min, one.limit_max), naturals, LIMITS.items(), strict=True):
        lines[kind] = str(SPECIFIED if value is not None else NO_LIMIT if natural is None else NATURAL)
        stated = natural if value is None else value
        if stated is not None:
            lines[limit] = _number(stated)
    lines["K2142"] = one.unit if one.unit.strip() else "1"
    if one.definition:
        lines["K2900"] = one.definition.translate(INSTEAD)
    return [f"{key}/{number} {value}" for key, value in lines.items()]


def natural_limits(one: Characteristic) -> tuple[float | None, float | None]:
    """Return the smallest and the largest value that there is of a characteristic with one limit, opposite that limit.

    A statistics program takes a natural limit for no tolerance: it computes the indices of the other side alone, and
    expects a skewed distribution. None where there is none, or where the recipe states no limit or both.
    """
    row = METRICS_DEFINED.get(one.metric)
    if row is None or (one.limit_min is None) == (one.limit_max is None):
        return None, None
    usual = row.usual
    return (usual.floor, None) if one.limit_min is None else (None, usual.ceiling)


def _value(run: Row[Any], row: Row[Any] | None) -> str:
    valid = row is not None and row.value is not None and not run.objection
    moment = datetime.fromisoformat(run.started).astimezone(UTC).strftime(MOMENT)
    events = [number for number, holds in (
        (1, not run.first), (2, run.verdict == "FAIL"), (3, run.verdict == "NOT DECIDABLE"),
        (4, row is not None and row.judged == "FAIL"), (5, run.virtual),
    ) if holds]  # fmt: skip
    value = _number(row.value) if row is not None and valid else "0"
    entries = (value, str(VALID if valid else NOT_MEASURED), moment, ",".join(map(str, events)))
    return NEXT_ENTRY.join(entries)


def _number(value: float) -> str:
    return f"{value:.{DIGITS}g}"
