"""Master part over time and units against each other."""

import math

import numpy as np
import pytest

from analysis.line.master_part import master_part_trend
from analysis.line.spread import unit_to_unit
from analysis.trace.errors import AnalysisError

DAYS = np.arange(30.0)


def steady(seed: int = 1) -> np.ndarray:
    return 0.94 + np.random.default_rng(seed).normal(0.0, 0.004, 30)


def test_a_steady_bench_is_in_control() -> None:
    found = master_part_trend(DAYS, steady(), reference=(0.94, 0.005))
    assert found.in_control
    assert found.low_limit < 0.93
    assert found.high_limit > 0.95
    assert abs(found.slope_per_day) < 3 * found.u_slope_per_day
    assert found.bias == pytest.approx(0.0, abs=0.004)


def test_false_alarms_are_rare() -> None:
    alarms = [{signal.rule for signal in master_part_trend(DAYS, steady(seed)).signals} for seed in range(200)]
    assert sum("limit" in rules for rules in alarms) < 20
    assert sum("trend" in rules for rules in alarms) < 8


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        (0.002 * np.maximum(DAYS - 10, 0), "trend"),
        (np.where(DAYS == 20, 0.05, 0.0), "limit"),
        (np.where(DAYS >= 15, -0.009, 0.0), "side"),
    ],
)
def test_a_bench_that_changes_is_noticed(change: np.ndarray, rule: str) -> None:
    found = master_part_trend(DAYS, steady() + change)
    assert rule in {signal.rule for signal in found.signals}
    assert not found.in_control


def test_first_place_of_a_signal() -> None:
    signals = master_part_trend(DAYS, steady() + np.where(DAYS == 20, 0.05, 0.0)).signals
    assert [signal.measurement for signal in signals if signal.rule == "limit"] == [21]


def test_seven_rising_in_a_row() -> None:
    values = [1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.5]
    found = master_part_trend(np.arange(13.0), values, baseline=6)
    assert [(signal.rule, signal.measurement) for signal in found.signals] == [("steps", 12)]


def test_slope_and_its_uncertainty() -> None:
    found = master_part_trend(DAYS, steady() + 0.001 * DAYS)
    assert found.slope_per_day == pytest.approx(0.001, abs=3 * found.u_slope_per_day)
    assert found.u_slope_per_day == pytest.approx(0.004 / np.sqrt(np.square(DAYS - DAYS.mean()).sum()), rel=0.4)


def test_bias_against_the_certificate() -> None:
    found = master_part_trend(DAYS, steady(), reference=(0.90, 0.005))
    assert found.bias == pytest.approx(0.04, abs=0.004)
    assert [signal.rule for signal in found.signals] == ["bias"]


@pytest.mark.parametrize("reference", [(np.nan, 0.005), (np.inf, 0.005), (0.9, np.nan), (0.9, np.inf), (0.9, -0.005)])
def test_a_certified_value_that_is_no_number_is_refused(reference: tuple[float, float]) -> None:
    """Against none of them a bias would ever show."""
    with pytest.raises(AnalysisError, match="certified value"):
        master_part_trend(DAYS, steady(), reference=reference)
    assert master_part_trend(DAYS, steady(), reference=(0.94, 0.0)).u_bias_expanded


@pytest.mark.parametrize(
    ("days", "values", "baseline", "said"),
    [
        (DAYS[:5], steady(), 5, "5 days for 30 values"),
        (DAYS[::-1], steady(), 5, "do not rise"),
        (DAYS, steady(), 3, "expected a baseline of 5 to 30"),
        (DAYS, steady(), 31, "found 30 values, and a baseline of 31"),
        (DAYS[:3], steady()[:3], 10, "found 3 values, and a baseline of 10; expected 5 values or more"),
        (DAYS, np.ones(30), 10, "identical"),
        (DAYS, np.full(30, np.inf), 10, "value 1 is inf"),
    ],
)
def test_wrong_histories_are_said(days: np.ndarray, values: np.ndarray, baseline: int, said: str) -> None:
    with pytest.raises(AnalysisError, match=said):
        master_part_trend(days, values, baseline)


def test_spread_between_units_without_repeatability() -> None:
    random = np.random.default_rng(8)
    true = random.normal(98.0, 2.0, 200)
    found = unit_to_unit({f"P1-{n:04d}": value + random.normal(0.0, 1.0, 1 + n % 4) for n, value in enumerate(true)})
    assert found.sd_within == pytest.approx(1.0, rel=0.1)
    assert found.sd_units == pytest.approx(2.0, rel=0.15)
    assert found.units == 200
    assert found.measurements == 500
    assert found.sd_low < found.sd < found.sd_high
    assert found.least[1] == pytest.approx(min(true), abs=2.0)


def test_one_measurement_each_has_no_repeatability() -> None:
    found = unit_to_unit({"a": [1.0], "b": [2.0], "c": [4.0]})
    assert (found.sd_within, found.sd_units) == (None, None)
    assert (found.least, found.most) == (("a", 1.0), ("c", 4.0))
    assert found.mean == pytest.approx(7 / 3)


def test_an_unusual_unit_is_named() -> None:
    found = unit_to_unit({"a": [98.0], "b": [98.2], "c": [97.9], "soft": [80.0], "d": [98.1]})
    assert found.unusual == ("soft",)


def test_too_few_units_and_a_unit_without_values() -> None:
    with pytest.raises(AnalysisError, match="found 2 units"):
        unit_to_unit({"a": [1.0], "b": [2.0]})
    with pytest.raises(AnalysisError, match="unit to unit: b: found 0 values"):
        unit_to_unit({"a": [1.0], "b": [], "c": [1.0]})


def test_a_value_that_is_no_number_is_named_with_its_unit() -> None:
    with pytest.raises(AnalysisError, match="unit to unit: b: value 2 is nan"):
        unit_to_unit({"a": [1.0], "b": [2.0, math.nan], "c": [1.0]})
