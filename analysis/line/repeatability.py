"""Repeatability of a metric: its spread over the cycles of a run, and over runs of the same unit.

One-way analysis of variance with runs as groups. Source: "static testing system" (three repeats) and "backlash and
stiffness measurement system"; ISO 5725-2 for the two components.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from analysis.line.samples import checked_row
from analysis.trace.errors import AnalysisError

LEAST_RUNS = 2


class Repeatability(NamedTuple):
    """Spread of a metric, in its own unit."""

    runs: int
    cycles: int
    """Of all runs together."""
    mean: float
    """Of the runs' values; each run counts once."""
    sd_runs: float
    """Standard deviation of the runs' values."""
    sd_cycles: float | None
    """Standard deviation of one cycle within its run, pooled over the runs; None when every run has one cycle."""
    sd_between: float | None
    """What the runs differ by beyond what their cycles explain; 0 where nothing is left, None as above."""
    run_values: tuple[float, ...]


def repeatability(runs: Sequence[Sequence[float]]) -> Repeatability:
    """Return the spread of a metric from its values per cycle, run by run.

    Raises AnalysisError for fewer than two runs, and for a run without a finite value.
    """
    if len(runs) < LEAST_RUNS:
        raise AnalysisError(f"repeatability: found {len(runs)} runs; expected {LEAST_RUNS} or more of the same unit")
    rows = [checked_row(values, f"repeatability: run {number}", 1) for number, values in enumerate(runs, start=1)]
    means = np.array([row.mean() for row in rows])
    counts = np.array([row.size for row in rows])
    sd_runs = float(means.std(ddof=1))
    freedom = int((counts - 1).sum())
    sd_cycles = sd_between = None
    if freedom:
        within = sum(float(np.square(row - row.mean()).sum()) for row in rows) / freedom
        sd_cycles = math.sqrt(within)
        sd_between = math.sqrt(max(0.0, sd_runs**2 - within * float(np.mean(1.0 / counts))))
    return Repeatability(
        len(rows), int(counts.sum()), float(means.mean()), sd_runs, sd_cycles, sd_between, tuple(means.tolist())
    )
