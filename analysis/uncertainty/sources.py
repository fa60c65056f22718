"""The table of error sources: what each is, which declared figure it comes from, and how it moves a measured loop.

A source is written down once, as what it does to the channels of the trace (torque at the output, torque at the input,
wind-up) per unit of its amount; all are linear in it. `chain` carries it through the calibration to the loop.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from analysis.uncertainty.circumstances import AngleName, Circumstances, Points
from analysis.uncertainty.distributions import DISTRIBUTIONS, STATED_BY
from analysis.uncertainty.figures import AngleFigures, SensorFigures, TorqueFigures
from analysis.units import RAD_PER_ARCMIN, FloatArray

ARCSEC_PER_RAD = 180.0 * 3600.0 / math.pi

ROUNDINGS = 24
"""Ways in which the counts of an encoder may lie over a loop; their contributions are averaged as variances."""

ROUNDING_SEED = 5
"""The same loop has the same uncertainty whenever it is evaluated."""

TorqueName = Literal["torque_in", "torque_out"]


class Effect(NamedTuple):
    """What one unit of an error does to torque at the output [N·m], torque at the input [N·m], wind-up [arcmin]."""

    torque_out_nm: FloatArray | float = 0.0
    torque_in_nm: FloatArray | float = 0.0
    angle_arcmin: FloatArray | float = 0.0


class Setting(NamedTuple):
    """What an error meets: points of one branch, how they were measured, and what is declared."""

    points: Points
    circumstances: Circumstances
    figures: SensorFigures


NOTHING = Effect()
Shape = Callable[[Setting], Effect]


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
    error a new one, so a calibration that was stored earlier has another one.
    """

    id: str
    text: str
    unit: str
    distribution: Callable[[SensorFigures], str]
    limit: Callable[[SensorFigures, Circumstances], float | None]
    shapes: tuple[Shape, ...]
    retared: bool = False

    def declared(self, figures: SensorFigures, circumstances: Circumstances) -> Declared | None:
        """Return what is declared of this source; None where nothing of it enters."""
        found = self.limit(figures, circumstances)
        return Declared(found, self.distribution(figures)) if found else None


def _rectangular(_: SensorFigures) -> str:
    return "rectangular"


def _lens(setting: Setting) -> FloatArray:
    """Hysteresis of a sensor: none at the turning points, full in the middle; falling torque reads high."""
    points = setting.points
    lens: FloatArray = -points.direction * (1.0 - np.square(points.torque_nm / setting.circumstances.peak_nm))
    return lens


def _torque_in(setting: Setting) -> FloatArray | float:
    return 0.0 if setting.points.torque_in_nm is None else setting.points.torque_in_nm


def _skew(setting: Setting) -> Effect:
    """Torque that comes later than the angle by one second reads lower by the rate of torque, on a rising branch."""
    points = setting.points
    return Effect(-points.rate_nm_s, 0.0 if points.torque_in_nm is None else -points.rate_nm_s / points.slope)


def _drift(setting: Setting) -> Effect:
    seconds = setting.points.seconds
    return NOTHING if seconds is None else Effect(angle_arcmin=seconds / 60.0)


def _fixture(setting: Setting) -> Effect:
    method, torque = setting.circumstances.method, setting.points.torque_nm
    if method.fixture_curve is not None:
        return Effect(angle_arcmin=method.fixture_curve.at(torque))
    stiffness = method.fixture_stiffness_nm_per_arcmin
    return NOTHING if stiffness is None else Effect(angle_arcmin=torque / stiffness)


def _encoder(figures: SensorFigures, name: AngleName) -> AngleFigures | None:
    return figures.angle_in if name == "angle_in" else figures.angle_out


def _turned_arcmin(setting: Setting, name: AngleName, stretch: float = 1.0) -> FloatArray:
    """Angle that the shaft of an encoder has turned, at the output; stretch: of what the fixture gives way by."""
    stiffness = setting.circumstances.method.fixture_stiffness_nm_per_arcmin or math.inf
    turned: FloatArray = setting.points.torque_nm * (stretch / stiffness)
    return turned if name == setting.circumstances.locked else turned + setting.points.angle_arcmin


def _cyclic(
    name: AngleName, period_rad: Callable[[AngleFigures], float], wave: Callable[[FloatArray], FloatArray]
) -> Shape:
    """Error of an encoder that repeats with its own angle, per arcsec at its shaft."""

    def shape(setting: Setting) -> Effect:
        method, encoder = setting.circumstances.method, _encoder(setting.figures, name)
        if encoder is None:
            return NOTHING
        scale = method.ratio if name == "angle_in" else 1.0
        phase = _turned_arcmin(setting, name) * (2.0 * math.pi * RAD_PER_ARCMIN * scale / period_rad(encoder))
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


def _roundings() -> list[Rounding]:
    """Return the ways that are tried: each of the four is spread evenly, in an order of its own."""
    random = np.random.default_rng(ROUNDING_SEED)
    start, phase, amplitude, stretch = ((random.permutation(ROUNDINGS) + 0.5) / ROUNDINGS for _ in range(4))
    rows = zip(start, 2.0 * math.pi * phase, amplitude, 2.0 * stretch - 1.0, strict=True)
    return [Rounding(*(float(value) for value in row)) for row in rows]


def _rounded(name: AngleName, way: Rounding) -> Shape:
    """Error of rounding to counts, per arcsec at the encoder's shaft; all ways together have the size of one.

    Rounded is what the encoder reads: its angle with the error within a line in it. Between two places some counts
    apart that error, and what is not known of the fixture, move the distance by more than a part of a count: so two
    places that seem to be a whole number of counts apart are not rounded alike.
    """

    def shape(setting: Setting) -> Effect:
        encoder = _encoder(setting.figures, name)
        if encoder is None:
            return NOTHING
        scale = setting.circumstances.method.ratio if name == "angle_in" else 1.0
        stretch = 1.0 + way.stretch * setting.figures.fixture_fraction
        angle = _turned_arcmin(setting, name, stretch) * (RAD_PER_ARCMIN * scale)
        wave = np.sin(2.0 * math.pi * angle / encoder.line_rad + way.phase)
        counts = (angle + way.amplitude * encoder.interpolation_rad * wave) / encoder.step_rad + way.start
        error = np.round(counts) - counts
        return Effect(angle_arcmin=error * (math.sqrt(12.0 / ROUNDINGS) / (60.0 * scale)))

    return shape


def _torque_rows(name: TorqueName, words: str) -> list[ErrorSource]:
    """Gain, zero and reversibility of one torque sensor."""

    def sensor_of(figures: SensorFigures) -> TorqueFigures | None:
        return figures.torque_in if name == "torque_in" else figures.torque_out

    def stated(figures: SensorFigures) -> str:
        sensor = sensor_of(figures)
        return _rectangular(figures) if sensor is None else STATED_BY[sensor.stated_by]

    def limit(fraction: Callable[[TorqueFigures], float], *, of_scale: bool) -> Callable[..., float | None]:
        def found(figures: SensorFigures, circumstances: Circumstances) -> float | None:
            sensor = sensor_of(figures)
            unused = name == "torque_in" and circumstances.quadrants is None
            if sensor is None or unused:
                return None
            return fraction(sensor) * (sensor.full_scale_nm if of_scale else 1.0)

        return found

    def shape(of: Callable[[Setting], FloatArray | float]) -> tuple[Shape]:
        if name == "torque_in":
            return (lambda setting: Effect(torque_in_nm=of(setting)),)
        return (lambda setting: Effect(torque_out_nm=of(setting)),)

    reading = _torque_in if name == "torque_in" else (lambda setting: setting.points.torque_nm)
    return [
        ErrorSource(
            f"{name}_gain", f"gain of the {words} torque sensor", "1", stated,
            limit(lambda sensor: sensor.gain_fraction, of_scale=False), shape(reading),
        ),
        ErrorSource(
            f"{name}_zero", f"zero of the {words} torque sensor, what the tare left", "N·m", _rectangular,
            limit(lambda sensor: sensor.zero_fraction, of_scale=True), shape(lambda _: 1.0), retared=True,
        ),
        ErrorSource(
            f"{name}_reversibility", f"reversibility (hysteresis) of the {words} torque sensor", "N·m", stated,
            limit(lambda sensor: sensor.reversibility_fraction, of_scale=True), shape(_lens),
        ),
    ]  # fmt: skip


def _angle_rows(name: AngleName, words: str) -> list[ErrorSource]:
    """Error over a turn, error within a line, and rounding of one encoder."""

    def limit(value_rad: Callable[[AngleFigures], float]) -> Callable[..., float | None]:
        def found(figures: SensorFigures, circumstances: Circumstances) -> float | None:
            encoder = _encoder(figures, name)
            if encoder is None or name not in circumstances.encoders:
                return None
            return value_rad(encoder) * ARCSEC_PER_RAD

        return found

    def cyclic(_: SensorFigures) -> str:
        return "cyclic"

    def both(period_rad: Callable[[AngleFigures], float]) -> tuple[Shape, ...]:
        return tuple(_cyclic(name, period_rad, wave) for wave in (np.sin, np.cos))

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
            f"{name}_step", f"counts of the {words} encoder (rounding)", "arcsec", lambda _: "quantised",
            limit(lambda encoder: encoder.step_rad / 2.0),
            tuple(_rounded(name, way) for way in _roundings()),
        ),
    ]  # fmt: skip


def _timed(circumstances: Circumstances) -> bool:
    return circumstances.forward.timed and circumstances.backward.timed


SOURCES: tuple[ErrorSource, ...] = (
    *_torque_rows("torque_out", "output"),
    *_torque_rows("torque_in", "input"),
    *_angle_rows("angle_in", "input"),
    *_angle_rows("angle_out", "output"),
    ErrorSource(
        "skew", "delay of the torque against the angle that is left", "s", _rectangular,
        lambda figures, circumstances: figures.skew_s if _timed(circumstances) else None, (_skew,),
    ),
    ErrorSource(
        "drift", "drift of the wind-up that is left", "arcmin/min", _rectangular,
        lambda figures, circumstances: figures.drift_arcmin_per_min if _timed(circumstances) else None, (_drift,),
    ),
    ErrorSource(
        "drift_unseen", "drift that a single cycle does not show: gap of the loop", "arcmin/min", _rectangular,
        lambda _, circumstances: circumstances.unseen_drift_arcmin_per_min or None, (_drift,),
    ),
    ErrorSource(
        "fixture", "stiffness of the fixture that the wind-up is corrected by", "1", _rectangular,
        lambda figures, circumstances: figures.fixture_fraction if circumstances.fixture_corrected else None,
        (_fixture,),
    ),
    ErrorSource(
        "lock_width", "teeth at which the shaft is locked: loop width", "arcmin", _rectangular,
        lambda figures, _: figures.lock_width_arcmin,
        (lambda setting: Effect(angle_arcmin=0.5 * setting.points.direction),),
    ),
    ErrorSource(
        "lock_windup", "teeth at which the shaft is locked: wind-up", "1", _rectangular,
        lambda figures, _: figures.lock_windup_fraction,
        (lambda setting: Effect(angle_arcmin=setting.points.angle_arcmin),),
    ),
)  # fmt: skip
"""All sources of systematic error. Noise, scatter between cycles and calibration lines have modules of their own."""
