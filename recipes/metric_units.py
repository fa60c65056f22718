"""Metrics that a recipe may ask for: the unit of each, and what a measurement needs to give it."""

from __future__ import annotations

from typing import NamedTuple

from recipes.quantity import ARCMINUTES, LOSS, STIFFNESS, TORQUE, Kind


class MetricNeeds(NamedTuple):
    """Row of `METRIC_NEEDS`: what has to be measured for a metric."""

    unit: str
    reach: float = 0.0
    """Torque that the cycles must pass, as a fraction of the reference torque."""
    torque: bool = False
    """The metric is asked at a torque, option `torque`."""
    calibration: bool = False
    """The metric comes from the state calibrate, not from the cycles."""


METRIC_NEEDS: dict[str, MetricNeeds] = {
    "backlash_width_3pct": MetricNeeds("arcmin", reach=0.03),
    "backlash_width_zero": MetricNeeds("arcmin"),
    "lost_motion": MetricNeeds("arcmin", reach=0.03),
    "windup": MetricNeeds("arcmin", reach=1.0),
    "stiffness_lsq": MetricNeeds("N·m/arcmin", reach=0.8),
    "stiffness_two_point": MetricNeeds("N·m/arcmin", reach=0.8),
    "stiffness_end_point": MetricNeeds("N·m/arcmin"),
    "stiffness_50_100": MetricNeeds("N·m/arcmin", reach=1.0),
    "stiffness_at": MetricNeeds("N·m/arcmin", torque=True),
    "spring_constant": MetricNeeds("N·m/arcmin", reach=1.0),
    "hysteresis_energy": MetricNeeds("N·m·arcmin"),
    "torque_ratio_slope": MetricNeeds("1", calibration=True),
    "torque_ratio_offset": MetricNeeds("N·m", calibration=True),
}

METRIC_UNITS: dict[str, str] = {metric: needs.unit for metric, needs in METRIC_NEEDS.items()}
"""Unit of every metric, in which limits are loaded; `1` is a plain number."""

KIND_OF_UNIT: dict[str, Kind | None] = {
    "arcmin": ARCMINUTES,
    "N·m/arcmin": STIFFNESS,
    "N·m·arcmin": LOSS,
    "N·m": TORQUE,
    "1": None,
}
