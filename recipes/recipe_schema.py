"""What a recipe file may say. Attributes are SI floats with the unit in the name; keys of the file carry none."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, field_validator, model_validator

from recipes.metric_units import METRIC_KINDS
from recipes.problems import nearest
from recipes.quantity import (
    Angle,
    Fraction,
    PositiveAngle,
    PositiveFraction,
    PositiveTime,
    PositiveTorque,
    QuantityError,
    SignedTorque,
    Speed,
    Stiffness,
    Temperature,
    parse,
)
from recipes.section import Section
from recipes.sequence_schema import Step, unfold

Name = Annotated[str, Field(min_length=1, max_length=80, pattern=r"^[A-Za-z0-9][A-Za-z0-9._+-]*$")]
Revision = Annotated[int, Field(ge=1, le=1_000_000)]


class Header(Section):
    """Which recipe this is."""

    name: Name
    revision: Revision
    description: str = ""


class TorqueRatioLine(Section):
    """T_out = offset + slope T_in while loading."""

    slope: Annotated[float, Field(gt=0.0, le=10_000.0, strict=False)]
    offset_nm: SignedTorque = Field(alias="offset")


class UnitUnderTest(Section):
    """The reducer that the recipe is for, by its catalogue."""

    model: Name
    ratio: Annotated[float, Field(ge=1.0, le=10_000.0, strict=False)]
    rated_torque_nm: PositiveTorque = Field(alias="rated_torque")
    stiffness_nm_per_arcmin: Stiffness = Field(alias="stiffness")
    loading_torque_ratio: TorqueRatioLine


class Measurement(Section):
    """Where the output torque comes from, and the torque that percentages of the metrics refer to."""

    output_torque: Literal["reaction", "calibrated"]
    calibration: Literal["measured", "stored"] = "measured"
    reference_torque_nm: PositiveTorque = Field(alias="reference_torque", default=math.nan)


class Sampling(Section):
    """Scan period, and how many missed periods and how old a sample the result can bear."""

    period_s: PositiveTime = Field(alias="period")
    missed_periods_fraction: Fraction = Field(alias="missed_periods")
    sample_age_s: PositiveTime = Field(alias="sample_age")

    @property
    def period_ns(self) -> int:
        """Scan period in integer nanoseconds."""
        return round(self.period_s * 1e9)


class Interlocks(Section):
    """Limits that stop the bench, whatever the sequence is doing."""

    torque_out_alarm_nm: PositiveTorque = Field(alias="torque_out_alarm")
    torque_out_trip_nm: PositiveTorque = Field(alias="torque_out_trip")
    torque_in_trip_nm: PositiveTorque = Field(alias="torque_in_trip")
    speed_rad_s: Speed = Field(alias="speed")
    travel_rad: PositiveAngle = Field(alias="travel")
    lock_slip_rad: PositiveAngle = Field(alias="lock_slip")
    housing_temperature_c: Temperature = Field(alias="housing_temperature")
    sample_age_s: PositiveTime = Field(alias="sample_age", default=0.01)
    drive_age_s: PositiveTime = Field(alias="drive_age", default=0.01)
    io_age_s: PositiveTime = Field(alias="io_age", default=0.1)
    brake_age_s: PositiveTime = Field(alias="brake_age", default=0.1)
    drive_heartbeat_s: PositiveTime = Field(alias="drive_heartbeat", default=0.1)
    missed_in_a_row: Annotated[int, Field(ge=1, le=1000)] = 20
    internal_limit_s: PositiveTime = Field(alias="internal_limit", default=0.05)


class MetricWanted(Section):
    """A metric to report, and its limits in the metric's own unit."""

    id: str
    branch: Literal["load", "unload", "mean"] | None = None
    side: Literal["+", "-", "both"] | None = None
    torque_nm: PositiveTorque | None = Field(alias="torque", default=None)
    band: PositiveFraction | None = None
    min: float | None = None
    max: float | None = None

    @field_validator("id")
    @classmethod
    def _known(cls, value: str) -> str:
        if value not in METRIC_KINDS:
            allowed = ", ".join(sorted(METRIC_KINDS))
            raise QuantityError(
                f"found '{value}', which is no metric. {nearest(value, METRIC_KINDS)}".rstrip(), allowed
            )
        return value

    @field_validator("min", "max", mode="before")
    @classmethod
    def _limit(cls, value: Any, info: Any) -> Any:
        kind = METRIC_KINDS.get(info.data.get("id", ""))
        if kind is None or value is None:
            return None  # the unknown metric has been reported already
        rated_torque_nm = (info.context or {}).get("rated_torque_nm")
        return parse(value, kind.quantity, least=-1e9, most=1e9, rated_torque_nm=rated_torque_nm)


class Decision(Section):
    """How limits, value and uncertainty become a verdict: plain limits, or limits moved in by r U."""

    rule: Literal["simple", "guard_band"]
    guard_factor: Annotated[float, Field(ge=0.0, le=2.0, strict=False)] = 0.8225


class Recipe(Section):
    """A whole recipe."""

    recipe: Header
    unit_under_test: UnitUnderTest
    loading: Literal["input", "output"]
    measurement: Measurement
    sequence: Annotated[
        tuple[Annotated[Step, BeforeValidator(unfold)], ...], Field(min_length=1, max_length=200, strict=False)
    ]
    sampling: Sampling
    interlocks: Interlocks
    metrics: Annotated[tuple[MetricWanted, ...], Field(min_length=1, max_length=200, strict=False)]
    decision: Decision

    @model_validator(mode="after")
    def _reference_torque(self) -> Recipe:
        if math.isnan(self.measurement.reference_torque_nm):
            rated = {"reference_torque_nm": self.unit_under_test.rated_torque_nm}
            object.__setattr__(self, "measurement", self.measurement.model_copy(update=rated))
        return self


__all__ = ["Angle", "Decision", "Header", "Interlocks", "Measurement", "MetricWanted", "Recipe", "Sampling"]
