"""Distributions of errors: standard uncertainty from a declared figure, and draws of the error's components.

A cyclic error has two components (sine and cosine of the shaft's angle), for nobody knows its phase; the counts of an
encoder have one for each way in which they may lie.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from analysis.trace.units import FloatArray


class Distribution(NamedTuple):
    """Divisor that makes a figure a standard uncertainty (of each component), and how components are drawn.

    draw: (generator, figure, draws, components) → errors, shape (draws, components).
    """

    text: str
    divisor: float
    draw: Callable[[np.random.Generator, float, int, int], FloatArray]


def _rectangular(random: np.random.Generator, limit: float, draws: int, components: int) -> FloatArray:
    return random.uniform(-limit, limit, (draws, components))


def _normal(random: np.random.Generator, limit: float, draws: int, components: int) -> FloatArray:
    return random.normal(0.0, limit, (draws, components))


def _expanded(random: np.random.Generator, limit: float, draws: int, components: int) -> FloatArray:
    return _normal(random, limit / 2.0, draws, components)


def _cyclic(random: np.random.Generator, limit: float, draws: int, components: int) -> FloatArray:  # noqa: ARG001
    return _phased(random, random.uniform(0.0, limit, draws))


def _quantised(random: np.random.Generator, limit: float, draws: int, components: int) -> FloatArray:
    # Counts lie in one way at a time, in each as often: all components together have the size of one error.
    drawn = np.zeros((draws, components))
    amount = random.choice((-1.0, 1.0), draws) * (limit * math.sqrt(components / 3.0))
    drawn[np.arange(draws), random.permutation(draws) % components] = amount
    return drawn


def _phased(random: np.random.Generator, amplitude: FloatArray) -> FloatArray:
    phase = random.uniform(0.0, 2.0 * math.pi, amplitude.size)
    return np.stack([amplitude * np.sin(phase), amplitude * np.cos(phase)], axis=1)


DISTRIBUTIONS: dict[str, Distribution] = {
    "normal": Distribution("normal, the figure is its standard deviation", 1.0, _normal),
    "rectangular": Distribution("anywhere within ± the figure", math.sqrt(3.0), _rectangular),
    "normal, k = 2": Distribution("normal, the figure is an expanded uncertainty with k = 2", 2.0, _expanded),
    "cyclic": Distribution("a sine of any phase, amplitude anywhere up to the figure", math.sqrt(6.0), _cyclic),
    "quantised": Distribution("rounding to steps of twice the figure", math.sqrt(3.0), _quantised),
}
"""By name. GUM 4.3.3 (k = 2), 4.3.7; cyclic: variance of r·sin(x), r rectangular in 0…a, is a²/6 per component."""

STATED_BY = {"data_sheet": "rectangular", "certificate": "normal, k = 2"}
"""Distribution of a sensor's figure by who states it: limits of a whole series, or a calibration of this one piece."""
