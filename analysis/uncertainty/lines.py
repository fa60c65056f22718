"""Calibration lines as sources of error: offset and slope of each, correlated as they were fitted.

u²(T) = u_C² + T_in² u_m² + 2 T_in cov(C, m). The covariance is split into two independent components (Cholesky), and
each moves the converted torque of its quadrant.
"""

from __future__ import annotations

import math

from analysis.loop import Loop
from analysis.quadrants import QUADRANTS, TorqueLine
from analysis.uncertainty.chain import LineMove, Move, by_changed_lines
from analysis.uncertainty.circumstances import Circumstances
from analysis.uncertainty.figures import LineCovariance, SensorFigures


def covariance_of(name: str, circumstances: Circumstances, figures: SensorFigures) -> LineCovariance | None:
    """Return the covariance of a line: of the fit when it was measured in this run, else as declared; or None."""
    if circumstances.quadrants is None:
        return None
    fit = circumstances.quadrants.fits.get(name)
    if fit is None:
        return figures.calibration.get(name)
    return LineCovariance(fit.u_offset_nm, fit.u_slope, fit.correlation)


def components(line: LineCovariance) -> tuple[LineMove, LineMove]:
    """Return two independent changes of a line, one standard uncertainty each, that have its covariance."""
    along = LineMove(line.u_offset_nm, line.correlation * line.u_slope)
    across = LineMove(0.0, line.u_slope * math.sqrt(1.0 - line.correlation**2))
    return along, across


def line_moves(name: str, line: LineCovariance, loop: Loop, circumstances: Circumstances) -> tuple[Move, ...]:
    """Return what one standard uncertainty of each component of a line does to a loop of converted torque."""
    branches = circumstances.points_of(loop)
    return tuple(
        Move(*((by_changed_lines({name: change}, points), 0.0) for points in branches)) for change in components(line)
    )


def u_torque_nm(name: str, line: LineCovariance, circumstances: Circumstances) -> float:
    """Return the standard uncertainty [N·m] of a line's torque at the reference torque."""
    ratio_line: TorqueLine = getattr(circumstances.quadrants, name)
    sign = 1.0 if name.endswith("positive") else -1.0
    torque_in = (sign * circumstances.method.reference_nm - ratio_line.offset_nm) / ratio_line.slope
    return math.hypot(*(change.offset_nm + change.slope * torque_in for change in components(line)))


def quadrants_used(circumstances: Circumstances) -> tuple[str, ...]:
    """Name the lines that a loop was converted by: all four, or none."""
    return QUADRANTS if circumstances.converted else ()
