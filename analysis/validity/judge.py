"""Judge the validity checks of `CHECKS`: figure against limit, and what is said of it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from analysis.trace.errors import AnalysisError
from analysis.validity import (
    calibration_checks,
    channel_checks,
    cycle_checks,
    drive_checks,
    fixture_checks,
    loop_checks,
    noise_checks,
    record_checks,
    torque_checks,
)
from analysis.validity.evidence import Evidence, Figure, LeftOpen
from definitions.checks import CHECKS, Check

TABLES = (
    calibration_checks,
    channel_checks,
    cycle_checks,
    drive_checks,
    fixture_checks,
    loop_checks,
    noise_checks,
    record_checks,
    torque_checks,
)

FIGURES: dict[str, Figure] = {name: figure for table in TABLES for name, figure in table.FIGURES.items()}
"""What gives the figure of each check of `CHECKS`, by its id."""


@dataclass(frozen=True)
class NotExcluded:
    """Error that a check of a run cannot see: its largest size in its unit, None where nothing bounds it.

    id: of the check. text: which error it is. in_budget: it is a contribution to U, and no metric that it moves is
    decided where nothing bounds it.
    """

    id: str
    figure: float | None
    unit: str
    text: str
    in_budget: bool = False


@dataclass(frozen=True)
class CheckResult:
    """A check's figure against its limit; `passed` is None where it does not apply, and the text then says why."""

    id: str
    figure: float | None
    limit: float
    unit: str
    passed: bool | None
    text: str
    left_open: NotExcluded | None = None

    def to_dict(self) -> dict[str, object]:
        """Return the object of the JSON contract."""
        return {
            "id": self.id,
            "figure": self.figure,
            "limit": self.limit,
            "unit": self.unit,
            "passed": self.passed,
            "text": self.text,
        }


def judge_checks(evidence: Evidence, limits: Mapping[str, float] | None = None) -> tuple[CheckResult, ...]:
    """Judge every check; limits replace those of the table, in the check's unit.

    A figure that is not a number fails. Raises AnalysisError for limits of checks that do not exist or are fixed.
    """
    chosen = dict(limits or {})
    for name, limit in chosen.items():
        check = CHECKS.get(name)
        if check is None or check.settable is None or not math.isfinite(limit):
            allowed = ", ".join(key for key, row in CHECKS.items() if row.settable)
            raise AnalysisError(f"validity check '{name}': found a limit of {limit:g}; limits may be set for {allowed}")
    if evidence.facts is not None:
        chosen["missed_periods"] = evidence.facts.missed_allowed * 100.0
        chosen["sample_age"] = float(evidence.facts.sample_age_allowed_scans)
    return tuple(_judged(check, evidence, chosen.get(name, check.limit)) for name, check in CHECKS.items())


def _judged(check: Check, evidence: Evidence, limit: float) -> CheckResult:
    reading = FIGURES[check.id](evidence)
    if isinstance(reading, str):
        text = f"{check.title}: not applicable: {reading}"
        return CheckResult(check.id, None, limit, check.unit, None, text, _left_open(check, limit, None))
    figure = reading.figure
    passed = figure >= limit if check.at_least else figure <= limit
    said = _with_unit(figure, check.unit)
    allowed = f"allowed is {_with_unit(limit, check.unit)} {'at least' if check.at_least else 'at most'}"
    if is_loose(check.id, limit):
        allowed += f" by the recipe, where {_with_unit(check.limit, check.unit)} is usual"
    if passed:
        text = f"{check.title}: {said}, {allowed}"
    else:
        text = f"{reading.words or check.failed}: {said}, {allowed}; {check.action}"
    shown = figure if math.isfinite(figure) else None
    left_open = _left_open(check, limit, reading.left_open)
    return CheckResult(check.id, shown, limit, check.unit, passed, text, left_open)


def _left_open(check: Check, limit: float, found: LeftOpen | None) -> NotExcluded | None:
    """Return the largest error that passes a limit unseen; None of a check that leaves none open."""
    if check.leaves_open is None:
        return None
    text, unit = check.leaves_open
    if found is None:
        return NotExcluded(check.id, None, unit, text)
    size = found.for_each * limit + found.besides
    text = f"{text}, {found.words}" if found.words else text
    return NotExcluded(check.id, size if math.isfinite(size) else None, unit, text)


def is_loose(name: str, limit: float) -> bool:
    """Say whether a limit lets more pass than that of the table does."""
    check = CHECKS[name]
    return limit < check.limit if check.at_least else limit > check.limit


def _with_unit(value: float, unit: str) -> str:
    if not math.isfinite(value):
        return "no number"
    return f"{value:.3g}" if unit == "1" else f"{value:.3g} {unit}"


def check_reasons(checks: Sequence[CheckResult], objections: Sequence[str]) -> list[str]:
    """Return why a measurement does not count; empty if it does.

    One line for each objection and each failed check, but for those that the failure of another one explains.
    """
    said = [f"measurement invalid: {objection}" for objection in objections]
    failed = {check.id: check.text for check in checks if check.passed is False and check.id != "record"}
    causes = [name for name in failed if CHECKS[name].explained_by not in failed]
    return said + [f"measurement invalid: {name}: {failed[name]}" for name in causes]
