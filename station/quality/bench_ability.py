"""Can this bench measure: one part of known value measured again and again, and what is due."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import func, select

from analysis.line.master_part import MasterPart, master_part_trend
from analysis.line.type_one import TypeOne, type_one
from analysis.trace.errors import AnalysisError
from recipes import Bench, RecipeError, parse_recipe
from recipes.text.yaml_source import read_bytes
from station.counted import counted
from station.errors import StationError
from station.records.data_folder import Store
from station.records.master_parts import ProductRecipe, master_parts
from station.records.run_record import RECIPE_COPY, RunRecord
from station.store.quality.lot import Production
from station.store.quality.values import Characteristic, metrics_of_run, one_of, part_runs, values_of_part
from station.store.tables import RUNS

SECONDS_PER_DAY = 86400.0


@dataclass(frozen=True, slots=True)
class Part:
    """What is asked of a part: its serial number, the metric by its name, and on which bench; side None: each.

    runs: the runs that are meant, None for all.
    """

    serial: str
    metric: str
    side: str | None = None
    branch: str | None = None
    bench: str | None = None
    virtual: bool = False
    runs: tuple[str, ...] | None = None


@dataclass(frozen=True, slots=True)
class PartSeries:
    """The values of a part on one side, in order of time, with the runs they came from."""

    metric: Characteristic
    side: str
    runs: tuple[str, ...]
    started: tuple[str, ...]
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class TypeOneFigure:
    """Type 1 study of a part over the side that judges; others: the sides that do better, with their Cgk."""

    part: Part
    series: PartSeries
    study: TypeOne
    tolerance_from: str
    others: tuple[tuple[str, float], ...]


def series_of(production: Production, part: Part) -> tuple[PartSeries, ...]:
    """Return the values of a part, of each side that is asked for.

    Raises:
        StationError: the part was never measured so, it has no such metric or side, or several benches measured it.

    """
    runs = part_runs(production, part.serial, part.bench, virtual=part.virtual, only=part.runs)
    benches = production.connection.execute(select(runs.c.bench, func.count()).group_by(runs.c.bench)).all()
    if not benches:
        kind = "virtual" if part.virtual else "real"
        where = "" if part.bench is None else f" on bench {part.bench}"
        raise StationError(
            f"{production.chain.data}: this data folder has no valid run of the {kind} unit {part.serial}{where}. "
            "Measure the unit, or see 'lostmotion list'"
            + ("" if part.virtual else ". Add --virtual for units of the virtual bench")
        )
    if len(benches) > 1:
        there = ", ".join(f"{name} ({counted(number, 'run')})" for name, number in benches)
        raise StationError(
            f"unit {part.serial} was measured on {there}; each bench is judged alone. Choose one with --bench"
        )
    newest = production.connection.execute(select(func.max(runs.c.run))).scalar_one()
    what = one_of(metrics_of_run(production, str(newest)), part.metric, part.branch)
    if part.side is not None and part.side not in what.sides:
        raise StationError(f"--side: found '{part.side:.20}'; the metric {what.name} has {' and '.join(what.sides)}")
    found = []
    for side in what.sides if part.side is None else (part.side,):
        rows = values_of_part(production, runs, what, side)
        found.append(PartSeries(what, side, *zip(*((row.run, row.started, row.value) for row in rows), strict=True)))
    return tuple(found)


def type_one_of(  # noqa: PLR0917 - what a command line asks
    production: Production, part: Part, reference: float, tolerance: float | None, share: float, level: float = 0.95
) -> TypeOneFigure:
    """Return the type 1 study of a part; of two sides the worse one judges.

    tolerance: upper minus lower limit; None: that of the recipe. Raises StationError as `series_of` and `tolerance_of`,
    AnalysisError as `type_one`.
    """
    series = series_of(production, part)
    said, told = (tolerance, "given") if tolerance is not None else tolerance_of(production, series[0])
    studies = [(one, type_one(one.values, reference, said, share=share, level=level)) for one in series]
    studies.sort(key=lambda found: found[1].cgk)
    others = tuple((one.side, study.cgk) for one, study in studies[1:])
    return TypeOneFigure(part, studies[0][0], studies[0][1], told, others)


def tolerance_of(production: Production, series: PartSeries) -> tuple[float, str]:
    """Return the tolerance of a metric, and where it is from: its recipe's option, or the distance of its two limits.

    Raises:
        StationError: the metric has one limit or none, and its recipe states no tolerance.

    """
    what = series.metric
    run = RunRecord(production.chain.data / series.runs[-1])
    stated = stated_tolerance(run, what.metric)
    if stated is not None:
        return stated, f"the tolerance in the recipe of run {run.id}"
    if what.limit_min is not None and what.limit_max is not None:
        return what.limit_max - what.limit_min, f"the limits in run {run.id}"
    one = "one limit" if what.limited else "no limit"
    raise StationError(
        f"{what.name}: run {run.id} has {one} for this metric, so its tolerance is not known. Write the tolerance into "
        f"the recipe, '- {{id: {what.metric}, tolerance: …}}', or give it with --tolerance"
    )


def stated_tolerance(run: RunRecord, metric: str) -> float | None:
    """Return the tolerance that the recipe of a run states for a metric; None where it states none."""
    path = run.folder / RECIPE_COPY
    try:
        recipe = parse_recipe(read_bytes(path), str(path))
    except (RecipeError, OSError):
        return None  # of a run from before, or of another program: its limits are in its result all the same
    return next((one.tolerance for one in recipe.metrics if one.id == metric and one.tolerance is not None), None)


@dataclass(frozen=True, slots=True)
class PartFigure:
    """A master part over time: its values, and the trend where there are enough of them; why says why there is none."""

    series: PartSeries
    trend: MasterPart | None
    why: str = ""


def parts_of(production: Production, *, virtual: bool) -> tuple[tuple[str, int], ...]:
    """Return the master parts of a folder, with their valid runs, the most measured first."""
    asked = select(RUNS.c.serial, func.count()).where(RUNS.c.chain == production.chain.id, RUNS.c.master != "")
    asked = asked.where(RUNS.c.valid, RUNS.c.scenario.is_(None), RUNS.c.virtual.is_(virtual), production.trusted())
    rows = production.connection.execute(asked.group_by(RUNS.c.serial).order_by(func.count().desc(), RUNS.c.serial))
    return tuple((str(serial), int(number)) for serial, number in rows)


def part_trend(production: Production, part: Part, baseline: int = 10) -> PartFigure:
    """Return a master part over time, on the side with more signals; StationError as `series_of`."""
    found = []
    for series in series_of(production, part):
        days = [datetime.fromisoformat(moment).timestamp() / SECONDS_PER_DAY for moment in series.started]
        try:
            trend = master_part_trend(days, series.values, baseline)
            found.append(PartFigure(series, trend))
        except AnalysisError as error:
            found.append(PartFigure(series, None, str(error)))
    return max(found, key=lambda one: -1 if one.trend is None else len(one.trend.signals))


@dataclass(frozen=True, slots=True)
class Due:
    """Something that a bench needs from time to time: whether it is in order, and in words."""

    bench: str
    what: str
    in_order: bool
    text: str


def due_on(
    store: Store, bench: Bench, now: datetime, products: Iterable[ProductRecipe | None] = (None,)
) -> tuple[Due, ...]:
    """Return what is due on a bench: master parts, stored torque ratios, the blank test of its fixture.

    products: recipes that the master parts are to speak for; without one, by a released recipe they were measured.
    """
    name = bench.bench.name
    checked = (part for one in products for part in master_parts(store, bench, now, one))
    found = list(dict.fromkeys(Due(name, "master part", one.in_order, one.text) for one in checked))
    dated = [("torque ratio", f"{one.id} for {one.model}", one.due) for one in bench.calibrations]
    curve = bench.fixture.curve
    dated += [] if curve is None else [("blank test of the fixture", curve.id, curve.due)]
    for what, which, due in dated:
        left = (due - now.date()).days
        days = counted(abs(left), "day")
        text = f"{which}: due {due}, in {days}" if left >= 0 else f"{which}: was due {due}, {days} ago"
        found.append(Due(name, what, left >= 0, text))
    return tuple(found)
