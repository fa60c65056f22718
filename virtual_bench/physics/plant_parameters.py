"""The numbers of the plant: constants of one bench with one unit in it, and its elastic table."""

from __future__ import annotations

from functools import lru_cache
from math import pi

import numpy as np

from virtual_bench.config import BenchConfig, sign, torque_unit_nm
from virtual_bench.physics.elastic import elastic_windup_arcmin
from virtual_bench.physics.plant_numbers import ARCMIN_RAD, FloatArray, P
from virtual_bench.physics.units import Unit

TABLE_HALF_ARCMIN = 30.0
TABLE_STEP_ARCMIN = 0.0025
AT_A_TIME = 4096
"""Places of the table that are made together: with all that is between, what a processor has nearby."""

PASSES, SHARED_PASSES = 60, 13
"""Of the bisection that inverts the curve; the first ones have fewer torques to look at than the table has places."""

LOCKED_DRAG_OUTPUT_NMS_RAD = 1.0
LOCKED_FRICTION_OUTPUT_NM = 0.5  # bearings of the open lock
LOCK_INERTIA_OUTPUT_KGM2 = 0.1
LOCK_INERTIA_INPUT_KGM2 = 2.5e-4
LOCKED_DRAG_INPUT_NMS_RAD = 1e-3
GEARBOX_FRICTION_NM = 1.0  # of the servo's gearbox, where it has one, at the loaded shaft
GEARBOX_BRISTLE_ARCMIN = 0.005
BRISTLE_DAMPING_RATIO = 0.06
GEARBOX_VISCOUS_NMS_RAD = 1.0
MIN_LAG_S = 1e-6


def elastic_table(unit: Unit) -> FloatArray:
    """Return the elastic torque on an even grid of wind-up: the inverse of `elastic_windup_arcmin`."""
    return _elastic_table(unit).copy()


@lru_cache(maxsize=32)
def _elastic_table(unit: Unit) -> FloatArray:
    """Make the table; kept for the next bench with this unit: its sixty passes are most of a bench's start."""
    cells = round(2 * TABLE_HALF_ARCMIN / TABLE_STEP_ARCMIN)
    grid = np.linspace(-TABLE_HALF_ARCMIN, TABLE_HALF_ARCMIN, cells + 1)
    edges = _first_edges(unit)
    windup = elastic_windup_arcmin(unit, edges[1:-1])
    pieces = (grid[at : at + AT_A_TIME] for at in range(0, grid.size, AT_A_TIME))
    return np.concatenate([_torques_nm(unit, piece, edges, windup) for piece in pieces])


def _first_edges(unit: Unit) -> FloatArray:
    """Return the torques that the first passes halve at: the same for every wind-up, and fewer than those."""
    stiffest = max(unit.stiffness_positive_nm_per_arcmin, unit.stiffness_negative_nm_per_arcmin)
    edges: FloatArray = np.array([-stiffest * 40.0, stiffest * 40.0])
    for _ in range(SHARED_PASSES):
        edges = np.insert(edges, range(1, edges.size), (edges[:-1] + edges[1:]) / 2.0)
    return edges


def _torques_nm(unit: Unit, windup_arcmin: FloatArray, edges: FloatArray, edges_arcmin: FloatArray) -> FloatArray:
    """Return the torque of each wind-up; `edges` of the first passes, and the wind-ups of those between."""
    first = np.searchsorted(edges_arcmin, windup_arcmin, side="right")
    low, high = edges[first], edges[first + 1]
    for _ in range(PASSES - SHARED_PASSES):  # bisection: the curve has corners that Newton's method would jump over
        middle = (low + high) / 2.0
        above = elastic_windup_arcmin(unit, middle) > windup_arcmin
        high = np.where(above, middle, high)
        low = np.where(above, low, middle)
    torques: FloatArray = (low + high) / 2.0
    return torques


def parameters(unit: Unit, config: BenchConfig) -> FloatArray:
    """Put the constants of unit and bench at their places."""
    drive, brake = config.drive, config.brake
    gear = drive.gear_ratio
    drives_input = config.loading == "input"
    driven_ratio, locked_ratio = (unit.ratio, 1.0) if drives_input else (1.0, unit.ratio)
    unit_inertia = unit.input_inertia_kgm2 if drives_input else unit.output_inertia_kgm2
    inertia = config.motor.inertia_kgm2 * gear**2 + unit_inertia
    values = {
        P.DRIVEN_RATIO: driven_ratio,
        P.LOCKED_RATIO: locked_ratio,
        P.DRIVEN_INERTIA_KGM2: inertia,
        P.UNIT_INERTIA_KGM2: unit_inertia,
        P.FIXTURE_NM_ARCMIN: config.fixture_stiffness_nm_per_arcmin * locked_ratio**2,
        P.DAHL_STIFFNESS_NM_ARCMIN: unit.hysteresis_stiffness_nm_per_arcmin,
        P.DAHL_FORCE_NM: unit.hysteresis_nm,
        P.FRICTION_BEHIND_SENSOR: 1.0 if drives_input else 0.0,
        P.DRIFT_ARCMIN: unit.drift_arcmin,
        P.DRIFT_TIME_S: unit.drift_time_s,
        P.BRAKE_NM_PER_A: brake.torque_constant_nm_per_a,
        P.BRAKE_TIME_S: max(brake.time_constant_s, MIN_LAG_S),
        P.BRAKE_HYSTERESIS: brake.hysteresis_fraction,
        P.BRAKE_HOLDS: unit.lock_holds,
        P.GEAR_RATIO: gear,
        P.TORQUE_LOOP_RAD_S: 2.0 * pi * config.motor.torque_bandwidth_hz,
        P.TABLE_START_ARCMIN: -TABLE_HALF_ARCMIN,
        P.TABLE_STEP_ARCMIN: TABLE_STEP_ARCMIN,
        P.TORQUE_UNIT_NM: sign(drive) * torque_unit_nm(drive),
        P.COUNTS_PER_RAD: sign(drive) * drive.profile.scaling.position_counts_per_motor_rev / (2.0 * pi),
        P.COUNTS_S_PER_RAD_S: sign(drive) * drive.profile.scaling.velocity_counts_per_rad_s,
    }
    values |= _friction(unit) if drives_input else _gearbox_friction(inertia)
    values |= _lock(unit, drives_input=drives_input)
    values |= _velocity_loop(inertia / gear**2, config.motor.velocity_bandwidth_rad_s)
    torque_lags = tuple(
        MIN_LAG_S if s is None else max(s.lag_s, MIN_LAG_S) for s in (config.torque_in, config.torque_out)
    )
    angle_lags = tuple(MIN_LAG_S if s is None else max(s.lag_s, MIN_LAG_S) for s in (config.angle_in, config.angle_out))
    driven, locked = (0, 1) if drives_input else (1, 0)
    values |= {
        P.LAG_TORQUE_DRIVEN_S: torque_lags[driven],
        P.LAG_TORQUE_LOCKED_S: torque_lags[locked],
        P.LAG_ANGLE_DRIVEN_S: angle_lags[driven],
        P.LAG_ANGLE_LOCKED_S: angle_lags[locked],
    }
    return np.array([values[name] for name in P])


def _friction(unit: Unit) -> dict[P, float]:
    """Return the friction of a driven input shaft: the reducer's own."""
    return {
        P.BRISTLE_STIFFNESS_NM_RAD: unit.bristle_stiffness_nm_rad,
        P.BRISTLE_DAMPING_NMS_RAD: unit.bristle_damping_nms_rad,
        P.VISCOUS_NMS_RAD: unit.viscous_nms_rad,
        P.FRICTION_LOADING_NM: unit.friction_loading_nm,
        P.FRICTION_UNLOADING_NM: unit.friction_unloading_nm,
        P.FRICTION_LOADING_PER_NM: unit.friction_loading_fraction,
        P.FRICTION_UNLOADING_PER_NM: unit.friction_unloading_fraction,
    }


def _gearbox_friction(inertia_kgm2: float) -> dict[P, float]:
    """Return the friction of a driven output shaft: that of the servo's gearbox, before the torque sensor."""
    stiffness = GEARBOX_FRICTION_NM / (GEARBOX_BRISTLE_ARCMIN * ARCMIN_RAD)
    return {
        P.BRISTLE_STIFFNESS_NM_RAD: stiffness,
        P.BRISTLE_DAMPING_NMS_RAD: 2.0 * BRISTLE_DAMPING_RATIO * (stiffness * inertia_kgm2) ** 0.5,
        P.VISCOUS_NMS_RAD: GEARBOX_VISCOUS_NMS_RAD,
        P.FRICTION_LOADING_NM: GEARBOX_FRICTION_NM,
        P.FRICTION_UNLOADING_NM: GEARBOX_FRICTION_NM,
        P.FRICTION_LOADING_PER_NM: 0.0,
        P.FRICTION_UNLOADING_PER_NM: 0.0,
    }


def _lock(unit: Unit, *, drives_input: bool) -> dict[P, float]:
    """Return what the locked shaft is when its brake is open: an inertia, some drag and some friction."""
    if drives_input:
        return {
            P.LOCKED_INERTIA_KGM2: LOCK_INERTIA_OUTPUT_KGM2 + unit.output_inertia_kgm2,
            P.LOCKED_DRAG_NMS_RAD: LOCKED_DRAG_OUTPUT_NMS_RAD,
            P.LOCKED_FRICTION_NM: LOCKED_FRICTION_OUTPUT_NM,
        }
    return {
        P.LOCKED_INERTIA_KGM2: LOCK_INERTIA_INPUT_KGM2 + unit.input_inertia_kgm2,
        P.LOCKED_DRAG_NMS_RAD: LOCKED_DRAG_INPUT_NMS_RAD,
        P.LOCKED_FRICTION_NM: unit.friction_loading_nm,
    }


def _velocity_loop(motor_inertia_kgm2: float, bandwidth_rad_s: float) -> dict[P, float]:
    """Return gains that put the velocity loop's three poles at the bandwidth on a free shaft.

    The second integral is there because a reducer that winds up is a ramp of torque: without it the speed would stay
    below its set-point by the ratio of the reducer's stiffness to the first integral's gain.
    """
    return {
        P.VELOCITY_P_NMS_RAD: 3.0 * motor_inertia_kgm2 * bandwidth_rad_s,
        P.VELOCITY_I_NM_RAD: 3.0 * motor_inertia_kgm2 * bandwidth_rad_s**2,
        P.VELOCITY_II_NM_RADS: motor_inertia_kgm2 * bandwidth_rad_s**3,
    }
