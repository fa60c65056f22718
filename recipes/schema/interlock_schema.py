"""Section `interlocks` of a recipe: an option for every limit of the fault table, made from its row."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, create_model, model_validator

from definitions.faults import LIMITS, Limit
from definitions.units import NUMBER, TORQUE
from recipes.text.quantity import show
from recipes.text.section import RATED, Quantity, Section, TorqueSlope, refusal


def _option(limit: Limit) -> tuple[Any, Any]:
    """Return the type of a limit's option, and its default; `...` where a recipe must set it."""
    least, most, beyond_least = limit.range
    default = ... if limit.default is None else limit.default
    if limit.kind is NUMBER:
        return Annotated[int, Field(ge=int(least), le=int(most))], default
    above, at_least = (least, None) if beyond_least else (None, least)
    percent_of = RATED if limit.of_rated else ""
    return Annotated[float, Quantity(limit.kind, above, at_least, most, percent_of)], default


class InterlockLimits(Section):
    """Limits that are watched in every scan."""

    torque_rate_nm_s: TorqueSlope | None = None
    """Steepest ramp allowed in a sequence. Checked before the run, not watched during it."""

    @model_validator(mode="after")
    def _alarm_before_trip(self) -> InterlockLimits:
        if self.torque_out_alarm_nm >= self.torque_out_trip_nm:
            found = f"an alarm at {show(self.torque_out_alarm_nm, TORQUE)}"
            allowed = f"an alarm below torque_out_trip, {show(self.torque_out_trip_nm, TORQUE)}"
            raise refusal(found, allowed, "Lower the alarm or raise the trip.", at="torque_out_alarm")
        return self

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> float:
            """A limit of the table: the type checker cannot know the rows."""


if TYPE_CHECKING:
    Interlocks = InterlockLimits
else:
    Interlocks = create_model(
        "Interlocks",
        __base__=InterlockLimits,
        __module__=__name__,
        __doc__=InterlockLimits.__doc__,
        **{limit.option: _option(limit) for limit in LIMITS},
    )
