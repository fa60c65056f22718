"""Stiffness of a fixture by its parts, and that of the unit without it, by the documents' formulas."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.loop.fixture_curve import (
    compensated_stiffness,
    fixture_stiffness,
    series_stiffness,
    stiffness_at_output,
)
from analysis.trace.errors import AnalysisError


@pytest.mark.parametrize(("fixture", "read"), [(5000.0, 112.58), (2000.0, 108.90), (500.0, 93.61)])
def test_compensation_of_the_fixture(fixture: float, read: float) -> None:
    """What unit P1 reads on a fixture, of which half the compliance is at the input with i = 121, and what it has."""
    at_input = 2 * fixture / 121**2
    assert stiffness_at_output(at_input, 121) == pytest.approx(2 * fixture)
    assert series_stiffness(2 * fixture, 2 * fixture) == pytest.approx(fixture)
    assert compensated_stiffness(read, 2 * fixture, at_input, 121) == pytest.approx(115.17, abs=8e-3)
    assert compensated_stiffness(read, fixture, 1e9, 121) == pytest.approx(115.17, abs=8e-3)


def test_a_side_that_does_not_give_way_is_infinitely_stiff() -> None:
    assert fixture_stiffness(2000.0, math.inf, 121) == 2000.0
    assert fixture_stiffness(math.inf, 1.0, 121) == pytest.approx(121**2)
    assert compensated_stiffness(95.0, math.inf, math.inf, 121) == pytest.approx(95.0)
    for wrong in (-1.0, 0.0, math.nan):
        with pytest.raises(AnalysisError, match=r"stiffness: found .*; expected a number above zero"):
            fixture_stiffness(2000.0, wrong, 121)


def test_compensation_by_the_printed_formula() -> None:
    measured, output_side, input_side = 66.589, 800.0, 0.5
    printed = 1 / (1 / measured - 1 / output_side - 1 / (input_side * 121**2))
    assert compensated_stiffness(measured, output_side, input_side, 121) == pytest.approx(printed)


def test_a_fixture_softer_than_what_was_measured_is_said() -> None:
    with pytest.raises(AnalysisError, match="the fixture alone has 90"):
        compensated_stiffness(95.0, 100.0, 1000.0 / 121**2, 121.0)


@given(st.floats(1e-6, 1e9), st.floats(0.1, 1e3))
def test_a_spring_at_either_shaft_stores_the_same_energy(stiffness: float, ratio: float) -> None:
    angle, torque = 0.01, stiffness * 0.01
    assert stiffness_at_output(stiffness, ratio) * angle / ratio == pytest.approx(torque * ratio)


def test_a_ratio_that_cannot_be_is_said() -> None:
    with pytest.raises(AnalysisError, match=r"ratio: found 0\.0"):
        stiffness_at_output(1.0, 0.0)
