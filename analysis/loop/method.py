"""How a trace is to be evaluated: the method, the metrics wanted with their limits, and the rule of decision.

Plain data; whoever reads recipes fills these.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

from analysis.loop.fixture_curve import FixtureCurve
from analysis.torque_ratio.quadrants import Quadrants
from analysis.trace.errors import AnalysisError
from definitions.method import ONE_SIDED_95, DecisionRule, LeftOpenErrors, Loading, OutputTorque

BREAK_FRACTION = 90.0 / 412.0
"""Break torques of the six-segment fit, of the reference torque: ±90 N·m for 412 N·m ("backlash and stiffness
measurement system"); the inverse loading method takes ±20 % instead."""

FIT_END_FRACTION = 420.0 / 412.0
"""End of the quadratic segments of the six-segment fit, of the reference torque: ±420 N·m for 412 N·m (same source)."""

STIFFNESS_BREAK_FRACTIONS = (0.2, 0.7)
"""Break torques T1 and T2 of the three-segment stiffness, of the reference torque, where the recipe gives none.

A choice of this program: every model's catalogue has its own, and those are to be given."""

SPRING_STEP_NM = 10.0
"""Torque step of the spring constant, N·m ("inverse loading test system": 10 N·m near rated torque)."""

REVERSAL_EXCLUSION = 2.25
"""Torque excluded after each reversal, in multiples of the friction torque of the loop; two is the least."""

CHOICES: dict[str, tuple[str, ...]] = {
    "loading": get_args(Loading),
    "output_torque": get_args(OutputTorque),
    "alignment": ("correct", "two_speeds", "report"),
    "drift": ("correct", "report"),
    "fixture": ("correct", "report"),
    "left_open": get_args(LeftOpenErrors),
}
"""What a method may choose between."""


@dataclass(frozen=True)
class Method:
    """Evaluation of one unit: SI units except the stiffness, which is in N·m/arcmin.

    loading: shaft that the servo drives; the other one is locked. The wind-up [arcmin] is angle_in/ratio − angle_out
    with input loading and angle_out − angle_in/ratio with output loading.
    output_torque: "reaction" takes torque_out_nm as measured, "calibrated" converts torque_in_nm by `quadrants`, which
    are fitted from the trace's calibrate segments when None.
    reference_torque_nm: what percentages refer to; the rated torque when None.
    fixture_stiffness_nm_per_arcmin: of lock and couplings; corrects the wind-up where the locked shaft's own angle is
    not in the trace (where it is, subtracting it has removed the deflection already).
    locked_stiffness_nm_per_arcmin: of the part of it whose deflection the locked shaft's own encoder sees, for the
    checks on the lock; all of the fixture when None.
    fixture_curve: the same as measured by a blank test; it comes before the stiffness.
    lags_s: delay of each channel behind what it measures, by channel; None when they are not known.
    alignment: "correct" moves channels by their lags, "two_speeds" estimates the skew of torque and angle from cycles
    of different speed instead and corrects it, "report" moves nothing. drift, fixture: "correct" or "report".
    left_open: "told" says beside the verdict which errors the validity checks cannot see, "budget" has them in U.
    catalogue_offset_nm: of the unit's loading line, held against its friction beside the verdict.
    catalogue_stiffness_nm_per_arcmin: of the unit, for the check that looks at the scale of angle and torque; never for
    a metric. None when it is not known.
    check_limits: limits of validity checks that differ from the table's, by check.
    planned_nm_s: slowest and fastest torque rate that is planned for a measured branch, holds included, at the output;
    None when no rate is known. It tells a wrong unit of time.
    """

    ratio: float
    rated_torque_nm: float
    reference_torque_nm: float | None = None
    loading: Loading = "input"
    output_torque: OutputTorque = "reaction"
    quadrants: Quadrants | None = None
    fixture_stiffness_nm_per_arcmin: float | None = None
    break_torque_nm: float | None = None
    fit_end_nm: float | None = None
    stiffness_break_t1_nm: float | None = None
    stiffness_break_t2_nm: float | None = None
    spring_step_nm: float = SPRING_STEP_NM
    reversal_exclusion: float = REVERSAL_EXCLUSION
    fixture_curve: FixtureCurve | None = None
    lags_s: Mapping[str, float] | None = None
    alignment: Literal["correct", "two_speeds", "report"] = "correct"
    drift: Literal["correct", "report"] = "correct"
    fixture: Literal["correct", "report"] = "correct"
    left_open: LeftOpenErrors = "told"
    catalogue_stiffness_nm_per_arcmin: float | None = None
    catalogue_offset_nm: float | None = None
    check_limits: Mapping[str, float] = field(default_factory=dict)
    locked_stiffness_nm_per_arcmin: float | None = None
    planned_nm_s: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Refuse what is not positive, and names that are not known."""
        for name in ("ratio", "rated_torque_nm", "reference_torque_nm", "fixture_stiffness_nm_per_arcmin",
                     "locked_stiffness_nm_per_arcmin", "break_torque_nm", "fit_end_nm", "stiffness_break_t1_nm",
                     "stiffness_break_t2_nm", "spring_step_nm", "reversal_exclusion",
                     "catalogue_stiffness_nm_per_arcmin"):  # fmt: skip
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise AnalysisError(f"method: {name}: found {value}; expected a number above zero")
        for name, allowed in CHOICES.items():
            if getattr(self, name) not in allowed:
                raise AnalysisError(f"method: {name}: found '{getattr(self, name)}'; allowed are {', '.join(allowed)}")
        for channel, lag_s in (self.lags_s or {}).items():
            if not (math.isfinite(lag_s) and lag_s >= 0):
                raise AnalysisError(f"method: lags_s: {channel}: found {lag_s}; expected a time of 0 s or more")
        if self.loading == "output" and self.output_torque == "calibrated":
            raise AnalysisError(
                "method: output_torque: found 'calibrated' with loading 'output'; the torque is applied at the output "
                "and measured there: choose 'reaction'"
            )
        if not self.break_nm < self.reference_nm <= self.fit_nm:
            raise AnalysisError(
                f"method: break torque {self.break_nm:g}, reference torque {self.reference_nm:g} and end of the fit "
                f"{self.fit_nm:g} N·m; expected break < reference <= end"
            )
        first, second = self.stiffness_breaks_nm
        if not first < second < self.reference_nm:
            raise AnalysisError(
                f"method: break torques of the three-segment stiffness T1 {first:g}, T2 {second:g} and reference "
                f"torque {self.reference_nm:g} N·m; expected T1 < T2 < reference"
            )

    @property
    def lock_nm_per_arcmin(self) -> float | None:
        """Stiffness by which the locked shaft gives way, at the output, N·m/arcmin; None when it is not known."""
        own, whole = self.locked_stiffness_nm_per_arcmin, self.fixture_stiffness_nm_per_arcmin
        return whole if own is None else own

    @property
    def reference_nm(self) -> float:
        """Torque that percentages refer to, N·m."""
        return self.rated_torque_nm if self.reference_torque_nm is None else self.reference_torque_nm

    @property
    def break_nm(self) -> float:
        """Break torque of the six-segment fit, N·m."""
        return BREAK_FRACTION * self.reference_nm if self.break_torque_nm is None else self.break_torque_nm

    @property
    def stiffness_breaks_nm(self) -> tuple[float, float]:
        """Break torques T1 and T2 of the three-segment stiffness, N·m."""
        first, second = (fraction * self.reference_nm for fraction in STIFFNESS_BREAK_FRACTIONS)
        return (
            first if self.stiffness_break_t1_nm is None else self.stiffness_break_t1_nm,
            second if self.stiffness_break_t2_nm is None else self.stiffness_break_t2_nm,
        )

    @property
    def fit_nm(self) -> float:
        """End of the quadratic segments of the six-segment fit, N·m."""
        return FIT_END_FRACTION * self.reference_nm if self.fit_end_nm is None else self.fit_end_nm


@dataclass(frozen=True)
class MetricWanted:
    """A metric asked for by id, with limits in the metric's own unit; None leaves the choice to its definition.

    branch: "load", "unload" or "mean"; side: "+" or "-", None judges the worse side; torque_nm: where `stiffness_at`
    or `hysteresis_angle` is taken; band: fraction of the reference torque, half width for `lost_motion`; variant: one
    of the definition's estimators (`spring_constant`: "ending", "centred", "from", "direct"); fit: one of
    `analysis.loop.curves.FITS`, for metrics of a fitted curve. max_standard_deviation: over the cycles, on each side.
    """

    id: str
    branch: str | None = None
    side: str | None = None
    torque_nm: float | None = None
    band: float | None = None
    min: float | None = None
    max: float | None = None
    variant: str | None = None
    fit: str | None = None
    max_standard_deviation: float | None = None

    @property
    def limited(self) -> bool:
        """Whether there is a limit, on the value or on its standard deviation over the cycles."""
        return any(limit is not None for limit in (self.min, self.max, self.max_standard_deviation))


@dataclass(frozen=True)
class Decision:
    """Decision rule: "simple" judges the value, "guard_band" moves each limit by w = guard_factor · U."""

    rule: DecisionRule = "simple"
    guard_factor: float = ONE_SIDED_95

    def __post_init__(self) -> None:
        """Refuse an unknown rule or a negative factor."""
        if self.rule not in get_args(DecisionRule):
            raise AnalysisError(f"decision: rule: found '{self.rule}'; allowed are {', '.join(get_args(DecisionRule))}")
        if not (math.isfinite(self.guard_factor) and self.guard_factor >= 0):
            raise AnalysisError(f"decision: guard_factor: found {self.guard_factor}; expected zero or more")
