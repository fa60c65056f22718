"""Uncertainty of the torque ratio itself: its fit, and the sensors on both sides of it."""

from __future__ import annotations

import math

from analysis.uncertainty.budget import Budget, Entry, combined, only
from analysis.uncertainty.chain import line_moves
from analysis.uncertainty.circumstances import Circumstances
from analysis.uncertainty.figures import SensorFigures
from analysis.uncertainty.lines import covariance_of
from analysis.uncertainty.sources import SOURCES

FIT = ("line_fit", "scatter of the points about the fitted line", "normal")


def ratio_budget(
    name: str, unit: str, circumstances: Circumstances, figures: SensorFigures | None, *, of_slope: bool
) -> Budget | None:
    """Return the budget of offset or slope of a calibration line, by the line's name; None for one of no known origin.

    Without figures it is the scatter about the line alone.
    """
    covariance = covariance_of(name, circumstances, SensorFigures() if figures is None else figures)
    if covariance is None:
        return None
    u_fit = covariance.u_slope if of_slope else covariance.u_offset_nm
    fitted = Entry(*FIT, u_fit, unit, u_fit)
    if figures is None or not circumstances.lines_of_this_run:
        return only(fitted)
    entries = [fitted]
    for source in SOURCES:
        declared = source.declared(figures, circumstances)
        if declared is None:
            continue
        moves = [line_moves(shape, circumstances, figures)[name] for shape in source.shapes]
        parts = [declared.u * (move.slope if of_slope else move.offset_nm) for move in moves]
        if any(parts):
            part = parts[0] if len(parts) == 1 else math.hypot(*parts)
            entries.append(Entry(source.id, source.text, declared.distribution, declared.u, source.unit, part))
    return combined(entries, 0.0, (), unit)
