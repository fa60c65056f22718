"""Simulated units, each measured once by a simulated bench with errors, and what each truly is."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from analysis.evaluation.metric_result import MetricResult
from analysis.evaluation.pipeline import analyse
from analysis.loop.method import Method, MetricWanted
from analysis.studies.coverage import Pair
from analysis.studies.simulated_run import (
    Course,
    SimulatedBench,
    TorqueErrors,
    as_built,
    course_of,
    exact_trace,
    measured_trace,
)
from analysis.studies.simulated_unit import SimulatedUnit
from analysis.studies.stored_lines import stored_lines
from analysis.uncertainty.figures import SensorFigures

SEED = 20


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
    true_method = Method(method.ratio, method.rated_torque_nm, method.reference_torque_nm)
    for seed in range(units):
        random = np.random.default_rng([SEED, seed])
        unit, built = SimulatedUnit().varied(random), as_built(bench, figures, random)
        course = course_of(unit, built)
        truth = analyse(exact_trace(course, built), true_method, wanted).metrics
        if calibrated_units:
            yield truth, _by_stored_lines(calibrated_units, course, built, figures, method, wanted, random)
        else:
            yield (
                truth,
                analyse(measured_trace(course, built, figures, random), method, wanted, figures=figures).metrics,
            )


def _by_stored_lines(  # noqa: PLR0917 - a run, how it is measured, and by what
    units: int, course: Course, bench: SimulatedBench, figures: SensorFigures, method: Method,
    wanted: Sequence[MetricWanted], random: np.random.Generator,
) -> tuple[MetricResult, ...]:  # fmt: skip
    of_sensors = {"torque_in": figures.torque_in, "torque_out": figures.torque_out}
    sensors = {name: TorqueErrors.drawn(one, random) for name, one in of_sensors.items() if one is not None}
    lines, known = stored_lines(units, bench, figures, sensors, random)
    trace = replace(measured_trace(course, bench, figures, random, sensors), torque_out_nm=None)
    return analyse(trace, replace(method, quadrants=lines), wanted, figures=known).metrics
