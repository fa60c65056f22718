"""The plant: one reducer on one bench, advanced in time, and the sensors that look at it.

Deterministic: the same configuration and the same calls give the same bytes. Noise comes from PCG64 in blocks numbered
by the sample counter, so a sample has the same noise however often and whenever it is read.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from virtual_bench.config import BenchConfig
from virtual_bench.physics.decay import decay_of
from virtual_bench.physics.find_unit import find_unit
from virtual_bench.physics.machine_code import look
from virtual_bench.physics.motor_stop import MotorView
from virtual_bench.physics.plant_numbers import (
    NOISE_ROWS,
    SAMPLE_NS,
    SEEN_COUNTS,
    SEEN_VALUES,
    STEP_NS,
    C,
    DriveLoop,
    FloatArray,
    Parts,
    S,
    parts_of,
)
from virtual_bench.physics.plant_parameters import elastic_table, parameters
from virtual_bench.physics.plant_sensors import CHANNELS, sensor_table

# Plain ints: an enum member as an index costs three times as much, and these are read in every scan.
LIMITED = int(S.LIMITED)
MADE = (*Parts._fields, "_look", "_addresses")  # of a plant's numbers: a copy makes its own
NOT_READY = 4  # bit of `Sample.status`
SAMPLE_US = SAMPLE_NS // 1000
NOISE_BLOCK_NS = NOISE_ROWS * SAMPLE_NS
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


@dataclass(slots=True)
class Shown:
    """What the channels show of the newest sample while no fault disturbs them; written in place by `advance`."""

    torque_in_nm: float = 0.0
    torque_out_nm: float = 0.0
    angle_in_rad: float = 0.0
    angle_out_rad: float = 0.0
    saturated: int = 0  # bits 0 and 1 of `Sample.status`


class Plant:
    """Physics, drive loops and sensors. Controls are the properties and methods below; time moves by `advance`."""

    def __init__(self, config: BenchConfig) -> None:
        self.unit = find_unit(config.unit, config.catalogue)
        self._config = config
        params, channels, table = parameters(self.unit, config), sensor_table(config), elastic_table(self.unit)
        zeroes = np.zeros(len(S) + len(C))  # of state and control
        self._numbers: FloatArray = np.concatenate([zeroes, params, channels.ravel(), table])
        self._noise_seed = [config.noise_seed, 0 if self.unit.seed is None else self.unit.seed + 1]
        self._noise_block = -1
        self._noise: FloatArray = np.zeros((NOISE_ROWS, len(CHANNELS)))
        self._counts = np.zeros(SEEN_COUNTS, dtype=np.int64)
        self._values: FloatArray = np.zeros(SEEN_VALUES)
        self._share_out()
        self._pending_ns = 0
        self.motor = MotorView()  # `limited` is for the drive to say: see `take_limited`
        self.shown = Shown()
        self._limited = 0.0
        self.now_ns = 0  # simulated time, a whole number of inner steps
        self.brake_share = 1.0  # of the ordered current that the supply delivers
        self.overlay: Callable[[Sample], Sample] | None = None  # what faults make of a sample

    def _share_out(self) -> None:
        """Name the parts of the numbers, for whoever changes one, and where the compiled step finds them."""
        self.state, self.control, self.params, self.channels, self.table = parts_of(self._numbers)
        self._look = look()
        self._addresses = (
            (self._numbers.ctypes.data, self._numbers.size, self._noise.ctypes.data),
            (self._counts.ctypes.data, self._values.ctypes.data),
        )

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name not in MADE}

    def __setstate__(self, kept: dict[str, Any]) -> None:
        vars(self).update(kept)
        self._share_out()  # the parts of a copy are parts of its own numbers

    def advance(self, duration_ns: int) -> None:
        """Move on by `duration_ns`; what is left over below an inner step is kept for the next call."""
        steps, self._pending_ns = divmod(self._pending_ns + duration_ns, STEP_NS)
        if steps > 0:
            self.now_ns = now_ns = self.now_ns + steps * STEP_NS
            block = now_ns // NOISE_BLOCK_NS
            if block != self._noise_block:
                self._draw_noise(block)
            self._see(steps)

    def _see(self, steps: int) -> None:
        """Advance by inner steps, or by none, and take what the kernel then sees."""
        plant, seen = self._addresses
        self._look(*plant, steps, *seen)
        motor, shown = self.motor, self.shown
        motor.torque_permille, motor.position_counts, motor.velocity_counts_s, shown.saturated = self._counts.tolist()
        (
            self._limited,
            shown.torque_in_nm,
            shown.torque_out_nm,
            shown.angle_in_rad,
            shown.angle_out_rad,
        ) = self._values.tolist()

    def _draw_noise(self, block: int) -> None:
        generator = np.random.Generator(np.random.PCG64([block, *self._noise_seed]))
        generator.standard_normal(out=self._noise)
        self._noise_block = block

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

    def take_limited(self) -> bool:
        """Return whether a limit of the drive has acted since the last call."""
        if not self._limited:
            return False
        self.state[LIMITED] = self._limited = 0.0
        return True

    @property
    def housing_temp_c(self) -> float:
        """Temperature of the housing: rises with the same time constant as the drift."""
        time_s = self.now_ns * 1e-9
        warmed = 1.0 - decay_of(time_s / self.unit.drift_time_s)
        return self._config.ambient_temp_c + self.unit.temperature_rise_k * warmed

    @property
    def ambient_temp_c(self) -> float:
        """Temperature of the room."""
        return self._config.ambient_temp_c

    @property
    def counter(self) -> int:
        """Number of the newest sample."""
        return self.now_ns // SAMPLE_NS

    def measure_again(self) -> None:
        """Let the channels look anew at the newest sample: something about them has changed since `advance`."""
        block = self.counter // NOISE_ROWS
        if block != self._noise_block:
            self._draw_noise(block)
        self._see(0)

    def sample(self) -> Sample:
        """Return the newest sample of the amplifier: all channels latched at one instant, at most 0.1 ms ago."""
        self.measure_again()
        counter, shown = self.counter, self.shown
        sample = Sample(
            shown.torque_in_nm,
            shown.torque_out_nm,
            shown.angle_in_rad,
            shown.angle_out_rad,
            counter & 0xFFFFFFFF,
            counter * SAMPLE_US & 0xFFFFFFFF,
            shown.saturated if counter else shown.saturated | NOT_READY,
        )
        return sample if self.overlay is None else self.overlay(sample)


def warm_up(config: BenchConfig) -> None:
    """Have the kernel compiled, which takes some seconds the first time, and whatever else the first steps need."""
    plant = Plant(config)
    plant.advance(SAMPLE_NS)
    plant.sample()
