"""The result of a run, `result.json`: verdict with reasons, metrics, validity checks, stages, timing and alarms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from pydantic import AliasChoices, Field

from station.documents.entries import Count, Number, left_out
from station.documents.events import Alarm, LeftState
from station.documents.manifest import BenchSource, EarlierAttempt, RecipeHead, Unit, VerdictName
from station.documents.timing import Timing


@dataclass(frozen=True, slots=True, kw_only=True)
class BudgetRow:
    """One contribution: standard uncertainty `u` in its unit, sensitivity, contribution to u of the metric, share."""

    quantity: str
    text: str = ""
    distribution: str = ""
    u: Number | None = None
    unit: str = ""
    sensitivity: Number | None = None
    contribution: Number = 0.0
    share: Number | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class MonteCarlo:
    """Monte Carlo beside a budget: number of draws, their u and mean shift, ends of the 95.45 % interval."""

    draws: Count
    u: Number
    shift: Number
    low: Number
    high: Number


@dataclass(frozen=True, slots=True, kw_only=True)
class SideValue:
    """A metric on one side: value, expanded uncertainty U = k·u, and the verdict where the metric has a limit."""

    value: Number | None
    uncertainty: Number | None = None
    budget: tuple[BudgetRow, ...] = ()
    monte_carlo: MonteCarlo | None = None
    standard_deviation: Number | None = None
    per_cycle: tuple[Number, ...] = ()
    verdict: VerdictName | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Limits of a metric in its unit; `max_standard_deviation` over the cycles of a side."""

    min: Number | None = None
    max: Number | None = None
    max_standard_deviation: Number | None = left_out()

    def __bool__(self) -> bool:
        """Whether there is any."""
        return any(limit is not None for limit in (self.min, self.max, self.max_standard_deviation))


@dataclass(frozen=True, slots=True, kw_only=True)
class MetricValue:
    """A metric: its definition, its value on the side that it goes by, and each of its sides.

    `value_j`: an energy in joules. `monte_carlo`: where draws were asked for.
    """

    id: str
    title: str | None = left_out()
    definition: str = ""
    value: Number | None
    unit: str
    uncertainty: Number | None
    coverage_factor: Number | None = None
    uncertainty_kind: str | None = "budget"
    budget: tuple[BudgetRow, ...] = ()
    branch: str
    side: str
    estimator: str = ""
    choices: tuple[str, ...] = ()
    band: Number | None = None
    torque_nm: Number | None = None
    cycles: Count | None = None
    mean: Number | None = None
    standard_deviation: Number | None = None
    per_cycle: tuple[Number, ...] = ()
    limits: Limits = Limits()
    verdict: VerdictName | None
    reasons: tuple[str, ...] = ()
    sides: Mapping[str, SideValue] = field(default_factory=dict)
    monte_carlo: MonteCarlo | None = left_out()
    value_j: Number | None = left_out()


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckValue:
    """A validity check: figure and limit in its unit; `passed` is null for one that did not apply."""

    id: str
    figure: Number | None = None
    limit: Number | None = None
    unit: str = ""
    passed: bool | None = None
    text: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class NotExcluded:
    """An error that the cross-checks of this run cannot see, up to `figure` in its unit; null where nothing bounds it.

    `id`: the check that would see a larger one. `in_budget`: it is in the uncertainty of every metric that it moves,
    and such a metric is not decided where nothing bounds it; otherwise it is in none.
    """

    id: str
    figure: Number | None = None
    unit: str = ""
    text: str = ""
    in_budget: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class StageFigure:
    """A figure of a stage with its unit."""

    value: Number | None
    unit: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class StageRow:
    """What one stage of the evaluation did, in words and figures; `applied` when it changed the data."""

    stage: Annotated[str, Field(validation_alias=AliasChoices("stage", "name"))]
    text: str = ""
    applied: bool = False
    figures: Mapping[str, StageFigure] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class DecisionRule:
    """The rule by which limits decide: `simple`, or `guard_band` with its factor r."""

    rule: str = "simple"
    guard_factor: Number = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """What the analysis of a trace gives to a result."""

    verdict: VerdictName
    reasons: tuple[str, ...] = ()
    decision: DecisionRule = DecisionRule()
    metrics: tuple[MetricValue, ...] = ()
    notes: tuple[str, ...] = ()
    gates: tuple[CheckValue, ...] = ()
    not_excluded: tuple[NotExcluded, ...] = ()
    stages: tuple[StageRow, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class OriginNote:
    """The run that a file was exported from; `changed` when the trace in it is another now."""

    run: str
    serial: str | None = None
    attempt: Count | None = None
    started: str | None = None
    state: str | None = None
    verdict: str | None = None
    unit: str | None = None
    clock: str | None = None
    scenario: str | None = None
    operator: str | None = None
    changed: bool
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """What a run or an evaluation came to. `gates` are the validity checks.

    `altered`: why a record is not as it was when the run was concluded. `records` and `waiting`: of a run without a
    result, its scans on disk and in memory. `lock_angle_deg`: of the locked shaft when the lock had closed, from 0 to
    360 by the reference of its encoder; left out where the run did not come to loading.
    """

    run: str | None
    serial: str | None
    attempt: Count | None = None
    recipe: RecipeHead
    bench: BenchSource | None = None
    unit: Unit | None = None
    scenario: str | None = None
    operator: str | None = None
    retest_reason: str | None = left_out()
    before: tuple[EarlierAttempt, ...] | None = left_out()
    clock: str | None = None
    state: str
    stopped_by: str | None = None
    verdict: VerdictName
    reasons: tuple[str, ...]
    decision: DecisionRule = DecisionRule()
    metrics: tuple[MetricValue, ...]
    gates: tuple[CheckValue, ...] = ()
    not_excluded: tuple[NotExcluded, ...] = ()
    notes: tuple[str, ...] = ()
    stages: tuple[StageRow, ...] = ()
    timing: Timing | None = None
    alarms: tuple[Alarm, ...] = ()
    lock_angle_deg: Number | None = left_out()
    left: LeftState | None = None
    record: str | None = None
    records: int | None = left_out()
    waiting: int | None = left_out()
    altered: tuple[str, ...] | None = left_out()

    @property
    def first_cause(self) -> Alarm | None:
        """The alarm that ended the run, None when none did."""
        return next((alarm for alarm in self.alarms if alarm.first), None)


@dataclass(frozen=True, slots=True, kw_only=True)
class DecidedMetric:
    """The verdict of a metric."""

    verdict: VerdictName | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Decided:
    """What of a result is held against the manifest and the chain: whose it is and what was decided."""

    run: str
    serial: str
    state: str
    verdict: VerdictName
    metrics: tuple[DecidedMetric, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluation(Result):
    """A result that `analyze` makes anew: by which metrics, and whose verdict the run's own was.

    `reevaluated`: by another recipe, bench or choice of metrics than the run's own. `origin`: of an exported file.
    """

    preset: str | None = None
    selection: tuple[str, ...] = ()
    reevaluated: bool | None = left_out()
    reevaluated_bench: str | None = None
    original_verdict: str | None = None
    origin: OriginNote | None = left_out()
