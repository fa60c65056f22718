"""`lostmotion study lock-angle`, `temperature` and `eccentricity`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from analysis.studies.eccentricity import PUBLISHED, EccentricityRow, EccentricityTrend, eccentricity_trend
from analysis.studies.lock_angle import Correlation, Spread, lock_angle_study
from analysis.studies.temperature import TemperatureTrend, temperature_trend
from definitions.states import LOADED
from station.cli.csv_columns import read_csv_columns
from station.cli.line.line_statistics import Asked, Side, Values, figure, values_of, worse_side
from station.cli.line.line_statistics import FromFile as FromColumn
from station.cli.line.stored_metric import Ask
from station.cli.line.stored_values import FromRuns, StoredValues, values_of_sides
from station.cli.say import Grid, say
from station.counted import counted
from station.documents.entries import alongside
from station.errors import StationError
from station.records.program_file import StoredProgram
from station.records.run_record import RunRecord
from station.records.samples.samples import channel_values

TEMPERATURE = "temperature_c"
LABELS = ("test", "position", "position_deg", "lock_deg", "run")
"""Columns of a CSV file that number the positions and are no metrics."""

LOOKED_AT = 512
"""Records that a mean temperature is taken of: a housing warms within minutes, not within scans."""

SQUARE = 2.0
ECCENTRICITY_COLUMNS = EccentricityRow._fields


@dataclass(frozen=True)
class FromFile:
    """Where the values of a study come from, for JSON: a CSV file, None for the published table."""

    file: str | None


@dataclass(frozen=True)
class FromPositions:
    """Where the values of a study come from, for JSON: runs of a unit, and where its shaft was locked."""

    runs: list[str]
    serial: str | None
    lock_position_deg: list[float]


class Positions(NamedTuple):
    """Values per metric, one for each position, their units, where they come from, and what is to be known of them."""

    values: Mapping[str, list[float]]
    units: Mapping[str, str]
    source: FromFile | FromPositions
    notes: Sequence[str]


@dataclass(frozen=True, kw_only=True)
class LockAngleStudied:
    """What `study lock-angle --json` prints."""

    source: FromFile | FromPositions = alongside()
    positions: int
    level: float
    spreads: Mapping[str, Spread]
    correlations: Sequence[Correlation]


@dataclass(frozen=True, kw_only=True)
class TemperatureStudied:
    """What `study temperature --json` prints."""

    source: FromRuns | FromColumn = alongside()
    level: float
    temperature_c: Sequence[float]
    found: TemperatureTrend = alongside()


class StiffnessAt(NamedTuple):
    """What the law gives for an eccentricity."""

    eccentricity_mm: float
    stiffness_nm_per_rad: float


@dataclass(frozen=True, kw_only=True)
class EccentricityStudied:
    """What `study eccentricity --json` prints."""

    source: FromFile = alongside()
    found: EccentricityTrend = alongside()
    rows: Sequence[EccentricityRow]
    at: Sequence[StiffnessAt]


def lock_angle(file: Path | None, asks: Sequence[Ask], data: Path, level: float, *, as_json: bool) -> int:
    """Print the spread of metrics over lock positions and their correlation; return 0.

    Raises:
        StationError, AnalysisError: bad input, or fewer than four positions.

    """
    metrics, units, source, notes = _columns(file, asks) if file is not None else _runs(asks, data)
    study = lock_angle_study(metrics, level)
    spreads = [
        (name, *(figure(value, units.get(name, "")) for value in (one.mean, one.sd, one.least, one.most)))
        for name, one in study.spreads.items()
    ]
    pairs = [
        (
            f"{one.first} and {one.second}",
            figure(one.coefficient, "", 3),
            f"{figure(one.low, '', 3)} … {figure(one.high, '', 3)}",
            f"{one.p_none:.2g}",
        )
        for one in study.correlations
    ]
    blocks: list[str | Grid] = [
        f"{study.positions} positions of the lock",
        Grid(("metric", "mean", "standard deviation", "lowest", "highest"), spreads, right=(1, 2, 3, 4)),
        "The standard deviation is the standard uncertainty that an unknown position of the lock adds",
    ]
    if pairs:
        blocks.append(Grid(("pair", "correlation", f"{level:.0%} interval", "p of none"), pairs, right=(1, 3)))
    document = LockAngleStudied(
        source=source,
        positions=study.positions,
        level=level,
        spreads=study.spreads,
        correlations=study.correlations,
    )
    return say(document, [*blocks, *notes], as_json=as_json)


def _columns(file: Path, asks: Sequence[Ask]) -> Positions:
    table = read_csv_columns(file)
    names = [ask.metric for ask in asks] or [name for name in table.numeric() if name not in LABELS]
    if not names:
        raise StationError(f"{file}: found columns {', '.join(table.columns)}; expected a column of numbers per metric")
    return Positions({name: table.numbers(name) for name in names}, {}, FromFile(str(file)), [])


def _runs(asks: Sequence[Ask], data: Path) -> Positions:
    if not asks or asks[0].serial is None:
        raise StationError("give a CSV FILE with a column per metric, or --serial SN and --metric ID for stored runs")
    found: list[StoredValues] = [side for ask in asks for side in values_of_sides(data, ask)]
    ids = [one.run_id for one in found[0].values]
    for other in found[1:]:
        if [one.run_id for one in other.values] != ids:
            raise StationError(
                f"metrics {other.ask.metric} and {asks[0].metric} come from different runs. Choose one recipe with "
                "--recipe"
            )
    positions = [lock_position_deg(run) for run in found[0].runs()]
    source = FromPositions(ids, asks[0].serial, positions)
    places = ", ".join(figure(place, "", 4) for place in positions)
    notes = [f"locked shaft at {places}° (by its encoder)", *found[0].notes()]
    values = {one.name: [row.value for row in one.values] for one in found}
    return Positions(values, {one.name: one.unit for one in found}, source, notes)


def temperature(
    file: Path | None, column: str, ask: Ask | None, data: Path, how: tuple[float, float], *, as_json: bool
) -> int:
    """Print the slope of a metric over the temperature of the housing; return 0.

    Args:
        file: CSV file with `temperature_c` and the column of the values, or None.
        column: its column of values.
        ask: metric of stored runs, or None.
        data: their folder.
        how: reference temperature [°C] and level of confidence.
        as_json: one JSON object instead of text.

    Raises:
        StationError, AnalysisError: bad input, fewer than four runs, or temperatures within 2 °C.

    """
    reference, level = how
    sides = []
    for values in values_of(Asked(file, column, data, ask)):
        celsius = _temperatures(values)
        trend = temperature_trend(celsius, values.values, reference, level)
        slope = f"slope {figure(trend.slope_per_c, _per_c(values.unit), 4)}"
        sides.append(Side(values, (trend, celsius), abs(trend.slope_per_c), slope))
    found, (one, celsius), of_sides = worse_side(sides)
    unit, per = found.unit, _per_c(found.unit)
    interval = f"{figure(one.slope_low, '', 3)} … {figure(one.slope_high, '', 3)} with {level:.0%} confidence"
    means = "depends" if one.p_none < 1.0 - level else "does not visibly depend"
    rows = [
        ("slope", figure(one.slope_per_c, per, 4), f"± {one.u_slope_per_c:.2g} (k = 1), {interval}"),
        (f"value at {reference:g} °C", figure(one.at_reference, unit), f"± {one.u_at_reference:.2g} (k = 1)"),
        ("spread about the line", figure(one.residual_sd, unit, 3), ""),
    ]
    blocks: list[str | Grid] = [
        f"{found.name}: {counted(one.runs, 'run')} from {one.low_c:.1f} to {one.high_c:.1f} °C",
        Grid(("", "", ""), rows, right=(1,)),
        f"The metric {means} on temperature (p of no slope: {one.p_none:.2g})",
    ]
    document = TemperatureStudied(source=found.head(), level=level, temperature_c=celsius, found=one)
    return say(document, [*blocks, *of_sides, *found.notes()], as_json=as_json)


def _temperatures(values: Values) -> list[float]:
    if values.stored is not None:
        return [housing_temperature_c(run) for run in values.stored.runs()]
    return values.table.numbers(TEMPERATURE) if values.table is not None else []


def _per_c(unit: str) -> str:
    return f"{unit}/°C" if unit else "/°C"


def eccentricity(
    file: Path | None, exponent: float | None, at_mm: Sequence[float], *, free: bool, as_json: bool
) -> int:
    """Print the law of stiffness over eccentricity, and what it gives for each row of its table; return 0.

    Raises:
        StationError, AnalysisError: bad input, or too few rows.

    """
    if free and exponent is not None:
        raise StationError("--free and --exponent cannot be combined. Give only one of the two options")
    if any(not 0.0 < place < 1e3 for place in at_mm):
        raise StationError(f"--at: found {at_mm[0]:g}; allowed are eccentricities above 0 mm")
    rows: Sequence[EccentricityRow] = PUBLISHED
    if file is not None:
        table = read_csv_columns(file)
        numbers = [table.numbers(name) for name in ECCENTRICITY_COLUMNS]
        rows = [EccentricityRow(*row) for row in zip(*numbers, strict=True)]
    chosen = None if free else SQUARE if exponent is None else exponent
    trend = eccentricity_trend(rows, chosen)
    shown = [
        (
            f"{row.eccentricity_mm:g}",
            f"{row.torque_nm:g}",
            f"{1e3 * row.deflection_rad:.4g}",
            f"{1e3 * trend.deflection_rad(row.eccentricity_mm, row.torque_nm):.4g}",
        )
        for row in rows
    ]
    spread = f" ± {trend.u_exponent:.2g}" if free else " (given)"
    origin = file or "the published table"
    asked = [(place, trend.stiffness_nm_per_rad(place)) for place in at_mm]
    blocks: list[str | Grid] = [
        f"K = {trend.coefficient:.5g} N·m/rad · (a/mm)^{trend.exponent:.4g}{spread}, from {origin}",
        Grid(("a [mm]", "torque [N·m]", "deflection [mrad]", "by the law [mrad]"), shown, right=(0, 1, 2, 3)),
        f"ln K scatters by {trend.residual:.2g} about the law",
        *(f"at {place:g} mm: {stiffness:.5g} N·m/rad" for place, stiffness in asked),
    ]
    at = [StiffnessAt(place, stiffness) for place, stiffness in asked]
    document = EccentricityStudied(source=FromFile(None if file is None else str(file)), found=trend, rows=rows, at=at)
    return say(document, blocks, as_json=as_json)


def housing_temperature_c(run: RunRecord) -> float:
    """Return the mean temperature of the housing while the run measured [°C]; StationError when there is none."""
    state, temperature = channel_values(run, [("orders", "state"), ("image", "housing_temp_c")])
    if not state.size:
        raise StationError(f"{run.id}: the run has no records. Name another run")
    step = max(1, state.size // LOOKED_AT)
    values = temperature[::step][np.isin(state[::step], sorted(LOADED))]
    if not values.size or not np.isfinite(values).all():
        raise StationError(f"{run.id}: no housing temperature was measured during the run. Name another run")
    return float(values.mean())


def lock_position_deg(run: RunRecord) -> float:
    """Return where the locked shaft stood when the lock had closed [° of that shaft, by its encoder's reference]."""
    locked_output = StoredProgram.of(run).loading_input
    (zero,) = channel_values(run, [("orders", "angle_out_zero_rad" if locked_output else "angle_in_zero_rad")])
    if not zero.size:
        raise StationError(f"{run.id}: the run has no records. Name another run")
    return math.degrees(float(zero[-1]))
