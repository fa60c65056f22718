"""The bench has the same bits on every processor, and with every library that is made faster for one."""

from __future__ import annotations

import os
import subprocess
import sys
from math import exp, inf, isnan, nan
from pathlib import Path

import numpy as np
import pytest

from virtual_bench.physics.decay import LARGEST, decay, decay_of, series

STEPPED = """
import hashlib, sys
from dataclasses import replace
from virtual_bench.physics import machine_code
if "plain" in sys.argv:
    machine_code.llvm.get_host_cpu_name = str  # '': a processor with what each of its kind has, and no more
    machine_code.llvm.get_host_cpu_features = lambda: machine_code.llvm.FeatureMap()
from virtual_bench.physics.plant import DriveLoop, Plant
from virtual_bench_example import example_bench_config
seen = hashlib.sha256()
for unit in ("P1", "worn"):
    config = replace(example_bench_config(), unit=unit)
    plant = Plant(config)
    plant.set_brake_current(config.brake.max_current_a)
    plant.set_drive_limits(1e3, 1e3, 1e6)
    for cycle in range(600):
        plant.set_drive(DriveLoop.TORQUE, 3.0 * (1 if cycle % 200 < 100 else -1), 0.0)
        plant.advance(1_000_000)
        seen.update(plant.state.tobytes())
    seen.update(plant.table.tobytes())
print(seen.hexdigest())
"""

C_LIBRARY = "glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2,-AVX512F"
"""Tells the C library to leave its own faster functions alone; another one does not know it."""


def stepped(*words: str, **environment: str) -> str:
    path = os.pathsep.join([str(Path(__file__).parent), *filter(None, sys.path)])
    command = [sys.executable, "-c", STEPPED, *words]
    return subprocess.check_output(command, env=os.environ | environment | {"PYTHONPATH": path}, text=True)


def test_the_plant_has_the_same_bits_whatever_the_processor_can_do() -> None:
    from numpy._core._multiarray_umath import __cpu_dispatch__  # noqa: PLC0415 - it has no other name

    here = stepped()
    assert here
    assert stepped(NPY_DISABLE_CPU_FEATURES=" ".join(__cpu_dispatch__), GLIBC_TUNABLES=C_LIBRARY) == here
    assert stepped("plain") == here


Y = np.concatenate(
    [[0.0], np.linspace(0.0, 60.0, 20_001), np.geomspace(1e-300, LARGEST, 20_001), [LARGEST, 1e300, inf]]
)


def test_it_is_the_exponential_function() -> None:
    found = decay(Y)
    expected = np.array([exp(-y) for y in Y.tolist()])
    assert np.abs(found - expected).max() < 3e-16
    there = expected > 1e-300
    assert np.abs(found[there] / expected[there] - 1.0).max() < 6e-16
    assert (found[0], found[-1]) == (1.0, 0.0)


def test_of_one_number_it_has_the_same_bits() -> None:
    assert [decay_of(y) for y in Y.tolist()] == decay(Y).tolist()
    assert isnan(decay_of(nan))


@pytest.mark.parametrize("r", [0.0, 1e-9, -0.0108, 0.0108])
def test_the_series_stands_for_small_numbers(r: float) -> None:
    assert series(r) == pytest.approx(exp(-r), rel=4e-16, abs=0.0)
