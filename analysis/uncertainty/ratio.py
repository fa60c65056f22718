"""Uncertainty of the torque ratio itself: its fit, and the sensors on both sides of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from analysis.uncertainty.budget import Budget, Entry, combined, only
from analysis.uncertainty.chain import line_moves
from analysis.uncertainty.circumstances import Circumstances
from analysis.uncertainty.distributions import DISTRIBUTIONS
from analysis.uncertainty.figures import SensorFigures
from analysis.uncertainty.lines import components, covariance_of
from analysis.uncertainty.monte_carlo import SEED, interval
from analysis.uncertainty.sources import SOURCES

FIT = ("line_fit", "scatter of the points about the fitted line", "normal")


def ratio_budget(
    name: str, unit: str, circumstances: Circumstances, figures: SensorFigures | None, *,
    of_slope: bool, value: float = 0.0, draws: int = 0,
) -> Budget | None:  # fmt: skip
    """Return the budget of offset or slope of a calibration line, by the line's name; None for one of no known origin.

    Without figures it is the scatter about the line alone. draws: of Monte Carlo about the value, 0 for none.
    """
    covariance = covariance_of(name, circumstances, SensorFigures() if figures is None else figures)
    if covariance is None:
        return None
    fit = _Drawn("normal", 1.0, tuple(move.slope if of_slope else move.offset_nm for move in components(covariance)))
    u_fit = covariance.u_slope if of_slope else covariance.u_offset_nm
    fitted = Entry(*FIT, u_fit, unit, u_fit)
    if figures is None or not circumstances.lines_of_this_run:
        return _with_draws(only(fitted), [fit], value, draws)
    entries, drawn = [fitted], [fit]
    for source in SOURCES:
        declared = source.declared(figures, circumstances)
        if declared is None:
            continue
        moves = [line_moves(shape, circumstances, figures)[name] for shape in source.shapes]
        parts = [move.slope if of_slope else move.offset_nm for move in moves]
        if any(parts):
            part = declared.u * (parts[0] if len(parts) == 1 else math.hypot(*parts))
            entries.append(Entry(source.id, source.text, declared.distribution, declared.u, source.unit, part))
            drawn.append(_Drawn(declared.distribution, declared.figure, tuple(parts)))
    return _with_draws(combined(entries, 0.0, (), unit), drawn, value, draws)


class _Drawn(NamedTuple):
    """What is drawn of one source: distribution, limit, and what one unit of each component does to the value."""

    distribution: str
    limit: float
    parts: tuple[float, ...]


def _with_draws(budget: Budget, sources: Sequence[_Drawn], value: float, draws: int) -> Budget:
    """Return a budget with the distribution of the value when every source is drawn at once."""
    if not draws:
        return budget
    random = np.random.default_rng(SEED)
    errors = np.zeros(draws)
    for one in sources:
        errors += DISTRIBUTIONS[one.distribution].draw(random, one.limit, draws, len(one.parts)) @ np.array(one.parts)
    u = float(errors.std(ddof=1)) if draws > 1 else math.nan
    return replace(budget, monte_carlo=interval(errors, value, u))
