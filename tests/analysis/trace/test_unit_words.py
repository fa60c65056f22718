"""Units as people write them: each is known as that of its column, as another, or as none."""

from __future__ import annotations

import pytest

from analysis.trace.trace_files import COLUMNS
from analysis.trace.unit_words import QUANTITIES, Kind, contradicts, kind_of, same_unit

OWN = {
    "t_s": ("s", "S", "sec", "sec.", "Seconds", "Sekunden", "t/s", "t / s", "<s>", "in s", "Time [s]", "unit: s"),
    "torque_out_nm": (
        "Nm",
        "N·m",
        "N m",
        "N*m",
        "N-m",
        "Newtonmeter",
        "newton metres",
        "M/Nm",
        "{Nm}",
        "M in/out (N·m)",
    ),
    "windup_arcmin": ("arcmin", "arc min", "'", "′", "Bogenminuten", "phi/arcmin", "Angle (in arcmin)", "Winkel in '"),
    "angle_in_rad": ("rad", "[rad]", "Radians", "φ/rad", "a/rad", "W / rad"),
    "temperature_c": ("°C", "℃", "ºC", "C", "deg C", "Grad Celsius", "T/°C"),
}
OTHERS = {
    "t_s": ("ms", "msec", "Millisekunden", "µs", "μs", "t/ms", "<ms>", "in ms", "min", "h", "10 s", "1e-3 s", "10⁻³ s"),
    "torque_out_nm": ("kNm", "mN·m", "MNm", "N·cm", "lbf·ft", "ft-lb", "in lb", "M/kNm", "V", "%", "10 Nm"),
    "windup_arcmin": ("deg", "Grad", "°", "º", "rad", "arcsec", "″", "phi/deg", "1/60 deg", "x10 arcmin"),
    "angle_in_rad": ("arcmin", "deg", "gon", "mrad", "counts"),
    "temperature_c": ("K", "°F", "T/K"),
}
NONE = ("", "-", "–", "[-]", "n/a", "Unit", "Units:", "Einheit", "Maßeinheit", "Y_Unit_Label", "Torque unit")
WORDS = ("Nm/rad", "Nm/arcmin", "12", "0,5", "2026-01-15", "08:00", "community", "Operator", "s Nm", "s" * 100)


def cells(table: dict[str, tuple[str, ...]]) -> list[tuple[str, str]]:
    return [(column, cell) for column, row in table.items() for cell in row]


def test_each_column_that_has_a_unit_has_words_for_it() -> None:
    assert set(QUANTITIES) == set(COLUMNS)
    for quantity in QUANTITIES.values():
        assert not quantity.own & quantity.others


@pytest.mark.parametrize(("column", "cell"), cells(OWN))
def test_the_unit_of_a_column_is_known(column: str, cell: str) -> None:
    assert kind_of(cell, column) in (Kind.SURE, Kind.FITS)
    assert not contradicts(cell, column)
    assert same_unit(cell, QUANTITIES[column].shown, column)


@pytest.mark.parametrize(("column", "cell"), cells(OTHERS))
def test_another_unit_of_the_quantity_is_known_and_contradicts(column: str, cell: str) -> None:
    assert kind_of(cell, column) in (Kind.SURE, Kind.FITS)
    assert contradicts(cell, column)
    assert not same_unit(cell, QUANTITIES[column].shown, column)
    assert same_unit(cell, cell, column)


@pytest.mark.parametrize("cell", NONE)
@pytest.mark.parametrize("column", QUANTITIES)
def test_what_says_no_unit_contradicts_none(column: str, cell: str) -> None:
    assert kind_of(cell, column) in (Kind.EMPTY, Kind.LABEL)
    assert not contradicts(cell, column)
    assert same_unit(cell, "deg", column)


@pytest.mark.parametrize("cell", WORDS)
@pytest.mark.parametrize("column", QUANTITIES)
def test_other_text_is_no_unit(column: str, cell: str) -> None:
    assert kind_of(cell, column) is Kind.WORD
    assert contradicts(cell, column)


def test_a_column_of_another_name_takes_any_unit() -> None:
    assert kind_of("rpm", "speed") is Kind.UNIT
    assert kind_of("[foo]", "speed") is Kind.BRACKETS
    assert kind_of("speed", "speed") is Kind.WORD
    assert not contradicts("foo", "speed")
