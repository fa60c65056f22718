"""What stands below the metrics of a result: how far they can be trusted, what was corrected, what failed."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping
from typing import Any

from analysis import GATES, Decision, Verdict, is_loose, judge
from analysis.metric_definition import SIDED
from station.reports.content import uncertainty_kind
from station.reports.result_text import figure_text, limits_text, metric_name, number, uncertainty_text

CORRECTIONS = ("time alignment", "drift", "fixture")
"""Stages that move what was measured, and are named when they did."""

RECIPE_NOTE = "recipe "
"""How the note begins that a recipe's name and revision have meant something else before."""

FAULTS_NOTE = "faults were injected"
"""How the note begins that names the scenario of a run."""

ONE_SIDE = tuple({side} for side in SIDED)
"""Sides of a metric that was judged on one of its two."""

MOST_NOTES = 4

FULL_GUARD = Decision("guard_band", 1.0)
"""Guard band as wide as U: what it leaves undecided lies nearer to its limit than it is known."""


def note_lines(result: Mapping[str, Any]) -> list[str]:
    """Return the notes that a person should see: warnings of the run, and corrections that were applied."""
    stages = [stage for stage in result.get("stages") or () if isinstance(stage, Mapping)]
    said = {stage.get("text") for stage in stages}
    notes = [str(note) for note in result.get("notes") or () if note not in said]
    if not stages:
        notes = [note for note in notes if note.startswith(RECIPE_NOTE)]
    applied = [stage for stage in stages if stage.get("applied")]
    notes = (
        fault_notes(result)
        + one_sided(result)
        + within_uncertainty(result)
        + loose_limits(result)
        + [note for note in notes if not note.startswith(FAULTS_NOTE)]
    )
    notes += [str(stage["text"]) for stage in applied if stage.get("stage", stage.get("name")) in CORRECTIONS]
    left = len(notes) - MOST_NOTES
    return notes if left <= 0 else [*notes[:MOST_NOTES], f"and {left} more, in the report"]


def fault_notes(result: Mapping[str, Any]) -> list[str]:
    """Return one note that names the scenario by which faults were injected; none where none were."""
    said = [str(note) for note in result.get("notes") or () if str(note).startswith(FAULTS_NOTE)]
    return said or ([f"{FAULTS_NOTE}: {result['scenario']}"] if result.get("scenario") else [])


def one_sided(result: Mapping[str, Any]) -> list[str]:
    """Return one note on the metrics with a limit that were judged on one side of the two they have; none where none.

    The side that was not asked for may be the bad one. A metric of the whole loop has one side, `both`, and is not
    meant; nor is one that the recipe asks for on each side by itself, with limits of their own.
    """
    sides: defaultdict[str, set[str]] = defaultdict(set)
    limited = [metric for metric in result.get("metrics") or () if _has_limit(metric)]
    for metric in limited:
        sides[_whole_name(metric)] |= set(metric.get("sides") or ())
    alone = [metric_name(metric) for metric in limited if sides[_whole_name(metric)] in ONE_SIDE]
    return [f"judged on one side alone: {', '.join(alone)}"] if alone else []


def _has_limit(metric: Mapping[str, Any]) -> bool:
    return any(limit is not None for limit in (metric.get("limits") or {}).values())


def _whole_name(metric: Mapping[str, Any]) -> str:
    return metric_name({**metric, "side": ""})


def within_uncertainty(result: Mapping[str, Any]) -> list[str]:
    """Return one note on what the rule `simple` decided nearer to a limit than its uncertainty; none where nothing."""
    if (result.get("decision") or {}).get("rule") != "simple":
        return []
    said = [
        f"{metric_name({**metric, 'side': side})} {number(row['value'], row['uncertainty'])} {uncertainty_text(row)} "
        f"(limit {limits_text(metric['limits'])})"
        for metric in result.get("metrics") or ()
        for side, row in (metric.get("sides") or {}).items()
        if row["uncertainty"] is not None and _undecided(metric, row)
    ]
    return (
        [f"nearer to its limit than its uncertainty, which rule simple leaves out: {', '.join(said)}"] if said else []
    )


def _undecided(metric: Mapping[str, Any], row: Mapping[str, Any]) -> bool:
    limits = metric["limits"]["min"], metric["limits"]["max"]
    return judge(row["value"], row["uncertainty"], limits, FULL_GUARD)[0] is Verdict.NOT_DECIDABLE


def loose_limits(result: Mapping[str, Any]) -> list[str]:
    """Return one note on the validity limits that let more pass than the usual ones; none where none does."""
    said = [
        f"{name} {figure_text(gate['limit'], gate['unit'])} ({figure_text(GATES[name].limit, gate['unit'])})"
        for gate in result.get("gates") or ()
        if (name := gate.get("id")) in GATES and is_loose(name, gate["limit"])
    ]
    return [f"validity limits of the recipe wider than usual (in brackets): {', '.join(said)}"] if said else []


def gate_lines(result: Mapping[str, Any]) -> list[str]:
    """Return one line per failed gate, with its figure and limit; empty when none failed."""
    return [
        f"{gate.get('id')}: {figure_text(gate.get('figure'), gate.get('unit') or '')}, "
        f"limit {figure_text(gate.get('limit'), gate.get('unit') or '')}"
        for gate in result.get("gates") or ()
        if gate.get("passed") is False
    ]


def summary_line(result: Mapping[str, Any]) -> str:
    """Return in one line what U is, and how many gates were in order; nothing for a run without metrics."""
    metrics = result.get("metrics") or []
    parts = [uncertainty_kind(metrics)] if metrics else []
    counts = Counter(gate.get("passed") for gate in result.get("gates") or ())
    if counts and not counts[False] and metrics:
        skipped = f", {counts[None]} do not apply" if counts[None] else ""
        parts.append(f"{counts[True]} validity gates in order{skipped}.")
    return " ".join(parts)
