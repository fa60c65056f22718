"""Quantities with units, as a person writes them: `412 N·m`, `0.05 rpm`, `110 %`, `20 bit`.

`KINDS` is the table of what can be asked for. A quantity becomes a plain float in the kind's base unit; SI except where
the field knows only its own unit (stiffness in N·m/arcmin, temperature in °C).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from pydantic import BeforeValidator, ValidationInfo

if TYPE_CHECKING:
    import pint


class Kind(NamedTuple):
    """Row of the table of quantities: what it is called, its base unit, how that unit is shown, and an example."""

    noun: str
    unit: str
    shown: str
    example: str


KINDS: dict[str, Kind] = {
    "torque": Kind("a torque", "newton * meter", "N·m", "412 N·m"),
    "torque_rate": Kind("a torque rate", "newton * meter / second", "N·m/s", "60 N·m/s"),
    "angle": Kind("an angle", "radian", "rad", "1 arcmin"),
    "speed": Kind("a speed of rotation", "radian / second", "rad/s", "0.5 rpm"),
    "acceleration": Kind("an angular acceleration", "radian / second ** 2", "rad/s²", "1 rad/s²"),
    "time": Kind("a time", "second", "s", "200 ms"),
    "temperature": Kind("a temperature", "degree_Celsius", "°C", "60 degC"),
    "stiffness": Kind("a torsional stiffness", "newton * meter / arcminute", "N·m/arcmin", "100 N·m/arcmin"),
    "torque_per_current": Kind("a torque per current", "newton * meter / ampere", "N·m/A", "100 N·m/A"),
    "current": Kind("a current", "ampere", "A", "10 A"),
    "fraction": Kind("a share", "dimensionless", "(1 = 100 %)", "0.1 %"),
    "bits": Kind("a resolution", "bit", "bit", "20 bit"),
    "angle_arcmin": Kind("an angle", "arcminute", "arcmin", "1 arcmin"),
    "energy_nm_arcmin": Kind("an energy", "newton * meter * arcminute", "N·m·arcmin", "500 N·m·arcmin"),
}

_NUMBER = re.compile(r"^\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*$")
_SPELLINGS = (("N·m", "newton*meter"), ("Nm", "newton*meter"), ("N*m", "newton*meter"), ("N m", "newton*meter"))
_SIGNS = (("·", "*"), ("²", "**2"), ("°C", "degC"), ("µ", "u"), ("′", "arcmin"), ("″", "arcsec"))
LONGEST = 60


class QuantityError(ValueError):
    """A text is not the quantity that is wanted; says what was found and what is allowed."""

    def __init__(self, found: str, allowed: str) -> None:
        self.found, self.allowed = found, allowed
        super().__init__(f"{found}; allowed: {allowed}")


@cache
def _registry() -> pint.UnitRegistry[float]:
    import pint  # noqa: PLC0415 - a fifth of a second that `--help` does not pay

    return pint.UnitRegistry(cache_folder=None)


def parse(
    value: object,
    kind_name: str,
    *,
    above: float = -math.inf,
    least: float = -math.inf,
    most: float = math.inf,
    rated_torque_nm: float | None = None,
) -> float:
    """The quantity as a float in the kind's base unit; raises `QuantityError`.

    `above`, `least` and `most` bound it in the base unit. A torque may be a percentage when `rated_torque_nm` is known.
    """
    kind = KINDS[kind_name]
    allowed = f"{kind.noun} such as '{kind.example}'{_range(kind, above, least, most)}"
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise QuantityError(f"found {_show(value)}", allowed)
    if not isinstance(value, str):
        if kind_name != "fraction":
            raise QuantityError(f"found the bare number {value!r}, without a unit", allowed)
        magnitude = float(value)
    else:
        magnitude = _convert(value, kind_name, allowed, rated_torque_nm)
    if not math.isfinite(magnitude):
        raise QuantityError(f"found {_show(value)}, which is not a finite number", allowed)
    if not (magnitude > above and magnitude >= least and magnitude <= most):
        raise QuantityError(f"found {_show(value)}, which is out of range", allowed)
    return magnitude


def _convert(text: str, kind_name: str, allowed: str, rated_torque_nm: float | None) -> float:
    kind = KINDS[kind_name]
    match = _NUMBER.match(text) if len(text) <= LONGEST else None
    if match is None:
        raise QuantityError(f"found {_show(text)}, which is not a number with a unit", allowed)
    number, unit = float(match[1]), match[2]
    if unit == "%":
        if kind_name == "torque":
            if rated_torque_nm is None:
                raise QuantityError(f"found {_show(text)}, but the rated torque is not known", allowed)
            return number / 100.0 * rated_torque_nm
        if kind_name == "fraction":
            return number / 100.0
    if not unit:
        if kind_name == "fraction":
            return number
        raise QuantityError(f"found {_show(text)}, a number without a unit", allowed)
    return _to_base(number, unit, text, kind, allowed)


def _to_base(number: float, unit: str, text: str, kind: Kind, allowed: str) -> float:
    import pint  # noqa: PLC0415 - see `_registry`

    spelled = unit
    for written, meant in _SPELLINGS + _SIGNS:
        spelled = spelled.replace(written, meant)
    registry = _registry()
    try:
        quantity = registry.Quantity(number, registry.parse_units(spelled))
    except (
        pint.PintError,
        ValueError,
        TypeError,
        AttributeError,
        KeyError,
        SyntaxError,
        ArithmeticError,
        AssertionError,
    ):
        raise QuantityError(f"found {_show(text)}, and '{unit}' is not a unit", allowed) from None
    try:
        return float(quantity.to(kind.unit).magnitude)
    except pint.DimensionalityError:
        what = _noun_of(quantity)
        raise QuantityError(f"found {_show(text)}, which is {what}", allowed) from None
    except (pint.PintError, ArithmeticError):
        raise QuantityError(f"found {_show(text)}, which cannot be converted", allowed) from None


def _noun_of(quantity: pint.Quantity[float]) -> str:
    for kind in KINDS.values():
        if quantity.check(_registry().Unit(kind.unit).dimensionality):
            return kind.noun
    return "another kind of quantity"


def _range(kind: Kind, above: float, least: float, most: float) -> str:
    lower = f" above {above:g}" if above > -math.inf else f" from {least:g}" if least > -math.inf else ""
    upper = f" up to {most:g}" if most < math.inf else ""
    return f",{lower}{upper} {kind.shown}" if lower or upper else ""


def _show(value: object) -> str:
    text = repr(value) if not isinstance(value, str) else f"'{value}'"
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."


def quantity(
    kind_name: str,
    *,
    above: float = -math.inf,
    least: float = -math.inf,
    most: float = math.inf,
) -> Callable[[Any, ValidationInfo], float]:
    """Validator of a schema field; the rated torque for percentages comes from the validation context."""

    def validate(value: Any, info: ValidationInfo) -> float:
        rated_torque_nm = (info.context or {}).get("rated_torque_nm")
        return parse(value, kind_name, above=above, least=least, most=most, rated_torque_nm=rated_torque_nm)

    return validate


Torque = Annotated[float, BeforeValidator(quantity("torque", least=0.0, most=1e5))]
PositiveTorque = Annotated[float, BeforeValidator(quantity("torque", above=0.0, most=1e5))]
SignedTorque = Annotated[float, BeforeValidator(quantity("torque", least=-1e5, most=1e5))]
TorqueRate = Annotated[float, BeforeValidator(quantity("torque_rate", above=0.0, most=1000.0))]
Angle = Annotated[float, BeforeValidator(quantity("angle", least=0.0, most=100.0))]
PositiveAngle = Annotated[float, BeforeValidator(quantity("angle", above=0.0, most=100.0))]
Speed = Annotated[float, BeforeValidator(quantity("speed", above=0.0, most=1000.0))]
Acceleration = Annotated[float, BeforeValidator(quantity("acceleration", above=0.0, most=1e5))]
Time = Annotated[float, BeforeValidator(quantity("time", least=0.0, most=1e5))]
PositiveTime = Annotated[float, BeforeValidator(quantity("time", above=0.0, most=1e5))]
Temperature = Annotated[float, BeforeValidator(quantity("temperature", least=-40.0, most=200.0))]
Stiffness = Annotated[float, BeforeValidator(quantity("stiffness", above=0.0, most=1e6))]
TorquePerCurrent = Annotated[float, BeforeValidator(quantity("torque_per_current", above=0.0, most=1e5))]
Current = Annotated[float, BeforeValidator(quantity("current", above=0.0, most=1000.0))]
Fraction = Annotated[float, BeforeValidator(quantity("fraction", least=0.0, most=1.0))]
PositiveFraction = Annotated[float, BeforeValidator(quantity("fraction", above=0.0, most=10.0))]
Bits = Annotated[float, BeforeValidator(quantity("bits", least=8.0, most=40.0))]
