"""From an error of the channels to what it does to a loop: directly, or through the calibration of the torque.

A torque that is converted from the input carries the output sensor's errors through the calibration lines. Errors of
the input sensor that are there while calibrating and while measuring cancel, and do so here by themselves.

A calibration line is a source of error itself, its offset and slope correlated as they were fitted:
u²(T) = u_C² + T_in² u_m² + 2 T_in cov(C, m). The covariance is split into two independent components (Cholesky), and
each moves the converted torque of its quadrant.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from analysis.loop.branches import Branch, made_rising
from analysis.loop.loop import Loop
from analysis.torque_ratio.quadrants import QUADRANTS, TorqueLine
from analysis.trace.units import FloatArray
from analysis.uncertainty.conditions import MeasurementConditions, Points, line_name
from analysis.uncertainty.figures import LineCovariance, SensorFigures
from analysis.uncertainty.shapes import NOTHING, Effect, Setting, Shape
from analysis.uncertainty.sources import ErrorSource


class Move(NamedTuple):
    """What one unit of one error does to the torque [N·m] and the wind-up [arcmin] of both branches of a loop."""

    forward: tuple[FloatArray | float, FloatArray | float]
    backward: tuple[FloatArray | float, FloatArray | float]

    @property
    def moves_anything(self) -> bool:
        """Say whether the error reaches the loop at all."""
        return any(np.any(np.asarray(part) != 0.0) for branch in self for part in branch)

    def applied(self, loop: Loop, amount: float) -> Loop:
        """Return the loop with so much of the error in it."""
        return Loop(
            moved(loop.forward, amount, *self.forward), moved(loop.backward, amount, *self.backward), loop.method
        )


class LineMove(NamedTuple):
    """What one unit of one error does to a calibration line."""

    offset_nm: float
    slope: float


STILL = LineMove(0.0, 0.0)


def moved(branch: Branch, amount: float, torque_nm: FloatArray | float, angle_arcmin: FloatArray | float) -> Branch:
    """Return a branch with an amount of an error in it; its torque still rises."""
    torque = branch.torque_nm + amount * torque_nm
    return made_rising(torque, branch.angle_arcmin + amount * angle_arcmin, np.ones(torque.size))


def moves_of(source: ErrorSource, loop: Loop, conditions: MeasurementConditions, figures: SensorFigures) -> list[Move]:
    """Return what each component of a source does to a loop."""
    stored = conditions.converted and source.retared and not conditions.lines_of_this_run
    parts = (("measuring",), ("calibrating",)) if stored else (("measuring", "calibrating"),)
    return [_move(shape, loop, conditions, figures, part) for shape in source.shapes for part in parts]


def _move(
    shape: Shape, loop: Loop, conditions: MeasurementConditions, figures: SensorFigures, during: tuple[str, ...]
) -> Move:
    """Return what an error does that is there while measuring, while calibrating, or all the time."""
    calibrating = conditions.converted and "calibrating" in during
    lines = line_moves(shape, conditions, figures) if calibrating else {}
    parts = []
    for points in conditions.points_of(loop):
        effect = shape(Setting(points, conditions, figures)) if "measuring" in during else NOTHING
        corrected = conditions.corrects(points.direction)
        torque = (
            _converted(effect, points, lines, corrected=corrected) if conditions.converted else effect.torque_out_nm
        )
        parts.append((torque, effect.angle_arcmin))
    return Move(parts[0], parts[1])


def _converted(effect: Effect, points: Points, lines: dict[str, LineMove], *, corrected: bool) -> FloatArray | float:
    """Error of a converted torque: of the input torque by the slope, and of the lines themselves.

    A conversion that was corrected by what it left over while calibrating gives back what the output sensor read there,
    whatever line lies between: its errors are the converted torque's, and those of the input sensor cancel.
    """
    if points.torque_in_nm is None or corrected:
        return effect.torque_out_nm
    return by_changed_lines(lines, points) + points.slope * effect.torque_in_nm


def by_changed_lines(changes: Mapping[str, LineMove], points: Points) -> FloatArray | float:
    """Return what changes of lines, by quadrant, do to the converted torque [N·m] of a branch."""
    if points.torque_in_nm is None:
        return 0.0
    positive, negative = (changes.get(line_name(sign, points.direction), STILL) for sign in (1, -1))
    changed: FloatArray = np.where(
        points.torque_nm >= 0.0,
        positive.offset_nm + positive.slope * points.torque_in_nm,
        negative.offset_nm + negative.slope * points.torque_in_nm,
    )
    return changed


def line_moves(shape: Shape, conditions: MeasurementConditions, figures: SensorFigures) -> dict[str, LineMove]:
    """Return what one unit of an error does to each calibration line: the line is fitted again to moved points."""
    found = {}
    for name, points in conditions.line_points.items():
        effect = shape(Setting(points, conditions, figures))
        torque_in = points.torque_in_nm
        if torque_in is None:
            continue
        change = np.zeros_like(torque_in) + effect.torque_out_nm - points.slope * effect.torque_in_nm
        offset, slope = np.polynomial.polynomial.polyfit(torque_in, change, 1) if change.any() else (0.0, 0.0)
        found[name] = LineMove(float(offset), float(slope))
    return found


def covariance_of(name: str, conditions: MeasurementConditions, figures: SensorFigures) -> LineCovariance | None:
    """Return the covariance of a line: of the fit when it was measured in this run, else as declared; or None."""
    if conditions.quadrants is None:
        return None
    fit = conditions.quadrants.fits.get(name)
    if fit is None:
        return figures.calibration.get(name)
    return LineCovariance(fit.u_offset_nm, fit.u_slope, fit.correlation)


def components(line: LineCovariance) -> tuple[LineMove, LineMove]:
    """Return two independent changes of a line, one standard uncertainty each, that have its covariance."""
    along = LineMove(line.u_offset_nm, line.correlation * line.u_slope)
    across = LineMove(0.0, line.u_slope * math.sqrt(1.0 - line.correlation**2))
    return along, across


def covariance_moves(
    name: str, line: LineCovariance, loop: Loop, conditions: MeasurementConditions
) -> tuple[Move, ...]:
    """Return what one standard uncertainty of each component of a line does to a loop of converted torque."""
    branches = conditions.points_of(loop)
    return tuple(
        Move(*((by_changed_lines({name: change}, points), 0.0) for points in branches)) for change in components(line)
    )


def u_torque_nm(name: str, line: LineCovariance, conditions: MeasurementConditions) -> float:
    """Return the standard uncertainty [N·m] of a line's torque at the reference torque."""
    ratio_line: TorqueLine = getattr(conditions.quadrants, name)
    sign = 1.0 if name.endswith("positive") else -1.0
    torque_in = (sign * conditions.method.reference_nm - ratio_line.offset_nm) / ratio_line.slope
    return math.hypot(*(change.offset_nm + change.slope * torque_in for change in components(line)))


def quadrants_used(conditions: MeasurementConditions) -> tuple[str, ...]:
    """Name the lines that a loop was converted by: all four, or none."""
    return QUADRANTS if conditions.converted else ()
