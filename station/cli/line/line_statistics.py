"""`lostmotion capability`, `units` and `master-part`: what many runs of one metric say, or the values of a CSV file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, NamedTuple, TypeVar

from analysis.line.capability import Capability, capability
from analysis.line.master_part import MasterPart, master_part_trend
from analysis.line.spread import UnitToUnit, unit_to_unit
from station.cli.csv_columns import CsvColumns, read_csv_columns
from station.cli.line.stored_metric import Ask
from station.cli.line.stored_values import FromRuns, StoredValues, values_of_sides
from station.cli.say import Grid, say
from station.counted import counted
from station.documents.entries import alongside
from station.documents.result import Limits
from station.errors import StationError
from station.reports.result_text import limits_text, minus, unit_text

TIMES = ("days", "day", "started", "time")
"""Columns of a CSV file that say when: a number of days, or a date and time as ISO 8601 writes it."""

LEAST_SHARE = 1e-6
"""Share of units beyond the limits that is still told as a figure: 1 in a million. No tail is known further out."""

TWO_DIGITS_UP_TO = 0.995
"""Share from which two digits would make 1e+02 of it."""

SECONDS_PER_DAY = 86400.0
Study = TypeVar("Study")
OUT_OF_CONTROL = 1


@dataclass(frozen=True)
class Asked:
    """Where the values come from: a CSV file and its column, or a metric of stored runs."""

    file: Path | None
    column: str
    data: Path
    ask: Ask | None


@dataclass(frozen=True)
class FromFile:
    """Where the values of a study come from, for JSON: the column of a CSV file."""

    file: str | None
    column: str


@dataclass(frozen=True, kw_only=True)
class CapabilityStudy:
    """What `capability --json` prints."""

    source: FromRuns | FromFile = alongside()
    level: float
    subgroup: int
    found: Capability = alongside()


@dataclass(frozen=True, kw_only=True)
class UnitsStudy:
    """What `units --json` prints."""

    source: FromRuns | FromFile = alongside()
    level: float
    found: UnitToUnit = alongside()


@dataclass(frozen=True, kw_only=True)
class MasterPartStudy:
    """What `master-part --json` prints."""

    source: FromRuns | FromFile = alongside()
    level: float
    measurements: int
    found: MasterPart = alongside()
    in_control: bool


@dataclass(frozen=True)
class Values:
    """Values with what they are called, and the table or runs that they came from."""

    name: str
    unit: str
    values: list[float]
    table: CsvColumns | None
    stored: StoredValues | None

    def head(self) -> FromRuns | FromFile:
        """Return where the values come from."""
        if self.stored is not None:
            return self.stored.head()
        return FromFile(None if self.table is None else str(self.table.file), self.name)

    def notes(self) -> list[str]:
        """Return what a reader must know of the source."""
        return [] if self.stored is None else self.stored.notes()


def values_of(asked: Asked) -> list[Values]:
    """Return the values that were asked for, of each side where the metric has two and none was chosen.

    Raises:
        StationError: it is not clear which, or they cannot be read.

    """
    if (asked.file is None) == (asked.ask is None):
        raise StationError("give either a CSV FILE, or --metric ID for the stored runs below --data")
    if asked.file is not None:
        table = read_csv_columns(asked.file)
        return [Values(asked.column, "", table.numbers(asked.column), table, None)]
    sides = values_of_sides(asked.data, asked.ask or Ask(""))
    return [Values(one.name, one.unit, [row.value for row in one.values], None, one) for one in sides]


class Side(NamedTuple, Generic[Study]):
    """A study of the values of one side, and how bad it is: the larger, the worse."""

    found: Values
    study: Study
    badness: float
    text: str


def worse_side(sides: Sequence[Side[Study]]) -> tuple[Values, Study, list[str]]:
    """Return the worse side, which judges, with a note that names the other one."""
    worst, *others = sorted(sides, key=lambda side: -side.badness)
    notes = [f"The worse side. The other one, {other.found.name}: {other.text}" for other in others]
    return worst.found, worst.study, notes


def figure(value: float | None, unit: str = "", digits: int = 5) -> str:
    """Return a figure with its unit, a dash for none."""
    return "–" if value is None else f"{minus(f'{value:.{digits}g}')} {unit_text(unit)}".rstrip()


def capability_of(
    asked: Asked, limits: tuple[float | None, float | None], subgroup: int, level: float, *, as_json: bool
) -> int:
    """Print the capability of the line against the limits given, or else those of the newest run; return 0.

    Raises:
        StationError, AnalysisError: bad input, no limit, or too few values.

    """
    sides = []
    for values in values_of(asked):
        lower, upper = limits
        if limits == (None, None) and values.stored is not None:
            lower, upper = values.stored.limits.min, values.stored.limits.max
        if lower is None and upper is None:
            raise _no_limit(values)
        index = capability(values.values, lower, upper, subgroup, level)
        nearest = index.overall.nearest
        sides.append(Side(values, index, -nearest, f"Ppk {figure(nearest, '', 4)}"))
    found, one, of_sides = worse_side(sides)
    both = one.lower is not None and one.upper is not None
    rows = [
        (name, figure(sd, found.unit, 4), figure(index.both, "", 4), figure(index.nearest, "", 4))
        for name, sd, index in (("within", one.sd_within, one.within), ("overall", one.sd_overall, one.overall))
    ]
    blocks: list[str | Grid] = [
        f"{found.name}: {counted(one.values, 'value')}, mean {figure(one.mean, found.unit)}, "
        f"limit {limits_text(Limits(min=one.lower, max=one.upper))} {unit_text(found.unit)}".rstrip(),
        Grid(("spread", "standard deviation", "Cp, Pp", "Cpk, Ppk"), rows, right=(1, 2, 3)),
        f"{_intervals(one)} with {level:.0%} confidence",
        f"expected beyond limits: {_share(one.outside_fraction)} of the units, if they are normally distributed",
    ]
    if not both:
        blocks.append(
            "This metric has one limit only, so Cp and Pp cannot be calculated. Cpk and Ppk use the side that has the "
            "limit"
        )
    document = CapabilityStudy(source=found.head(), level=level, subgroup=subgroup, found=one)
    return say(document, [*blocks, *of_sides, *found.notes()], as_json=as_json)


def _intervals(one: Capability) -> str:
    """Return the interval of every index that is defined."""
    found = {
        "Cpk": (one.cpk_low, one.cpk_high),
        "Ppk": (one.ppk_low, one.ppk_high),
        "Cp": (one.cp_low, one.cp_high),
        "Pp": (one.pp_low, one.pp_high),
    }
    there = {name: ends for name, ends in found.items() if ends[0] is not None}
    return ", ".join(f"{name} {figure(low, '', 3)} … {figure(high, '', 3)}" for name, (low, high) in there.items())


def _no_limit(found: Values) -> StationError:
    """Say why there is no limit, and how to give one."""
    if found.stored is None:
        return StationError(f"capability of {found.name}: a file has no limits. Give --min X, --max X or both")
    newest = found.stored.values[-1].run_id
    return StationError(
        f"capability of {found.name}: the recipe of the newest run, {newest}, has no limit for this metric. Give "
        "--min X, --max X or both, or name another recipe: --recipe NAME"
    )


def _share(fraction: float) -> str:
    """Return a share of the units in per cent; below what any normal distribution can be trusted with, only that."""
    if fraction < LEAST_SHARE:
        return f"less than {100 * LEAST_SHARE:g} %"
    digits = 3 if fraction >= TWO_DIGITS_UP_TO else 2
    return f"{100 * fraction:.{digits}g} %"


def units_of(asked: Asked, level: float, *, as_json: bool) -> int:
    """Print how units differ; return 0. A CSV file needs the columns `serial` and the one of the values.

    Raises:
        StationError, AnalysisError: bad input, or fewer than three units.

    """
    found, one, of_sides = worse_side([_between_units(values, level) for values in values_of(asked)])
    unit = found.unit
    interval = f"{figure(one.sd_low, '', 3)} … {figure(one.sd_high, '', 3)} with {level:.0%} confidence"
    rows = [
        ("mean of the units", figure(one.mean, unit), f"median {figure(one.median, unit)}"),
        ("standard deviation of their means", figure(one.sd, unit, 3), interval),
        ("between units, repeatability removed", figure(one.sd_units, unit, 3), _repeated(one.sd_units)),
        ("repeatability on one unit", figure(one.sd_within, unit, 3), ""),
        ("lowest", figure(one.least[1], unit), one.least[0]),
        ("highest", figure(one.most[1], unit), one.most[0]),
    ]
    unusual = f"unusual: {', '.join(one.unusual)}" if one.unusual else "no unit is unusual"
    blocks: list[str | Grid] = [
        f"{found.name}: {counted(one.measurements, 'measurement')} of {counted(one.units, 'unit')}",
        Grid(("", "", ""), rows, right=(1,)),
        f"{unusual} (modified z score beyond 3.5)",
    ]
    document = UnitsStudy(source=found.head(), level=level, found=one)
    return say(document, [*blocks, *of_sides, *found.notes()], as_json=as_json)


def _between_units(found: Values, level: float) -> Side[UnitToUnit]:
    if found.stored is not None:
        serials: Sequence[str] = [one.serial for one in found.stored.values]
    else:
        serials = found.table.texts("serial") if found.table is not None else []
    by_unit: dict[str, list[float]] = {}
    for serial, value in zip(serials, found.values, strict=True):
        by_unit.setdefault(serial, []).append(value)
    one = unit_to_unit(by_unit, level)
    return Side(found, one, one.sd, f"standard deviation {figure(one.sd, found.unit, 3)}")


def _repeated(spread: float | None) -> str:
    return "no unit was measured twice" if spread is None else ""


def _days(found: Values) -> list[float]:
    """Return when each value was measured, in days; StationError when a CSV file does not say."""
    if found.stored is not None:
        return [one.started.timestamp() / SECONDS_PER_DAY for one in found.stored.values]
    table = found.table
    column = None if table is None else next((name for name in TIMES if name in table.columns), None)
    if table is None or column is None:
        raise StationError(
            f"file {table.file if table else ''} does not say when each value was measured; expected one of the "
            f"columns {', '.join(TIMES)}. Add the column"
        )
    if column in table.numeric():
        return table.numbers(column)
    from datetime import UTC, datetime  # noqa: PLC0415 - for this kind of file only

    days = []
    for row, text in enumerate(table.texts(column), start=1):
        try:
            moment = datetime.fromisoformat(text)
        except ValueError as error:
            raise StationError(
                f"{table.file}: row {row}, column {column}: found '{text:.40}'; expected a number of days, or a date "
                "as in 2026-01-31T08:00:00"
            ) from error
        days.append((moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp() / SECONDS_PER_DAY)
    return days


def master_part_of(
    asked: Asked, baseline: int, reference: tuple[float, float] | None, level: float, *, as_json: bool
) -> int:
    """Print whether the bench is steady; return 0, or 1 when a rule is broken.

    Raises:
        StationError, AnalysisError: bad input, or too few measurements.

    """
    sides = []
    for values in values_of(asked):
        trend = master_part_trend(_days(values), values.values, baseline, reference, level)
        badness = len(trend.signals) - trend.p_no_trend
        sides.append(Side(values, trend, badness, "in control" if trend.in_control else "OUT OF CONTROL"))
    found, one, of_sides = worse_side(sides)
    days, unit = _days(found), found.unit
    rows = [
        ("centre", figure(one.centre, unit), f"of the first {baseline}"),
        ("control limits", f"{figure(one.low_limit)} … {figure(one.high_limit, unit)}", ""),
        ("last", figure(found.values[-1], unit), ""),
        (
            "drift per day",
            figure(one.slope_per_day, unit, 3),
            f"± {one.u_slope_per_day:.2g}, p of none {one.p_no_trend:.2g}",
        ),
    ]
    if one.bias is not None and one.u_bias_expanded is not None:
        rows.append(("off the certified value", figure(one.bias, unit, 3), f"U = {one.u_bias_expanded:.2g} (k = 2)"))
    blocks: list[str | Grid] = [
        f"{found.name}: {len(days)} measurements over {days[-1] - days[0]:.4g} days",
        Grid(("", "", ""), rows, right=(1,)),
    ]
    blocks += [f"OUT OF CONTROL at measurement {s.measurement}: {s.text}" for s in one.signals] or ["in control"]
    document = MasterPartStudy(
        source=found.head(), level=level, measurements=len(days), found=one, in_control=one.in_control
    )
    say(document, [*blocks, *of_sides, *found.notes()], as_json=as_json)
    return 0 if one.in_control else OUT_OF_CONTROL
