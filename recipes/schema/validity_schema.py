"""Section `validity` of a recipe: an option for every validity check whose limit may be set, made from its row."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, create_model, model_validator

from definitions.checks import CHECKS, Check
from definitions.units import FRACTION, SAMPLES, TEMPERATURE, TEMPERATURE_CHANGE
from recipes.text.quantity import show
from recipes.text.section import Quantity, Section, refusal

SUFFIXES = {FRACTION: "_fraction", TEMPERATURE: "_c", TEMPERATURE_CHANGE: "_k", SAMPLES: ""}
"""Unit at the end of an attribute's name, by the kind of the check's figure."""

PERCENT = 100.0
"""Checks say shares in percent, as people do; an attribute holds the fraction."""


def _attribute(check: Check) -> str:
    return check.id + SUFFIXES[check.kind]


def _option(check: Check) -> tuple[Any, float]:
    """Return the type of a check's option and its default."""
    least, most, beyond_least = check.settable or (0.0, 0.0, False)
    if check.kind is SAMPLES:
        return Annotated[int, Field(ge=int(least), le=int(most))], int(check.limit)
    bounds = {"above": least} if beyond_least else {"at_least": least}
    kind = Annotated[float, Quantity(check.kind, up_to=most, **bounds)]
    return kind, check.limit / PERCENT if check.kind is FRACTION else check.limit


SETTABLE = tuple(check for check in CHECKS.values() if check.settable)


class ValidityLimits(Section):
    """Limits of the validity checks: what may be seen of a measurement that is judged; beyond, NOT DECIDABLE.

    Fractions are of the wind-up between the turning points, unless the check says otherwise.
    """

    @model_validator(mode="after")
    def _in_order(self) -> ValidityLimits:
        for check in SETTABLE:
            if check.below:
                low, high = getattr(self, _attribute(check)), getattr(self, _attribute(CHECKS[check.below]))
                if low >= high:
                    allowed = f"a limit below that of {check.below}, {show(high, check.kind)}"
                    hint = "Exchange both limits or correct one."
                    raise refusal(f"a limit of {show(low, check.kind)}", allowed, hint, at=check.id)
        return self

    def limits(self) -> dict[str, float]:
        """Return the limit of every check that a recipe may set, by id and in the unit of the check."""
        return {
            check.id: getattr(self, _attribute(check)) * (PERCENT if check.kind is FRACTION else 1.0)
            for check in SETTABLE
        }


if TYPE_CHECKING:
    Validity = ValidityLimits
else:
    Validity = create_model(
        "Validity",
        __base__=ValidityLimits,
        __module__=__name__,
        __doc__=ValidityLimits.__doc__,
        **{_attribute(check): _option(check) for check in SETTABLE},
    )
