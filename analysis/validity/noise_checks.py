"""Figures of the validity checks that hold the noise of the torques against what is declared of their sensors.

Noise is what a sample has that its neighbours have not. A trace with much less of it was smoothed, and smoothing takes
from the play of a loop; one with much more has a fault, or a coarser resolution, that no row of the budget knows.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from analysis.loop.measured import Measured
from analysis.trace.runs import Run
from analysis.trace.units import FloatArray
from analysis.validity.evidence import NOT_EVALUATED, Evidence, Figure, Reading

SLOWEST_S = 0.005
"""Time between samples up to which what a sample has of its own is noise, and not the course of the torque."""

SECOND_DIFFERENCE = 6.0
"""Variance of x(n−1) − 2·x(n) + x(n+1) of noise, in variances of the noise: 1 + 4 + 1."""

BLOCK = 50
"""Samples of which the noise is told where the quietest stretch counts: fewer would scatter below a third by chance."""

LEAST_BLOCKS = 10
"""Of a branch of the calibration that is looked at: in a shorter one the jerks at its ends would count as noise."""

Worst = Callable[[list[tuple[float, str]]], tuple[float, str]]
"""Which channel counts, by its noise over the declared one."""


def noise_low(evidence: Evidence) -> Reading | str:
    """Noise of the quietest 50 samples over the declared one, of the torque channel that has least of it, %.

    A display that shows little torque as none, a channel that stands for a while: each has a stretch without noise.
    """
    return _noise(evidence, lambda runs: min(float(one.min()) for one in runs), min)


def noise_high(evidence: Evidence) -> Reading | str:
    """Noise over the declared one, of the torque channel that has most of it, %: measuring, or in a calibration branch.

    Lines of the torque ratio are fitted to the noise of the input torque, which makes them flatter.
    """
    return _noise(evidence, lambda runs: max(float(one.mean()) for one in runs), max, calibration=True)


def _noise(
    evidence: Evidence, of_runs: Callable[[list[FloatArray]], float], of_channels: Worst, *, calibration: bool = False
) -> Reading | str:
    """Return the noise of the channel that counts, in shares of what is declared of it, %."""
    found = evidence.measured
    if found is None:
        return NOT_EVALUATED
    declared = {name: nm for name, nm in evidence.torque_noise_nm.items() if nm > 0.0}
    there = [name for name in declared if getattr(found.trace, name) is not None]
    if not there:
        return "needs the noise of a torque sensor in the bench file"
    step_s = found.trace.step_s
    if step_s is None or step_s > SLOWEST_S:
        return f"not measured: needs {1.0 / SLOWEST_S:g} samples per second or more to separate noise from the signal"
    variances = {name: _variances(found, name, calibration=calibration) for name in there}
    if not all(variances.values()):
        return f"not measured: no branch has {BLOCK} samples"
    ratio, name = of_channels([(math.sqrt(of_runs(some)) / declared[name], name) for name, some in variances.items()])
    words = f"{name} has noise of {ratio * declared[name]:.2g} N·m, and {declared[name]:.2g} are declared"
    return Reading(100.0 * ratio, words)


def _variances(found: Measured, channel: str, *, calibration: bool) -> list[FloatArray]:
    """Return the variance of a torque channel's noise in each block, (N·m)²: of all measured branches, then of others.

    The others are the branches of the calibration, each for itself: its lines are fitted to few of them.
    """
    values = getattr(found.recorded, channel)
    together = [_of_run(one.run, values) for pair in found.pairs for one in pair]
    alone = [_of_run(run, values) for run in found.runs if calibration and run.role == "calibrate"]
    variances = [np.concatenate(together), *(one for one in alone if one.size >= LEAST_BLOCKS)]
    return [one for one in variances if one.size]


def _of_run(run: Run, values: FloatArray) -> FloatArray:
    blocks = []
    for rows in run.pieces:
        squares = np.square(np.diff(values[rows], 2)) / SECOND_DIFFERENCE
        blocks.append(squares[: squares.size // BLOCK * BLOCK].reshape(-1, BLOCK).mean(axis=1))
    return np.concatenate(blocks)


FIGURES: dict[str, Figure] = {
    "noise_low": noise_low,
    "noise_high": noise_high,
}
"""Figures of these checks, by their ids."""
