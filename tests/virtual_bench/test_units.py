"""What the units of the table are like, from their parameters alone: branches are the elastic curve ± F_c."""

from __future__ import annotations

import numpy as np
import pytest

from virtual_bench.physics.elastic import elastic_windup_arcmin
from virtual_bench.physics.find_unit import find_unit
from virtual_bench.physics.units import UNITS, Unit


def windup(unit: Unit, torque_nm: float, side: float) -> float:
    """Return the wind-up at a torque on the loading (+1) or unloading (-1) branch away from the turning points."""
    return float(elastic_windup_arcmin(unit, np.array([torque_nm - side * unit.hysteresis_nm]))[0])


def width_3pct(unit: Unit, sign: float = 1.0) -> float:
    torque = sign * 0.03 * unit.rated_torque_nm
    return windup(unit, torque, -1.0) - windup(unit, torque, 1.0)


def spring_constant(unit: Unit) -> float:
    """Return the chord of the mean curve over the last 50 N·m below rated torque."""

    def mean(torque: float) -> float:
        return (windup(unit, torque, 1.0) + windup(unit, torque, -1.0)) / 2.0

    return 50.0 / (mean(unit.rated_torque_nm) - mean(unit.rated_torque_nm - 50.0))


def torque_ratio_offset(unit: Unit) -> float:
    return -unit.friction_loading_nm * unit.ratio / (1.0 + unit.friction_loading_fraction)


@pytest.mark.parametrize(
    ("name", "backlash", "stiffness", "offset"),
    [
        ("P1", (0.939, 0.941), (108.0, 112.0), (-14.0, -13.8)),
        ("worn", (1.05, 1.3), (106.0, 112.0), (-14.0, -13.8)),
        ("soft", (0.85, 0.98), (80.0, 92.0), (-14.0, -13.8)),
        ("tight", (0.939, 0.941), (108.0, 112.0), (-27.9, -27.6)),
        ("cracked", (0.88, 0.98), (86.0, 93.0), (-14.0, -13.8)),
    ],
)
def test_a_bad_unit_is_bad_in_its_own_way(
    name: str, backlash: tuple[float, float], stiffness: tuple[float, float], offset: tuple[float, float]
) -> None:
    unit = UNITS[name]
    for sign in (1.0, -1.0):
        assert backlash[0] < width_3pct(unit, sign) < backlash[1]
    assert stiffness[0] < spring_constant(unit) < stiffness[1]
    assert offset[0] < torque_ratio_offset(unit) < offset[1]


def test_the_small_unit_has_its_published_figures() -> None:
    unit = UNITS["S50"]
    torque = np.linspace(10.0, 40.0, 200)
    loading = elastic_windup_arcmin(unit, torque - unit.hysteresis_nm)
    assert 1.0 / np.polyfit(torque, loading, 1)[0] == pytest.approx(27.634, rel=2e-3)
    assert width_3pct(unit) == pytest.approx(2.5, abs=1e-3)


def test_a_tight_unit_stays_below_the_input_torque_trip() -> None:
    unit = UNITS["tight"]
    peak_in = unit.friction_loading_nm + (1.0 + unit.friction_loading_fraction) * 453.0 / unit.ratio
    assert peak_in < 5.4


def test_most_seeds_of_the_good_unit_are_good() -> None:
    lot = [find_unit(f"P1:{seed}") for seed in range(200)]
    good = [unit for unit in lot if width_3pct(unit) < 1.0 and torque_ratio_offset(unit) > -25.0]
    assert len(good) >= 190
    assert np.std([width_3pct(unit) for unit in lot]) > 0.005
