"""Quantities: spellings, dimensions, ranges, and the law that value times unit is kept."""

from __future__ import annotations

import contextlib
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis import METRIC_UNITS
from recipes.metric_units import METRIC_KINDS
from recipes.quantity import KINDS, QuantityError, parse

SPELLINGS: tuple[tuple[str, str, float], ...] = (
    ("412 N·m", "torque", 412.0),
    ("412 Nm", "torque", 412.0),
    ("412N*m", "torque", 412.0),
    ("0.412 kN·m", "torque", 412.0),
    ("0.05 rpm", "speed", 0.05 * 2 * math.pi / 60),
    ("0.8 deg/s", "speed", math.radians(0.8)),
    ("1 arcmin", "angle", math.pi / 10800),
    ("1′", "angle", math.pi / 10800),
    ("30 arcsec", "angle", 30 * math.pi / 648000),
    ("30 arcsec", "angle_arcmin", 0.5),
    ("200 ms", "time", 0.2),
    ("60 degC", "temperature", 60.0),
    ("60 °C", "temperature", 60.0),
    ("20 bit", "bits", 20.0),
    ("0.1 %", "fraction", 0.001),
    ("95000 N·m/rad", "stiffness", 95000 * math.pi / 10800),
    ("60 N·m/s", "torque_rate", 60.0),
    ("1e-1 N·m", "torque", 0.1),
)


@pytest.mark.parametrize(("text", "kind", "value"), SPELLINGS)
def test_spellings(text, kind, value):
    assert parse(text, kind) == pytest.approx(value, rel=1e-12)


def test_percent_of_rated_torque():
    assert parse("110 %", "torque", rated_torque_nm=412.0) == pytest.approx(453.2)
    with pytest.raises(QuantityError, match="rated torque is not known"):
        parse("110 %", "torque")


@pytest.mark.parametrize(
    "value", ["", "N·m", "1 2 N·m", "1 N·m N", "nan N·m", "1e999 N·m", None, True, [], {}, "5 __import__('os')"]
)
def test_nonsense_is_refused_with_an_example(value):
    with pytest.raises(QuantityError, match="allowed: a torque such as '412 N·m'"):
        parse(value, "torque")


@given(st.floats(1e-3, 1e6))
def test_value_times_unit_is_kept(value):
    assert parse(f"{value!r} mN·m", "torque") == pytest.approx(value * 1e-3, rel=1e-9)


@given(st.text(max_size=30), st.sampled_from(sorted(KINDS)))
def test_any_text_is_a_quantity_or_refused(text, kind):
    with contextlib.suppress(QuantityError):
        assert math.isfinite(parse(text, kind))


@pytest.mark.parametrize("name", sorted(KINDS))
def test_every_kind_accepts_its_own_example(name):
    kind = KINDS[name]
    assert math.isfinite(parse(kind.example, name))
    assert kind.noun.startswith(("a ", "an "))


def test_limits_of_metrics_have_a_kind():
    assert {kind.quantity for kind in METRIC_KINDS.values()} <= set(KINDS)


def test_metric_table_is_the_analysis_table():
    assert {name: kind.unit for name, kind in METRIC_KINDS.items()} == dict(METRIC_UNITS)
