"""The inner step is small enough: half of it gives the same loop."""

from __future__ import annotations

import types
from dataclasses import replace

import numpy as np
import pytest

from virtual_bench.config import BenchConfig
from virtual_bench.physics.plant import Plant
from virtual_bench.physics.plant_numbers import DriveLoop, S


@pytest.fixture(scope="module")
def kernels() -> tuple[tuple[object, int], ...]:
    """The inner step, and the same compiled for half of its step size, with how many of it make one.

    Loaded here: every worker collects this file, and most of them would compile for nothing.
    """
    from numba import njit  # noqa: PLC0415

    from virtual_bench.physics import plant_kernel  # noqa: PLC0415

    names = {**vars(plant_kernel), "DT": plant_kernel.DT / 2.0}
    half = njit(types.FunctionType(plant_kernel.advance.py_func.__code__, names))
    return (plant_kernel.advance, 1), (half, 2)


@pytest.mark.parametrize("unit", ["P1", "S50"])
def test_half_the_step_gives_the_same_torque(bench_config: BenchConfig, kernels: tuple, unit: str) -> None:
    peak = 4.5 if unit == "P1" else 0.7
    results = []
    for kernel, parts in kernels:
        plant = Plant(replace(bench_config, unit=unit))
        plant.set_drive_limits(6.0, 30.0, 10.0)
        plant.set_brake_current(9.0)
        trace = []
        for target in (peak, -peak, peak):
            plant.set_drive(DriveLoop.TORQUE, target, 0.0)
            for _ in range(150):
                kernel(plant.state, plant.params, plant.control, plant.table, parts * 400)
                trace.append((plant.state[S.TORQUE_NM], plant.state[S.WINDUP_ARCMIN]))
        results.append(np.array(trace))
    peak_torque = np.max(np.abs(results[0][:, 0]))
    assert peak_torque > 30.0
    assert np.max(np.abs(results[0] - results[1]), axis=0)[0] < 0.01 * peak_torque
    assert np.max(np.abs(results[0] - results[1]), axis=0)[1] < 0.05
