"""The budget of a metric: every source's standard uncertainty, sensitivity, contribution and share; U = k·u.

GUM 5.1.3: contributions that do not know of each other add as squares.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from analysis.trace.errors import AnalysisError
from analysis.uncertainty.monte_carlo import MonteCarlo
from analysis.uncertainty.scatter import USUAL, Coverage, deviation, enlarged

STUDENT = "Student's t"
NOISE = ("noise", "noise of the sensors, mean of the cycles", "normal")
SCATTER = ("repeatability", "scatter between cycles beyond the noise, enlarged for few cycles (Student)", STUDENT)
ONLY_SCATTER = ("repeatability", "scatter between cycles, enlarged for few cycles (Student)", STUDENT)


class BudgetRow(NamedTuple):
    """One quantity: its standard uncertainty in its unit, what a unit of it does to the metric, and its contribution.

    distribution: of `distributions`, or Student's t. contribution: standard uncertainty of the metric from it; share:
    its part of the variance, 0 to 1.
    """

    quantity: str
    text: str
    distribution: str
    u: float
    unit: str
    sensitivity: float
    contribution: float
    share: float


@dataclass(frozen=True)
class Budget:
    """Rows, largest first; combined standard uncertainty u; kind; coverage, with the k of U.

    kind: "budget" with every source, "untimed" with all but delay and drift, "repeatability" without figures.
    """

    rows: tuple[BudgetRow, ...]
    u: float
    kind: str
    monte_carlo: MonteCarlo | None = None
    coverage: Coverage = USUAL

    @property
    def expanded(self) -> float:
        """U = k·u."""
        return self.coverage.factor * self.u


class Entry(NamedTuple):
    """One quantity before it is combined: as in `BudgetRow`, its contribution with its sign."""

    quantity: str
    text: str
    distribution: str
    u: float
    unit: str
    contribution: float


def combined(
    entries: Sequence[Entry], noise: float, values: Sequence[float], unit: str, coverage: Coverage = USUAL
) -> Budget:
    """Combine systematic entries with the noise and scatter of the cycles."""
    cycles = max(len(values), 1)
    u_noise = noise / math.sqrt(cycles)
    known = math.hypot(u_noise, *(entry.contribution for entry in entries))
    rows = [*entries, Entry(*NOISE, u_noise, unit, u_noise)] if noise else [*entries]
    if cycles > 1:
        scatter = enlarged(known, beyond(values, noise), cycles - 1, coverage)
        rows.append(Entry(*SCATTER, scatter, unit, scatter))
    return _budget(rows, "budget", coverage)


def beyond(values: Sequence[float], noise: float) -> float:
    """Standard deviation of the mean by what scatters between cycles beyond the noise."""
    return math.sqrt(max(deviation(values) ** 2 - noise**2, 0.0) / max(len(values), 1))


def of_scatter(values: Sequence[float], unit: str, coverage: Coverage = USUAL) -> Budget | None:
    """Return what can be said without any figures: the scatter of the cycles. None for fewer than two cycles."""
    if len(values) < 2:
        return None
    u = enlarged(0.0, deviation(values) / math.sqrt(len(values)), len(values) - 1, coverage)
    return only(Entry(*ONLY_SCATTER, u, unit, u), coverage)


def only(entry: Entry, coverage: Coverage = USUAL) -> Budget:
    """Return the budget of a measurement of which nothing is declared: the one thing that its scatter shows."""
    return _budget([entry], "repeatability", coverage)


def _budget(entries: Sequence[Entry], kind: str, coverage: Coverage) -> Budget:
    contributions = np.array([entry.contribution for entry in entries])
    if not np.isfinite(contributions).all():
        raise AnalysisError(
            "the uncertainty has no value: with one of the sensor errors added, the metric cannot be computed. "
            "Check the sensor specifications in the bench file"
        )
    variance = float(np.square(contributions).sum())
    rows = [
        BudgetRow(
            name, text, drawn, u, row_unit, part / u if u else 0.0, abs(part), part**2 / variance if variance else 0.0
        )
        for name, text, drawn, u, row_unit, part in entries
    ]
    return Budget(tuple(sorted(rows, key=lambda row: -row.contribution)), math.sqrt(variance), kind, coverage=coverage)
