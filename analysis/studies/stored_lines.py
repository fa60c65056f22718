"""Torque ratio that a simulated bench has stored: the mean of some units of a lot, each calibrated once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.studies.simulated_run import Sensors, SimulatedBench, course_of, measured_trace
from analysis.studies.simulated_unit import SimulatedUnit
from analysis.torque_ratio.quadrant_fit import fit_quadrants
from analysis.torque_ratio.quadrants import QUADRANTS, Quadrants, TorqueLine
from analysis.trace.runs import commanded_runs
from analysis.uncertainty.figures import LineCovariance, SensorFigures, UnitDeviation


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
