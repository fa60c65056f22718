"""The plant: one reducer on one bench, advanced in time, and the sensors that look at it.

Deterministic: the same configuration and the same calls give the same bytes. Noise comes from PCG64 in blocks numbered
by the sample counter, so a sample has the same noise however often and whenever it is read.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import exp, pi
from typing import NamedTuple

import numpy as np

from drivers.virtual.config import AngleSensor, BenchConfig, TorqueSensor
from drivers.virtual.plant_kernel import (
    ARCMIN_RAD,
    SAMPLE_NS,
    STEP_NS,
    C,
    DriveLoop,
    FloatArray,
    P,
    S,
    Seen,
    advance_kernel,
    measure_kernel,
)
from drivers.virtual.units import Unit, find_unit

TABLE_HALF_ARCMIN = 30.0
TABLE_STEP_ARCMIN = 0.0025
NOISE_ROWS = 4096
LOCKED_DRAG_OUTPUT_NMS_RAD = 1.0
LOCKED_FRICTION_OUTPUT_NM = 0.5  # bearings of the open lock
LOCK_INERTIA_OUTPUT_KGM2 = 0.1
LOCK_INERTIA_INPUT_KGM2 = 2.5e-4
LOCKED_DRAG_INPUT_NMS_RAD = 1e-3
GEARBOX_FRICTION_NM = 1.0  # of the servo's gearbox, where it has one, at the loaded shaft
GEARBOX_BRISTLE_ARCMIN = 0.005
BRISTLE_DAMPING_RATIO = 0.06
GEARBOX_VISCOUS_NMS_RAD = 1.0
ADC_BITS = 20
SATURATION = 1.1  # of full scale
MIN_LAG_S = 1e-6
# Plain ints: an enum member as an index costs three times as much, and these are read in every scan.
LIMITED = int(S.LIMITED)
MODE, TORQUE_NM, VELOCITY_RAD_S = int(C.MODE), int(C.TORQUE_NM), int(C.VELOCITY_RAD_S)
CHANNELS = ("torque_in", "torque_out", "angle_in", "angle_out")


class Sample(NamedTuple):
    """One sample of the measuring amplifier."""

    torque_in_nm: float
    torque_out_nm: float
    angle_in_rad: float
    angle_out_rad: float
    counter: int
    time_us: int
    status: int  # bit 0 torque_in saturated, bit 1 torque_out saturated, bit 2 not ready


_sample_of = partial(tuple.__new__, Sample)
"""Of a tuple of all fields; faster than a call with as many arguments, and made in every scan."""


class Plant:
    """Physics, drive loops and sensors. Controls are the properties and methods below; time moves by `advance`."""

    def __init__(self, config: BenchConfig) -> None:
        self.unit = find_unit(config.unit)
        self._config = config
        self.state: FloatArray = np.zeros(len(S))
        self.control: FloatArray = np.zeros(len(C))
        self.params: FloatArray = _parameters(self.unit, config)
        self.table: FloatArray = elastic_table(self.unit)
        self.channels: FloatArray = _channels(config)  # rows of CHANNELS: see `measure_kernel`
        self._noise_seed = [config.seed, 0 if self.unit.seed is None else self.unit.seed + 1]
        self._noise_block = -1
        self._noise: FloatArray = np.zeros((NOISE_ROWS, len(CHANNELS)))
        self._out: FloatArray = np.zeros(len(CHANNELS) + 1)
        self._pending_ns = 0
        self._seen: Seen = (0.0, 0.0, 0.0, 0.0, 0.0)
        self.now_ns = 0  # simulated time, a whole number of inner steps
        self._gear = config.drive.gear_ratio
        self.brake_share = 1.0  # of the ordered current that the supply delivers
        self.overlay: Callable[[Sample], Sample] | None = None  # what faults make of a sample

    def advance(self, duration_ns: int) -> None:
        """Move on by `duration_ns`; what is left over below an inner step is kept for the next call."""
        steps, self._pending_ns = divmod(self._pending_ns + duration_ns, STEP_NS)
        if steps > 0:
            self._seen = advance_kernel(self.state, self.params, self.control, self.table, steps)
            self.now_ns += steps * STEP_NS

    def set_drive(self, loop: DriveLoop, torque_nm: float, velocity_rad_s: float) -> None:
        """Close one of the drive's loops with a target torque or velocity of the motor."""
        control = self.control
        control[MODE] = loop
        control[TORQUE_NM] = torque_nm
        control[VELOCITY_RAD_S] = velocity_rad_s

    def set_drive_limits(self, torque_nm: float, speed_rad_s: float, torque_slope_nm_s: float) -> None:
        """Set the drive's own limits, motor side."""
        self.control[C.TORQUE_LIMIT_NM] = torque_nm
        self.control[C.SPEED_LIMIT_RAD_S] = speed_rad_s
        self.control[C.TORQUE_SLOPE_NM_S] = torque_slope_nm_s

    def set_brake_current(self, current_a: float) -> None:
        """Set the current in the brake's coil, at least 0 A and at most its rating."""
        allowed_a = min(max(current_a, 0.0), self._config.brake.max_current_a)
        self.control[C.BRAKE_CURRENT_A] = allowed_a * self.brake_share

    @property
    def reducer_torque_nm(self) -> float:
        """Torque in the reducer, at the output: what is there, whatever a sensor shows."""
        return float(self.state[S.TORQUE_NM])

    @property
    def brake_current_a(self) -> float:
        """Current in the brake's coil."""
        return float(self.control[C.BRAKE_CURRENT_A])

    def motor(self) -> tuple[float, float, float, bool]:
        """Return the motor's torque, angle and speed, and whether a limit has acted since the last call."""
        torque_nm, angle_rad, speed_rad_s, limited, samples = self._seen
        if limited:
            self.state[LIMITED] = 0.0
            self._seen = (torque_nm, angle_rad, speed_rad_s, 0.0, samples)
        return torque_nm, angle_rad * self._gear, speed_rad_s * self._gear, limited != 0.0

    @property
    def housing_temp_c(self) -> float:
        """Temperature of the housing: rises with the same time constant as the drift."""
        time_s = self.now_ns * 1e-9
        return self._config.ambient_temp_c + self.unit.temperature_rise_k * (
            1.0 - exp(-time_s / self.unit.drift_time_s)
        )

    @property
    def ambient_temp_c(self) -> float:
        """Temperature of the room."""
        return self._config.ambient_temp_c

    def sample(self) -> Sample:
        """Return the newest sample of the amplifier: all channels latched at one instant, at most 0.1 ms ago."""
        counter = int(self._seen[4])
        block, row = divmod(counter, NOISE_ROWS)
        if block != self._noise_block:
            generator = np.random.Generator(np.random.PCG64([block, *self._noise_seed]))
            self._noise = generator.standard_normal((NOISE_ROWS, len(CHANNELS)))
            self._noise_block = block
        measure_kernel(self.state, self.channels, self._noise, row, self._out)
        torque_in, torque_out, angle_in, angle_out, status = self._out.tolist()
        time_us = counter * (SAMPLE_NS // 1000)
        bits = int(status) if counter else int(status) | 4
        stamp = (counter & 0xFFFFFFFF, time_us & 0xFFFFFFFF, bits)
        sample: Sample = _sample_of((torque_in, torque_out, angle_in, angle_out, *stamp))
        return sample if self.overlay is None else self.overlay(sample)


def warm_up(config: BenchConfig) -> None:
    """Compile the kernels, or load them from numba's cache; takes about a second the first time."""
    plant = Plant(config)
    plant.advance(SAMPLE_NS)
    plant.sample()


def elastic_windup_arcmin(unit: Unit, torque_nm: FloatArray) -> FloatArray:
    """Return the elastic wind-up over torque: linear part, soft contact at low torque, gap."""
    magnitude = np.abs(torque_nm)
    stiffness = np.where(torque_nm >= 0.0, unit.stiffness_positive_nm_per_arcmin, unit.stiffness_negative_nm_per_arcmin)
    soft = unit.soft_arcmin * np.sign(torque_nm) * -np.expm1(-magnitude / unit.soft_torque_nm)
    gap = unit.gap_arcmin / 2.0 * np.tanh(torque_nm / unit.gap_torque_nm)
    windup: FloatArray = torque_nm / stiffness + soft + gap
    return windup


def elastic_table(unit: Unit) -> FloatArray:
    """Return the elastic torque on an even grid of wind-up: the inverse of `elastic_windup_arcmin`."""
    cells = round(2 * TABLE_HALF_ARCMIN / TABLE_STEP_ARCMIN)
    grid = np.linspace(-TABLE_HALF_ARCMIN, TABLE_HALF_ARCMIN, cells + 1)
    stiffest = max(unit.stiffness_positive_nm_per_arcmin, unit.stiffness_negative_nm_per_arcmin)
    low, high = np.full_like(grid, -stiffest * 40.0), np.full_like(grid, stiffest * 40.0)
    for _ in range(60):  # bisection: the curve has corners that Newton's method would jump over
        middle = (low + high) / 2.0
        above = elastic_windup_arcmin(unit, middle) > grid
        high = np.where(above, middle, high)
        low = np.where(above, low, middle)
    table: FloatArray = (low + high) / 2.0
    return table


def _parameters(unit: Unit, config: BenchConfig) -> FloatArray:
    """Put the constants of unit and bench at their places."""
    drive, brake = config.drive, config.brake
    gear = drive.gear_ratio
    drives_input = config.loading == "input"
    driven_ratio, locked_ratio = (unit.ratio, 1.0) if drives_input else (1.0, unit.ratio)
    unit_inertia = unit.input_inertia_kgm2 if drives_input else unit.output_inertia_kgm2
    inertia = drive.motor_inertia_kgm2 * gear**2 + unit_inertia
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
        P.TORQUE_LOOP_RAD_S: 2.0 * pi * drive.torque_bandwidth_hz,
        P.TABLE_START_ARCMIN: -TABLE_HALF_ARCMIN,
        P.TABLE_STEP_ARCMIN: TABLE_STEP_ARCMIN,
    }
    values |= _friction(unit, inertia) if drives_input else _gearbox_friction(inertia)
    values |= _lock(unit, drives_input=drives_input)
    values |= _velocity_loop(inertia / gear**2, drive.velocity_bandwidth_rad_s)
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


def _friction(unit: Unit, inertia_kgm2: float) -> dict[P, float]:
    """Return the friction of a driven input shaft: the reducer's own."""
    del inertia_kgm2
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


def _channels(config: BenchConfig) -> FloatArray:
    """Return one row per channel: source, gain, offset, noise, quantum, limit, error offset, stuck flag and value."""
    generator = np.random.Generator(np.random.PCG64([config.seed, 0x5E45]))
    sensors = (config.torque_in, config.torque_out, config.angle_in, config.angle_out)
    driven, locked = (0, 1) if config.loading == "input" else (1, 0)
    sources = {
        driven: int(S.SAMPLE_TORQUE_DRIVEN_NM),
        locked: int(S.SAMPLE_TORQUE_LOCKED_NM),
        2 + driven: int(S.SAMPLE_ANGLE_DRIVEN_RAD),
        2 + locked: int(S.SAMPLE_ANGLE_LOCKED_RAD),
    }
    rows = []
    for channel, sensor in enumerate(sensors):
        zero, gain = generator.uniform(-0.5, 0.5, 2)
        match sensor:
            case TorqueSensor():
                zero_error = zero * sensor.accuracy_fraction * sensor.full_scale_nm
                gain_error = 0.2 * gain * sensor.accuracy_fraction
                noise = sensor.noise_fraction * sensor.full_scale_nm
                quantum = 2.0 * SATURATION * sensor.full_scale_nm / 2**ADC_BITS
                limit = SATURATION * sensor.full_scale_nm
                rows.append([sources[channel], 1.0 + gain_error, zero_error, noise, quantum, limit, 0.0, 0.0, 0.0])
            case AngleSensor():
                quantum = 2.0 * pi / 2**sensor.resolution_bits
                rows.append([sources[channel], 1.0, zero * pi, sensor.noise_rad, quantum, 0.0, 0.0, 0.0, 0.0])
            case None:
                rows.append([sources[channel], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    return np.array(rows)
