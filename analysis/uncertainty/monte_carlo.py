"""Monte Carlo beside the budget (GUM supplement 1): every error drawn at once, the metric evaluated for each draw.

It needs no sensitivities and no k: where a metric is not straight in its errors, or one error outweighs the others, the
interval is not value ± U. Draws work on the reduced branches, errors of all draws in one product of matrices.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from analysis.loop.branches import Branch, made_rising
from analysis.loop.loop import Loop
from analysis.trace.units import FloatArray
from analysis.uncertainty.chain import Move
from analysis.uncertainty.distributions import DISTRIBUTIONS
from analysis.uncertainty.scatter import CONFIDENCE

SEED = 11


class Drawn(NamedTuple):
    """What is drawn of one source: distribution, limit, and the moves of its components."""

    distribution: str
    limit: float
    moves: tuple[Move, ...]


class MonteCarlo(NamedTuple):
    """Standard deviation, mean shift, and the 95.45 % interval of a metric's value.

    In u the scatter of the cycles counts plainly: Student's t of one or two degrees of freedom has no deviation.
    """

    draws: int
    u: float
    shift: float
    low: float
    high: float


def drawn_loops(loop: Loop, sources: Sequence[Drawn], draws: int) -> list[Loop]:
    """Return the loop with so many draws of all errors in it."""
    random = np.random.default_rng(SEED)
    amounts = [DISTRIBUTIONS[one.distribution].draw(random, one.limit, draws, len(one.moves)) for one in sources]
    moves = [move for one in sources for move in one.moves]
    together = np.concatenate(amounts, axis=1) if amounts else np.zeros((draws, 0))
    branches = [
        _moved(branch, together, [move[side] for move in moves])
        for side, branch in enumerate((loop.forward, loop.backward))
    ]
    return [Loop(forward, backward, loop.method) for forward, backward in zip(*branches, strict=True)]


def _moved(
    branch: Branch, amounts: FloatArray, parts: Sequence[tuple[FloatArray | float, FloatArray | float]]
) -> list[Branch]:
    points = branch.torque_nm.size
    torque, angle = (
        branch_values + amounts @ np.array([np.broadcast_to(part[index], points) for part in parts]).reshape(-1, points)
        for index, branch_values in enumerate((branch.torque_nm, branch.angle_arcmin))
    )
    counts = np.ones(points)
    return [made_rising(one_torque, one_angle, counts) for one_torque, one_angle in zip(torque, angle, strict=True)]


def monte_carlo(
    estimate: Callable[[Loop], float], base: Loop, loops: Sequence[Loop], value: float, *,
    besides: Sequence[tuple[str, float]], scatter: float, freedom: int,
) -> MonteCarlo:  # fmt: skip
    """Return the distribution of a metric about its value.

    besides: distribution and limit of errors of the mean itself, as noise makes them. scatter: standard deviation of
    the mean from the cycles beyond it, by Student's t of `freedom` (GUM-S1, 6.4.9).
    """
    random = np.random.default_rng(SEED)
    errors = np.array([estimate(loop) for loop in loops]) - estimate(base)
    for distribution, limit in besides:
        errors += DISTRIBUTIONS[distribution].draw(random, limit, errors.size, 1)[:, 0]
    u = math.hypot(float(errors.std(ddof=1)), scatter)
    if scatter > 0.0 and freedom > 0:
        return interval(errors, value, u, scatter * random.standard_t(freedom, errors.size))
    return interval(errors, value, u)


def interval(errors: FloatArray, value: float, u: float, scattered: FloatArray | float = 0.0) -> MonteCarlo:
    """Return the distribution of a value that errors were drawn of; `scattered` widens it and shifts nothing."""
    shift, errors = float(errors.mean()), errors + scattered
    tail = 50.0 * (1.0 - CONFIDENCE)
    low, high = np.percentile(errors, [tail, 100.0 - tail])
    if not math.isfinite(float(errors.sum())):
        raise ArithmeticError(
            "Monte Carlo: in one of the draws, the metric cannot be computed. Check the sensor specifications"
        )
    return MonteCarlo(errors.size, u, shift, value + float(low), value + float(high))
