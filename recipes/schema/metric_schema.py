"""What a recipe asks for: metrics with their choices and limits, one by one or as presets."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, ValidationInfo, field_validator, model_validator

from definitions.metrics import METRICS
from definitions.units import NUMBER
from recipes.schema.metric_presets import PRESETS, PresetMetric
from recipes.text.problems import did_you_mean, excerpt, one_of
from recipes.text.quantity import QuantityError, read_quantity
from recipes.text.section import FROM_DOCUMENT, Band, Section, TorqueOfReference, refusal

LIMIT_OPTIONS = ("min", "max", "max_standard_deviation")
"""Options of a metric that decide."""


class MetricWanted(Section):
    """One metric to report, with the limits that decide; limits are in the metric's own unit."""

    id: str = Field(description="a metric of the [table](metrics.md)")
    branch: Literal["load", "unload", "mean", "width"] | None = None
    side: Literal["+", "-", "both"] | None = None
    torque_nm: TorqueOfReference | None = None
    band: Band | None = None
    """Fraction of the reference torque."""
    variant: str | None = Field(default=None, description="a variant of the metric, see its [row](metrics.md)")
    fit: str | None = Field(
        default=None, description="the [fit](metrics.md#fits-of-the-stiffness-curve) that the curve is read from"
    )
    min: float | None = None
    max: float | None = None
    max_standard_deviation: float | None = Field(
        default=None, description="largest standard deviation over the measured cycles, each side for itself"
    )

    tolerance: float | None = Field(
        default=None,
        description="distance of the limits that a gage is judged by, for a metric with one limit; decides nothing",
    )

    @property
    def limited(self) -> bool:
        """Whether the metric has a limit."""
        return any(getattr(self, name) is not None for name in LIMIT_OPTIONS)

    @field_validator("id")
    @classmethod
    def _known(cls, value: str) -> str:
        if value not in METRICS:
            hint = did_you_mean(value, METRICS)
            raise refusal(f"the unknown metric {excerpt(value)}", one_of(list(METRICS)), hint)
        return value

    @field_validator(*LIMIT_OPTIONS, "tolerance", mode="before", json_schema_input_type=str | float | None)
    @classmethod
    def _limit_with_unit(cls, value: Any, info: ValidationInfo) -> Any:
        if not (info.context or {}).get(FROM_DOCUMENT) or value is None:
            return value
        metric = info.data.get("id")
        if metric is None:  # its own problem is reported; the limit cannot be judged
            return 0.0
        kind = METRICS[metric].kind
        if kind is NUMBER:
            return value
        try:
            return read_quantity(value, kind)
        except QuantityError as error:
            raise refusal(error.found, error.allowed, error.hint) from None

    @model_validator(mode="after")
    def _limits_in_order(self) -> MetricWanted:
        if self.min is not None and self.max is not None and self.min > self.max:
            unit = METRICS[self.id].unit.replace("1", "").strip()
            found = f"min {self.min:g} {unit}".strip()
            allowed = f"a min up to max, {self.max:g} {unit}".strip()
            raise refusal(found, allowed, "Exchange the two or correct one.", at="min")
        return self

    @model_validator(mode="after")
    def _tolerance_above_zero(self) -> MetricWanted:
        if self.tolerance is not None and not self.tolerance > 0.0:
            unit = METRICS[self.id].unit
            raise refusal(f"{self.tolerance:g} {unit}", "a tolerance above 0", "Correct or delete it.", at="tolerance")
        return self

    @model_validator(mode="after")
    def _spread_of_cycles(self) -> MetricWanted:
        limit, row, option = self.max_standard_deviation, METRICS[self.id], "max_standard_deviation"
        if limit is not None and (row.calibration or row.graded):
            why = (
                "a run has one value of it"
                if row.calibration
                else "the grade is a whole number; limit the backlash instead"
            )
            raise refusal(
                f"a {option} for {self.id}", f"no such limit, because {why}", "Delete this option.", at=option
            )
        if limit is not None and not limit > 0.0:
            raise refusal(f"{limit:g} {row.unit}", "a standard deviation above 0", "Correct or delete it.", at=option)
        return self

    @model_validator(mode="after")
    def _possible_choices(self) -> MetricWanted:
        row = METRICS[self.id]
        for option, chosen, choices in (
            ("branch", self.branch, row.branches),
            ("side", self.side, row.sides),
            ("variant", self.variant, row.variants),
            ("fit", self.fit, row.fits),
        ):
            if chosen is not None and chosen not in choices:
                allowed = one_of(choices) if choices else f"nothing: {self.id} has no {option} to choose"
                hint = did_you_mean(chosen, choices) or "It is part of the definition."
                raise refusal(f"{excerpt(chosen)} for {self.id}", allowed, hint, at=option)
        if self.fit is not None and self.variant == "direct":
            raise refusal(
                f"'{self.fit}' with variant direct",
                "no fit",
                "Variant 'direct' uses no fit: delete this option.",
                "fit",
            )
        for option, given in (("band", self.band), ("torque", self.torque_nm)):
            if given is not None and option not in row.free:
                allowed = one_of([name for name, other in METRICS.items() if option in other.free])
                hint = f"Delete it: the {option} of {self.id} is part of its definition."
                raise refusal(f"a {option} for {self.id}", f"a {option} for {allowed}", hint, at=option)
        return self

    def key(self, reference_nm: float) -> tuple[object, ...]:
        """Return what tells this definition from others: the choices, with what is taken where none is made."""
        row = METRICS[self.id]
        return (
            self.id,
            self.branch or row.branches[0],
            None if self.side == "both" else self.side,
            (row.torque or 0.0) * reference_nm if self.torque_nm is None else self.torque_nm,
            row.band if self.band is None else self.band,
            self.variant or next(iter(row.variants), None),
            (self.fit or next(iter(row.fits), None)) if self.variant != "direct" else None,
        )


PresetName = Literal["static", "inverse", "measurement", "output", "nabtesco", "spinea", "harmonic"]
"""Names of `PRESETS`."""


def preset_metrics(name: str) -> list[MetricWanted]:
    """Return the metrics of a preset, without limits."""
    return [_of_preset(row) for row in PRESETS[name].metrics]


def _of_preset(row: PresetMetric) -> MetricWanted:
    return MetricWanted.model_validate({"id": row.id, **{key: value for key, value in row._asdict().items() if value}})
