"""Quantities: spellings, dimensions, refusals in words, and the law that value and unit round trip."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from definitions.units import (
    ACCELERATION,
    ANGLE,
    ARCMINUTES,
    DURATION,
    FRACTION,
    KINDS,
    RESOLUTION,
    SPEED,
    STIFFNESS,
    TEMPERATURE,
    TORQUE,
    TORQUE_RATE,
)
from recipes.text import quantity
from recipes.text.quantity import (
    FACTORS,
    KNOWN,
    LONGEST_TEXT,
    SHARES,
    QuantityError,
    convert,
    read_quantity,
    read_unit,
    show,
    unit_registry,
)

ARCMIN = math.pi / 10800

SPELLINGS = (
    ("412 N·m", TORQUE, 412.0),
    ("412 N*m", TORQUE, 412.0),
    ("412 Nm", TORQUE, 412.0),
    ("412N m", TORQUE, 412.0),
    ("412 N⋅m", TORQUE, 412.0),
    ("-25 N·m", TORQUE, -25.0),
    ("−25 N·m", TORQUE, -25.0),
    ("0.412 kNm", TORQUE, 412.0),
    ("5 mN·m", TORQUE, 0.005),
    ("60 N·m/s", TORQUE_RATE, 60.0),
    ("60 Nm / s", TORQUE_RATE, 60.0),
    ("0.05 rpm", SPEED, 0.05 * 2 * math.pi / 60),
    ("0.05 r/min", SPEED, 0.05 * 2 * math.pi / 60),
    ("0.8 deg/s", SPEED, math.radians(0.8)),
    ("2 rad/s²", ACCELERATION, 2.0),
    ("2 rad/s^2", ACCELERATION, 2.0),
    ("1 arcmin", ANGLE, ARCMIN),
    ("1′", ANGLE, ARCMIN),
    ("30 arcsec", ARCMINUTES, 0.5),
    ("30″", ARCMINUTES, 0.5),
    ("200 ms", DURATION, 0.2),
    ("200ms", DURATION, 0.2),
    ("250 µs", DURATION, 250e-6),
    ("60 degC", TEMPERATURE, 60.0),
    ("60 °C", TEMPERATURE, 60.0),
    ("-5 °C", TEMPERATURE, -5.0),
    ("300 K", TEMPERATURE, 26.85),
    ("27.6 N·m/arcmin", STIFFNESS, 27.6),
    ("95000 N·m/rad", STIFFNESS, 95000 * ARCMIN),
    ("0.1 %", FRACTION, 0.001),
    ("500 ppm", FRACTION, 0.0005),
    ("20 bit", RESOLUTION, 20.0),
    ("60 1/min", SPEED, 2 * math.pi),
    ("60 min⁻¹", SPEED, 2 * math.pi),
    ("60 min^-1", SPEED, 2 * math.pi),
    ("60 min-1", SPEED, 2 * math.pi),
    ("60 U/min", SPEED, 2 * math.pi),
    ("60 RPM", SPEED, 2 * math.pi),
    ("60 r.p.m.", SPEED, 2 * math.pi),
    ("1'", ANGLE, ARCMIN),
    ('60"', ANGLE, ARCMIN),
    ("60''", ANGLE, ARCMIN),
    ("1 Arcmin", ANGLE, ARCMIN),
    ("1 ARCMIN", ANGLE, ARCMIN),
    ("1 arc min", ANGLE, ARCMIN),
    ("60 arc-sec", ANGLE, ARCMIN),
    ("27.6 N·m/'", STIFFNESS, 27.6),
    ("27.6 Nm/arc min", STIFFNESS, 27.6),
    ("412 N•m", TORQUE, 412.0),
    ("412 N.m", TORQUE, 412.0),
    ("412 N-m", TORQUE, 412.0),
    ("41200 N·cm", TORQUE, 412.0),
    ("41200 N.cm", TORQUE, 412.0),
    ("41200 Ncm", TORQUE, 412.0),
    ("60 N.m/sec", TORQUE_RATE, 60.0),
    ("0.2 sec", DURATION, 0.2),
    ("200 msec", DURATION, 0.2),
    ("250 µsec", DURATION, 250e-6),
    ("60 deg C", TEMPERATURE, 60.0),
    ("60 DegC", TEMPERATURE, 60.0),
)


@pytest.mark.parametrize(("text", "kind", "value"), SPELLINGS)
def test_spellings(text, kind, value):
    assert read_quantity(text, kind) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("number", "unit", "to_unit", "printed"),
    [
        (95_000.0, "N·m/rad", "N·m/arcmin", 27.634),
        (1.0, "N·m/arcmin", "N·m/rad", 3437.747),
        (8.0 / 121.0, "arcmin", "arcsec", 3.967),
        (1e-4, "rev", "arcmin", 2.16),
    ],
)
def test_figures_that_the_documents_print(number, unit, to_unit, printed):
    assert convert(number, unit, to_unit) == pytest.approx(printed, abs=5e-4)


def test_percent_is_of_what_it_is_told():
    assert read_quantity("110 %", TORQUE, 412.0) == pytest.approx(453.2)
    assert read_quantity("412 N·m", TORQUE, 50.0) == 412.0


REFUSED = (
    (60, TORQUE_RATE, "60 without a unit", "60 N·m/s"),
    ("60", TORQUE, "60 without a unit", "Write the unit behind the number"),
    (True, TORQUE, "true", "a torque such as '412 N·m'"),
    (None, TORQUE, "nothing", "a torque"),
    (["1"], TORQUE, "a list", "a torque"),
    ("60 N·m", TORQUE_RATE, "'60 N·m', which is a torque", "Write it with a torque rate unit"),
    ("50 %", ANGLE, "which is a fraction", "an angle unit"),
    ("110 %", TORQUE, "which is a fraction", "a torque"),
    ("4 J", TORQUE, "which is an energy", "a torque"),
    ("1 Hz", SPEED, "which is a frequency", "'0.05 rpm'"),
    ("1 rad", SPEED, "which is an angle", "a speed"),
    ("5 m", ANGLE, "which is a length", "an angle"),
    ("5 N·m/s/s/s", TORQUE, "does not measure a torque", "a torque"),
    ("5 nm", TORQUE, "whose unit is not known", "Did you mean 'N·m'?"),
    ("5 rmp", SPEED, "whose unit is not known", "Did you mean 'rpm'?"),
    ("0.2 secs", DURATION, "whose unit is not known", "Write it in"),
    ("4१2 N·m", TORQUE, "digits other than 0 to 9", "the digits 0 to 9"),
    ("١٢ N·m", TORQUE, "digits other than 0 to 9", "the digits 0 to 9"),
    ("5 N·m/(s)", TORQUE_RATE, "whose unit is not known", "Did you mean 'N·m/s'?"),
    ("0,5 rpm", SPEED, "not a number with a unit", "decimal sign as a point"),
    ("1.500,5 Nm", TORQUE, "not a number with a unit", "nothing between thousands"),
    ("1'500.5 Nm", TORQUE, "not a number with a unit", "nothing between thousands"),
    ("1,500.5 Nm", TORQUE, "not a number with a unit", "nothing between thousands"),
    ("1 500,5 Nm", TORQUE, "not a number with a unit", "nothing between thousands"),
    ("fast", SPEED, "not a number with a unit", "a number, a space and a unit"),
    ("nan N·m", TORQUE, "not a number with a unit", "a torque"),
    ("1e999 N·m", TORQUE, "too large for a number", "Check the exponent"),
    ("9" * (LONGEST_TEXT + 1) + " N·m", TORQUE, "...", "a torque"),
)


@pytest.mark.parametrize(("text", "kind", "found", "then"), REFUSED)
def test_refused_with_found_allowed_and_what_to_do(text, kind, found, then):
    with pytest.raises(QuantityError) as caught:
        read_quantity(text, kind)
    assert found in caught.value.found
    assert then in f"{caught.value.allowed}. {caught.value.hint}"


@given(kind=st.sampled_from(KINDS), value=st.floats(-1e6, 1e6).filter(lambda value: abs(value) > 1e-6))
def test_value_and_unit_round_trip(kind, value):
    shown = show(convert(value, kind.shown, kind.unit), kind, digits=17)
    assert read_quantity(shown, kind) == pytest.approx(convert(value, kind.shown, kind.unit), rel=1e-9, abs=1e-9)


@given(value=st.floats(1e-3, 1e3), kind=st.sampled_from([TORQUE, TORQUE_RATE, STIFFNESS]))
def test_a_prefix_is_a_factor(value, kind):
    plain = read_quantity(f"{value!r} {kind.shown}", kind)
    assert read_quantity(f"{value!r} k{kind.shown}", kind) == pytest.approx(1000 * plain, rel=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_the_example_of_a_kind_is_one(kind):
    assert math.isfinite(read_quantity(kind.example, kind))
    assert kind.name.startswith(("a ", "an "))


@given(st.text(max_size=40), st.sampled_from(KINDS))
def test_any_text_is_a_finite_number_or_refused(text, kind):
    try:
        assert math.isfinite(read_quantity(text, kind, 412.0))
    except QuantityError as error:
        spoken = error.allowed
    else:
        spoken = "a number"
    assert spoken


@given(st.from_regex(r"[0-9]{1,3} [a-zA-Z·*/^0-9%°µ² ]{1,12}", fullmatch=True), st.sampled_from(KINDS))
def test_any_unit_is_converted_or_refused(text, kind):
    try:
        assert math.isfinite(read_quantity(text, kind, 412.0))
    except QuantityError as error:
        spoken = error.allowed
    else:
        spoken = "a number"
    assert spoken


def test_the_units_are_defined_once_each_and_the_library_has_nothing_to_say(caplog):
    """Found in a plant's own tests: pytest showed its warnings with every failure."""
    unit_registry.__wrapped__()
    assert caplog.records == []


@pytest.mark.parametrize(("unit", "to_unit", "factor"), [*((*pair, by) for pair, by in FACTORS.items()),
                                                         *((unit, unit, 1.0) for unit in sorted(KNOWN))])  # fmt: skip
def test_what_is_known_of_usual_units_is_what_the_library_says(unit: str, to_unit: str, factor: float) -> None:
    for number in (1.0, -0.0, 1 / 3, 412.0, 1e300):
        said = unit_registry().Quantity(number, read_unit(unit)).to(read_unit(to_unit)).magnitude
        assert float(said).hex() == (number * factor).hex() == convert(number, unit, to_unit).hex()
    assert (unit in SHARES) == (to_unit in SHARES) == (not read_unit(unit).dimensionality)


def test_for_usual_units_the_library_is_not_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    expected = [read_quantity(kind.example, kind) for kind in KINDS]
    monkeypatch.setattr(quantity, "unit_registry", None)
    monkeypatch.setattr(quantity, "read_unit", None)
    assert [read_quantity(kind.example, kind) for kind in KINDS] == expected
    assert [show(1.0, kind) for kind in KINDS]
    assert read_quantity("50 %", TORQUE, 412.0) == 206.0
