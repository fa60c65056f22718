"""Base of all sections of recipe and bench files, and the types of their options.

An option is written without a unit in its name and its value has one (`torque_rate: 60 N·m/s`); the loaded attribute is
a plain number with the unit in its name (`torque_rate_nm_s`). Python code may build sections directly, by attribute
names and with numbers.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, is_dataclass
from typing import Annotated, Any, TypeVar

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    StringConstraints,
    TypeAdapter,
    ValidationInfo,
    with_config,
)
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from definitions.units import (
    ACCELERATION,
    ANGLE,
    ARCMINUTES,
    CURRENT,
    DRIFT,
    DURATION,
    FRACTION,
    FREQUENCY,
    PERIOD,
    RESOLUTION,
    SPEED,
    STIFFNESS,
    TEMPERATURE,
    TEMPERATURE_CHANGE,
    TORQUE,
    TORQUE_CONSTANT,
    TORQUE_RATE,
    TRAVEL,
    Kind,
)
from recipes.text.problems import excerpt
from recipes.text.quantity import QuantityError, convert, read_quantity, show

UNIT_SUFFIX = re.compile(
    r"_(nm_per_arcmin|nm_per_a|per_s|nm_s|nm|arcmin_min|arcmin|rad_s2|rad_s|rad|ns|hz|s|a|c|k|fraction|bits)$",
)
"""Units at the end of attribute names."""

T = TypeVar("T")

EXACT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
"""How dataclasses are read: nothing is converted, and nothing taken that they do not know."""

FROM_DOCUMENT = "from_document"
"""Key of the validation context that the loader sets: quantities are texts with units, not numbers."""


def option_name(attribute: str) -> str:
    """Return the name of an option in a document: the attribute's name without its unit."""
    return UNIT_SUFFIX.sub("", attribute)


class Section(BaseModel):
    """A frozen section of a document that knows its options and refuses others."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", alias_generator=option_name, populate_by_name=True, allow_inf_nan=False
    )


def strict(model: type[T]) -> type[T]:
    """Return a class that documents are read into: a section as it is, a dataclass made as strict as those are."""
    return with_config(EXACT)(model) if is_dataclass(model) else model


_READERS: dict[Any, TypeAdapter[Any]] = {}


def reader(model: type[T]) -> TypeAdapter[T]:
    """Return what makes an object of this class from a document; made once, for it takes longer than to read one."""
    made = _READERS.get(model)
    if made is None:
        made = _READERS[model] = TypeAdapter(strict(model))
    return made


def refusal(found: str, allowed: str, hint: str = "", at: str = "") -> PydanticCustomError:
    """Return the error to raise in a validator; `at` is the option inside the section that the message points to."""
    context = {"found": found, "allowed": allowed, "hint": hint, "at": at}
    return PydanticCustomError("refused", "found {found}; allowed: {allowed}. {hint}", context)


@dataclass(frozen=True, slots=True)
class Quantity:
    """Annotation of a number that documents write as a quantity, with its range in the unit that people see."""

    kind: Kind
    above: float | None = None
    at_least: float | None = None
    up_to: float | None = None
    percent_of: str = ""
    """Key of the validation context with the number that 100 % stands for; empty where percentages make no sense."""
    scale: float = 1.0
    """Loaded number per unit of the kind."""
    whole: bool = False
    """The loaded number is a whole one."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.with_info_before_validator_function(self._loaded, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Return what a document has here: a text with a unit, not the number that is loaded."""
        del schema, handler
        return {"type": "string", "description": self.allowed()}

    def _loaded(self, value: Any, info: ValidationInfo) -> Any:
        context: Mapping[str, Any] = info.context or {}
        if not context.get(FROM_DOCUMENT) and not isinstance(value, str):
            return value
        whole_torque = context.get(self.percent_of)
        unknown = bool(self.percent_of) and whole_torque is None
        try:
            number = read_quantity(value, self.kind, 1.0 if unknown else whole_torque, self.allowed())
        except QuantityError as error:
            raise refusal(error.found, error.allowed, error.hint) from None
        if not unknown:  # what 100 % stands for is wrong itself, and reported where it stands
            self._check_range(number, value)
        loaded = number * self.scale
        if self.whole and abs(loaded - round(loaded)) > 1e-6 * abs(loaded):
            raise refusal(excerpt(value), self.allowed(), "Write a whole number of this unit.")
        return round(loaded) if self.whole else loaded

    def _check_range(self, number: float, text: str) -> None:
        shown = convert(number, self.kind.unit, self.kind.shown)
        tolerance = 1e-9 * abs(shown)  # conversions round
        low = (self.above is not None and shown <= self.above) or (
            self.at_least is not None and shown < self.at_least - tolerance
        )
        high = self.up_to is not None and shown > self.up_to + tolerance
        if low or high:
            relative = f", which is {show(number, self.kind)}" if "%" in text and self.percent_of else ""
            hint = "This is too small." if low else "This is too large."
            raise refusal(excerpt(text) + relative, self.allowed(), hint)

    def allowed(self) -> str:
        """Return what is allowed, as messages say it."""
        limits = []
        if self.above is not None:
            limits.append(f"above {self.above:g}")
        if self.at_least is not None:
            limits.append(f"from {self.at_least:g}")
        if self.up_to is not None:
            limits.append(f"up to {self.up_to:g}")
        text = f"{self.kind.name} such as '{self.kind.example}'"
        if self.percent_of == RATED:
            text += " (or '110 %' of the rated torque)"
        elif self.percent_of == REFERENCE:
            text += " (or '50 %' of the reference torque)"
        if limits:
            joined = (
                limits[0] if len(limits) == 1 else f"{limits[0]} {'and ' if self.above is not None else ''}{limits[1]}"
            )
            text += f", {joined} {self.kind.shown}"
        return text


RATED = "rated_torque_nm"
REFERENCE = "reference_torque_nm"

Torque = Annotated[float, Quantity(TORQUE, above=0, up_to=20000)]
SignedTorque = Annotated[float, Quantity(TORQUE, at_least=-20000, up_to=20000)]
TorqueSpread = Annotated[float, Quantity(TORQUE, at_least=0, up_to=20000)]
"""A standard deviation or a standard uncertainty of a torque."""
TorqueOfRated = Annotated[float, Quantity(TORQUE, above=0, up_to=20000, percent_of=RATED)]
TorqueOfReference = Annotated[float, Quantity(TORQUE, above=0, up_to=20000, percent_of=REFERENCE)]
TorqueRate = Annotated[float, Quantity(TORQUE_RATE, above=0, up_to=1000)]
TorqueSlope = Annotated[float, Quantity(TORQUE_RATE, above=0, up_to=100000)]
Stiffness = Annotated[float, Quantity(STIFFNESS, above=0, up_to=1e6)]
StiffnessAtInput = Annotated[float, Quantity(STIFFNESS, above=0, up_to=1000)]
"""No input shaft is stiffer: one of 50 mm and a tenth of a metre has 140. More is a stiffness at the output."""
TorqueConstant = Annotated[float, Quantity(TORQUE_CONSTANT, above=0, up_to=10000)]
SmallAngle = Annotated[float, Quantity(ANGLE, above=0, up_to=600)]
AngleError = Annotated[float, Quantity(ANGLE, above=0, up_to=60)]
"""Limit of an error: no encoder is without any."""
AngleNoise = Annotated[float, Quantity(ANGLE, at_least=0, up_to=60)]
Travel = Annotated[float, Quantity(TRAVEL, above=0, up_to=36000)]
Speed = Annotated[float, Quantity(SPEED, above=0, up_to=6000)]
Acceleration = Annotated[float, Quantity(ACCELERATION, above=0, up_to=1000)]
Frequency = Annotated[float, Quantity(FREQUENCY, above=0, up_to=100)]
SweepPeriod = Annotated[float, Quantity(DURATION, above=0, up_to=600)]
Dwell = Annotated[float, Quantity(DURATION, at_least=0, up_to=600)]
TareTime = Annotated[float, Quantity(DURATION, at_least=0.01, up_to=60)]
TimeLimit = Annotated[float, Quantity(DURATION, above=0, up_to=3600)]
Interval = Annotated[float, Quantity(DURATION, above=0, up_to=366 * 86400.0)]
Age = Annotated[float, Quantity(PERIOD, above=0, up_to=10000)]
Lag = Annotated[float, Quantity(PERIOD, at_least=0, up_to=1000)]
PeriodNs = Annotated[int, Quantity(PERIOD, at_least=0.5, up_to=20, scale=1e9, whole=True)]
BitCount = Annotated[int, Quantity(RESOLUTION, at_least=8, up_to=40, whole=True)]
Current = Annotated[float, Quantity(CURRENT, above=0, up_to=100)]
Temperature = Annotated[float, Quantity(TEMPERATURE, at_least=-40, up_to=150)]
TemperatureChange = Annotated[float, Quantity(TEMPERATURE_CHANGE, above=0, up_to=100)]
Deflection = Annotated[float, Quantity(ARCMINUTES, at_least=-600, up_to=600)]
Fraction = Annotated[float, Quantity(FRACTION, at_least=0, up_to=100)]
SensorError = Annotated[float, Quantity(FRACTION, above=0, up_to=10)]
"""Limit of an error: no sensor is without any, and one that may be wrong by more than a tenth measures nothing."""
SensorNoise = Annotated[float, Quantity(FRACTION, at_least=0, up_to=10)]
FixtureError = Annotated[float, Quantity(FRACTION, above=0, up_to=50)]
Efficiency = Annotated[float, Quantity(FRACTION, above=0, up_to=150)]
UsableRange = Annotated[float, Quantity(FRACTION, at_least=100, up_to=200)]
Drift = Annotated[float, Quantity(DRIFT, at_least=0, up_to=100)]
Band = Annotated[float, Quantity(FRACTION, above=0, up_to=50)]

LONGEST_NAME = 60
Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+-]*$", max_length=LONGEST_NAME)]
"""Short name that also serves as a file name."""
Text = Annotated[str, StringConstraints(max_length=500)]
Host = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_.:-]+$", max_length=253)]
Word = Annotated[str, StringConstraints(pattern=r"^\S+$", max_length=200)]
"""Name or path without spaces: a profile, a bus, a serial port."""
PublicKey = Annotated[str, StringConstraints(pattern=r"^ed25519:[0-9a-f]{64}$")]
"""Public key of a bench, as `lostmotion key` prints it."""
Port = Annotated[int, Field(ge=1, le=65535)]
Revision = Annotated[int, Field(ge=1, le=1_000_000)]
