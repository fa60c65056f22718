"""Does the stated uncertainty hold? Units measured once each with errors, against what they truly are.

For a metric to pass, U (k = 2) must contain the error of nearly 95 % of the units, and what all units are wrong by in
the same direction (bias) must be small beside U.

The units are simulated, each measured once by a simulated bench with errors. Their torque ratio is that of the run, or
a stored one: the mean of some units of a lot, each calibrated once.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy import special

from analysis.evaluation.metric_result import MetricResult
from analysis.evaluation.pipeline import analyse
from analysis.loop.method import Method, MetricWanted
from analysis.torque_ratio.quadrant_fit import fit_quadrants
from analysis.torque_ratio.quadrants import QUADRANTS, Quadrants, TorqueLine
from analysis.trace.runs import commanded_runs
from analysis.uncertainty.figures import LineCovariance, SensorFigures, UnitDeviation
from benchmarks.simulated.simulated_run import (
    Course,
    Sensors,
    SimulatedBench,
    TorqueErrors,
    as_built,
    course_of,
    exact_trace,
    measured_trace,
)
from benchmarks.simulated.simulated_unit import SimulatedUnit

Pair = tuple[Sequence[MetricResult], Sequence[MetricResult]]
"""Metrics of one unit: true, and as measured."""

SEED = 20


@dataclass(frozen=True)
class CoverageRow:
    """One metric, its sides together: mean of the true values, bias and standard deviation of the error.

    expanded: median U; largest, largest_relative: the largest U of any unit, and over its value; covered: share of
    `count` values, of `units` units, whose error is within U.
    """

    metric: str
    unit: str
    value: float
    bias: float
    deviation: float
    expanded: float
    largest: float
    largest_relative: float
    covered: float
    count: int
    units: int

    @property
    def bias_over_u(self) -> float:
        """Bias in units of U; less than a fifth is wanted."""
        return abs(self.bias) / self.expanded

    @property
    def covered_between(self) -> tuple[float, float]:
        """Interval of 95 % for the share covered of all such units (Clopper and Pearson).

        Sides of a unit share its errors, so a unit counts once, with the share of its sides that is covered.
        """
        hit = self.covered * self.units
        missed = self.units - hit
        low = special.betaincinv(hit, missed + 1.0, 0.025) if hit > 0.0 else 0.0
        high = special.betaincinv(hit + 1.0, missed, 0.975) if missed > 0.0 else 1.0
        return float(low), float(high)


def coverage(wanted: Sequence[MetricWanted], pairs: Iterable[Pair]) -> list[CoverageRow]:
    """Compare what was measured of units with what is true; a metric that no unit has a value of has no row.

    A value without an uncertainty, or none where there is a true one, counts as not covered.
    """
    found: list[list[tuple[float, float, float]]] = [[] for _ in wanted]
    units = 0
    names: list[str] = []
    for truth, shown in pairs:
        units += 1
        names = [one.definition.unit for one in shown]
        for row, true, seen in zip(found, truth, shown, strict=True):
            for exact, side in zip(true.sides, seen.sides, strict=True):
                if exact.value is None or side.value is None or side.uncertainty is None:
                    row.append((np.nan, np.nan, np.nan))
                else:
                    row.append((exact.value, side.value - exact.value, side.uncertainty))
    return [
        coverage_row(one, unit, values, units)
        for one, unit, values in zip(wanted, names, found, strict=True)
        if not np.isnan(values).all()
    ]


def coverage_row(wanted: MetricWanted, unit: str, values: list[tuple[float, float, float]], units: int) -> CoverageRow:
    """Return the row of a metric: values are its true value, error and U, of each side of so many units."""
    exact, error, expanded = np.array(values).T
    return CoverageRow(
        metric=wanted.id if wanted.branch is None else f"{wanted.id} {wanted.branch}",
        unit=unit,
        value=float(np.nanmean(exact)),
        bias=float(np.nanmean(error)),
        deviation=float(np.nanstd(error, ddof=1)),
        expanded=float(np.nanmedian(expanded)),
        largest=float(np.nanmax(expanded)),
        largest_relative=float(np.nanmax(expanded / np.maximum(np.abs(exact), 1e-9))),
        covered=float((np.abs(error) <= expanded).mean()),
        count=error.size,
        units=units,
    )


def simulated_pairs(
    units: int, figures: SensorFigures, wanted: Sequence[MetricWanted], method: Method, bench: SimulatedBench, *,
    calibrated_units: int = 0,
) -> Iterator[Pair]:  # fmt: skip
    """Measure so many seeded units around the default one; yield true and measured metrics of each.

    Every parameter is moved within ± 20 %, and the sides of a unit differ within ± 5 % (`SimulatedUnit.varied`).

    method: with output_torque "calibrated" the torque is converted from the input torque; the true loop never is.
    calibrated_units: the lines for it are not measured in the run, but stored: the mean of so many other units, two or
    more, that each bench calibrated before; the torque at the output is not measured then.
    """
    of_method = method.ratio, method.rated_torque_nm, method.reference_torque_nm
    for seed in range(units):
        random = np.random.default_rng([SEED, seed])
        unit, built = SimulatedUnit().varied(random), as_built(bench, figures, random)
        course = _course(unit, built)
        truth = _truth(unit, built, of_method, tuple(wanted))
        if calibrated_units:
            yield truth, _by_stored_lines(calibrated_units, course, built, figures, method, wanted, random)
        else:
            yield (
                truth,
                analyse(measured_trace(course, built, figures, random), method, wanted, figures=figures).metrics,
            )


_course = lru_cache(maxsize=1)(course_of)


@lru_cache(maxsize=256)
def _truth(
    unit: SimulatedUnit, bench: SimulatedBench, of_method: tuple[float, float, float | None],
    wanted: tuple[MetricWanted, ...],
) -> tuple[MetricResult, ...]:  # fmt: skip
    """Return what is true of a unit: studies measure the same ones by several kinds of torque and of sensors.

    of_method: ratio, rated and reference torque [N·m].
    """
    return analyse(exact_trace(_course(unit, bench), bench), Method(*of_method), wanted).metrics


def _by_stored_lines(  # noqa: PLR0917 - a run, how it is measured, and by what
    units: int, course: Course, bench: SimulatedBench, figures: SensorFigures, method: Method,
    wanted: Sequence[MetricWanted], random: np.random.Generator,
) -> tuple[MetricResult, ...]:  # fmt: skip
    of_sensors = {"torque_in": figures.torque_in, "torque_out": figures.torque_out}
    sensors = {name: TorqueErrors.drawn(one, random) for name, one in of_sensors.items() if one is not None}
    lines, known = stored_lines(units, bench, figures, sensors, random)
    trace = replace(measured_trace(course, bench, figures, random, sensors), torque_out_nm=None)
    return analyse(trace, replace(method, quadrants=lines), wanted, figures=known).metrics


def stored_lines(
    units: int, bench: SimulatedBench, figures: SensorFigures, sensors: Sensors, random: np.random.Generator
) -> tuple[Quadrants, SensorFigures]:
    """Calibrate so many units; return their mean lines, and the figures with what is known of these.

    units: two or more. sensors: of the bench, which are the same in every run; each run is tared anew.
    """
    only_calibrates = replace(bench, cycles=0)
    found = []
    for _ in range(units):
        course = course_of(SimulatedUnit().varied(random), bench=only_calibrates)
        trace = measured_trace(course, bench, figures, random, sensors)
        found.append(fit_quadrants(trace, commanded_runs(trace)))
    lines = {name: _mean([getattr(one, name) for one in found]) for name in QUADRANTS}
    lengths = [one.transition_rad for one in found if one.transition_rad is not None]
    length = sum(lengths) / units if len(lengths) == units else None
    rows = list(lines.values())
    mean = Quadrants(rows[0], rows[1], rows[2], rows[3], transition_rad=length)
    known = replace(
        figures,
        calibration={name: _of_mean(name, found) for name in QUADRANTS},
        calibrated_units=[UnitDeviation.between(one, mean) for one in found],
    )
    return mean, known


def _mean(lines: list[TorqueLine]) -> TorqueLine:
    return TorqueLine(*(float(np.mean(values)) for values in zip(*lines, strict=True)))


def _of_mean(name: str, found: list[Quadrants]) -> LineCovariance:
    fits = [one.fits[name] for one in found]
    u_offset, u_slope = (
        float(np.linalg.norm([getattr(fit, of) for fit in fits])) / len(fits) for of in ("u_offset_nm", "u_slope")
    )
    return LineCovariance(u_offset, u_slope, float(np.mean([fit.correlation for fit in fits])))
