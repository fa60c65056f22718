"""The sensors that look at the plant: a table with one row per channel, and the compiled function that applies it.

A row takes an element of the plant's latched sample and gives it gain, zero, noise, saturation and quantum. `CH` names
its columns, in the file of the function that numba compiles, as in `plant_kernel`.
"""

from __future__ import annotations

from enum import IntEnum
from math import floor, pi

import numpy as np
from numba import njit

from drivers.virtual.config import AngleSensor, BenchConfig, TorqueSensor
from drivers.virtual.plant_kernel import FloatArray, S

CHANNELS = ("torque_in", "torque_out", "angle_in", "angle_out")
"""Rows of the table of sensors."""

ADC_BITS = 20
SATURATION = 1.1  # of full scale


class CH(IntEnum):
    """Columns of the sensor table, one row per channel."""

    SOURCE = 0  # element of the state
    GAIN = 1
    ZERO = 2
    NOISE = 3  # rms
    QUANTUM = 4
    LIMIT = 5  # saturates here; 0 never
    FAULT_OFFSET = 6
    STUCK = 7
    STUCK_AT = 8


def sensor_table(config: BenchConfig) -> FloatArray:
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


def _measure(state: FloatArray, channels: FloatArray, noise: FloatArray, row: int, out: FloatArray) -> None:
    """Write the four channels of the latched sample, and the saturation bits of the two torques, into `out`."""
    status = 0.0
    for channel in range(4):
        value = state[int(channels[channel, CH.SOURCE])] * channels[channel, CH.GAIN]
        value += channels[channel, CH.ZERO] + channels[channel, CH.NOISE] * noise[row, channel]
        value += channels[channel, CH.FAULT_OFFSET]
        limit = channels[channel, CH.LIMIT]
        if limit > 0.0 and abs(value) >= limit:
            value = limit if value > 0.0 else -limit
            status += 1.0 + channel
        quantum = channels[channel, CH.QUANTUM]
        if quantum > 0.0:
            value = floor(value / quantum + 0.5) * quantum
        if channels[channel, CH.STUCK] != 0.0:
            value = channels[channel, CH.STUCK_AT]
        out[channel] = value
    out[4] = status


measure_kernel = njit(cache=True)(_measure)
