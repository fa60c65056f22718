"""The plant: one reducer on one bench, advanced in time, and the sensors that look at it.

Deterministic: the same configuration and the same calls give the same bytes. Noise comes from PCG64 in blocks numbered
by the sample counter, so a sample has the same noise however often and whenever it is read.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import exp
from typing import NamedTuple

import numpy as np

from drivers.virtual.config import BenchConfig
from drivers.virtual.plant_kernel import (
    SAMPLE_NS,
    STEP_NS,
    C,
    DriveLoop,
    FloatArray,
    S,
    Seen,
    advance_kernel,
)
from drivers.virtual.plant_parameters import elastic_table, parameters
from drivers.virtual.plant_sensors import CHANNELS, measure_kernel, sensor_table
from drivers.virtual.units import find_unit

NOISE_ROWS = 4096
# Plain ints: an enum member as an index costs three times as much, and these are read in every scan.
LIMITED = int(S.LIMITED)
MODE, TORQUE_NM, VELOCITY_RAD_S = int(C.MODE), int(C.TORQUE_NM), int(C.VELOCITY_RAD_S)


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
        self.params: FloatArray = parameters(self.unit, config)
        self.table: FloatArray = elastic_table(self.unit)
        self.channels: FloatArray = sensor_table(config)  # one row each of CHANNELS: see `measure_kernel`
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
