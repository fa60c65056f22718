"""What the report of a batch says: its tables, once for the page, the PDF and the spreadsheets, and its loops."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from analysis.line.proportions import Proportion
from station.counted import counted
from station.documents.result import Limits
from station.errors import StationError
from station.quality.batch.names import column_of, names_of
from station.quality.figures import CapabilityRow, capability_of, causes_of, left_out_of, said_beside, yield_of
from station.records.run_record import RunRecord
from station.reports.loop_curves import FALLING, RISING, Line, loop_curves
from station.reports.result_text import limits_text, unit_text
from station.store.quality.lot import Lot, production
from station.store.quality.retests import retests_of
from station.store.quality.values import Characteristic, ValueRow, characteristics, values

Cell = str | float | int | None


@dataclass(frozen=True, slots=True)
class BatchTable:
    """A table: the name of its file, its title, heads, and rows of texts and figures.

    remarks: of each row, '' for none, the last column of the file where there are any; page and PDF say them in the
    notes of the batch.
    """

    name: str
    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class BatchLoop:
    """A loop that is drawn: its run and serial number, and the branches of its first cycle."""

    run: str
    serial: str
    branches: tuple[Line, ...]


@dataclass(frozen=True, slots=True)
class Batch:
    """A batch: what it is, in words, its tables, its loops, and what a reader must know.

    Table `values` has a row for each unit: it goes to a file, and is too long for the page. numbers: the values of a
    characteristic on a side. names: what each characteristic is called, no two alike.
    """

    title: str
    facts: tuple[tuple[str, str], ...]
    tables: tuple[BatchTable, ...]
    values: BatchTable
    loops: tuple[BatchLoop, ...]
    capability: tuple[CapabilityRow, ...]
    names: dict[Characteristic, str]
    numbers: dict[tuple[Characteristic, str], tuple[float, ...]]
    notes: tuple[str, ...]


def batch_of(data: Path, lot: Lot, most_loops: int, told: Callable[[str], None] = lambda _: None) -> Batch:
    """Return the batch of a lot; told is called with each loop that is evaluated.

    Raises:
        StationError: the lot has no valid run, or runs of several recipes.

    """
    with production(data) as look:
        lot = look.one_recipe(lot)
        there = characteristics(look, lot)
        yields, causes = yield_of(look, lot), causes_of(look, lot)
        limited = [one for one in there if one.limited]
        capability = capability_of(look, lot).rows if limited else ()
        series = {(one, side): values(look, lot, one, side) for one in there for side in one.sides}
        again, left_out = retests_of(look, lot), left_out_of(look, lot)
    names = names_of(there)
    by_run: dict[str, dict[tuple[Characteristic, str], float]] = {}
    serials: dict[str, tuple[str, str]] = {}
    for key, rows in series.items():
        for row in rows:
            by_run.setdefault(row.run, {})[key] = row.value
            serials[row.run] = row.serial, row.started
    heads = [f"{column_of(names[one], side)}{_of_unit(one.unit)}" for one, side in series]
    value_rows = tuple((run, *serials[run], *(by_run[run].get(key) for key in series)) for run in sorted(by_run))
    loops, without = _loops(data, sorted(by_run)[-most_loops:] if most_loops else [], serials, told)
    first, final = yields.whole.first_pass, yields.whole.final
    spans = sorted(moment for _, moment in serials.values())
    notes = ["VIRTUAL: units of the virtual bench"] if lot.virtual else []
    notes += left_out
    notes += [f"not drawn: {counted(without, 'loop')}"] if without else []
    notes += [text for row in capability for text in said_beside(row, names[row.metric])]
    facts = (
        ("Recipe", lot.recipe or ""), ("Model", lot.model or "any"), ("Bench", lot.bench or "any"),
        ("First attempts", str(first.of)), ("Units with a valid first measurement", str(len(by_run))),
        ("From, to (UTC)", f"{spans[0][:16]} to {spans[-1][:16]}".replace("T", " ")),
        ("First-pass yield", _share(first)), ("Final yield", _share(final)),
    )  # fmt: skip
    failed = [("metric failed", one.name, one.number, 100 * one.share) for one in causes.failed]
    failed += [("no verdict", one.name, one.number, 100 * one.share) for one in causes.undecided]
    failed += [("alarm", one.name, one.number, 100 * one.share) for one in causes.alarms]
    tables: tuple[BatchTable, ...] = (
        BatchTable("capability", "Metrics", CAPABILITY_HEADS,
                   tuple(_summary(names, key, rows, capability) for key, rows in series.items()),
                   tuple(_remark(key, capability) for key in series)),
        BatchTable("pareto", "What hindered it", ("kind", "cause", "runs", "share [%]"), tuple(failed)),
    )  # fmt: skip
    if again:
        retests = tuple((one.run.run, one.run.serial, one.run.verdict, one.attempts) for one in again)
        tables += (BatchTable("retests", "Units measured again", ("run", "serial", "verdict", "attempts"), retests),)
    numbers = {key: tuple(row.value for row in rows) for key, rows in series.items() if rows}
    table = BatchTable("values", "Values", ("run", "serial", "started", *heads), value_rows)
    title = f"Batch report: {lot.recipe}"
    return Batch(title, facts, tables, table, loops, tuple(capability), names, numbers, tuple(notes))


CAPABILITY_HEADS = (
    "metric", "unit", "limit", "n", "mean", "standard deviation", "smallest", "largest", "Cpk", "Cpk low", "Cpk high",
    "Ppk", "Ppk low", "Ppk high",
)  # fmt: skip


def _of_unit(unit: str) -> str:
    return "" if unit in ("", "1") else f" [{unit_text(unit)}]"


def _share(one: Proportion) -> str:
    share = "–" if one.share is None else f"{100 * one.share:.1f} %"
    return f"{one.number} of {one.of}, {share} (95 %: {100 * one.low:.1f} to {100 * one.high:.1f} %)"


def _summary(
    names: dict[Characteristic, str],
    key: tuple[Characteristic, str],
    rows: Sequence[ValueRow],
    capability: Sequence[CapabilityRow],
) -> tuple[Cell, ...]:
    one, side = key
    found = [row.value for row in rows]
    number = len(found)
    mean = sum(found) / number if number else None
    sd = (
        (sum((value - mean) ** 2 for value in found) / (number - 1)) ** 0.5 if mean is not None and number > 1 else None
    )
    judged = next((row.found for row in capability if (row.metric, row.side) == key), None)
    indices: tuple[Cell, ...] = (None,) * 6
    if judged is not None:
        indices = (judged.within.nearest, judged.cpk_low, judged.cpk_high, judged.overall.nearest, judged.ppk_low,
                   judged.ppk_high)  # fmt: skip
    limit = limits_text(Limits(min=one.limit_min, max=one.limit_max)) if one.limited else ""
    ends = (min(found), max(found)) if found else (None, None)
    name = column_of(names[one], side)
    return (name, unit_text(one.unit), limit, number, mean, sd, *ends, *indices)


def _remark(key: tuple[Characteristic, str], capability: Sequence[CapabilityRow]) -> str:
    """Return what a reader must know of the indices in a row."""
    return "; ".join(text for row in capability if (row.metric, row.side) == key for text in said_beside(row, ""))


def _loops(
    data: Path, runs: list[str], serials: dict[str, tuple[str, str]], told: Callable[[str], None]
) -> tuple[tuple[BatchLoop, ...], int]:
    """Return the loops of runs, the first cycle of each, and of how many runs there is none."""
    found, without = [], 0
    for run in runs:
        told(run)
        try:
            lines = loop_curves(RunRecord(data / run)).loop
        except StationError:
            without += 1
            continue
        first = [next((line for line in lines if line.name.startswith(name)), None) for name in (RISING, FALLING)]
        branches = tuple(line for line in first if line is not None) or lines[:1]
        found.append(BatchLoop(run, serials[run][0], branches))
    return tuple(found), without
