"""Reducers that can be put on the virtual bench: a table of good and bad ones, and seeded variations of each.

Without a seed a unit is the row of the table; a seed moves each parameter by a factor drawn from `1 ± SPREAD`. Spreads
are those of one production lot, at most ±20 %, and small where a larger one would make most seeds of a good unit bad.
Bad units are their base with the parameters moved that the defect moves.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from definitions.units import RAD_PER_ARCMIN


@dataclass(frozen=True)
class Unit:
    """Physics of one reducer; torques in the reducer and angles are at the output."""

    name: str
    model: str
    defect: str
    ratio: float
    rated_torque_nm: float
    stiffness_positive_nm_per_arcmin: float  # K_inf, for torque above zero
    stiffness_negative_nm_per_arcmin: float
    soft_arcmin: float  # b: extra wind-up of the soft contact at low torque
    soft_torque_nm: float  # T0
    gap_arcmin: float  # j
    gap_torque_nm: float  # T_j
    hysteresis_nm: float  # F_c
    hysteresis_stiffness_nm_per_arcmin: float  # sigma
    friction_loading_nm: float  # T_c, at the input
    friction_unloading_nm: float  # T_cb
    friction_loading_fraction: float  # mu_L, of T / ratio
    friction_unloading_fraction: float  # mu_U
    bristle_nm: float  # torque at which a bristle of the input friction deflects one arcmin of output
    bristle_damping_nms_rad: float
    viscous_nms_rad: float
    input_inertia_kgm2: float  # J_r
    output_inertia_kgm2: float
    drift_arcmin: float  # A
    drift_time_s: float  # tau
    temperature_rise_k: float
    lock_holds: float = 1.0  # share of its torque that a brake transmits to this unit's flange
    seed: int | None = None

    @property
    def bristle_stiffness_nm_rad(self) -> float:
        """Stiffness of the input friction's bristles at the input shaft."""
        return self.bristle_nm / (self.ratio * RAD_PER_ARCMIN)


P1 = Unit(
    name="P1",
    model="RV-40E-121",
    defect="",
    ratio=121.0,
    rated_torque_nm=412.0,
    stiffness_positive_nm_per_arcmin=110.86950329,
    stiffness_negative_nm_per_arcmin=110.86950329,
    soft_arcmin=0.7789045,
    soft_torque_nm=100.0,
    gap_arcmin=0.2,
    gap_torque_nm=2.0,
    hysteresis_nm=23.47536281,
    hysteresis_stiffness_nm_per_arcmin=2000.0,
    friction_loading_nm=13.889 / 94.689,
    friction_unloading_nm=13.889 / 94.689,
    friction_loading_fraction=121.0 / 94.689 - 1.0,
    friction_unloading_fraction=121.0 / 94.689 - 1.0,
    bristle_nm=30.0,
    bristle_damping_nms_rad=0.05,
    viscous_nms_rad=1e-4,
    input_inertia_kgm2=0.5e-4,
    output_inertia_kgm2=0.05,
    drift_arcmin=0.01,
    drift_time_s=900.0,
    temperature_rise_k=6.0,
)
"""The reference unit: backlash 0.94 arcmin, 115.17 N·m/arcmin at rated torque, on a loop to ±480 N·m."""

S50 = replace(
    P1,
    name="S50",
    model="RV-50",
    rated_torque_nm=50.0,
    stiffness_positive_nm_per_arcmin=31.335440,
    stiffness_negative_nm_per_arcmin=31.335440,
    soft_arcmin=0.25,
    soft_torque_nm=12.0,
    gap_arcmin=2.105766,
    gap_torque_nm=0.3,
    hysteresis_nm=4.0,
    hysteresis_stiffness_nm_per_arcmin=400.0,
    friction_loading_nm=0.018,
    friction_unloading_nm=0.018,
    bristle_nm=6.0,
    bristle_damping_nms_rad=0.02,
)
"""A 50 N·m unit: 27.634 N·m/arcmin (95 000 N·m/rad) by least squares, loop width 2.5 arcmin at 3 % of rated torque."""

UNITS: dict[str, Unit] = {
    unit.name: unit
    for unit in (
        P1,
        S50,
        replace(P1, name="worn", defect="backlash above 1 arcmin", gap_arcmin=0.35, hysteresis_nm=26.0),
        replace(
            P1,
            name="soft",
            defect="spring constant about 20 % low",
            stiffness_positive_nm_per_arcmin=88.7,
            stiffness_negative_nm_per_arcmin=88.7,
            hysteresis_nm=20.0,  # keeps the backlash below its limit: the stiffness is the defect
        ),
        replace(
            P1,
            name="tight",
            defect="input friction doubled",
            friction_loading_nm=2 * P1.friction_loading_nm,
            friction_unloading_nm=2 * P1.friction_unloading_nm,
        ),
        replace(
            P1,
            name="cracked",
            defect="stiffness about 15 % lower for positive torque",
            stiffness_positive_nm_per_arcmin=92.0,
            stiffness_negative_nm_per_arcmin=108.5,
            hysteresis_nm=21.0,
        ),
        replace(P1, name="loose-lock", defect="the lock holds a quarter of its torque", lock_holds=0.25),
    )
}

SPREAD: dict[str, float] = {
    "stiffness_positive_nm_per_arcmin": 0.02,
    "stiffness_negative_nm_per_arcmin": 0.02,
    "soft_arcmin": 0.03,
    "soft_torque_nm": 0.05,
    "gap_arcmin": 0.08,
    "gap_torque_nm": 0.20,
    "hysteresis_nm": 0.03,
    "hysteresis_stiffness_nm_per_arcmin": 0.10,
    "friction_loading_nm": 0.20,
    "friction_unloading_nm": 0.20,
    "friction_loading_fraction": 0.04,
    "friction_unloading_fraction": 0.04,
    "viscous_nms_rad": 0.20,
    "drift_arcmin": 0.20,
    "drift_time_s": 0.20,
    "temperature_rise_k": 0.20,
}
"""Half width of the factor that a seed draws, by parameter. What is not here is the same in every unit of a model."""


def vary(unit: Unit, seed: int) -> Unit:
    """Return another unit of the same lot: every parameter of `SPREAD` times a factor drawn for this name and seed."""
    generator = np.random.Generator(np.random.PCG64([seed, *unit.name.encode()]))
    factors = {name: 1.0 + spread * generator.uniform(-1.0, 1.0) for name, spread in SPREAD.items()}
    moved = {name: getattr(unit, name) * factor for name, factor in factors.items()}
    return replace(unit, seed=seed, **moved)


def parameters(unit: Unit) -> dict[str, float]:
    """Return the numeric parameters of a unit by name, for records and tables."""
    return {field.name: value for field in fields(unit) if isinstance(value := getattr(unit, field.name), float)}
