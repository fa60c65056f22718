"""The inner step is small enough: half of it gives the same loop."""

from __future__ import annotations

import types
from dataclasses import replace

import numpy as np
import pytest
from numba import njit

from virtual_bench.config import BenchConfig
from virtual_bench.physics import plant_kernel
from virtual_bench.physics.plant import Plant
from virtual_bench.physics.plant_numbers import DriveLoop, S


def kernel_with_step(seconds: float) -> object:
    """Return the same inner step compiled for another step size."""
    names = {**vars(plant_kernel), "DT": seconds}
    body = plant_kernel.advance.py_func
    return njit(types.FunctionType(body.__code__, names))


@pytest.mark.parametrize("unit", ["P1", "S50"])
def test_half_the_step_gives_the_same_torque(bench_config: BenchConfig, unit: str) -> None:
    peak = 4.5 if unit == "P1" else 0.7
    results = []
    for kernel, parts in ((plant_kernel.advance, 1), (kernel_with_step(plant_kernel.DT / 2.0), 2)):
        plant = Plant(replace(bench_config, unit=unit))
        plant.set_drive_limits(6.0, 30.0, 10.0)
        plant.set_brake_current(9.0)
        trace = []
        for target in (peak, -peak, peak):
            plant.set_drive(DriveLoop.TORQUE, target, 0.0)
            for _ in range(150):
                kernel(plant.state, plant.params, plant.control, plant.table, parts * 400)  # type: ignore[operator]
                trace.append((plant.state[S.TORQUE_NM], plant.state[S.WINDUP_ARCMIN]))
        results.append(np.array(trace))
    peak_torque = np.max(np.abs(results[0][:, 0]))
    assert peak_torque > 30.0
    assert np.max(np.abs(results[0] - results[1]), axis=0)[0] < 0.01 * peak_torque
    assert np.max(np.abs(results[0] - results[1]), axis=0)[1] < 0.05
