"""The sensors that look at the plant: a table with one row per channel, which `plant_kernel` applies."""

from __future__ import annotations

from math import pi

import numpy as np

from virtual_bench.config import AngleSensor, BenchConfig, TorqueSensor
from virtual_bench.physics.plant_numbers import FloatArray, S

CHANNELS = ("torque_in", "torque_out", "angle_in", "angle_out")
"""Rows of the table of sensors."""

ADC_BITS = 20
SATURATION = 1.1  # of full scale


def sensor_table(config: BenchConfig) -> FloatArray:
    """Return one row per channel: source, gain, offset, noise, quantum, limit, error offset, stuck flag and value."""
    generator = np.random.Generator(np.random.PCG64([config.sensor_seed, 0x5E45]))
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
