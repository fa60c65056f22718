"""Figures of the validity checks that hold the torque sensors against the torque that the servo drive reports.

The drive knows its torque from the motor's current: coarse, and never a measurement, but of neither sensor's gain nor
of its delay. Each returns a Reading, or the reason in words why the figure does not apply here.
"""

from __future__ import annotations

import numpy as np

from analysis.loop.measured import Measured
from analysis.trace.runs import Run
from analysis.trace.units import FloatArray
from analysis.validity.evidence import Figure, Reading, of_measured

NO_DRIVE = "not measured: the torque that the drive reports is not in the trace"
MIDDLE = (0.1, 0.9)
"""Share of the peak torque over which the two are compared: friction of the motor reverses next to the turn."""


@of_measured
def drive_torque_agreement(found: Measured) -> Reading | str:
    """How far the drive's torque over that of the sensor of the loaded shaft is from one, %; the worse side.

    It is the mean slope of loading and unloading: what a gearbox takes while loading it gives back while unloading.
    """
    slopes = []
    for pair in found.pairs:
        both = [torques for one in pair if (torques := _torques(found, one.run)) is not None]
        if not both:
            return NO_DRIVE
        slopes += [float(np.mean([_slope(*torques, side) for torques in both])) for side in (1, -1)]
    worst = max(slopes, key=lambda one: abs(one - 1.0))
    words = f"the drive reports {worst:.3g} of the torque that the sensor of the loaded shaft measures"
    return Reading(100.0 * abs(worst - 1.0), words)


@of_measured
def drive_torque_gap(found: Measured) -> Reading | str:
    """Drive's torque less the sensor's, rising against falling branch, % of the torque between the turning points.

    A sensor that lags reads too little while the torque rises and too much while it falls. Friction between motor and
    sensor does the same: of a gearbox it is too much to tell the two apart.
    """
    if found.method.loading == "output":
        return "not measured: friction in the load servo's gearbox looks like a lag"
    worst = 0.0
    for pair in found.pairs:
        differences, spans = [], []
        for one in pair:
            torques = _torques(found, one.run)
            if torques is None:
                return NO_DRIVE
            measured, reported = torques
            middle = np.abs(measured) < MIDDLE[1] * float(np.abs(measured).max())
            differences.append(float(np.mean(reported[middle] - measured[middle])))
            spans.append(float(np.ptp(measured)))
        rising, falling = differences
        worst = max(worst, abs(rising - falling) / min(spans))
    return Reading(100.0 * worst)


def _torques(found: Measured, run: Run) -> tuple[FloatArray, FloatArray] | None:
    """Torque of the loaded shaft by its sensor and by the drive [N·m] along a branch; None without one of them."""
    trace = found.trace
    measured = trace.torque_in_nm if found.method.loading == "input" else trace.torque_out_nm
    if measured is None or trace.drive_torque_nm is None:
        return None
    return run.take(measured), run.take(trace.drive_torque_nm)


def _slope(measured: FloatArray, reported: FloatArray, side: int) -> float:
    """Slope of the drive's torque over the sensor's on one side of zero; infinity where the sensor shows no range."""
    low, high = (share * float(np.abs(measured).max()) for share in MIDDLE)
    x, y = (values[(side * measured > low) & (side * measured < high)] for values in (measured, reported))
    if x.size < 3 or not np.ptp(x) > 0.0:
        return float("inf")
    return float(np.cov(x, y)[0, 1] / x.var(ddof=1))


FIGURES: dict[str, Figure] = {
    "drive_torque_agreement": drive_torque_agreement,
    "drive_torque_gap": drive_torque_gap,
}
"""Figures of these checks, by their ids."""
