"""How far noise of the sensors moves a metric: the loop is measured again and again, with noise, on paper.

What averaging in blocks and monotone regression leave of the noise is no formula, so it is tried: the branch is laid
out evenly in time, as it was measured, noise as declared is added, and it is reduced again.
"""

from __future__ import annotations

import math

import numpy as np

from analysis.branches import MOST_BLOCKS, Branch, made_rising
from analysis.loop import Loop
from analysis.uncertainty.circumstances import Circumstances
from analysis.uncertainty.figures import SensorFigures
from analysis.units import ARCMIN_PER_RAD, FloatArray

NOISY_LOOPS = 40
"""Loops that are tried: their scatter is then known to 11 %."""

SEED = 1
"""The same loop has the same uncertainty whenever it is evaluated."""


def noisy_loops(loop: Loop, circumstances: Circumstances, figures: SensorFigures) -> list[Loop]:
    """Return the loop as one cycle might have shown it with other noise; empty when no noise is declared."""
    random = np.random.default_rng(SEED)
    angle_sd = _angle_noise(circumstances, figures)
    sensor = figures.torque_in if circumstances.converted else figures.torque_out
    torque_sd = 0.0 if sensor is None else sensor.noise_fraction * sensor.full_scale_nm
    if torque_sd == 0.0 and angle_sd == 0.0:
        return []
    laid_out = [
        _even(loop.forward, circumstances, 1, torque_sd, angle_sd),
        _even(loop.backward, circumstances, -1, torque_sd, angle_sd),
    ]
    found = []
    for _ in range(NOISY_LOOPS):
        forward, backward = (
            made_rising(
                branch.torque_nm + torque * random.standard_normal(branch.torque_nm.size),
                branch.angle_arcmin + angle * random.standard_normal(branch.torque_nm.size),
                np.ones(branch.torque_nm.size),
            )
            for branch, torque, angle in laid_out
        )
        found.append(Loop(forward, backward, loop.method))
    return found


def _even(
    branch: Branch, circumstances: Circumstances, direction: int, torque_sd: float, angle_sd: float
) -> tuple[Branch, FloatArray | float, float]:
    """Lay a branch out in blocks evenly in time; return it with the noise of a block's torque and wind-up."""
    samples = (circumstances.forward if direction > 0 else circumstances.backward).samples
    size = -(-samples // MOST_BLOCKS)
    torque = np.linspace(branch.torque_nm[0], branch.torque_nm[-1], -(-samples // size))
    even = Branch(torque, np.interp(torque, branch.torque_nm, branch.angle_arcmin))
    slope = circumstances.points(even, direction).slope if circumstances.converted else 1.0
    return even, slope * torque_sd / math.sqrt(size), angle_sd / math.sqrt(size)


def _angle_noise(circumstances: Circumstances, figures: SensorFigures) -> float:
    """Standard deviation of the wind-up of one sample, arcmin."""
    variance = 0.0
    for name, encoder, scale in (
        ("angle_in", figures.angle_in, circumstances.method.ratio),
        ("angle_out", figures.angle_out, 1.0),
    ):
        if encoder is not None and name in circumstances.encoders:
            variance += (encoder.noise_rad * ARCMIN_PER_RAD / scale) ** 2
    return math.sqrt(variance)
