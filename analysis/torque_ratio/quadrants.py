"""Output torque from input torque, with the friction on the right side in each quadrant.

Friction reverses with the motion: loading obeys T_out = C + m·T_in with one pair (C, m), unloading with another. Four
lines (sign of torque × loading or unloading) map a whole loop. After a reversal the input torque traverses twice the
friction before the output follows: there the map moves from the loading line to the unloading line with the angle
turned since, λ = exp(−|Δangle_in| / L), as friction with presliding does; L comes from the calibration. Without L (a
stored calibration, or no input angle) that stretch is masked.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import scipy  # loads ndimage where it is used

from analysis.torque_ratio.line_fit import RatioFit
from analysis.trace.errors import AnalysisError
from analysis.trace.units import BoolArray, FloatArray

QUADRANTS = ("load_positive", "unload_positive", "load_negative", "unload_negative")
"""Names of the four lines."""

BLEND_END = 1e-5
"""The transition ends where less than this share of the loading line is left."""

ZERO_SAMPLES = 15
"""Samples over which the input torque is averaged to find where unloading ends."""

NEAR_ZERO = (1.2, 0.06)
"""Piece of the unloading line, in fractions of its friction torque, that is continued to zero."""

MASK_BELOW_TURN = 0.25
"""Share of the torque at the turn that is masked after a reversal when the transition length is not known.

Lines are fitted to what is left. On the virtual bench the output torque joins the unloading line 19 % below the turn.
"""


class TorqueLine(NamedTuple):
    """One quadrant: T_out = offset_nm + slope · T_in, N·m."""

    offset_nm: float
    slope: float


class Leftover(NamedTuple):
    """Converted less measured torque [N·m] along a branch, in bins of the place on it [N·m] (see `Leftovers`).

    torque_nm: the measured torque there; counts: samples of each bin.
    """

    place_nm: FloatArray
    torque_nm: FloatArray
    error_nm: FloatArray
    counts: FloatArray


class Converted(NamedTuple):
    """A branch converted by its lines: torque [N·m], samples that count, and where among them unloading ends."""

    torque_nm: FloatArray
    valid: BoolArray
    crossing: float

    def places(self, stiffness_nm_per_rad: float, angle_in_rad: FloatArray) -> FloatArray:
        """Return the places on the branch [N·m] of its samples at these input angles (see `Leftovers`)."""
        return self.torque_nm + stiffness_nm_per_rad * (angle_in_rad - _angle_at(self.crossing, angle_in_rad))


class Leftovers(NamedTuple):
    """What a calibration leaves over, in two fineness: what is corrected, and what shows how good the correction is.

    The place on a branch is converted torque + stiffness × input angle, counted from the end of unloading. About zero
    the converted torque stands still while the angle goes on, and after a reversal the angle hardly moves while the
    torque does: their sum always grows.
    """

    stiffness_nm_per_rad: float
    corrected: Leftover
    fine: Leftover

    def at(self, place_nm: FloatArray) -> FloatArray:
        """Return the error that is corrected at places [N·m], straight between the means of two bins."""
        found: FloatArray = np.interp(place_nm, self.corrected.place_nm, self.corrected.error_nm)
        return found


@dataclass(frozen=True)
class Quadrants:
    """Four lines, the transition length L [rad at the input shaft] or None, and the fits they came from if measured.

    zero_nm: what the output sensor reads where no torque is. There friction goes over from unloading to loading, within
    zero_transition_rad (None: as much shorter than L as less friction changes there).
    left: by direction of motion, what lines and transition leave over while calibrating; it is taken off. Lines without
    fits are of another run, with another tare and perhaps another turn: nothing is taken off by them.
    begins_nm: output torque that a loading line begins at, of those that begin later than others for a bounce.
    """

    load_positive: TorqueLine
    unload_positive: TorqueLine
    load_negative: TorqueLine
    unload_negative: TorqueLine
    transition_rad: float | None = None
    zero_nm: float = 0.0
    zero_transition_rad: float | None = None
    fits: Mapping[str, RatioFit] = field(default_factory=dict)
    left: Mapping[int, Leftovers] = field(default_factory=dict)
    begins_nm: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse lines that cannot be inverted."""
        for name in QUADRANTS:
            line: TorqueLine = getattr(self, name)
            if not (np.isfinite(line.offset_nm) and np.isfinite(line.slope) and line.slope > 0):
                raise AnalysisError(f"torque ratio: {name}: found {line}; expected a finite offset and a slope above 0")

    def leftovers(self, direction: int) -> Leftovers | None:
        """Return what is taken off a branch, None where nothing is."""
        return self.left.get(direction) if self.fits else None


def output_torque(
    quadrants: Quadrants, torque_in_nm: FloatArray, direction: int, angle_in_rad: FloatArray | None
) -> tuple[FloatArray, BoolArray]:
    """Convert a run's input torque to output torque; return it [N·m] and the mask of samples fit to be evaluated.

    angle_in_rad: input angle of the same samples, None when it was not measured.
    """
    found, left = by_lines(quadrants, torque_in_nm, direction, angle_in_rad), quadrants.leftovers(direction)
    if left is None or angle_in_rad is None:
        return found.torque_nm, found.valid
    return found.torque_nm - left.at(found.places(left.stiffness_nm_per_rad, angle_in_rad)), found.valid


def by_lines(
    quadrants: Quadrants, torque_in_nm: FloatArray, direction: int, angle_in_rad: FloatArray | None
) -> Converted:
    """Convert by lines and transitions."""
    steady, crossing = _steady(quadrants, torque_in_nm, direction, angle_in_rad)
    valid = np.ones(steady.size, dtype=np.bool_)
    before, after = turn_lines(quadrants, direction)
    at_turn = before.offset_nm + before.slope * float(torque_in_nm[0])
    if at_turn * direction >= 0:
        return Converted(steady, valid, crossing)
    if quadrants.transition_rad is None or angle_in_rad is None:
        beyond = -direction * steady > (1.0 - MASK_BELOW_TURN) * abs(at_turn)
        if beyond.any():
            valid[: int(np.flatnonzero(beyond)[-1]) + 1] = False
        return Converted(steady, valid, crossing)
    share = np.exp(-np.abs(angle_in_rad - angle_in_rad[0]) / quadrants.transition_rad)
    after_turn = blended(before, after, torque_in_nm, float(torque_in_nm[0]), share)
    return Converted(np.where(share > BLEND_END, after_turn, steady), valid, crossing)


def _steady(
    quadrants: Quadrants, torque_in_nm: FloatArray, direction: int, angle_in_rad: FloatArray | None
) -> tuple[FloatArray, float]:
    """Away from reversals: the unloading line until it reaches zero, the loading line from there on; and where that is.

    Where unloading has more friction than loading both lines have a torque for the same input torque about zero, so the
    order in time decides. The friction goes over from one to the other with the angle turned, as after a reversal.
    """
    zero_nm = quadrants.zero_nm
    loading, unloading = (
        TorqueLine(line.offset_nm - zero_nm, line.slope)
        for line in (
            (quadrants.load_positive, quadrants.unload_negative)
            if direction > 0
            else (quadrants.load_negative, quadrants.unload_positive)
        )
    )
    unloaded = direction * (unloading.offset_nm + unloading.slope * torque_in_nm)
    crossing = _end_of_unloading(unloaded, abs(unloading.offset_nm))
    at_zero = -loading.offset_nm / loading.slope
    step = -unloading.offset_nm / unloading.slope - at_zero
    share: FloatArray | float = 0.0
    length = zero_length_rad(quadrants, direction, float(torque_in_nm[0]))
    if angle_in_rad is not None and length > 0.0:
        share = np.exp(-np.abs(angle_in_rad - _angle_at(crossing, angle_in_rad)) / length)
    loaded = direction * (loading.offset_nm + loading.slope * (torque_in_nm - step * share))
    before = np.arange(unloaded.size) < crossing
    result: FloatArray = zero_nm + direction * np.where(before, np.minimum(unloaded, 0.0), np.maximum(loaded, 0.0))
    return result, crossing


def _angle_at(sample: float, angle_in_rad: FloatArray) -> float:
    """Angle at a place between two samples."""
    return float(np.interp(sample, np.arange(angle_in_rad.size), angle_in_rad))


def zero_length_rad(quadrants: Quadrants, direction: int, at_turn_nm: float) -> float:
    """Length of the transition at zero torque [rad at the input] of a run with this input torque at its turn."""
    if quadrants.zero_transition_rad is not None or quadrants.transition_rad is None:
        return quadrants.zero_transition_rad or 0.0
    loading = quadrants.load_positive if direction > 0 else quadrants.load_negative
    at_zero = (quadrants.zero_nm - loading.offset_nm) / loading.slope
    turn = reversed_friction_nm(*turn_lines(quadrants, direction), at_turn_nm)
    return quadrants.transition_rad * min(1.0, abs(2.0 * at_zero / turn)) if turn else 0.0


def _end_of_unloading(unloaded: FloatArray, friction_nm: float) -> float:
    """Place among the samples at which unloading is over; unloaded: its torque, from below zero up to zero.

    Friction changes there within few samples: half a sample beside it shows, so it lies between two.

    Near zero friction changes and the line no longer holds: the last piece that it holds for is continued straight.
    """
    smooth = scipy.ndimage.uniform_filter1d(unloaded, ZERO_SAMPLES, mode="nearest")
    far, near = (int(np.argmax(smooth >= -share * friction_nm)) for share in NEAR_ZERO)
    if smooth[near] < -NEAR_ZERO[1] * friction_nm:
        return float(unloaded.size)
    if near - far < ZERO_SAMPLES:
        return float(near)
    at, slope = _line_ahead(unloaded[far:near])
    ahead = -at / slope if slope > 0.0 else 0.0
    return float(min(near + min(max(ahead, 0.0), near - far), unloaded.size))


def _line_ahead(values: FloatArray) -> tuple[float, float]:
    """Return what the straight line through evenly spaced values, by least squares, has after the last; and its slope.

    A fit of the zero asks for it some two hundred times.
    """
    count = values.size
    about = np.arange(count) - (count - 1) / 2.0
    slope = float(about @ values) / (count * (count * count - 1) / 12.0)
    return float(values.mean()) + slope * (count + 1) / 2.0, slope


def turn_lines(quadrants: Quadrants, direction: int) -> tuple[TorqueLine, TorqueLine]:
    """Line before and line after the reversal that a run starts with."""
    if direction < 0:
        return quadrants.load_positive, quadrants.unload_positive
    return quadrants.load_negative, quadrants.unload_negative


def blended(
    before: TorqueLine, after: TorqueLine, torque_in_nm: FloatArray, at_turn_nm: float, share: FloatArray
) -> FloatArray:
    """Output torque while friction goes over to the other side: at the turn it is that of the line before.

    What is left of the old friction, an input torque, is the share (1 to 0) of the step between the lines at the turn;
    at_turn_nm is the input torque there.
    """
    result: FloatArray = after.offset_nm + after.slope * (
        torque_in_nm - reversed_friction_nm(before, after, at_turn_nm) * share
    )
    return result


def reversed_friction_nm(before: TorqueLine, after: TorqueLine, at_turn_nm: float) -> float:
    """Return the input torque between two lines at the output torque of a turn: the friction that reverses, N·m."""
    turn_nm = before.offset_nm + before.slope * at_turn_nm
    return at_turn_nm - (turn_nm - after.offset_nm) / after.slope
