"""A torque in another unit is told by the peak that the recipe plans."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from analysis.trace.trace import Trace
from benchmarks.simulated.kinds import KINDS
from benchmarks.simulated.loop_generator import Bench, course_of, measured
from recipes import load_recipe
from station.cli.runs.evaluate_anew import elsewhere
from station.results.unit_hint import NEAR, TORQUE_UNITS, in_other_unit, torque_unit_hint

RECIPE = load_recipe("rv-40e-121-quick")
PEAK_NM = 453.2


@pytest.mark.parametrize("unit", list(TORQUE_UNITS))
def test_a_unit_is_named(unit: str) -> None:
    trace = Trace(torque_out_nm=TORQUE_UNITS[unit] * PEAK_NM * np.sin(np.linspace(0.0, 6.3, 1000)))
    assert f"in {unit} " in torque_unit_hint(trace, RECIPE)


@pytest.mark.parametrize(("recipe", "peak_nm"), [("static-50nm", 100.0), ("rv-40e-121-output", 300.0)])
def test_cycles_by_speed_plan_a_peak_too(recipe: str, peak_nm: float) -> None:
    """A sound unit whose torque was in lbf·ft was a FAIL there: softer by a quarter."""
    loop = peak_nm * np.sin(np.linspace(0.0, 6.3, 1000))
    assert "in lbf·ft " in torque_unit_hint(Trace(torque_out_nm=TORQUE_UNITS["lbf·ft"] * loop), load_recipe(recipe))
    assert torque_unit_hint(Trace(torque_out_nm=loop), load_recipe(recipe)) == ""


@pytest.mark.parametrize("share", [1.0, 0.97, 1.02, 0.5, 0.8, 1.3])
def test_a_smaller_or_a_larger_loop_is_no_unit(share: float) -> None:
    trace = Trace(torque_out_nm=share * PEAK_NM * np.sin(np.linspace(0.0, 6.3, 1000)))
    assert torque_unit_hint(trace, RECIPE) == ""
    assert torque_unit_hint(Trace(torque_in_nm=np.ones(3)), RECIPE) == ""


@pytest.mark.parametrize(("share", "stiffness", "told"), [
    (0.7376, 0.74, True), (0.7376, 0.68, True), (0.7376, None, True),  # in lbf·ft
    (0.7376, 1.0, False), (1.0, 0.74, False),  # a lower peak on purpose; a soft unit
])  # fmt: skip
def test_a_torque_in_another_unit_makes_the_unit_as_much_softer(
    share: float,
    stiffness: float | None,
    told: bool,  # noqa: FBT001 - a row of a table
) -> None:
    trace = Trace(torque_out_nm=share * PEAK_NM * np.sin(np.linspace(0.0, 6.3, 1000)))
    assert in_other_unit(torque_unit_hint(trace, RECIPE), stiffness) is told


def test_no_two_units_are_taken_for_each_other() -> None:
    factors = sorted([1.0, *TORQUE_UNITS.values()])
    assert all(high / low > (1 + NEAR) / (1 - NEAR) for low, high in pairwise(factors))


def test_both_torques_in_another_unit_decide_nothing(tmp_path: Path) -> None:
    """Each agrees with the other, and the unit is softer by a quarter: that was a FAIL of a sound unit."""
    unit, bench = KINDS["RV-40E"], Bench(cycles=1, calibrate=False, period_s=0.01)
    trace = measured(unit, course_of(unit, bench), bench, np.random.default_rng(1))
    channels = ("t_s", "torque_in_nm", "torque_out_nm", "angle_in_rad", "angle_out_rad")
    reasons = {}
    for factor in (1.0, TORQUE_UNITS["lbf·ft"]):
        columns = [getattr(trace, name) * (factor if name.startswith("torque") else 1.0) for name in channels]
        path = tmp_path / f"{factor:.3f}.csv"
        np.savetxt(path, np.column_stack(columns), delimiter=",", header=",".join(channels), comments="")
        found = elsewhere(path, "rv-40e-121-inverse", None)
        reasons[factor] = [reason for reason in found.reasons if "lbf·ft" in reason]
        assert factor == 1.0 or found.verdict == "NOT DECIDABLE"
        assert factor == 1.0 or found.reasons[0] == reasons[factor][0]
    assert [len(some) for some in reasons.values()] == [0, 1]
