"""What stands below the metrics of a result: how far they can be trusted, what was corrected, what failed."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace

from analysis.evaluation.verdict import Verdict, judge
from analysis.loop.method import Decision
from analysis.validity.judge import is_loose
from definitions.checks import CHECKS
from definitions.commissioning import CHANGED, UNFINISHED
from definitions.method import LEAST_USUAL_GUARD
from definitions.metrics import SIDED
from definitions.protections import MISSING
from station.documents.manifest import MASTER
from station.documents.result import MetricValue, Result
from station.reports.content import check_title, checks_line, open_line, other_notes, shown_checks, uncertainty_kind
from station.reports.metric_sides import on_side
from station.reports.result_text import figure_text, limits_text, metric_name, number, uncertainty_text

CORRECTIONS = ("time alignment", "drift", "fixture")
"""Stages that move what was measured, and are named when they did."""

RECIPE_NOTE = "recipe "
"""How notes on the recipe begin: an odd limit, or that its name and revision have meant something else before."""

FAULTS_NOTE = "faults were injected"
"""How the note begins that names the scenario of a run."""

ONE_SIDE = tuple({side} for side in SIDED)
"""Sides of a metric that was judged on one of its two."""

MOST_NOTES = 4

FULL_GUARD = Decision("guard_band", 1.0)
"""Guard band as wide as U: what it leaves undecided lies nearer to its limit than it is known."""


def note_lines(result: Result) -> list[str]:
    """Return the notes that a person should see: warnings of the run, and corrections that were applied."""
    stages = result.stages
    notes = list(other_notes(result))
    if not stages:
        notes = [note for note in notes if note.startswith(RECIPE_NOTE)]
    applied = [stage for stage in stages if stage.applied]
    notes = (
        fault_notes(result)
        + [note for note in notes if note.startswith(MASTER)]
        + [note for note in result.notes if note.startswith((CHANGED, UNFINISHED))]
        + [note for note in notes if note.startswith(RECIPE_NOTE)]
        + missing_protections(result)
        + one_sided(result)
        + within_uncertainty(result)
        + not_cross_checked(result)
        + loose_limits(result)
        + [
            note
            for note in notes
            if not note.startswith((FAULTS_NOTE, MASTER, MISSING, CHANGED, UNFINISHED, RECIPE_NOTE))
        ]
    )
    notes += [stage.text for stage in applied if stage.stage in CORRECTIONS]
    left = len(notes) - MOST_NOTES
    return notes if left <= 0 else [*notes[:MOST_NOTES], f"and {left} more, in the report"]


def fault_notes(result: Result) -> list[str]:
    """Return one note that names the scenario by which faults were injected; none where none were."""
    said = [note for note in result.notes if note.startswith(FAULTS_NOTE)]
    return said or ([f"{FAULTS_NOTE}: {result.scenario}"] if result.scenario else [])


def missing_protections(result: Result) -> list[str]:
    """Return one note on the protections that the bench's drive does not have; none where it has all of them."""
    said = [note.removeprefix(MISSING).split(". ")[0] for note in result.notes if note.startswith(MISSING)]
    return [f"{MISSING}{'; '.join(said)}"] if said else []


def one_sided(result: Result) -> list[str]:
    """Return one note on the metrics with a limit that were judged on one side of the two they have; none where none.

    The side that was not asked for may be the bad one. A metric of the whole loop has one side, `both`, and is not
    meant; nor is one that the recipe asks for on each side by itself, with limits of their own.
    """
    sides: defaultdict[str, set[str]] = defaultdict(set)
    limited = [metric for metric in result.metrics if metric.limits]
    for metric in limited:
        sides[_whole_name(metric)] |= set(metric.sides)
    alone = [metric_name(metric) for metric in limited if sides[_whole_name(metric)] in ONE_SIDE]
    return [f"judged on one side only: {', '.join(alone)}"] if alone else []


def _whole_name(metric: MetricValue) -> str:
    return metric_name(replace(metric, side=""))


def within_uncertainty(result: Result) -> list[str]:
    """Return one note on what was decided nearer to a limit than its uncertainty; none where nothing.

    The rule `simple` decides so, and a guard band that is narrower than usual.
    """
    guarded, factor = result.decision.rule == "guard_band", result.decision.guard_factor
    if guarded and factor >= LEAST_USUAL_GUARD:
        return []
    why = f"guard_factor {factor:g}, usual is {LEAST_USUAL_GUARD:g} or more" if guarded else "rule simple ignores U"
    used = Decision("guard_band", factor) if guarded else Decision("simple")
    said = [
        f"{metric_name(row)} {number(row.value, row.uncertainty)} {uncertainty_text(row)} "
        f"(limit {limits_text(metric.limits)})"
        for metric in result.metrics
        for row in (on_side(metric, side, found) for side, found in metric.sides.items())
        if row.uncertainty is not None and _undecided(row, FULL_GUARD) and not _undecided(row, used)
    ]
    return [f"decided within the uncertainty of the limit ({why}): {', '.join(said)}"] if said else []


def _undecided(row: MetricValue, decision: Decision) -> bool:
    limits = row.limits.min, row.limits.max
    return judge(row.value, row.uncertainty, limits, decision)[0] is Verdict.NOT_DECIDABLE


def not_cross_checked(result: Result) -> list[str]:
    """Return one note where nothing held the gain of the torque and the ratio against each other; none elsewhere."""
    unread = [check for check in result.gates if check.id == "ratio_agreement"]
    if not unread or unread[0].passed is not None:
        return []
    return ["torque gain and gear ratio not cross-checked: an error in either is in every stiffness, but not in U"]


def loose_limits(result: Result) -> list[str]:
    """Return one note on the validity limits that let more pass than the usual ones; none where none does."""
    said = [
        f"{check.id} {figure_text(check.limit, check.unit)} ({figure_text(CHECKS[check.id].limit, check.unit)})"
        for check in result.gates
        if check.id in CHECKS and check.limit is not None and is_loose(check.id, check.limit)
    ]
    return (
        [f"validity limits wider than usual in the recipe (usual ones in brackets): {', '.join(said)}"] if said else []
    )


def check_lines(result: Result) -> list[str]:
    """Return one line per failed check, with its figure and limit; empty when none failed."""
    return [
        f"{check_title(check)}: ".removeprefix(": ")
        + f"{figure_text(check.figure, check.unit)}, "
        + f"limit {figure_text(check.limit, check.unit)}  {check.id}"
        for check in result.gates
        if check.passed is False
    ]


def summary_lines(result: Result) -> list[str]:
    """Return what ± is, how many checks passed, and what they leave open; nothing for a run without metrics."""
    metrics = result.metrics
    said = (uncertainty_kind(metrics), checks_line(shown_checks(result)), open_line(result)) if metrics else ()
    return [line for line in said if line]
