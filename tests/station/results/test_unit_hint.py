"""A torque in another unit is told by the peak that the recipe plans."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from analysis.trace.trace import Trace
from recipes import load_recipe
from station.results.unit_hint import NEAR, TORQUE_UNITS, torque_unit_hint

RECIPE = load_recipe("rv-40e-121-quick")
PEAK_NM = 453.2


@pytest.mark.parametrize("unit", list(TORQUE_UNITS))
def test_a_unit_is_named(unit: str) -> None:
    trace = Trace(torque_out_nm=TORQUE_UNITS[unit] * PEAK_NM * np.sin(np.linspace(0.0, 6.3, 1000)))
    assert f"in {unit} " in torque_unit_hint(trace, RECIPE)


@pytest.mark.parametrize("share", [1.0, 0.97, 1.02, 0.5, 0.8, 1.3])
def test_a_smaller_or_a_larger_loop_is_no_unit(share: float) -> None:
    trace = Trace(torque_out_nm=share * PEAK_NM * np.sin(np.linspace(0.0, 6.3, 1000)))
    assert torque_unit_hint(trace, RECIPE) == ""
    assert torque_unit_hint(Trace(torque_in_nm=np.ones(3)), RECIPE) == ""


def test_no_two_units_are_taken_for_each_other() -> None:
    factors = sorted([1.0, *TORQUE_UNITS.values()])
    assert all(high / low > (1 + NEAR) / (1 - NEAR) for low, high in pairwise(factors))
