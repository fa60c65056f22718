"""Does the stated uncertainty hold? Many simulated units, each measured once with errors, against its own true loop.

For a metric to pass, U (k = 2) must contain the error of nearly 95 % of the units, and what all units are wrong by in
the same direction (bias) must be small beside U.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from analysis.method import Method, MetricWanted
from analysis.pipeline import analyse
from analysis.studies.simulated_run import SimulatedBench, course_of, exact_trace, measured_trace
from analysis.studies.simulated_unit import SimulatedUnit
from analysis.uncertainty.figures import SensorFigures

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


def coverage(
    units: int,
    figures: SensorFigures,
    wanted: Sequence[MetricWanted],
    method: Method,
    *,
    bench: SimulatedBench | None = None,
    progress: Callable[[int], None] = lambda _: None,
) -> list[CoverageRow]:
    """Measure so many seeded units around the default one and compare with their true loops.

    Every parameter is moved within ± 20 %, and the sides of a unit differ within ± 5 % (`SimulatedUnit.varied`).

    method: with output_torque "calibrated" the torque is converted from the input torque; the true loop never is.
    """
    bench = bench or SimulatedBench()
    true_method = Method(method.ratio, method.rated_torque_nm, method.reference_torque_nm)
    found: list[list[tuple[float, float, float]]] = [[] for _ in wanted]
    for seed in range(units):
        random = np.random.default_rng([SEED, seed])
        course = course_of(SimulatedUnit().varied(random), bench)
        truth = analyse(exact_trace(course, bench), true_method, wanted).metrics
        shown = analyse(measured_trace(course, bench, figures, random), method, wanted, figures=figures).metrics
        for row, true, seen in zip(found, truth, shown, strict=True):
            for exact, side in zip(true.sides, seen.sides, strict=True):
                if exact.value is None or side.value is None or side.uncertainty is None:
                    row.append((np.nan, np.nan, np.nan))
                else:
                    row.append((exact.value, side.value - exact.value, side.uncertainty))
        progress(seed + 1)
    return [
        _row(one, seen.definition.unit, values, units) for one, seen, values in zip(wanted, shown, found, strict=True)
    ]


def _row(wanted: MetricWanted, unit: str, values: list[tuple[float, float, float]], units: int) -> CoverageRow:
    exact, error, expanded = np.array(values).T
    return CoverageRow(
        metric=wanted.id if wanted.branch is None else f"{wanted.id} {wanted.branch}",
        unit=unit,
        value=float(exact.mean()),
        bias=float(error.mean()),
        deviation=float(error.std(ddof=1)),
        expanded=float(np.median(expanded)),
        largest=float(expanded.max()),
        largest_relative=float((expanded / np.maximum(np.abs(exact), 1e-9)).max()),
        covered=float((np.abs(error) <= expanded).mean()),
        count=error.size,
        units=units,
    )
