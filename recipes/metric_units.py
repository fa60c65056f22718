"""Metrics that a recipe may ask for: the unit of each, what can be chosen, and what a measurement needs to give it."""

from __future__ import annotations

from typing import NamedTuple

from recipes.quantity import ARCMINUTES, ARCSECONDS, LOSS, STIFFNESS, TORQUE, Kind

BRANCHES = ("load", "unload", "mean")
CURVES = ("mean", "load", "unload")
"""Branches of a fitted curve; the first one is taken when none is asked for, here and everywhere else."""
SIDES = ("+", "-")
FITS = ("six_segment", "six_segment_20pct", "three_region")
"""Fits that a stiffness curve can be read from."""


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
    variants: tuple[str, ...] = ()
    """Variants that may be asked for."""
    fits: tuple[str, ...] = ()
    """Fits that may be asked for."""
    band: float | None = None
    """Band that is taken when none is asked for, as a fraction of the reference torque."""


STIFFNESS_UNIT = "N·m/arcmin"
_SEGMENT = MetricNeeds(STIFFNESS_UNIT, BRANCHES, SIDES, reach=1.0, variants=("fitted", "chord"))

METRIC_NEEDS: dict[str, MetricNeeds] = {
    "backlash_width_3pct": MetricNeeds("arcmin", ("width",), SIDES, reach=0.03),
    "backlash_width_zero": MetricNeeds("arcmin", ("width",), ("both",)),
    "backlash_branches_3pct": MetricNeeds("arcmin", ("width",), ("both",), reach=0.03),
    "gear_clearance": MetricNeeds("arcmin", ("unload",), ("both", *SIDES), variants=("centred", "intercept")),
    "grade": MetricNeeds(
        "1", ("width",), ("both",), reach=0.03, variants=("width_zero", "width_3pct", "branches", "lost_motion")
    ),
    "lost_motion": MetricNeeds("arcmin", ("mean",), ("both",), reach=0.03, free=("band",), band=0.03),
    "windup": MetricNeeds("arcmin", ("mean",), ("both",), reach=1.0, variants=("fitted", "direct"), fits=FITS),
    "asymmetry_at_rated": MetricNeeds("arcsec", ("mean",), ("both",), reach=1.0),
    "stiffness_lsq": MetricNeeds(STIFFNESS_UNIT, ("load",), SIDES, reach=0.8),
    "stiffness_two_point": MetricNeeds(STIFFNESS_UNIT, ("load",), SIDES, reach=0.8),
    "stiffness_end_point": MetricNeeds(STIFFNESS_UNIT, ("load",), SIDES, reach=1.0),
    "stiffness_estimate": MetricNeeds(STIFFNESS_UNIT, ("load",), SIDES, reach=1.0),
    "stiffness_50_100": MetricNeeds(STIFFNESS_UNIT, BRANCHES, SIDES, reach=1.0),
    "stiffness_at": MetricNeeds(STIFFNESS_UNIT, CURVES, SIDES, reach=0.5, free=("torque",), fits=FITS),
    "spring_constant": MetricNeeds(
        STIFFNESS_UNIT, CURVES, SIDES, reach=1.0, variants=("ending", "centred", "from", "direct"), fits=FITS
    ),
    "k1": _SEGMENT,
    "k2": _SEGMENT,
    "k3": _SEGMENT,
    "hysteresis_energy": MetricNeeds("N·m·arcmin", ("width",), ("both",)),
    "hysteresis_angle": MetricNeeds("arcsec", ("width",), SIDES, reach=0.5, free=("torque",)),
    "torque_ratio_slope": MetricNeeds("1", ("load",), SIDES, calibration=True),
    "torque_ratio_offset": MetricNeeds("N·m", ("load",), SIDES, calibration=True),
}

METRIC_UNITS: dict[str, str] = {metric: needs.unit for metric, needs in METRIC_NEEDS.items()}
"""Unit of every metric, in which limits are loaded; `1` is a plain number."""

KIND_OF_UNIT: dict[str, Kind | None] = {
    "arcmin": ARCMINUTES,
    "arcsec": ARCSECONDS,
    "N·m/arcmin": STIFFNESS,
    "N·m·arcmin": LOSS,
    "N·m": TORQUE,
    "1": None,
}
