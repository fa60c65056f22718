"""Sections of a recipe: what unit, how it is loaded, what is measured, what limits hold, how is decided."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field, PrivateAttr, StringConstraints, ValidationInfo, field_validator, model_validator

from definitions.method import ONE_SIDED_95, DecisionRule, LeftOpenErrors, Loading, OutputTorque
from definitions.units import TORQUE
from recipes.schema.interlock_schema import Interlocks
from recipes.schema.metric_presets import PRESETS
from recipes.schema.metric_schema import MetricWanted, PresetName, preset_metrics
from recipes.schema.sequence_schema import Step
from recipes.schema.validity_schema import Validity
from recipes.text.problems import OptionPath, Problem, Source, dotted, excerpt
from recipes.text.quantity import show
from recipes.text.section import (
    FROM_DOCUMENT,
    Age,
    Fraction,
    Name,
    PeriodNs,
    Revision,
    Section,
    SignedTorque,
    Stiffness,
    Text,
    Torque,
    TorqueOfRated,
    TorqueOfReference,
    refusal,
)


class Header(Section):
    """Name and revision of a recipe."""

    name: Name
    revision: Revision
    description: Text = ""


class LoadingTorqueRatio(Section):
    """Loading line of the torque ratio, T_out = offset + slope · T_in."""

    slope: Annotated[float, Field(gt=0, le=1000)]
    offset_nm: SignedTorque


class UnitUnderTest(Section):
    """Model, ratio and catalogue values of the reducer; the values plan the run and are never a result."""

    model: Name
    ratio: Annotated[float, Field(ge=1, le=10000)]
    rated_torque_nm: Torque
    stiffness_nm_per_arcmin: Stiffness
    loading_torque_ratio: LoadingTorqueRatio


class Measurement(Section):
    """Where the output torque comes from, and the torque that the percentages of metrics refer to."""

    output_torque: OutputTorque
    calibration: Literal["measured", "stored"] = "measured"
    alignment: Literal["declared", "two_speeds", "report"] = Field(
        default="declared",
        description="`declared` by the lags of the bench file, `two_speeds` by cycles of different speed, or `report`: "
        "nothing is moved",
    )
    """How the delay between torque and angles is corrected."""
    left_open: LeftOpenErrors = Field(
        default="told",
        description="Errors that the validity checks of a run cannot see (`not_excluded` of the result): `told` beside "
        "the verdict and not in U, or `budget`: each is a contribution to U, and a metric that it moves is NOT "
        "DECIDABLE where its size is not known",
    )
    reference_torque_nm: TorqueOfRated = Field(default="100 %", validate_default=True)
    break_torque_nm: TorqueOfReference | None = None
    """Six-segment fit: torque at which the linear middle segment ends."""
    break_torque_t1_nm: TorqueOfReference | None = None
    """Three-segment stiffness: torque at which segment K1 ends."""
    break_torque_t2_nm: TorqueOfReference | None = None
    """Three-segment stiffness: torque at which segment K2 ends."""

    @model_validator(mode="after")
    def _breaks_below_reference(self) -> Measurement:
        reference = show(self.reference_torque_nm, TORQUE)
        for option in ("break_torque", "break_torque_t1", "break_torque_t2"):
            torque_nm = getattr(self, f"{option}_nm")
            if torque_nm is not None and torque_nm >= self.reference_torque_nm:
                hint = "Lower it, or raise the reference torque."
                raise refusal(
                    show(torque_nm, TORQUE), f"a torque below the reference torque, {reference}", hint, option
                )
        first, second = self.break_torque_t1_nm, self.break_torque_t2_nm
        if (first is None) != (second is None):
            given, other = ("break_torque_t2", "T1") if first is None else ("break_torque_t1", "T2")
            raise refusal(f"{given} without {other}", "both break torques or none", "Give both.", at=given)
        if first is not None and second is not None and first >= second:
            allowed = f"a torque above break_torque_t1, {show(first, TORQUE)}"
            raise refusal(show(second, TORQUE), allowed, "Exchange the two or correct one.", at="break_torque_t2")
        return self


class Sampling(Section):
    """Scan period, and how many missed periods and how old a sample the run may have."""

    period_ns: PeriodNs
    missed_periods_fraction: Fraction
    sample_age_s: Age

    @property
    def period_s(self) -> float:
        """Scan period [s]."""
        return self.period_ns * 1e-9


class Decision(Section):
    """How limits and uncertainty become a verdict; the guard band is `guard_factor` times the expanded uncertainty."""

    rule: DecisionRule
    guard_factor: float = Field(default=None, validate_default=True, ge=0, le=3)

    @field_validator("guard_factor", mode="before")
    @classmethod
    def _of_the_rule(cls, value: Any, info: ValidationInfo) -> Any:
        guarded = info.data.get("rule") == "guard_band"
        if value is None:
            return ONE_SIDED_95 if guarded else 0.0
        from_document = (info.context or {}).get(FROM_DOCUMENT)
        if from_document and not guarded and info.data.get("rule") is not None:
            raise refusal(
                excerpt(value), "a guard factor with 'rule: guard_band' only", "Delete it or change the rule."
            )
        return value


ONE_LINE = r"^[^\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]*$"
"""Without what moves a terminal's cursor, ends a line, or shows characters in another order than they stand."""

Instruction = Annotated[str, StringConstraints(max_length=120, pattern=ONE_LINE)]
"""What a person at the bench does next: one line, as large as a screen shows it from afar."""


class WhatToDo(Section):
    """What is done with the unit after each verdict, as the operator reads it; '' is the program's own text."""

    passed: Instruction = ""
    failed: Instruction = ""
    not_decidable: Instruction = ""

    def after(self, verdict: str | None) -> str:
        """Return the text for a verdict, '' where the recipe has none."""
        return {"PASS": self.passed, "FAIL": self.failed, "NOT DECIDABLE": self.not_decidable}.get(verdict or "", "")


class Recipe(Section):
    """A recipe as loaded: everything that a run does and decides by."""

    recipe: Header
    unit_under_test: UnitUnderTest
    loading: Loading
    measurement: Measurement
    sequence: Annotated[tuple[Step, ...], Field(min_length=1, max_length=50)]
    sampling: Sampling
    interlocks: Interlocks
    presets: Annotated[tuple[PresetName, ...], Field(max_length=len(PRESETS))] = ()
    metrics: Annotated[tuple[MetricWanted, ...], Field(max_length=100)] = ()
    decision: Decision
    validity: Validity = Validity()
    what_to_do: WhatToDo = WhatToDo()
    report: Literal["on_request", "always"] = Field(
        default="on_request",
        description="When report and pictures are made: `on_request` by `lostmotion report`, or `always` after a run.",
    )

    _source: Source | None = PrivateAttr(default=None)

    @model_validator(mode="after")
    def _something_is_asked(self) -> Recipe:
        if not self.metrics and not self.presets:
            hint = "Add 'metrics:' with what is to be reported."
            raise refusal("neither metrics nor presets", "metrics, presets or both", hint, at="metrics")
        for index, name in enumerate(self.presets):
            if name in self.presets[:index]:
                hint = "Delete one of the two."
                raise refusal(f"'{name}' a second time", "each preset once", hint, at=f"presets.{index}")
        return self

    def wanted(self) -> list[tuple[OptionPath, MetricWanted]]:
        """Return every metric to report, each with the option that asks for it: the recipe's own, then the presets'.

        What the recipe asks for itself, with its limits, takes the place of the same definition in a preset.
        """
        reference_nm = self.measurement.reference_torque_nm
        found: dict[tuple[object, ...], tuple[OptionPath, MetricWanted]] = {}
        own = [(("metrics", index), metric) for index, metric in enumerate(self.metrics)]
        for index, name in enumerate(self.presets):
            for metric in preset_metrics(name):
                found.setdefault(metric.key(reference_nm), (("presets", index), metric))
        mine = {metric.key(reference_nm) for _, metric in own}
        return [*own, *(entry for key, entry in found.items() if key not in mine)]

    def problem(self, option: OptionPath, found: str, allowed: str, hint: str = "") -> Problem:
        """Return a problem at one of the options, with its place when the recipe was loaded from a file."""
        if self._source is None:
            return Problem(self.recipe.name, 1, 1, dotted(option), found, allowed, hint)
        return self._source.problem(option, found, allowed, hint)

    def empty_options(self) -> Iterator[OptionPath]:
        """Yield the options that its file has with nothing behind them; a step may stand there by its name alone."""
        found = () if self._source is None else self._source.empty_options()
        return (option for option in found if (option[0], len(option)) != ("sequence", 3))

    def refuse_empty_options(self) -> None:
        """Raise RecipeError for options of its file with nothing behind them, as `Source` does."""
        if self._source is not None:
            self._source.refuse_empty_options(self.empty_options())

    def with_source(self, source: Source) -> Recipe:
        """Return this recipe with the places of its options."""
        copy = self.model_copy()
        copy._source = source  # noqa: SLF001
        return copy
