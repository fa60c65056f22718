"""What a decision rule risks: bad parts accepted and good parts rejected, for a process of known distribution.

The true value of a part comes from the process, the measured one scatters about it with the standard uncertainty u. A
guard band w moves the limits in to accept (and out to reject): a smaller risk to accept wrongly is paid by good parts
that are not accepted. Source: JCGM 106:2012, 9.3 to 9.5.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import scipy  # loads optimize and stats where they are used

from analysis.trace.errors import AnalysisError
from analysis.trace.units import FloatArray

NODES = 120
"""Gauss–Legendre nodes of each piece between the points where the integrand bends."""

REACH = 12.0
"""Standard uncertainties about a limit beyond which a measurement is on one side of it for certain."""

TAIL = 1e-12
"""Share of the process that is left out at each end."""

ALIKE = 0.01
"""Share by which the u and the guard bands of values may differ for the values to count as measured alike."""


@dataclass(frozen=True)
class Process:
    """Distribution of the true values of what is produced (frozen, from scipy.stats), and its words."""

    distribution: Any
    text: str


@dataclass(frozen=True)
class Risks:
    """Shares of all parts, 0 to 1.

    outside: truly beyond a limit. false_accept: of these, accepted all the same (PFA, the consumer's risk).
    false_reject: good and not accepted (PFR, the producer's risk). false_fail: good and called FAIL, which needs a
    value beyond the limit moved out. undecided: neither PASS nor FAIL.
    """

    outside: float
    false_accept: float
    false_reject: float
    false_fail: float
    undecided: float
    guard: float


class Measured(NamedTuple):
    """How a value was measured: its standard uncertainty, and the guard band that it is judged with."""

    u: float
    guard: float = 0.0


def normal_process(mean: float, sd: float) -> Process:
    """Return a normal process; AnalysisError unless the standard deviation is above zero and the tails are numbers."""
    if not (math.isfinite(mean) and math.isfinite(sd) and sd > 0.0):
        raise AnalysisError(
            f"process: mean {mean:g}, standard deviation {sd:g}; expected a standard deviation above zero"
        )
    return _with_tails(Process(scipy.stats.norm(mean, sd), f"normal, mean {mean:g}, standard deviation {sd:g}"))


def gamma_process(shape: float, scale: float) -> Process:
    """Return a process of values above zero with a tail, a gamma distribution; AnalysisError unless both are > 0."""
    if not (shape > 0.0 and scale > 0.0 and math.isfinite(shape * scale)):
        raise AnalysisError(
            f"process: found a gamma distribution with shape {shape:g} and scale {scale:g}; expected numbers above zero"
        )
    return _with_tails(Process(scipy.stats.gamma(shape, scale=scale), f"gamma, shape {shape:g}, scale {scale:g}"))


def _with_tails(process: Process) -> Process:
    """Return a process whose tails and their distance are numbers; AnalysisError for one that reaches beyond them."""
    with np.errstate(all="ignore"):
        low, high = _tails(process)
        wide = high - low
    if not (math.isfinite(low) and math.isfinite(high) and math.isfinite(wide)):
        raise AnalysisError(f"process: {process.text}: its numbers are too large; give them in the unit of the limits")
    return process


def _tails(process: Process) -> tuple[float, float]:
    return float(process.distribution.ppf(TAIL)), float(process.distribution.isf(TAIL))


def risks(process: Process, low: float | None, high: float | None, u: float, guard: float = 0.0) -> Risks:
    """Return the risks of accepting within the limits moved in by `guard`; a negative one moves them out.

    u: standard uncertainty. Raises AnalysisError without a limit, for limits in the wrong order or with nothing left
    between them, for u that is not above zero, for a guard band that is no finite number, and for shares that cannot
    be computed.
    """
    return risks_of_each(process, low, high, [Measured(u, guard)])


def risks_of_each(process: Process, low: float | None, high: float | None, measured: Sequence[Measured]) -> Risks:
    """Return the mean of the risks of values that are measured each with its own u and judged with its own guard band.

    The risks by the mean of u and guard band would be others. A guard band that leaves nothing between the limits
    accepts no value; where each one does so, AnalysisError is raised, and otherwise as by `risks`.
    """
    _check(low, high, measured)
    alike: dict[tuple[int, ...], list[Measured]] = defaultdict(list)
    for one in measured:
        alike[(*_step(one.u), *_step(one.guard))].append(one)
    weighted = [
        [len(some) * share for share in astuple(_risks(process, low, high, *_mean(some)))] for some in alike.values()
    ]
    return Risks(*(sum(shares) / len(measured) for shares in zip(*weighted, strict=True)))


def _step(value: float) -> tuple[int, int]:
    """Return the sign of a value and its step on a scale of which each step is a share of `ALIKE` wide."""
    return (0, 0) if value == 0.0 else (int(math.copysign(1, value)), round(math.log(abs(value)) / ALIKE))


def _mean(measured: Sequence[Measured]) -> Measured:
    return Measured(*(sum(some) / len(measured) for some in zip(*measured, strict=True)))


def _risks(process: Process, low: float | None, high: float | None, u: float, guard: float) -> Risks:
    """Return the risks of values that are measured alike; AnalysisError for shares that cannot be computed."""
    with np.errstate(all="ignore"):
        found = _shares(process, low, high, u, guard)
    if not all(math.isfinite(share) for share in astuple(found)):
        raise AnalysisError(
            f"decision: the risks of the process ({process.text}) with u = {u:g} and a guard band of {guard:g} cannot "
            "be computed; give all of them in the unit of the limits"
        )
    return found


def _shares(process: Process, low: float | None, high: float | None, u: float, guard: float) -> Risks:
    accept = _between(low, high, -guard, u)
    not_fail = _between(low, high, abs(guard), u)
    true_low, true_high = -math.inf if low is None else low, math.inf if high is None else high

    def share(chance: Callable[[FloatArray], FloatArray], start: float, end: float) -> float:
        cuts = [limit + side * (REACH * u + abs(guard)) for limit in (low, high) if limit is not None
                for side in (-1, 0, 1)]  # fmt: skip
        return _integral(process, chance, start, end, cuts)

    inside = float(process.distribution.cdf(true_high) - process.distribution.cdf(true_low))
    good_accepted, good_not_failed = share(accept, true_low, true_high), share(not_fail, true_low, true_high)
    bad_accepted = share(accept, -math.inf, true_low) + share(accept, true_high, math.inf)
    bad_not_failed = share(not_fail, -math.inf, true_low) + share(not_fail, true_high, math.inf)
    return Risks(
        outside=1.0 - inside,
        false_accept=bad_accepted,
        false_reject=max(inside - good_accepted, 0.0),
        false_fail=max(inside - good_not_failed, 0.0),
        undecided=max(good_not_failed + bad_not_failed - good_accepted - bad_accepted, 0.0),
        guard=guard,
    )


def guard_for(process: Process, low: float | None, high: float | None, u: float, false_accept: float) -> float:
    """Return the guard band w that keeps wrong acceptance at a share of all parts.

    AnalysisError when no guard band between -5 u and 10 u does, or none leaves room between the limits.
    """
    most = 10.0 * u
    if low is not None and high is not None:
        most = min(most, 0.499 * (high - low))
    _check(low, high, [Measured(u)])

    def excess(guard: float) -> float:
        return risks(process, low, high, u, guard).false_accept - false_accept

    if not excess(-5.0 * u) > 0.0 > excess(most):
        raise AnalysisError(
            f"guard band: no guard band from {-5.0 * u:g} to {most:g} has a risk of {false_accept:.3%} of wrongly "
            "accepted parts; "
            "choose another risk, or measure with a smaller uncertainty"
        )
    return float(scipy.optimize.brentq(excess, -5.0 * u, most, xtol=1e-9 * u))


def _check(low: float | None, high: float | None, measured: Sequence[Measured]) -> None:
    if low is None and high is None:
        raise AnalysisError("decision: no limit; give the lower one, the upper one or both")
    for u, guard in measured:
        if not (math.isfinite(2.0 * u) and u > 0.0):
            raise AnalysisError(f"decision: u: found {u:g}; expected a standard uncertainty above zero, and finite")
        if not math.isfinite(guard):
            raise AnalysisError(f"decision: guard band: found {guard:g}; expected a finite number")
    least = min(guard for _, guard in measured)
    if low is not None and high is not None and not low + least < high - least:
        raise AnalysisError(
            f"decision: limits {low:g} and {high:g} with a guard band of {least:g}: no accepted value is left between "
            "them; "
            "measure with a smaller uncertainty"
        )


def _between(low: float | None, high: float | None, out: float, u: float) -> Callable[[FloatArray], FloatArray]:
    """Chance that a part of a true value measures within the limits moved out."""

    def chance(value: FloatArray) -> FloatArray:
        above = 0.0 if low is None else scipy.stats.norm.cdf((low - out - value) / u)
        below = 1.0 if high is None else scipy.stats.norm.cdf((high + out - value) / u)
        found: FloatArray = np.maximum(below - above, 0.0) + np.zeros_like(value)
        return found

    return chance


@cache
def _rule() -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights: made where there is something to integrate, and not by all who know of risks."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    return nodes, weights


def _integral(
    process: Process, chance: Callable[[FloatArray], FloatArray], start: float, end: float, cuts: list[float]
) -> float:
    """Integral of density times chance, in pieces between cuts at which either bends."""
    first_value, last_value = _tails(process)
    nodes, weights = _rule()
    low, high = max(start, first_value), min(end, last_value)
    total = 0.0
    for first, last in pairwise(sorted({low, high, *(min(max(cut, low), high) for cut in cuts)})):
        if last > first and high > low:
            half = (last - first) / 2.0
            value = first + half * (1.0 + nodes)
            total += half * float(np.sum(weights * process.distribution.pdf(value) * chance(value)))
    return total
