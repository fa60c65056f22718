"""Units made from the values of a recipe's model: a good one, its bad variants, and seeded variations of each.

Reducers of one family are alike: torques grow with the rated torque, angles hardly. So a unit of another model is the
reference unit P1 with its torques scaled to the rated torque and its angles to the stiffness. What the recipe demands
comes before that: backlash and lost motion end below their limits, stiffness above. Friction is that of the recipe's
loading line. Nothing of this is a measurement: such a unit shows whether a recipe and a bench can measure its model.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from virtual_bench.config import Catalogue
from virtual_bench.physics.elastic import elastic_windup_arcmin
from virtual_bench.physics.units import P1, UNITS, Unit, parameters

CATALOGUE = "catalogue"
VARIANTS: dict[str, Unit] = {
    CATALOGUE: P1,
    **{f"{CATALOGUE}-{name}": unit for name, unit in UNITS.items() if unit.model == P1.model and unit.defect},
}
"""Names of such units, each with the unit of the table that it is alike to."""

P1_CATALOGUE_NM_ARCMIN = 100.0
P1_MOTOR_KGM2 = 1.5e-4

P1_PLAY_ARCMIN: dict[str, float] = {
    "backlash_width_3pct": 0.940,
    "backlash_width_zero": 0.947,
    "backlash_branches_3pct": 1.315,
    "gear_clearance": 0.474,
    "lost_motion": 0.375,
}
P1_STIFFNESS_NM_ARCMIN: dict[str, float] = {
    "spring_constant": 115.6,
    "stiffness_50_100": 104.7,
    "stiffness_end_point": 105.8,
    "stiffness_at": 98.0,
    "stiffness_lsq": 95.4,
    "stiffness_two_point": 94.2,
}
"""What definitions find on P1, by metric: the limits of a recipe are held against these. Other metrics move nothing."""

PLAY_SHARE = 0.94
"""Of the strictest limit for backlash or lost motion, what a good unit has."""

STIFFNESS_SHARE = 1.03
"""Of the strictest limit for a stiffness, what a good unit has at least."""

MIN_FRICTION_FRACTION = 0.01
PLAY_RANGE, PLAY_HALVINGS = 20.0, 60


def catalogue_unit(name: str, catalogue: Catalogue) -> Unit:
    """Return the unit of `VARIANTS` for the values of a model: a bad one differs from the good one as in the table."""
    good, like = _good_unit(catalogue), parameters(VARIANTS[name])
    moved = {key: value / usual for key, usual in parameters(P1).items() if (value := like[key]) != usual}
    changed = {key: getattr(good, key) * factor for key, factor in moved.items()}
    return replace(good, name=name, defect=VARIANTS[name].defect, **changed)


def _good_unit(catalogue: Catalogue) -> Unit:
    torque = catalogue.rated_torque_nm / P1.rated_torque_nm
    stiffness = _stiffness(catalogue)
    angle = torque / stiffness
    friction_fraction = max(catalogue.ratio / catalogue.loading_slope - 1.0, MIN_FRICTION_FRACTION)
    friction_nm = max(-catalogue.loading_offset_nm, 0.0) / catalogue.loading_slope
    # a larger unit has a larger shaft: what is wound up swings no faster than on P1
    inertia_kgm2 = (P1.input_inertia_kgm2 + P1_MOTOR_KGM2) * stiffness * (P1.ratio / catalogue.ratio) ** 2
    unit = replace(
        P1,
        model=catalogue.model,
        ratio=catalogue.ratio,
        rated_torque_nm=catalogue.rated_torque_nm,
        stiffness_positive_nm_per_arcmin=P1.stiffness_positive_nm_per_arcmin * stiffness,
        stiffness_negative_nm_per_arcmin=P1.stiffness_negative_nm_per_arcmin * stiffness,
        soft_torque_nm=P1.soft_torque_nm * torque,
        gap_torque_nm=P1.gap_torque_nm * torque,
        hysteresis_stiffness_nm_per_arcmin=P1.hysteresis_stiffness_nm_per_arcmin * stiffness,
        friction_loading_nm=friction_nm,
        friction_unloading_nm=friction_nm,
        friction_loading_fraction=friction_fraction,
        friction_unloading_fraction=friction_fraction,
        bristle_nm=P1.bristle_nm * torque,
        input_inertia_kgm2=max(P1.input_inertia_kgm2, inertia_kgm2 - P1_MOTOR_KGM2),
        output_inertia_kgm2=P1.output_inertia_kgm2 * max(torque, 1.0),
        drift_arcmin=P1.drift_arcmin * angle,
    )
    limits = [limit / P1_PLAY_ARCMIN[metric] for metric, limit in catalogue.most.items() if metric in P1_PLAY_ARCMIN]
    if not limits:
        return _with_play(unit, angle, torque)
    wanted_arcmin = PLAY_SHARE * min(limits) * P1_PLAY_ARCMIN["backlash_width_3pct"]
    low, high = 0.0, PLAY_RANGE * angle
    for _ in range(PLAY_HALVINGS):
        middle = (low + high) / 2.0
        wide = width_3pct_arcmin(_with_play(unit, middle, middle * stiffness)) > wanted_arcmin
        low, high = (low, middle) if wide else (middle, high)
    return _with_play(unit, low, low * stiffness)


def _with_play(unit: Unit, angle: float, torque: float) -> Unit:
    """Return a unit with what makes its backlash, over that of P1; the stiffness at high torque is not moved."""
    return replace(
        unit,
        soft_arcmin=P1.soft_arcmin * angle,
        gap_arcmin=P1.gap_arcmin * angle,
        hysteresis_nm=P1.hysteresis_nm * torque,
    )


def width_3pct_arcmin(unit: Unit) -> float:
    """Return the width of the loop at 3 % of rated torque, by the parameters alone: branches are the curve ± F_c."""
    torque_nm = 0.03 * unit.rated_torque_nm
    unloading, loading = elastic_windup_arcmin(
        unit, np.array([torque_nm + unit.hysteresis_nm, torque_nm - unit.hysteresis_nm])
    )
    return float(unloading - loading)


def _stiffness(catalogue: Catalogue) -> float:
    """Return the stiffness over that of P1: the catalogue's, or what the limits of the recipe demand."""
    figures = P1_STIFFNESS_NM_ARCMIN
    limits = [limit / figures[metric] for metric, limit in catalogue.least.items() if metric in figures]
    demanded = STIFFNESS_SHARE * max(limits, default=0.0)
    return max(catalogue.stiffness_nm_per_arcmin / P1_CATALOGUE_NM_ARCMIN, demanded)
