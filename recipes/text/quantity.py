"""Quantities: the units that documents may use, and how a text such as `412 N·m` becomes a number.

The registry holds the units of a reducer test bench and no others, so that a joule or a hertz is refused where a torque
or a speed is meant. Angle is a dimension of its own here: 60 rpm is a speed, 1 Hz is not, and 50 % is not an angle.
A kind of quantity is one row of `KINDS`; its unit is the one that attributes carry in their names.
"""

from __future__ import annotations

import math
import re
from functools import cache
from typing import TYPE_CHECKING

from definitions.units import KINDS, Kind
from recipes.text.problems import did_you_mean, excerpt, one_of

if TYPE_CHECKING:
    import pint

UNIT_DEFINITIONS = """
micro- = 1e-6 = u-
milli- = 1e-3 = m-
centi- = 1e-2 = c-
kilo- = 1e3 = k-
mega- = 1e6 = M-
second = [time] = s
radian = [angle] = rad
newton = [force] = N
metre = [length] = m = meter
ampere = [current] = A
kelvin = [temperature]; offset: 0 = K
bit = [information]
one = []
minute = 60 * second = min
hour = 60 * minute = h
degree = 0.017453292519943295 * radian = deg
arcminute = degree / 60 = arcmin
arcsecond = degree / 3600 = arcsec
revolution = 360 * degree = rev = r
revolutions_per_minute = revolution / minute = rpm
degree_celsius = kelvin; offset: 273.15 = degC
hertz = 1 / second = Hz
joule = [energy] = J
percent = 0.01 * one
parts_per_million = 1e-6 * one = ppm
"""

WORDS = (
    (r"U/min|1/min|min\^?-1|min⁻¹|r\.?p\.?m\.?", "rpm"),
    (r"arc[ -]?min", "arcmin"),
    (r"arc[ -]?sec", "arcsec"),
    (r"deg[ .]?c", "degC"),
    (r"msec", "ms"),
    (r"[uµμ]sec", "us"),
    (r"sec", "s"),
    (r"N[.-]m", "N*m"),
    (r"N[.-]cm", "N*cm"),
)
"""Words that people write in several ways, whatever their case, and what the registry reads instead.

A speed in 1/min is what drives have on their name plates; a frequency in 1/s is none.
"""

SPELLINGS = (
    ("•", "*"),
    ("·", "*"),
    ("⋅", "*"),
    ("∙", "*"),
    ("×", "*"),
    ("²", "^2"),
    ("**", "^"),
    ("°C", "degC"),
    ("℃", "degC"),
    ("°", "deg"),
    ("′", "arcmin"),
    ("″", "arcsec"),
    ("''", "arcsec"),
    ("’", "arcmin"),
    ("'", "arcmin"),
    ('"', "arcsec"),
    ("”", "arcsec"),
    ("µ", "u"),
    ("μ", "u"),
    ("%", "percent"),
)
"""Signs that people write, and what the registry reads instead; applied from top to bottom."""

NEWTON_METRE = re.compile(r"(?<![A-Za-z])([umkM]?N)(c?m)(?![A-Za-z])")
NUMBER_AND_UNIT = re.compile(
    r"\s*(?P<number>[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)\s*(?P<unit>.*?)\s*", re.DOTALL
)
WITH_THOUSANDS = re.compile(
    r"\s*[+-]?\d{1,3}(?:(?P<sign>[.,])\d{3}(?:(?P=sign)\d{3}|(?!(?P=sign))[.,]\d)|['\u00a0\u202f ]\d{3})"
)
"""A number with signs between its thousands: two of one kind, one before a decimal sign of another, or a blank."""

DECIMAL_COMMA = re.compile(r"\s*[+-]?\d+,\d+")
WITH_SIGNS = re.compile(r"\s*[+-]?\d[\d.,]*")
"""A number with all points and commas in it, without its unit."""

EITHER_COMMA = re.compile(r"\s*[+-]?[1-9]\d{0,2},\d{3}(?!\d)")
"""A comma that may be a decimal one or stand between thousands."""

POINT = "Write the decimal sign as a point."
ONE_POINT = "Write the decimal sign as a point, and nothing between thousands."
UNIT_GRAMMAR = re.compile(r"[A-Za-z]+(\^[1-4])?([*/][A-Za-z]+(\^[1-4])?){0,5}")
LONGEST_TEXT = 80
"""Characters of the longest text that is read as a quantity."""


SHARES = frozenset({"one", "percent"})
KNOWN = SHARES.union(kind.unit for kind in KINDS)
FACTORS: dict[tuple[str, str], float] = {
    ("arcmin", "rad"): 0.0002908882086657216,
    ("rad", "arcmin"): 3437.746770784939,
    ("arcsec", "rad"): 4.84813681109536e-06,
    ("deg", "rad"): 0.017453292519943295,
    ("rad", "deg"): 57.29577951308232,
    ("rpm", "rad/s"): 0.10471975511965977,
    ("rad/s", "rpm"): 9.549296585513721,
    ("us", "s"): 1e-06,
    ("ms", "s"): 0.001,
    ("s", "ms"): 1000.0,
    ("percent", "one"): 0.01,
    ("one", "percent"): 100.0,
}
"""What usual units of documents and messages are in others, as the registry has it: that takes 0.2 s to load."""

OTHER_DIMENSIONS = (
    ("a length", "m"),
    ("a force", "N"),
    ("an energy", "J"),
    ("a stiffness per angle squared", "N*m/rad^2"),
)
"""Names for what is recognised and never allowed."""


class QuantityError(Exception):
    """A text is not the quantity that is meant; says what was found, what is allowed and what to do."""

    def __init__(self, found: str, allowed: str, hint: str) -> None:
        super().__init__(f"found {found}; allowed: {allowed}. {hint}")
        self.found = found
        self.allowed = allowed
        self.hint = hint


@cache
def unit_registry() -> pint.UnitRegistry[float]:
    """Build the registry on first use: importing pint takes 0.2 s, which documents with usual units need not pay."""
    import pint  # noqa: PLC0415

    registry: pint.UnitRegistry[float] = pint.UnitRegistry(None)
    registry.load_definitions(UNIT_DEFINITIONS.strip().splitlines())
    return registry


@cache
def read_unit(text: str) -> pint.Unit:
    """Return the unit that a text names, in any of the usual spellings.

    Raises ValueError when it is no unit of this registry.
    """
    import pint  # noqa: PLC0415

    plain = plain_unit(text)
    if not UNIT_GRAMMAR.fullmatch(plain):
        raise ValueError(text)
    try:
        return unit_registry().parse_units(plain)
    except (pint.PintError, AttributeError) as error:  # UndefinedUnitError is an AttributeError too
        raise ValueError(text) from error


@cache
def plain_unit(text: str) -> str:
    """Return a unit in the registry's spelling: `*` for products, `^` for powers, `N*m` for a newton metre."""
    for written, read in WORDS:
        text = re.sub(rf"(?<![A-Za-z])(?:{written})(?![A-Za-z])", read, text, flags=re.IGNORECASE)
    for written, read in SPELLINGS:
        text = text.replace(written, read)
    text = re.sub(r"\s*([*/^])\s*", r"\1", text.strip())
    return NEWTON_METRE.sub(r"\1*\2", re.sub(r"\s+", "*", text))


def dimension_name(unit: pint.Unit) -> str:
    """Return what a unit measures, in words, or an empty text when it measures nothing known here."""
    registry = unit_registry()
    named = [(kind.name, kind.unit) for kind in KINDS] + list(OTHER_DIMENSIONS)
    for name, known in named:
        if registry.parse_units(known).dimensionality == unit.dimensionality:
            return name
    return ""


def known_factor(unit: str, to_unit: str) -> float | None:
    """Return the factor between two units in the registry's spelling; None where the registry must be asked."""
    return 1.0 if unit == to_unit and unit in KNOWN else FACTORS.get((unit, to_unit))


def convert(number: float, unit: str, to_unit: str) -> float:
    """Convert a number between two units of the same dimension; offset units such as degC included."""
    factor = known_factor(plain_unit(unit), plain_unit(to_unit))
    if factor is not None:
        return number * factor
    registry = unit_registry()
    return float(registry.Quantity(number, read_unit(unit)).to(read_unit(to_unit)).magnitude)


def show(value: float, kind: Kind, digits: int = 6) -> str:
    """Return a loaded number for people, in the unit they use: `show(0.0523599, SPEED)` is `0.5 rpm`."""
    return f"{convert(value, kind.unit, kind.shown):.{digits}g} {kind.shown}"


def meant_by(text: str) -> tuple[tuple[str, ...], str]:
    """Return what a number with a comma, or with signs between thousands, may be meant as, and how to write it.

    Three digits behind its only comma may be decimals or thousands: both are told. Nothing and '' of another text.
    """
    if WITH_THOUSANDS.match(text):
        number = WITH_SIGNS.match(text)
        written = "" if number is None else number[0]
        *before, last = re.findall("[.,]", written) or [""]
        if not last:  # a blank or an apostrophe
            return (), ONE_POINT
        whole, _, decimals = written.rpartition(last)
        plain = whole.replace(",", "").replace(".", "") + ("" if last in before else ".") + decimals
        return (plain + text[len(written) :],), ONE_POINT
    if not DECIMAL_COMMA.match(text):
        return (), ""
    decimal = text.replace(",", ".", 1)
    return ((decimal, text.replace(",", "", 1)), ONE_POINT) if EITHER_COMMA.match(text) else ((decimal,), POINT)


def _how_to_write(text: str) -> str:
    meant, hint = meant_by(text)
    if len(meant) > 1:
        hint = f"{hint} Is it {one_of([excerpt(one) for one in meant])}?"
    return hint or "Write a number, a space and a unit."


def read_quantity(text: object, kind: Kind, percent_of: float | None = None, allowed: str = "") -> float:
    """Return the number of a quantity in the unit of its kind.

    `percent_of` is the number that 100 % stands for, None where percentages make no sense; `allowed` replaces the
    description of what is allowed. Raises QuantityError.
    """
    allowed = allowed or f"{kind.name} such as '{kind.example}'"
    if not isinstance(text, str):
        raise QuantityError(*_not_a_text(text, kind, allowed))
    match = NUMBER_AND_UNIT.fullmatch(text.replace("−", "-")) if len(text) <= LONGEST_TEXT else None
    if any(sign.isdecimal() and not sign.isascii() for sign in text):
        raise QuantityError(f"{excerpt(text)}, which has digits other than 0 to 9", allowed, "Write the digits 0 to 9.")
    if match is None or WITH_THOUSANDS.match(text) or DECIMAL_COMMA.match(text):
        raise QuantityError(f"{excerpt(text)}, which is not a number with a unit", allowed, _how_to_write(text))
    number = float(match["number"])
    if not match["unit"]:
        raise QuantityError(*_not_a_text(match["number"], kind, allowed))
    plain = plain_unit(match["unit"])
    relative = percent_of is not None and plain in SHARES
    factor = known_factor(plain, "one" if relative else kind.unit)
    if factor is None:
        value, relative = _by_registry(text, number, match["unit"], kind, allowed, may_be_share=percent_of is not None)
    else:
        value = number * factor
    if relative and percent_of is not None:
        value *= percent_of
    if not math.isfinite(value):
        raise QuantityError(f"{excerpt(text)}, which is too large for a number", allowed, "Check the exponent.")
    return value


def _by_registry(
    text: str, number: float, written: str, kind: Kind, allowed: str, *, may_be_share: bool
) -> tuple[float, bool]:
    """Return a number in the unit of its kind, and whether it is a share instead, whatever unit is written."""
    try:
        unit = read_unit(written)
    except ValueError:
        meant_kind = unit_registry().parse_units(kind.unit).dimensionality
        alike = [one for one in KINDS if unit_registry().parse_units(one.unit).dimensionality == meant_kind]
        spellings = {plain_unit(known.shown): known.shown for known in alike}
        meant = did_you_mean(plain_unit(written), spellings)
        for plain, shown in spellings.items():
            meant = meant.replace(f"'{plain}'", f"'{shown}'")
        hint = meant or f"Write it in {kind.shown}."
        raise QuantityError(f"{excerpt(text)}, whose unit is not known", allowed, hint) from None
    registry = unit_registry()
    relative = may_be_share and not unit.dimensionality
    wanted = registry.parse_units("one" if relative else kind.unit)
    if unit.dimensionality != wanted.dimensionality:
        name = dimension_name(unit)
        which = f", which is {name}" if name else f", whose unit does not measure {kind.name}"
        hint = f"Write it with a {kind.plain_name} unit."
        raise QuantityError(f"{excerpt(text)}{which}", allowed, hint.replace("a angle", "an angle"))
    return float(registry.Quantity(number, unit).to(wanted).magnitude), relative


def _not_a_text(value: object, kind: Kind, allowed: str) -> tuple[str, str, str]:
    """Return found, allowed and hint for a value without a unit."""
    if isinstance(value, bool) or value is None or isinstance(value, (list, dict)):
        return excerpt(value), allowed, f"Write a number and its unit, {kind.shown}."
    number = value if isinstance(value, str) else excerpt(value)
    return f"{number} without a unit", allowed, f"Write the unit behind the number: '{number} {kind.shown}'."
