"""Figures of a result as text: values as far as their uncertainty carries, limits as people say them, names, units."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from math import floor, log10
from typing import Any, Protocol

from station.documents.manifest import Software
from station.documents.result import DecisionRule, Limits, MetricValue

VERDICT_STYLES = {"PASS": "bold white on green", "FAIL": "bold white on red", "NOT DECIDABLE": "bold black on yellow"}
"""How a verdict is written in a terminal."""

COVERAGE = 2.0
"""The k of an uncertainty whose record does not say it."""

NO_UNCERTAINTY = "no uncertainty: needs two cycles"

REASON = re.compile(r"(?P<invalid>measurement invalid: )?(?P<id>\w+)(?P<side>, side [+-])?: ")
"""How a reason begins that is about one metric or check."""


def minus(text: str) -> str:
    """Return a number's text with the minus sign that stands in all other texts."""
    return text.replace("-", "−")


def number(value: float | None, uncertainty: float | None = None) -> str:
    """Return a value as far as its uncertainty carries (two digits of it), else four digits; a dash for none."""
    if value is None:
        return "–"
    if uncertainty is not None and uncertainty > 0:
        decimals = 1 - floor(log10(uncertainty))
        if 0 <= decimals <= 6:
            return minus(f"{value:.{decimals}f}")
    text = f"{value:.4g}"
    return minus(text if "e" not in text else f"{value:.3e}")


def limits_text(limits: Limits) -> str:
    """Return limits as they are said: `≤ 1`, `≥ 108`, `95 … 120`, `≤ 1, s ≤ 0.02`, or nothing."""
    low, high, spread = limits.min, limits.max, limits.max_standard_deviation
    of_value = _range_text(None if low is None else f"{low:g}", None if high is None else f"{high:g}")
    of_spread = "" if spread is None else f"s ≤ {spread:g}"
    return ", ".join(text for text in (of_value, of_spread) if text)


def guarded_text(metric: MetricValue, decision: DecisionRule) -> str:
    """Return the limits for acceptance, moved in by w = r·U; nothing without guard band or uncertainty."""
    if decision.rule != "guard_band" or metric.uncertainty is None or not metric.limits:
        return ""
    width = decision.guard_factor * metric.uncertainty
    low, high = metric.limits.min, metric.limits.max
    limits = _range_text(
        None if low is None else number(low + width, width), None if high is None else number(high - width, width)
    )
    return f"accept {limits}" if limits else ""


def _range_text(low: str | None, high: str | None) -> str:
    if low is not None and high is not None:
        return minus(f"{low} … {high}")
    if low is not None:
        return minus(f"≥ {low}")
    return minus(f"≤ {high}") if high is not None else ""


class Named(Protocol):
    """What a metric is named by."""

    @property
    def id(self) -> str: ...  # noqa: D102
    @property
    def torque_nm(self) -> float | None: ...  # noqa: D102
    @property
    def choices(self) -> Sequence[str]: ...  # noqa: D102
    @property
    def branch(self) -> str: ...  # noqa: D102
    @property
    def side(self) -> str: ...  # noqa: D102


def metric_name(metric: Named) -> str:
    """Return a metric's id with torque, branch and side where they tell it from others."""
    parts = [metric.id]
    if metric.torque_nm is not None:
        parts.append(f"{metric.torque_nm:g} N·m")
    parts += metric.choices
    if metric.branch in ("load", "unload") or metric.id == "stiffness_50_100":
        parts.append(metric.branch)
    if metric.side in ("+", "-"):
        parts.append(f"side {minus(metric.side)}")
    return " ".join(parts)


def titled_reason(reason: str, titles: Mapping[str, str]) -> str:
    """Return a reason with the title of the metric or check that it begins with, and the id behind it."""
    found = REASON.match(reason)
    if found is None or not titles.get(found["id"]):
        return reason
    invalid = "Measurement invalid. " if found["invalid"] else ""
    side = minus(found["side"] or "")
    return f"{invalid}{titles[found['id']]}{side} [{found['id']}]: {reason[found.end() :]}"


def uncertainty_text(metric: MetricValue) -> str:
    """Return the expanded uncertainty with two digits, why there is none, or nothing."""
    if metric.uncertainty is None:
        return NO_UNCERTAINTY if metric.value is not None and metric.cycles == 1 else ""
    return plus_minus(metric.uncertainty)


def coverage_factor(metrics: Sequence[MetricValue]) -> float:
    """Return the k of the uncertainties of a run: the largest; that of records of before, which do not say it, too."""
    return max((one.coverage_factor or COVERAGE for one in metrics), default=COVERAGE)


def coverage_text(metrics: Sequence[MetricValue]) -> str:
    """Return `U (k = 2)` with the k of a run."""
    return f"U (k = {coverage_factor(metrics):g})"


def plus_minus(uncertainty: float) -> str:
    """Return an expanded uncertainty with two digits."""
    decimals = max(1 - floor(log10(uncertainty)), 0) if uncertainty > 0 else 0
    return f"± {uncertainty:.{decimals}f}" if decimals <= 6 else f"± {uncertainty:.1e}"


def unit_text(unit: str) -> str:
    """Return the unit as it stands behind a number; nothing for pure numbers."""
    return "" if unit == "1" else unit


def spread_text(row: MetricValue) -> str:
    """Return the expanded uncertainty of a row as it stands in a table; what `no U` means stands below it."""
    said = uncertainty_text(row)
    return "no U" if said == NO_UNCERTAINTY else said


def figure_text(value: Any, unit: str = "", digits: int = 5) -> str:
    """Return any figure of the record as text: numbers with five digits, a dash for none."""
    if value is None:
        return "–"
    text = (
        minus(f"{value:.{digits}g}") if isinstance(value, int | float) and not isinstance(value, bool) else str(value)
    )
    return f"{text} {unit_text(unit)}".rstrip()


def software_rows(software: Software) -> list[tuple[str, str]]:
    """Return what made a run, name and text: the program, its libraries, the computer; as far as the record says it."""
    changed = ", files changed since that commit" if software.changed else ""
    program = f"{software.name} {software.version}{changed}, Python {software.python}, {software.platform}"
    libraries = ", ".join(f"{name} {number}" for name, number in software.dependencies.items())
    return [
        ("software", program),
        *([("files of the program", f"SHA-256 {software.files_sha256}")] if software.files_sha256 else []),
        *([("libraries", libraries)] if libraries else []),
        *([("computer, user", f"{software.host}, {software.user}")] if software.host else []),
    ]
