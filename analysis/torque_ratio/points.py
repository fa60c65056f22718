"""Points of one torque-ratio line as somebody measured them: a table of pairs, one loading of one direction.

Friction reverses with the torque's sign and with loading and unloading, and each of these four has a line of its own.
A table says nothing of it but by its torques, so both signs are refused, and torques that come down again are told.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.torque_ratio.line_fit import RatioFit, fit_torque_ratio
from analysis.trace.errors import AnalysisError
from analysis.trace.trace import Trace
from analysis.trace.units import FloatArray, IntArray

ABOUT_ZERO = 0.05
"""Share of the largest output torque below which a sign says nothing: the zero of the sensor."""

COMES_DOWN = 0.1
"""Share of the largest output torque by which a table may come down; more, and it was unloaded in between."""

LEAST_SLOPE = 1.0
"""Output over input torque of a reducer of the smallest ratio, with its friction."""

MANY_POINTS = 1000
"""A table made by hand has fewer; samples of a recording repeat each other's errors, which a fit does not know."""


def fit_points(trace: Trace, rows: IntArray) -> RatioFit:
    """Fit one line to a table of points; rows are theirs in the file, for messages.

    Raises AnalysisError when a column is missing, output torques have both signs, or there is no line in the points.
    """
    torque_in = trace.channel("torque_in_nm", "the torque ratio")
    torque_out = trace.channel("torque_out_nm", "the torque ratio")
    low, high = int(np.argmin(torque_out)), int(np.argmax(torque_out))
    if min(-torque_out[low], torque_out[high]) > ABOUT_ZERO * float(np.abs(torque_out).max()):
        first, then = sorted((low, high))
        raise AnalysisError(
            f"{trace.source}: row {rows[then]}, column torque_out_nm: found {torque_out[then]:g} N·m after "
            f"{torque_out[first]:g} N·m in row {rows[first]}; expected torques of one sign: friction reverses, so "
            "each sign needs its own line; keep one of them, or name the rows in a column segment (calibrate +1 1, "
            "calibrate -1 1)"
        )
    try:
        return fit_torque_ratio(torque_in, torque_out)
    except AnalysisError as error:
        raise AnalysisError(f"{trace.source}: {error}") from error


def doubts(fit: RatioFit, rows: IntArray) -> Sequence[str]:
    """Return in words what a table of points shows that one line does not fit."""
    found = []
    if fit.slope < LEAST_SLOPE:
        found.append(
            f"slope {fit.slope:.4g}: a reducer gives more torque than it takes, {LEAST_SLOPE:g} times or more; check "
            "whether the columns are exchanged, a sensor is stuck, or one has the wrong sign"
        )
    row = _comes_down(fit.outputs_nm)
    if row is not None:
        found.append(
            f"row {rows[row]}: the output torque comes down to {fit.outputs_nm[row]:g} N·m: if the unit was unloaded "
            "there, its friction helps instead of hindering, and those rows have another line; fit them by themselves"
        )
    if fit.points > MANY_POINTS:
        found.append(
            f"{fit.points} points: neighbours in a recording repeat each other's errors, and u(C) and u(m) read too "
            "small; average each torque to one point, or name the rows in a column segment"
        )
    return found


def _comes_down(torque_nm: FloatArray) -> int | None:
    """Index of the first point well below one before it, by magnitude."""
    size = np.abs(torque_nm)
    below = np.maximum.accumulate(size) - size > COMES_DOWN * float(size.max())
    return int(np.argmax(below)) if below.any() else None
