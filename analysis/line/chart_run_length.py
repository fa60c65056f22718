"""How long a control chart lasts without a change: its means by their rules and its spreads by their limits, together.

A chart is out of control where either signals, so a false alarm comes sooner than by the rules of the means alone. Mean
and spread of a subgroup of normal values are independent of each other. So the spreads end a run with one probability
at each point, which follows from the distribution of their statistic, and the run length of both together is as exact,
or as well simulated, as that of the rules. A moving range has a value in common with the one before it and two with the
points themselves: charts of single values are simulated, with the error stated.

Limits are known and values normal, as in `run_rules`. A chart whose limits come from few subgroups has others.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence

import scipy  # loads integrate and special where they are used

from analysis.line.control_chart import SIGMAS, SpreadKind, spread_constants
from analysis.line.run_rules import RunLength, average_run_length


def chart_run_length(rules: Sequence[str], kind: SpreadKind, subgroup: int, shift: float = 0.0) -> RunLength:
    """Return the average run length in points of both charts together.

    rules: of the means, names of `RULES`. kind, subgroup: what is plotted of the spread, and the values of a subgroup.
    shift: of the mean, in standard deviations of what is plotted; the spread stays. With subgroups of two and more the
    rules' own method takes a further probability of a signal at each point, that of `spread_alarm`; single values are
    simulated with the moving range, which signals beyond its limit.
    """
    if subgroup == 1:
        expected, scatter = spread_constants(kind, 2)
        return average_run_length(rules, shift, most_step=expected + SIGMAS * scatter)
    return average_run_length(rules, shift, beside=spread_alarm(kind, subgroup))


@functools.cache
def spread_alarm(kind: SpreadKind, subgroup: int) -> float:
    """Return the probability that range or standard deviation of normal values, two or more, is beyond its limits."""
    expected, scatter = spread_constants(kind, subgroup)
    low, high = (max(0.0, expected + side * SIGMAS * scatter) for side in (-1.0, 1.0))
    below = _range_below if kind == "range" else _sd_below
    return below(low, subgroup) + 1.0 - below(high, subgroup)


def _sd_below(sd: float, subgroup: int) -> float:
    """Return the probability of a smaller standard deviation: (n − 1) s² / σ² has the chi-squared distribution."""
    return float(scipy.special.chdtr(subgroup - 1, (subgroup - 1) * sd**2))


def _range_below(reach: float, subgroup: int) -> float:
    """Return the probability of a smaller range: the smallest value at x, all others within `reach` above it."""

    def density(x: float) -> float:
        within = scipy.special.ndtr(x + reach) - scipy.special.ndtr(x)
        return float(subgroup * math.exp(-0.5 * x * x) / math.sqrt(2.0 * math.pi) * within ** (subgroup - 1))

    return float(scipy.integrate.quad(density, -math.inf, math.inf, epsabs=1e-12)[0])
