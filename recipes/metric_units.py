"""Metrics that a recipe can ask for, with the kind of quantity their limits are written in.

The definitions belong to the analysis; this table says only what a recipe may write. A test holds both together.
"""

from __future__ import annotations

from typing import NamedTuple


class MetricKind(NamedTuple):
    """Row: unit of the value in reports, kind of quantity of its limits, and what it needs ("torque", "calibrate")."""

    unit: str
    quantity: str
    needs: str = ""


METRIC_KINDS: dict[str, MetricKind] = {
    "backlash_width_3pct": MetricKind("arcmin", "angle_arcmin"),
    "backlash_width_zero": MetricKind("arcmin", "angle_arcmin"),
    "lost_motion": MetricKind("arcmin", "angle_arcmin"),
    "stiffness_lsq": MetricKind("N·m/arcmin", "stiffness"),
    "stiffness_two_point": MetricKind("N·m/arcmin", "stiffness"),
    "stiffness_end_point": MetricKind("N·m/arcmin", "stiffness"),
    "stiffness_50_100": MetricKind("N·m/arcmin", "stiffness"),
    "stiffness_at": MetricKind("N·m/arcmin", "stiffness", "torque"),
    "spring_constant": MetricKind("N·m/arcmin", "stiffness"),
    "hysteresis_energy": MetricKind("N·m·arcmin", "energy_nm_arcmin"),
    "windup": MetricKind("arcmin", "angle_arcmin"),
    "torque_ratio_slope": MetricKind("1", "fraction", "calibrate"),
    "torque_ratio_offset": MetricKind("N·m", "torque", "calibrate"),
}

METRIC_UNITS: dict[str, str] = {name: kind.unit for name, kind in METRIC_KINDS.items()}
