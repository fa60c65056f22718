"""Stored lines that are the mean of several units, used on another one: what that may differ by.

How each unit differs from the mean, in all quadrants and in the transition together, is one component, so what goes
together in a unit (more friction everywhere) goes together here. A unit that is not among n of them is as far from
their mean as they are from each other, and the mean is not known better than they show: u² = s² (1 + 1/n), with
Student's factor for n − 1 degrees of freedom (GUM 4.2.3, G.3).
"""

from __future__ import annotations

import math

import numpy as np

from analysis.loop import Loop
from analysis.quadrants import Quadrants, reversed_friction_nm, turn_lines
from analysis.uncertainty.chain import LineMove, Move, by_changed_lines
from analysis.uncertainty.circumstances import Circumstances, Points, line_name
from analysis.uncertainty.figures import SensorFigures, UnitDeviation
from analysis.uncertainty.repeatability import student_factor
from analysis.units import RAD_PER_ARCMIN, FloatArray


def unit_moves(loop: Loop, circumstances: Circumstances, figures: SensorFigures) -> tuple[float, tuple[Move, ...]]:
    """Return the standard uncertainty [N·m] of the conversion at the reference torque, and its moves.

    A move is one standard uncertainty of a component. Zero and none where no units are declared, or where the lines
    are of the run itself.
    """
    units, quadrants = figures.calibrated_units, circumstances.quadrants
    if len(units) < 2 or not circumstances.converted or quadrants is None or circumstances.lines_of_this_run:
        return 0.0, ()
    freedom = len(units) - 1
    scale = math.sqrt((1.0 + 1.0 / len(units)) / freedom) * student_factor(freedom) / 2.0
    branches = circumstances.points_of(loop)
    ratio = circumstances.method.ratio
    changes = [[scale * _changed(unit, quadrants, points, ratio) for points in branches] for unit in units]
    moves = tuple(Move((rising, 0.0), (falling, 0.0)) for rising, falling in changes)
    place = int(np.argmin(np.abs(branches[0].torque_nm - circumstances.method.reference_nm)))
    return math.hypot(*(float(rising[place]) for rising, _ in changes)), moves


def _changed(unit: UnitDeviation, quadrants: Quadrants, points: Points, ratio: float) -> FloatArray:
    """Return the converted torque [N·m] of a branch by a unit's own lines and transition, less that by their mean."""
    lines = {name: LineMove(*line) for name, line in unit.lines.items()}
    changed = np.zeros_like(points.torque_nm) + by_changed_lines(lines, points)
    if quadrants.transition_rad is None:
        return changed
    before, after = turn_lines(quadrants, points.direction)
    turn = 0 if points.direction > 0 else -1
    at_turn_nm = (float(points.torque_nm[turn]) - before.offset_nm) / before.slope
    travel = np.abs(points.angle_arcmin - points.angle_arcmin[turn]) * (ratio * RAD_PER_ARCMIN)
    lengths = travel / quadrants.transition_rad
    share = np.exp(-lengths)  # of the old friction, as in `quadrants.blended`
    sign = -points.direction
    of_before, of_after = (lines[line_name(sign, way)] for way in (sign, points.direction))
    jump = (of_after.offset_nm - of_before.offset_nm) + (of_after.slope - of_before.slope) * at_turn_nm
    friction_nm = reversed_friction_nm(before, after, at_turn_nm)  # the input torque is higher by its share
    longer = after.slope * lengths * unit.transition_rad / quadrants.transition_rad
    found: FloatArray = changed + share * ((of_after.slope - longer) * friction_nm - jump)
    return found
