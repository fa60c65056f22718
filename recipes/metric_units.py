"""Metrics that a recipe may ask for: the unit of each, what can be chosen, and what a measurement needs to give it."""

from __future__ import annotations

from typing import NamedTuple

from recipes.quantity import ARCMINUTES, LOSS, STIFFNESS, TORQUE, Kind

BRANCHES = ("load", "unload", "mean")
SIDES = ("+", "-")


class MetricNeeds(NamedTuple):
    """Row of `METRIC_NEEDS`: what can be chosen for a metric, and what has to be measured for it."""

    unit: str
    branches: tuple[str, ...]
    """Branches that may be asked for."""
    sides: tuple[str, ...]
    """Sides that may be asked for; `both` where the metric belongs to the whole loop."""
    reach: float = 0.0
    """Torque that the cycles must reach, as a fraction of the reference torque."""
    free: tuple[str, ...] = ()
    """Of `band` and `torque`, what may be chosen; the rest is part of the definition."""
    calibration: bool = False
    """The metric comes from the state calibrate, not from the cycles."""


METRIC_NEEDS: dict[str, MetricNeeds] = {
    "backlash_width_3pct": MetricNeeds("arcmin", ("width",), SIDES, reach=0.03),
    "backlash_width_zero": MetricNeeds("arcmin", ("width",), ("both",)),
    "lost_motion": MetricNeeds("arcmin", ("mean",), ("both",), reach=0.03, free=("band",)),
    "windup": MetricNeeds("arcmin", ("mean",), ("both",), reach=1.0),
    "stiffness_lsq": MetricNeeds("N·m/arcmin", ("load",), SIDES, reach=0.8),
    "stiffness_two_point": MetricNeeds("N·m/arcmin", ("load",), SIDES, reach=0.8),
    "stiffness_end_point": MetricNeeds("N·m/arcmin", ("load",), SIDES, reach=1.0),
    "stiffness_50_100": MetricNeeds("N·m/arcmin", BRANCHES, SIDES, reach=1.0),
    "stiffness_at": MetricNeeds("N·m/arcmin", ("mean",), SIDES, reach=0.5, free=("torque",)),
    "spring_constant": MetricNeeds("N·m/arcmin", ("mean",), SIDES, reach=1.0),
    "hysteresis_energy": MetricNeeds("N·m·arcmin", ("width",), ("both",)),
    "torque_ratio_slope": MetricNeeds("1", ("load",), SIDES, calibration=True),
    "torque_ratio_offset": MetricNeeds("N·m", ("load",), SIDES, calibration=True),
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
