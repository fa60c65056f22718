"""Figures of the validity checks that hold the sensors of the loaded shaft against what the servo drive reports.

The drive knows its torque from the motor's current: coarse, and never a measurement, but of neither sensor's gain nor
of its delay. Its position is that of another encoder on the same shaft: a wave, a wrong scale or a lag of the angle is
not in it. Between the two lie a coupling, perhaps a gearbox, and the error of the motor's encoder. These come again
in every branch of one direction, at the same angle. Each returns a Reading, or the reason in words why the figure does
not apply here.
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np

from analysis.loop.measured import Measured
from analysis.trace.runs import Run
from analysis.trace.units import FloatArray
from analysis.validity.evidence import Figure, LeftOpen, Reading, of_measured, once
from definitions.units import ARCMIN_PER_RAD

NO_DRIVE = "not measured: needs the torque that the drive reports in the trace"
MIDDLE = (0.1, 0.9)
"""Share of the peak torque over which the two are compared: friction of the motor reverses next to the turn."""


LENS_MEAN = 1.0 - MIDDLE[1] ** 2 / 3.0
"""Mean of 1 − (T/peak)² over the torques that are compared."""


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
    # Of the drive's torque nothing is declared but the limit itself: a gain up to it is as good as none.
    return Reading(100.0 * abs(worst - 1.0), words, LeftOpen(1.0))


@of_measured
def drive_torque_gap(found: Measured) -> Reading | str:
    """Drive's torque less the sensor's, rising against falling branch, % of the torque between the turning points.

    A sensor that lags reads too little while the torque rises and too much while it falls. Friction between motor and
    sensor does the same: of a gearbox it is too much to tell the two apart. What the drive's gain makes of the friction
    of the unit, which is in both torques, is no gap: it is taken off.
    """
    if found.method.loading == "output":
        return "not possible with loading 'output': friction in the gearbox of the load servo looks like a lag"
    worst = 0.0
    for pair in found.pairs:
        differences, spans = [], []
        both = [torques for one in pair if (torques := _torques(found, one.run)) is not None]
        if len(both) < len(pair):
            return NO_DRIVE
        gain = float(np.mean([_slope(*torques, side) for torques in both for side in (1, -1)]))
        if not 0.0 < gain < np.inf:
            return Reading(float("inf"), "the drive's torque does not follow the sensor of the loaded shaft")
        for measured, reported in both:
            middle = np.abs(measured) < MIDDLE[1] * float(np.abs(measured).max())
            differences.append(float(np.mean(reported[middle] / gain - measured[middle])))
            spans.append(float(np.ptp(measured)))
        rising, falling = differences
        worst = max(worst, abs(rising - falling) / min(spans))
    peak_nm = max(float(np.abs(one.torque_nm).max()) for pair in found.pairs for one in pair)
    # A limit is of the whole torque between the turns, and the mean of a lens over `MIDDLE` is a share of its height.
    return Reading(100.0 * worst, "", LeftOpen(peak_nm / (100.0 * LENS_MEAN)))


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


NO_POSITION = "not measured: needs the drive's position, the angle of the loaded shaft and the time in the trace"

ANGLE_BLOCKS, LEAST_PER_BLOCK = 200, 4
"""Blocks of a branch over which position and angle are averaged, and the fewest samples of a block."""

SHARED = 0.75
"""Share of the longest way that two branches must have in common to be compared. One that begins at rest has another
torque at the same angle, as friction has not reversed in it, and the coupling another twist."""

FAST = 0.95
"""Share of a branch that is slower than the speed by which a delay is told as an angle."""


class _Apart(NamedTuple):
    """One branch: angle of the loaded shaft, drive's position less it, and its speed; arcmin and s, mean of blocks."""

    run: Run
    angle_arcmin: FloatArray
    apart_arcmin: FloatArray
    speed_arcmin_s: FloatArray


@of_measured
def drive_angle_agreement(found: Measured) -> Reading | str:
    """Change of the drive's position less the angle of its shaft within a measured branch, % of the way; the worst."""
    branches = _apart(found)
    if isinstance(branches, str):
        return branches
    way = max(float(np.ptp(one.angle_arcmin)) for one in branches)
    if not way > 0.0:
        return "not measured: the loaded shaft does not turn"
    worst = max(float(np.ptp(one.apart_arcmin)) for one in branches if one.run.role == "measure")
    words = f"the drive's position and the angle of the loaded shaft differ by {worst:.3g} arcmin of {way:.4g} arcmin"
    return Reading(100.0 * worst / way, words, LeftOpen(way / 200.0))


@of_measured
def drive_angle_repeat(found: Measured) -> Reading | str:
    """Angle by which that shaft is later in one branch than in another of its direction, % of the way; the worst."""
    branches = _apart(found)
    if isinstance(branches, str):
        return branches
    way = max(float(np.ptp(one.angle_arcmin)) for one in branches)
    worst, words = None, ""
    for one, other in combinations(branches, 2):
        if one.run.direction != other.run.direction or "measure" not in {one.run.role, other.run.role}:
            continue
        low = max(float(one.angle_arcmin.min()), float(other.angle_arcmin.min()))
        high = min(float(one.angle_arcmin.max()), float(other.angle_arcmin.max()))
        if high - low < SHARED * way or not way > 0.0:
            continue
        at = np.linspace(low, high, ANGLE_BLOCKS)
        change, speed = (_over(one, at, of) - _over(other, at, of) for of in ("apart_arcmin", "speed_arcmin_s"))
        speed = _over(one, at, "speed_arcmin_s") - 0.5 * speed
        late_s = _slope_of(speed, change)
        fast = float(np.quantile(np.abs(speed), FAST))
        if worst is None or abs(late_s) * fast > worst:
            worst, words = (
                abs(late_s) * fast,
                (
                    f"the loaded shaft's angle is {1e3 * abs(late_s):.2g} ms later behind the drive's position in one "
                    f"branch than in another of its direction ({one.run.role} and {other.run.role})"
                ),
            )
    if worst is None:
        return "needs two branches in the same direction"
    return Reading(100.0 * worst / way, words)


@of_measured
def drive_angle_direction(found: Measured) -> Reading | str:
    """Change of the drive's position less the angle of its shaft from rising to falling, % of the way; worst cycle.

    At the same angle waves, scale and the rest of the coupling are the same in both. What its twist by the friction of
    the loaded shaft explains, and one delay, is taken off: what is left comes and goes within the ramps.
    """
    branches = _apart(found)
    if isinstance(branches, str):
        return branches
    trace = found.trace
    torque = trace.torque_in_nm if found.method.loading == "input" else trace.torque_out_nm
    torque = trace.drive_torque_nm if torque is None else torque
    if torque is None:
        return "not measured: needs the torque of the loaded shaft in the trace, because it twists the coupling"
    way = max(float(np.ptp(one.angle_arcmin)) for one in branches)
    cycles = [one for one in branches if one.run.role == "measure"]
    pairs = [(up, down) for up in cycles for down in cycles
             if up.run.direction > 0 > down.run.direction and up.run.cycle == down.run.cycle]  # fmt: skip
    worst = None
    for up, down in pairs:
        low, high = (of(pick(up.angle_arcmin), pick(down.angle_arcmin)) for of, pick in ((max, np.min), (min, np.max)))
        if not way > 0.0 or high - low < SHARED * way:
            continue
        at = np.linspace(float(low), float(high), ANGLE_BLOCKS)
        change, speed = (_over(up, at, of) - _over(down, at, of) for of in ("apart_arcmin", "speed_arcmin_s"))
        twists = [_at(one.angle_arcmin, _means(one.run.take(torque)), at) for one in (up, down)]
        columns = np.stack([np.ones_like(at), speed, twists[0] - twists[1]], axis=1)
        left = change - columns @ np.linalg.lstsq(columns, change)[0]
        worst = max(worst or 0.0, float(np.ptp(left)))
    if worst is None:
        return "needs a rising and a falling branch of one cycle"
    words = f"the loaded shaft's angle is later in one part of a ramp than in another, by {worst:.2g} arcmin in all"
    over = found.method.ratio if found.method.loading == "input" else 1.0
    return Reading(100.0 * worst / way, words, LeftOpen(LENS_LEFT * way / (100.0 * over)))


LENS_LEFT = 4.2
"""Half of what a delay within the ramps adds to the width, over what of it is left: the largest of all types of units
of the independent generator, and of delays over a fifth of a ramp to all but its ends."""


def _over(branch: _Apart, at_arcmin: FloatArray, name: str) -> FloatArray:
    return _at(branch.angle_arcmin, getattr(branch, name), at_arcmin)


def _at(angle_arcmin: FloatArray, values: FloatArray, at_arcmin: FloatArray) -> FloatArray:
    """Return values of a branch at other angles than those that they were averaged at."""
    order = np.argsort(angle_arcmin)
    found: FloatArray = np.interp(at_arcmin, angle_arcmin[order], values[order])
    return found


def _means(values: FloatArray) -> FloatArray:
    """Return the mean of each block of a branch."""
    per_block = values.size // ANGLE_BLOCKS
    found: FloatArray = values[: ANGLE_BLOCKS * per_block].reshape(ANGLE_BLOCKS, per_block).mean(axis=1)
    return found


@once
def _apart(found: Measured) -> list[_Apart] | str:
    """Return the branches of one ramp, what one delay of the drive's position explains taken off; or why none."""
    trace = found.trace
    angle = trace.angle_in_rad if found.method.loading == "input" else trace.angle_out_rad
    if trace.drive_angle_rad is None or trace.t_s is None or angle is None:
        return NO_POSITION
    channels = (trace.t_s, angle * ARCMIN_PER_RAD, trace.drive_angle_rad * ARCMIN_PER_RAD)
    branches = []
    for run in found.runs:
        per_block = sum(rows.stop - rows.start for rows in run.pieces) // ANGLE_BLOCKS
        if len(run.pieces) > 1 or per_block < LEAST_PER_BLOCK:
            continue
        time, turned, position = (run.take(values) for values in channels)
        edges = np.minimum(per_block * np.arange(ANGLE_BLOCKS + 1), time.size - 1)
        took_s = np.diff(time[edges])
        if (took_s > 0.0).all():
            apart = _means(position) - _means(turned)
            # Both count half: what one delay puts between them is then its product with this speed, to the second
            # order. A speed by neighbouring blocks is too slow where the play is crossed within a few of them.
            speed = np.diff(0.5 * (position + turned)[edges]) / took_s
            branches.append(_Apart(run, _means(turned), apart - apart.mean(), speed))
    if not any(one.run.role == "measure" for one in branches):
        return f"not measured: no branch of one ramp has {ANGLE_BLOCKS * LEAST_PER_BLOCK} samples"
    # The median, for one branch may be the late one.
    delays_s = [_slope_of(one.speed_arcmin_s, one.apart_arcmin) for one in branches]
    delay_s = float(np.median(delays_s))
    return [one._replace(apart_arcmin=one.apart_arcmin - delay_s * one.speed_arcmin_s) for one in branches]


def _slope_of(speed: FloatArray, apart: FloatArray) -> float:
    """Slope of a difference of angles over the speed, seconds: what is late by it; 0 at one speed alone."""
    about = speed - speed.mean()
    power = float(about @ about)
    return float(about @ apart) / power if power > 0.0 else 0.0


FIGURES: dict[str, Figure] = {
    "drive_angle_agreement": drive_angle_agreement,
    "drive_angle_direction": drive_angle_direction,
    "drive_angle_repeat": drive_angle_repeat,
    "drive_torque_agreement": drive_torque_agreement,
    "drive_torque_gap": drive_torque_gap,
}
"""Figures of these checks, by their ids."""
