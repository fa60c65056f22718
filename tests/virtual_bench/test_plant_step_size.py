"""The inner step is small enough: half of it gives the same loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from unittest import mock

import numpy as np
import pytest

from virtual_bench import physics
from virtual_bench.config import BenchConfig
from virtual_bench.physics.plant import Plant
from virtual_bench.physics.plant_numbers import STEP_NS, DriveLoop, S

STEPS = 400
"""Inner steps between two looks."""

Advance = Callable[[Plant], None]


def as_it_is(plant: Plant) -> None:
    plant.advance(STEPS * STEP_NS)


@pytest.fixture(scope="module")
def in_halves() -> Advance:
    """What advances a plant by as much in half steps: its kernel once more, with nothing but the step compiled."""
    spec = spec_from_file_location("half_step_kernel", Path(physics.__file__).parent / "plant_kernel.py")
    assert spec is not None
    assert spec.loader is not None
    kernel = module_from_spec(spec)
    with mock.patch("numba.cfunc", return_value=lambda function: function):
        spec.loader.exec_module(kernel)
    kernel.DT /= 2.0
    return lambda plant: kernel.advance(plant.state, plant.params, plant.control, plant.table, 2 * STEPS)


@pytest.mark.parametrize("unit", ["P1", "S50"])
def test_half_the_step_gives_the_same_torque(bench_config: BenchConfig, in_halves: Advance, unit: str) -> None:
    peak = 4.5 if unit == "P1" else 0.7
    results = []
    for advance in (as_it_is, in_halves):
        plant = Plant(replace(bench_config, unit=unit))
        plant.set_drive_limits(6.0, 30.0, 10.0)
        plant.set_brake_current(9.0)
        trace = []
        for target in (peak, -peak, peak):
            plant.set_drive(DriveLoop.TORQUE, target, 0.0)
            for _ in range(150):
                advance(plant)
                trace.append((plant.state[S.TORQUE_NM], plant.state[S.WINDUP_ARCMIN]))
        results.append(np.array(trace))
    apart = np.max(np.abs(results[0] - results[1]), axis=0)
    peak_torque = np.max(np.abs(results[0][:, 0]))
    assert peak_torque > 30.0
    assert 0.0 < apart[0] < 0.01 * peak_torque
    assert 0.0 < apart[1] < 0.05
