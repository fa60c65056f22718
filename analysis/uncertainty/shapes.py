"""Shapes of errors: what one unit of an error does to the channels of a trace, at every point of a branch.

All are linear in the amount of the error. How large it is on a bench, and whether it is there at all, `sources` says.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from analysis.trace.units import FloatArray
from analysis.uncertainty.conditions import AngleName, MeasurementConditions, Points
from analysis.uncertainty.figures import AngleFigures, SensorFigures
from definitions.units import RAD_PER_ARCMIN

ROUNDINGS = 24
"""Ways in which the counts of an encoder may lie over a loop; their contributions are averaged as variances."""

ROUNDING_SEED = 5
"""The same loop has the same uncertainty whenever it is evaluated."""


class Effect(NamedTuple):
    """What one unit of an error does to torque at the output [N·m], torque at the input [N·m], wind-up [arcmin]."""

    torque_out_nm: FloatArray | float = 0.0
    torque_in_nm: FloatArray | float = 0.0
    angle_arcmin: FloatArray | float = 0.0


class Setting(NamedTuple):
    """What an error meets: points of one branch, how they were measured, and what is declared."""

    points: Points
    conditions: MeasurementConditions
    figures: SensorFigures


NOTHING = Effect()
Shape = Callable[[Setting], Effect]


def lens(setting: Setting) -> FloatArray:
    """Hysteresis of a sensor: none at the turning points, full in the middle; falling torque reads high."""
    points = setting.points
    part: FloatArray = -points.direction * (1.0 - np.square(points.torque_nm / setting.conditions.peak_nm))
    return part


def input_torque(setting: Setting) -> FloatArray | float:
    """Torque at the input [N·m], which an error of that sensor's gain grows with; 0 where it was not measured."""
    return 0.0 if setting.points.torque_in_nm is None else setting.points.torque_in_nm


def skew(setting: Setting) -> Effect:
    """Torque that comes later than the angle by one second reads lower by the rate of torque, on a rising branch.

    Both torques do, so the lines between them stay, and the wind-up at a torque is larger: by so much as was tried.
    """
    points = setting.points
    if points.late_arcmin_s is not None:
        return Effect(angle_arcmin=points.late_arcmin_s)
    return Effect(-points.rate_nm_s, 0.0 if points.torque_in_nm is None else -points.rate_nm_s / points.slope)


def creep(setting: Setting) -> Effect:
    """Wind-up that creeps by one arcmin per minute the way the torque points, and back: alike in every cycle.

    It is largest where the torque changes its sign, and nothing at the turning points.
    """
    points = setting.points
    if not points.rate_nm_s:
        return NOTHING
    seconds = (setting.conditions.peak_nm - np.abs(points.torque_nm)) / points.rate_nm_s
    return Effect(angle_arcmin=-seconds / 60.0)


def drift(setting: Setting) -> Effect:
    """Wind-up that grows by one arcmin per minute; nothing where no times are known."""
    seconds = setting.points.seconds
    return NOTHING if seconds is None else Effect(angle_arcmin=seconds / 60.0)


def fixture(setting: Setting) -> Effect:
    """Wind-up of the whole fixture, by its curve or its stiffness; nothing where neither is known."""
    method, torque = setting.conditions.method, setting.points.torque_nm
    if method.fixture_curve is not None:
        return Effect(angle_arcmin=method.fixture_curve.at(torque))
    stiffness = method.fixture_stiffness_nm_per_arcmin
    return NOTHING if stiffness is None else Effect(angle_arcmin=torque / stiffness)


def encoder_of(figures: SensorFigures, name: AngleName) -> AngleFigures | None:
    """Return what is declared of an encoder; None where the bench has none there."""
    return figures.angle_in if name == "angle_in" else figures.angle_out


def turned_arcmin(setting: Setting, name: AngleName, stretch: float = 1.0) -> FloatArray:
    """Angle that the shaft of an encoder has turned, at the output; stretch: of what the fixture gives way by."""
    method, locked = setting.conditions.method, name == setting.conditions.locked
    stiffness = (method.lock_nm_per_arcmin if locked else method.fixture_stiffness_nm_per_arcmin) or math.inf
    turned: FloatArray = setting.points.torque_nm * (stretch / stiffness)
    return turned if locked else turned + setting.points.angle_arcmin


def repeating(
    name: AngleName, period_rad: Callable[[AngleFigures], float], wave: Callable[[FloatArray], FloatArray]
) -> Shape:
    """Error of an encoder that repeats with its own angle, per arcsec at its shaft."""

    def shape(setting: Setting) -> Effect:
        method, encoder = setting.conditions.method, encoder_of(setting.figures, name)
        if encoder is None:
            return NOTHING
        scale = method.ratio if name == "angle_in" else 1.0
        phase = turned_arcmin(setting, name) * (2.0 * math.pi * RAD_PER_ARCMIN * scale / period_rad(encoder))
        return Effect(angle_arcmin=wave(phase) / (60.0 * scale))

    return shape


class Rounding(NamedTuple):
    """One way in which counts may lie: where the first begins [counts], phase of the error within a line [rad].

    amplitude, stretch: of that error and of the fixture's deviation, parts of what is declared, 0…1 and -1…1.
    """

    start: float
    phase: float
    amplitude: float
    stretch: float


def roundings() -> list[Rounding]:
    """Return the ways that are tried: each of the four is spread evenly, in an order of its own."""
    random = np.random.default_rng(ROUNDING_SEED)
    start, phase, amplitude, stretch = ((random.permutation(ROUNDINGS) + 0.5) / ROUNDINGS for _ in range(4))
    rows = zip(start, 2.0 * math.pi * phase, amplitude, 2.0 * stretch - 1.0, strict=True)
    return [Rounding(*(float(value) for value in row)) for row in rows]


def rounded(name: AngleName, way: Rounding) -> Shape:
    """Error of rounding to counts, per arcsec at the encoder's shaft; all ways together have the size of one.

    Rounded is what the encoder reads: its angle with the error within a line in it. Between two places some counts
    apart that error, and what is not known of the fixture, move the distance by more than a part of a count: so two
    places that seem to be a whole number of counts apart are not rounded alike.
    """

    def shape(setting: Setting) -> Effect:
        encoder = encoder_of(setting.figures, name)
        if encoder is None:
            return NOTHING
        scale = setting.conditions.method.ratio if name == "angle_in" else 1.0
        stretch = 1.0 + way.stretch * setting.figures.fixture_fraction
        angle = turned_arcmin(setting, name, stretch) * (RAD_PER_ARCMIN * scale)
        wave = np.sin(2.0 * math.pi * angle / encoder.line_rad + way.phase)
        counts = (angle + way.amplitude * encoder.interpolation_rad * wave) / encoder.step_rad + way.start
        error = np.round(counts) - counts
        return Effect(angle_arcmin=error * (math.sqrt(12.0 / ROUNDINGS) / (60.0 * scale)))

    return shape
