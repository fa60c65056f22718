"""Errors that the validity checks of a run cannot see, as sources of uncertainty, each as large as its check lets pass.

A recipe with `left_open: budget` has them in U. They are no property of the sensors but of this run: how large they may
be, its checks say (`MeasurementConditions.left_open`). What passes a check is as likely anywhere within: rectangular.
A wave has its peak there, at a phase that nobody knows: cyclic. Nor is its length known, so some are tried, and their
contributions averaged as variances.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from analysis.trace.units import FloatArray
from analysis.uncertainty.conditions import AngleName, MeasurementConditions
from analysis.uncertainty.figures import SensorFigures
from analysis.uncertainty.shapes import NOTHING, Effect, Setting, Shape, input_torque, lens, turned_arcmin
from analysis.uncertainty.sources import ErrorSource

OPEN = "open_"
"""How the quantities of these sources begin."""

TRIAL = 1.0
"""Size of an error that nothing bounds, in the unit of its check, to see which metrics it moves."""

SLOW_WAVES, FAST_WAVES = (0.5, 1.0, 2.0), (6.0, 9.0, 12.0)
"""Waves of an encoder in the whole way of its shaft, of which a loading branch has a third. Half a wave is much like a
wrong scale; from two in a loading branch on `angle_waves` says how large one may be. Between the two sets it sees more
and more of a wave, and none does more to a metric than those that are tried."""


def _loaded(conditions: MeasurementConditions) -> AngleName | None:
    """Name the encoder of the loaded shaft; None where the wind-up is not made of its angle."""
    name: AngleName = "angle_in" if conditions.method.loading == "input" else "angle_out"
    return name if name in conditions.encoders else None


def _both_torques(setting: Setting) -> Effect:
    return Effect(setting.points.torque_nm, input_torque(setting))


def _both_lenses(setting: Setting) -> Effect:
    of_output, points = lens(setting), setting.points
    return Effect(of_output, 0.0 if points.torque_in_nm is None else of_output / points.slope)


def _even_hysteresis(setting: Setting) -> Effect:
    """Hysteresis that is alike at every load, as of a bearing that bears a part: falling torque reads high.

    It turns over while the torque goes back by twice its size.
    """
    points, conditions = setting.points, setting.conditions
    size_nm = conditions.left_open.get("torque_out_zero") or TRIAL
    gone_nm = conditions.peak_nm + points.direction * points.torque_nm
    return Effect(points.direction * np.clip(1.0 - gone_nm / size_nm, -1.0, 1.0))


def _of_ratio(setting: Setting) -> Effect:
    return Effect(angle_arcmin=turned_arcmin(setting, "angle_in"))


def _late_angle(setting: Setting) -> Effect:
    """Angle that comes late between the turning points and not at them: it has yet to go on, so it narrows the loop."""
    return Effect(angle_arcmin=lens(setting))


def _wave(waves: float, of: Callable[[FloatArray], FloatArray], share: float) -> Shape:
    def shape(setting: Setting) -> Effect:
        name, way = _loaded(setting.conditions), setting.conditions.way_arcmin
        if name is None or not way > 0.0:
            return NOTHING
        scale = setting.conditions.method.ratio if name == "angle_in" else 1.0
        return Effect(angle_arcmin=share / scale * of(turned_arcmin(setting, name) * (2.0 * math.pi * waves / way)))

    return shape


def _waves(per_way: Sequence[float]) -> tuple[Shape, ...]:
    share = 1.0 / math.sqrt(len(per_way))
    return tuple(_wave(waves, of, share) for waves in per_way for of in (np.sin, np.cos))


def _open(
    check: str, over: float = 1.0, *, needs: Callable[[MeasurementConditions], bool] = lambda _: True
) -> Callable[[SensorFigures, MeasurementConditions], float | None]:
    """Return what gives the size that a check leaves open, over what makes its unit that of the source."""

    def found(_: SensorFigures, conditions: MeasurementConditions) -> float | None:
        size = conditions.left_open.get(check)
        return size / over if size and needs(conditions) else None

    return found


def _has_loaded(conditions: MeasurementConditions) -> bool:
    return _loaded(conditions) is not None


def _rectangular(_: SensorFigures) -> str:
    return "rectangular"


def _cyclic(_: SensorFigures) -> str:
    return "cyclic"


OPEN_SOURCES: Mapping[str, tuple[ErrorSource, ...]] = {
    "ratio_agreement": (
        ErrorSource(
            "open_torque_out_gain", "gain of the output torque that ratio_agreement leaves open", "1", _rectangular,
            _open("ratio_agreement", 100.0),
            # Of both sides alike, and half as much by which the sides differ.
            (lambda setting: Effect(setting.points.torque_nm),
             lambda setting: Effect(0.5 * np.abs(setting.points.torque_nm))),
        ),
        ErrorSource(
            "open_ratio", "ratio in the recipe that ratio_agreement leaves open", "1", _rectangular,
            _open("ratio_agreement", 100.0, needs=lambda conditions: "angle_in" in conditions.encoders), (_of_ratio,),
        ),
    ),
    "torque_out_zero": (
        ErrorSource(
            "open_even_hysteresis",
            "hysteresis of the output torque sensor, alike at every load, that torque_out_zero leaves open", "N·m",
            _rectangular, _open("torque_out_zero"), (_even_hysteresis,), whole=True,
        ),
    ),
    "torque_bend": (
        ErrorSource(
            "open_hysteresis", "hysteresis of the output torque sensor that torque_bend leaves open", "N·m",
            _rectangular, _open("torque_bend"), (lambda setting: Effect(lens(setting)),), whole=True,
        ),
    ),
    "angle_waves": (
        ErrorSource(
            "open_fast_wave", "fast wave of the loaded shaft's encoder that angle_waves leaves open", "arcmin", _cyclic,
            _open("angle_waves", needs=_has_loaded), _waves(FAST_WAVES),
        ),
    ),
    "drive_torque_agreement": (
        ErrorSource(
            "open_gain_of_both", "gain of both torques alike that drive_torque_agreement leaves open", "1",
            _rectangular, _open("drive_torque_agreement", 100.0), (_both_torques,),
        ),
    ),
    "drive_torque_gap": (
        ErrorSource(
            "open_hysteresis_of_both", "delay of both torques within a ramp that drive_torque_gap leaves open", "N·m",
            _rectangular, _open("drive_torque_gap"), (_both_lenses,), whole=True,
        ),
    ),
    "drive_angle_agreement": (
        ErrorSource(
            "open_slow_wave", "slow wave of the loaded shaft's encoder that drive_angle_agreement leaves open",
            "arcmin", _cyclic, _open("drive_angle_agreement", needs=_has_loaded), _waves(SLOW_WAVES),
        ),
    ),
    "drive_angle_direction": (
        ErrorSource(
            "open_late_angle", "delay of the loaded shaft's angle within a ramp that drive_angle_direction leaves open",
            "arcmin", _rectangular, _open("drive_angle_direction", needs=_has_loaded), (_late_angle,),
        ),
    ),
}  # fmt: skip
"""By the check that leaves it open. A figure that two errors share counts for each: nothing tells which it is."""
