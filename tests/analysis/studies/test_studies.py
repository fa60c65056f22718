"""Eccentricity, lock angle and temperature: published tables, recovered slopes, and what is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from published import DATA

from analysis.studies.eccentricity import PUBLISHED, EccentricityRow, eccentricity_trend
from analysis.studies.lock_angle import lock_angle_study
from analysis.studies.temperature import temperature_trend
from analysis.trace.errors import AnalysisError


def test_square_law_gives_the_printed_deflections() -> None:
    trend = eccentricity_trend(PUBLISHED)
    found = [trend.deflection_rad(row.eccentricity_mm, row.torque_nm) for row in PUBLISHED]
    assert [1e3 * deflection for deflection in found] == pytest.approx([1.153, 0.983, 0.847], abs=5e-4)
    # to the digits of the table
    assert [round(deflection, 4) for deflection in found] == [row.deflection_rad for row in PUBLISHED]


def test_printed_law_has_the_wrong_sign() -> None:
    printed = eccentricity_trend(PUBLISHED, exponent=-2.0)
    found = [round(printed.deflection_rad(row.eccentricity_mm, row.torque_nm), 4) for row in PUBLISHED]
    assert found != [row.deflection_rad for row in PUBLISHED]
    assert printed.residual > 5 * eccentricity_trend(PUBLISHED).residual
    free = eccentricity_trend(PUBLISHED, exponent=None)
    assert free.exponent == pytest.approx(2.63, abs=0.02)
    assert abs(free.exponent - 2.0) < 3 * free.u_exponent < abs(free.exponent + 2.0)


@given(exponent=st.floats(-4, 4), level=st.floats(1, 1e6))
def test_a_law_is_found_back(exponent: float, level: float) -> None:
    rows = [EccentricityRow(a, 100.0, 100.0 / (level * a**exponent)) for a in (1.0, 1.2, 1.7)]
    found = eccentricity_trend(rows, exponent=None)
    assert found.exponent == pytest.approx(exponent, abs=1e-6)
    assert found.coefficient == pytest.approx(level, rel=1e-6)


@pytest.mark.parametrize(
    ("rows", "exponent", "said"),
    [
        (PUBLISHED[:1], 2.0, "found 1 rows; expected 2"),
        (PUBLISHED[:2], None, "found 2 rows; expected 3"),
        ((*PUBLISHED, EccentricityRow(1.5, 100.0, 0.0)), 2.0, "row 4 is"),
        (PUBLISHED[:1] * 3, None, "the same eccentricity"),
    ],
)
def test_wrong_tables_are_said(rows: tuple[EccentricityRow, ...], exponent: float | None, said: str) -> None:
    with pytest.raises(AnalysisError, match=said):
        eccentricity_trend(rows, exponent)


def test_published_lock_positions() -> None:
    _, hysteresis, backlash = np.loadtxt(DATA / "lock_angle_tests.csv", delimiter=",", skiprows=1, unpack=True)
    study = lock_angle_study({"hysteresis_arcsec": hysteresis, "backlash_arcsec": backlash})
    assert study.positions == 14
    for name, mean, sd in (("hysteresis_arcsec", 5.14, 3.25), ("backlash_arcsec", 26.07, 7.13)):
        assert study.spreads[name].mean == pytest.approx(mean, abs=5e-3)
        assert study.spreads[name].sd == pytest.approx(sd, abs=5e-3)
    (pair,) = study.correlations
    assert pair.coefficient == pytest.approx(0.938, abs=5e-4)
    assert 0.8 < pair.low < pair.coefficient < pair.high < 0.99
    assert pair.p_none < 1e-5
    assert (study.spreads["backlash_arcsec"].least, study.spreads["backlash_arcsec"].most) == (16, 32)


def test_lock_positions_by_chance_and_constant() -> None:
    random = np.random.default_rng(1)
    covered = 0
    for _ in range(200):
        pair = lock_angle_study({"a": random.normal(size=14), "b": random.normal(size=14)}).correlations[0]
        covered += pair.low <= 0.0 <= pair.high
    assert covered / 200 > 0.9
    assert lock_angle_study({"a": [1, 1, 1, 1], "b": [1, 2, 3, 5]}).correlations == ()
    exact = lock_angle_study({"a": [1, 2, 3, 5], "b": [2, 4, 6, 10]}).correlations[0]
    assert (exact.low, exact.high) == (pytest.approx(1), pytest.approx(1))


def test_wrong_lock_positions_are_said() -> None:
    for metrics, said in (
        ({}, "no metric"),
        ({"a": [1, 2, 3]}, "found 3 values; expected 4"),
        ({"a": [1, 2, 3, 4], "b": [1, 2, 3, 4, 5]}, "a has 4, b has 5 positions"),
        ({"a": [1, 2, 3, float("nan")]}, "lock angle: a: value 4 is nan"),
    ):
        with pytest.raises(AnalysisError, match=said):
            lock_angle_study(metrics)


def test_slope_over_temperature() -> None:
    random = np.random.default_rng(2)
    covered = 0
    for _ in range(200):
        temperature = random.uniform(18, 35, 12)
        found = temperature_trend(temperature, 98.0 - 0.05 * (temperature - 20) + random.normal(0, 0.2, 12))
        covered += found.slope_low <= -0.05 <= found.slope_high
    assert 0.9 < covered / 200 < 0.99
    exact = temperature_trend([18, 22, 26, 30], [98.1, 97.9, 97.7, 97.5])
    assert exact.slope_per_c == pytest.approx(-0.05)
    assert exact.at_reference == pytest.approx(98.0)
    assert exact.corrected(97.5, 30.0) == pytest.approx(98.0)
    assert exact.p_none < 1e-10


def test_uncertainty_grows_away_from_the_runs() -> None:
    random = np.random.default_rng(3)
    temperature = np.linspace(24, 34, 10)
    values = 98.0 + random.normal(0, 0.2, 10)
    near, far = (temperature_trend(temperature, values, reference_c=there) for there in (29.0, 20.0))
    assert near.u_at_reference == pytest.approx(near.residual_sd / np.sqrt(10))
    assert far.u_at_reference > 2 * near.u_at_reference
    with pytest.raises(AnalysisError, match="measure runs near"):
        near.corrected(98.0, 50.0)


@pytest.mark.parametrize(
    ("temperature", "values", "said"),
    [
        ([20, 25, 30], [1, 2, 3], "found 3 values; expected 4"),
        ([20, 25, 30, 35], [1, 2, 3, 4, 5], "4 temperatures for 5 values"),
        ([20, 20.5, 21, 21.5], [1, 2, 3, 4], "expected 2 °C or more"),
    ],
)
def test_wrong_temperatures_are_said(temperature: list[float], values: list[float], said: str) -> None:
    with pytest.raises(AnalysisError, match=said):
        temperature_trend(temperature, values)
