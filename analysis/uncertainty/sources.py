"""The table of error sources: what each is, which declared figure it comes from, and how it moves a measured loop.

A source is written down once, as what it does to the channels of the trace (torque at the output, torque at the input,
wind-up) per unit of its amount (`shapes`). `chain` carries it through the calibration to the loop.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from analysis.trace.units import FloatArray
from analysis.uncertainty.conditions import AngleName, MeasurementConditions
from analysis.uncertainty.distributions import DISTRIBUTIONS, STATED_BY
from analysis.uncertainty.figures import AngleFigures, SensorFigures, TorqueChannel, TorqueFigures
from analysis.uncertainty.shapes import (
    Effect,
    Setting,
    Shape,
    creep,
    drift,
    encoder_of,
    fixture,
    input_torque,
    lens,
    repeating,
    rounded,
    roundings,
    skew,
)
from definitions.units import ARCSEC_PER_RAD

COARSE = 0.25
"""Share of the noise from which on a step of a torque counts: less is lost in the noise, and in the zero."""

TorqueName = Literal["torque_in", "torque_out"]


class Declared(NamedTuple):
    """Figure of an error source in its unit, and its distribution (of `distributions`)."""

    figure: float
    distribution: str

    @property
    def u(self) -> float:
        """Standard uncertainty of each component."""
        return self.figure / DISTRIBUTIONS[self.distribution].divisor


class ErrorSource(NamedTuple):
    """One row: words, unit of the amount, its distribution by the figures, its figure, its components.

    limit returns None where the bench has no such sensor, or where the error cannot enter. retared: each tare makes the
    error a new one, so a calibration that was stored earlier has another one. whole: it may be so large that a metric
    follows more of it by little, so all of it is tried, and the worse of both signs counts.
    """

    id: str
    text: str
    unit: str
    distribution: Callable[[SensorFigures], str]
    limit: Callable[[SensorFigures, MeasurementConditions], float | None]
    shapes: tuple[Shape, ...]
    retared: bool = False
    whole: bool = False

    def declared(self, figures: SensorFigures, conditions: MeasurementConditions) -> Declared | None:
        """Return what is declared of this source; None where nothing of it enters."""
        found = self.limit(figures, conditions)
        return Declared(found, self.distribution(figures)) if found else None


def _rectangular(_: SensorFigures) -> str:
    return "rectangular"


def _sensor_of(name: TorqueName, figures: SensorFigures) -> TorqueFigures | None:
    return figures.torque_in if name == "torque_in" else figures.torque_out


def _entering(name: TorqueName, figures: SensorFigures, conditions: MeasurementConditions) -> TorqueFigures | None:
    """Return what is declared of a sensor whose errors enter: the input's do by torque lines alone."""
    return None if name == "torque_in" and conditions.quadrants is None else _sensor_of(name, figures)


def _reading(name: TorqueName) -> Callable[[Setting], FloatArray | float]:
    """Return what gives the reading of a torque sensor, N·m."""
    return input_torque if name == "torque_in" else (lambda setting: setting.points.torque_nm)


def _moving(name: TorqueName, of: Callable[[Setting], FloatArray | float]) -> tuple[Shape]:
    """Return the shape of an error that moves the torque of one sensor."""
    if name == "torque_in":
        return (lambda setting: Effect(torque_in_nm=of(setting)),)
    return (lambda setting: Effect(torque_out_nm=of(setting)),)


def _torque_rows(name: TorqueName, words: str) -> list[ErrorSource]:
    """Gain, zero and reversibility of one torque sensor."""
    channel: TorqueChannel = "torque_in_nm" if name == "torque_in" else "torque_out_nm"

    def stated(figures: SensorFigures) -> str:
        sensor = _sensor_of(name, figures)
        return _rectangular(figures) if sensor is None else STATED_BY[sensor.stated_by]

    def limit(fraction: Callable[[TorqueFigures], float], *, of_scale: bool) -> Callable[..., float | None]:
        def found(figures: SensorFigures, conditions: MeasurementConditions) -> float | None:
            sensor = _entering(name, figures, conditions)
            if sensor is None:
                return None
            return fraction(sensor) * (sensor.full_scale_nm if of_scale else 1.0)

        return found

    def moved(figures: SensorFigures, conditions: MeasurementConditions) -> float | None:
        declared, moved_nm = figures.zero_move_nm(channel), conditions.zero_shifts_nm.get(channel)
        if declared is None or moved_nm is None or _entering(name, figures, conditions) is None:
            return None
        return max(0.0, abs(moved_nm) - declared[0]) or None

    def shown(figures: SensorFigures, conditions: MeasurementConditions) -> float | None:
        return None if _entering(name, figures, conditions) is None else conditions.zeroes_shown_nm.get(channel)

    def shape(of: Callable[[Setting], FloatArray | float]) -> tuple[Shape]:
        return _moving(name, of)

    reading = _reading(name)
    return [
        ErrorSource(
            f"{name}_gain", f"gain of the {words} torque sensor", "1", stated,
            limit(lambda sensor: sensor.gain_fraction, of_scale=False), shape(reading),
        ),
        ErrorSource(
            f"{name}_zero", f"zero offset of the {words} torque sensor after the tare", "N·m", _rectangular,
            limit(lambda sensor: sensor.zero_fraction, of_scale=True), shape(lambda _: 1.0), retared=True,
        ),
        ErrorSource(
            f"{name}_zero_moved", f"shift of the zero of the {words} torque sensor during the run",
            "N·m", _rectangular, moved, shape(lambda _: 1.0),
        ),
        ErrorSource(
            f"{name}_zero_shown", f"zero of the {words} torque sensor, as loading and unloading show it",
            "N·m", _rectangular, shown, shape(lambda _: 1.0),
        ),
        ErrorSource(
            f"{name}_reversibility", f"reversibility (hysteresis) of the {words} torque sensor", "N·m", stated,
            limit(lambda sensor: sensor.reversibility_fraction, of_scale=True), shape(lens),
        ),
    ]  # fmt: skip


def _steps_row(name: TorqueName, words: str) -> ErrorSource:
    """Coarse steps of one torque, as its samples show them: whether decimals were rounded or cut off, they do not."""
    channel: TorqueChannel = "torque_in_nm" if name == "torque_in" else "torque_out_nm"
    reading = _reading(name)

    def half_a_step(figures: SensorFigures, conditions: MeasurementConditions) -> float | None:
        sensor, step_nm = _entering(name, figures, conditions), conditions.torque_steps_nm.get(channel, 0.0)
        if sensor is None or step_nm <= COARSE * sensor.noise_fraction * sensor.full_scale_nm:
            return None
        return step_nm / 2.0

    def cut_off(setting: Setting) -> FloatArray:
        step_nm = setting.conditions.torque_steps_nm.get(channel, math.inf)
        part: FloatArray = np.clip(np.asarray(reading(setting)) / step_nm, -1.0, 1.0)
        return part

    return ErrorSource(
        f"{name}_steps", f"coarse steps of the {words} torque: cut off decimals make it smaller on both sides",
        "N·m", lambda _: "normal", half_a_step, _moving(name, cut_off),
    )  # fmt: skip


def _angle_rows(name: AngleName, words: str) -> list[ErrorSource]:
    """Error over a turn, error within a line, and rounding of one encoder."""

    def limit(value_rad: Callable[[AngleFigures], float]) -> Callable[..., float | None]:
        def found(figures: SensorFigures, conditions: MeasurementConditions) -> float | None:
            encoder = encoder_of(figures, name)
            if encoder is None or name not in conditions.encoders:
                return None
            return value_rad(encoder) * ARCSEC_PER_RAD

        return found

    def cyclic(_: SensorFigures) -> str:
        return "cyclic"

    def both(period_rad: Callable[[AngleFigures], float]) -> tuple[Shape, ...]:
        return tuple(repeating(name, period_rad, wave) for wave in (np.sin, np.cos))

    return [
        ErrorSource(
            f"{name}_turn", f"error of the {words} encoder over a turn", "arcsec", cyclic,
            limit(lambda encoder: encoder.accuracy_rad), both(lambda _: 2.0 * math.pi),
        ),
        ErrorSource(
            f"{name}_line", f"error of the {words} encoder within one line", "arcsec", cyclic,
            limit(lambda encoder: encoder.interpolation_rad), both(lambda encoder: encoder.line_rad),
        ),
        ErrorSource(
            f"{name}_step", f"resolution of the {words} encoder (rounding)", "arcsec", lambda _: "quantised",
            limit(lambda encoder: encoder.step_rad / 2.0),
            tuple(rounded(name, way) for way in roundings()),
        ),
    ]  # fmt: skip


def _timed(conditions: MeasurementConditions) -> bool:
    return conditions.forward.timed and conditions.backward.timed


def _width(setting: Setting) -> Effect:
    """Move both branches apart, by one arcmin in all."""
    return Effect(angle_arcmin=0.5 * setting.points.direction)


def _lean(setting: Setting) -> Effect:
    """Lean both branches alike, half an arcmin at the largest torque: next to a turn a late angle has yet to turn."""
    return Effect(angle_arcmin=0.5 * setting.points.torque_nm / setting.conditions.peak_nm)


SOURCES: tuple[ErrorSource, ...] = (
    *_torque_rows("torque_out", "output"),
    *_torque_rows("torque_in", "input"),
    _steps_row("torque_out", "output"),
    _steps_row("torque_in", "input"),
    *_angle_rows("angle_in", "input"),
    *_angle_rows("angle_out", "output"),
    ErrorSource(
        "skew", "remaining delay between torque and angle", "s", _rectangular,
        lambda figures, conditions: figures.skew_s if _timed(conditions) else None, (skew,),
    ),
    ErrorSource(
        "skew_estimate", "delay between torque and angle, estimated from cycles at different speeds", "s",
        lambda _: "normal", lambda _, conditions: conditions.u_skew_s or None, (skew,),
    ),
    ErrorSource(
        "late", "delay of the torque at the turning points, not corrected", "s",
        lambda _: "normal", lambda _, conditions: abs(conditions.late_s) or None, (skew,),
    ),
    ErrorSource(
        "locked_width", "friction in the lock, or a late angle of the locked shaft: loop width", "arcmin",
        lambda _: "normal", lambda _, conditions: abs(conditions.locked_width_arcmin) or None,
        (_width, _lean),
    ),
    ErrorSource(
        "creep", "creep of the wind-up under torque, the same in every cycle", "arcmin/min", _rectangular,
        lambda figures, conditions: figures.drift_arcmin_per_min if _timed(conditions) else None, (creep,),
    ),
    ErrorSource(
        "drift", "drift between the cycles, or the uncertainty of its correction", "arcmin/min",
        lambda _: "normal", lambda _, conditions: conditions.u_drift_arcmin_per_min or None, (drift,),
    ),
    ErrorSource(
        "drift_unseen", "drift that one cycle cannot show: gap of the loop", "arcmin/min", _rectangular,
        lambda _, conditions: conditions.unseen_drift_arcmin_per_min or None, (drift,),
    ),
    ErrorSource(
        "fixture", "stiffness of the fixture, by which the wind-up is corrected", "1", _rectangular,
        lambda figures, conditions: figures.fixture_fraction if conditions.fixture_corrected else None,
        (fixture,),
    ),
    ErrorSource(
        "lock_width", "angular position of the locked shaft: loop width", "arcmin", _rectangular,
        lambda figures, _: figures.lock_width_arcmin,
        (_width,),
    ),
    ErrorSource(
        "lock_windup", "angular position of the locked shaft: wind-up", "1", _rectangular,
        lambda figures, _: figures.lock_windup_fraction,
        (lambda setting: Effect(angle_arcmin=setting.points.angle_arcmin),),
    ),
)  # fmt: skip
"""All sources of systematic error. Noise, scatter between cycles and calibration lines have modules of their own."""
