"""Distributions of errors: standard uncertainty from a declared figure, and draws of the error's components.

A cyclic error has two components (sine and cosine of the shaft's angle), for nobody knows its phase, or two for each
length that it may have; the counts of an encoder have one for each way in which they may lie.
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


def _cyclic(random: np.random.Generator, limit: float, draws: int, components: int) -> FloatArray:
    phase = random.uniform(0.0, 2.0 * math.pi, draws)
    if components == 2:
        return limit * np.stack([np.sin(phase), np.cos(phase)], axis=1)
    # Of several lengths that a wave may have it has one: all pairs together have the size of one wave.
    drawn = np.zeros((draws, components // 2, 2))
    peak = limit * math.sqrt(components / 2)
    drawn[np.arange(draws), random.permutation(draws) % (components // 2)] = peak * np.stack(
        [np.sin(phase), np.cos(phase)], axis=1
    )
    return drawn.reshape(draws, components)


def _quantised(random: np.random.Generator, limit: float, draws: int, components: int) -> FloatArray:
    # Counts lie in one way at a time, in each as often: all components together have the size of one error.
    drawn = np.zeros((draws, components))
    amount = random.choice((-1.0, 1.0), draws) * (limit * math.sqrt(components / 3.0))
    drawn[np.arange(draws), random.permutation(draws) % components] = amount
    return drawn


DISTRIBUTIONS: dict[str, Distribution] = {
    "normal": Distribution("normal, the figure is its standard deviation", 1.0, _normal),
    "rectangular": Distribution("anywhere within ± the figure", math.sqrt(3.0), _rectangular),
    "normal, k = 2": Distribution("normal, the figure is an expanded uncertainty with k = 2", 2.0, _expanded),
    "cyclic": Distribution("a sine of any phase whose peak is the figure", math.sqrt(2.0), _cyclic),
    "quantised": Distribution("rounding to steps of twice the figure", math.sqrt(3.0), _quantised),
}
"""By name. GUM 4.3.3 (k = 2), 4.3.7.

cyclic: a·sin(x) at a phase that nobody knows has the arcsine distribution, of variance a²/2 per component (GUM-S1,
6.4.6). What an encoder declares is its largest deviation, so it is the peak of that sine.
"""

STATED_BY = {"data_sheet": "rectangular", "certificate": "normal, k = 2"}
"""Distribution of a sensor's figure by who states it: limits of a whole series, or a calibration of this one piece."""
