"""Limits on trial: which verdicts of a lot would be others, and what that does to wrong decisions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from analysis.evaluation.guard_band import Measured, Risks, normal_process, risks_of_each
from analysis.evaluation.verdict import Verdict, check_limits, judge, worst
from analysis.loop.method import Decision
from analysis.trace.errors import AnalysisError
from analysis.uncertainty.scatter import USUAL
from recipes import Recipe, parse_recipe
from recipes.editing import changed
from station.documents.result import Result
from station.errors import StationError
from station.quality.judged_by import NOT_KNOWN, guard_of, judged_by, recipe_bytes
from station.quality.recipe_change import change_of, changed_recipe, definition_of, place_of
from station.records.revisions.history import History
from station.records.revisions.revision import Revision
from station.records.revisions.writing import save_draft
from station.records.run_record import RESULT, RunRecord
from station.store.plant.meanings import number_of, numbers_of
from station.store.quality.guard_bands import GuardBands
from station.store.quality.lot import Lot, Production
from station.store.quality.trial import Flip, Rule, TriedSide, flipped, flips, tried_runs, tried_sides
from station.store.quality.values import Characteristic, ValueRow, characteristic, newest_run, values
from station.store.rows.projection import meaning_of

LEAST_VALUES = 10
"""Values from which on a process is told from its sample."""


class Spread(NamedTuple):
    """Mean and true standard deviation of a process, and the root mean square u of its values; nan: not known."""

    mean: float
    sd_process: float
    u: float


@dataclass(frozen=True, slots=True)
class SideRisks:
    """Wrong decisions on one side before and after, for a normal process of this mean and true spread.

    why: why they cannot be told, in words; then both are None. on_trial: process and u by another definition, where
    one is on trial; without one only the rule differs.
    """

    side: str
    mean: float
    sd_process: float
    u: float
    before: Risks | None
    after: Risks | None
    why: str = ""
    on_trial: Spread | None = None


@dataclass(frozen=True, slots=True)
class Trial:
    """What new limits do to a lot: verdicts of runs before and after, those that flip, and the risks of each side.

    definition: the other one that was tried, '' for none. not_evaluated: runs that could not be evaluated by it, or
    whose verdict under other limits is not known, each with why; they are not counted. evaluated: how many were now,
    and known: how many had been before.
    """

    lot: Lot
    metric: Characteristic
    before: Rule
    after: Rule
    recipe_run: str
    runs: int
    verdicts: tuple[tuple[str, str, int], ...]
    flipped: tuple[Flip, ...]
    flips: int
    risks: tuple[SideRisks, ...]
    definition: str = ""
    not_evaluated: tuple[tuple[str, str], ...] = ()
    evaluated: int = 0
    known: int = 0


@dataclass(frozen=True, slots=True)
class Tried:
    """What is tried: limits (None keeps the one that is, nan takes it away), and the guard band as a multiple of U.

    guard_factor: 0 is the simple rule; None keeps the rule. definition: another one of the metric, as `definition_of`
    reads it; '' keeps the one that is.
    """

    metric: str
    branch: str | None = None
    limit_min: float | None = None
    limit_max: float | None = None
    guard_factor: float | None = None
    definition: str = ""


def limits_trial(production: Production, lot: Lot, tried: Tried, most: int = 20) -> Trial:
    """Return what other limits or another rule do to the newest valid first attempts of a lot.

    most: runs that flip which are named. Raises StationError for a lot without valid runs, a metric that it lacks, one
    whose verdict depends on its spread over cycles too, or nothing that is tried; AnalysisError for limits that exclude
    each other; RecipeError for a record whose recipe cannot be read. Another definition is tried by `definition_trial`.
    """
    lot = production.one_recipe(lot)
    what = characteristic(production, lot, tried.metric, tried.branch)
    run, before, after, _ = rules_of(production, lot, what, tried)
    check_limits(what.name, after.limit_min, after.limit_max)
    judged = judged_by(production, lot)
    counts = flips(production, lot, what, after, judged=judged)
    unknown = tried_runs(production, lot, what, after, judged=judged, known=False)
    changing = sum(number for (was, new), number in counts.items() if was != new)
    return Trial(
        lot,
        what,
        before,
        after,
        run,
        sum(counts.values()),
        tuple((was, new, number) for (was, new), number in counts.items()),
        tuple(flips_with_reasons(production, lot, what, after, most, judged=judged)),
        changing,
        tuple(side_risks(side, values(production, lot, what, side), before, after) for side in what.sides),
        not_evaluated=tuple((one.run, NOT_KNOWN) for one in unknown),
    )


def flips_with_reasons(
    production: Production, lot: Lot, what: Characteristic, rule: Rule, most: int, *, judged: GuardBands
) -> list[Flip]:
    """Return the newest runs that flip, newest first, each with what decides it."""
    found = flipped(production, lot, what, rule, most, judged=judged)
    sides = tried_sides(production, what, [one.run for one in found])
    return [one._replace(why=why_by_rule(what, sides[one.run], rule, one.after)) for one in found]


def why_by_rule(what: Characteristic, sides: Sequence[TriedSide], rule: Rule, after: str) -> str:
    """Return what decides the verdict of a run under a rule, in words: the worst side, or another metric of the run."""
    decision = Decision("simple") if rule.guard_factor is None else Decision("guard_band", rule.guard_factor)
    judged = [(one, *judge(one.value, one.uncertainty, (rule.limit_min, rule.limit_max), decision)) for one in sides]
    if rule.limit_min is None and rule.limit_max is None:
        return f"the metric {what.name} has no limit; {REST[after]}"
    verdict = worst(one for _, one, _ in judged)
    decisive = [(one, limit) for one, found, limit in judged if found is verdict]
    said = f"{what.name} {'; '.join(_of_side(one, verdict, limit, what, rule) for one, limit in decisive)}"
    return said if verdict == after else f"{said}; {REST[after]}"


REST = {
    "PASS": "no other metric of this run prevents a PASS",
    "FAIL": "another metric of this run is FAIL",
    "NOT DECIDABLE": "another metric of this run is NOT DECIDABLE",
}
"""What the other metrics of a run say, where they decide its verdict."""


def _of_side(one: TriedSide, verdict: Verdict, limit: str, what: Characteristic, rule: Rule) -> str:
    side = "" if one.side == "both" else f"side {one.side} "
    if one.value is None:
        return f"{side}has no value"
    if limit == "uncertainty":
        return f"{side}has no expanded uncertainty U, which a guard band needs"
    unit = "" if what.unit in ("", "1") else f" {what.unit}"
    bound = rule.limit_min if limit == "min" else rule.limit_max
    found, named = f"{side}{one.value:.6g}{unit}", f"{limit} {bound:.6g}{unit}"
    if verdict is Verdict.FAIL:
        return f"{found} is beyond {named}"
    return f"{found} is within {named}" if verdict is Verdict.PASS else f"{found} is too near to {named} for its U"


class Rules(NamedTuple):
    """The newest run of a lot, the rule of its recipe, the one that is tried, and that recipe."""

    run: str
    before: Rule
    after: Rule
    recipe: Recipe


def rules_of(production: Production, lot: Lot, what: Characteristic, tried: Tried) -> Rules:
    """Return the rule of the newest run's recipe for a metric, and the one that is tried.

    Raises:
        StationError: nothing is tried, or the recipe limits the spread of the metric too. RecipeError: of that recipe.

    """
    run = newest_run(production, lot)
    recipe = recipe_of(production, lot)
    spread = [one for one in recipe.metrics if one.id == what.metric and one.max_standard_deviation is not None]
    if spread and not tried.definition:
        raise StationError(
            f"{what.name}: the recipe also limits the standard deviation over cycles of this metric, which the store "
            "of runs does not have. Evaluate the runs with 'lostmotion analyze --recipe'"
        )
    guard = guard_of(recipe)
    before = Rule(what.limit_min, what.limit_max, guard)
    after = Rule(
        _limit(tried.limit_min, what.limit_min),
        _limit(tried.limit_max, what.limit_max),
        guard if tried.guard_factor is None else (tried.guard_factor or None),
    )
    if after == before and not (tried.definition and _differs(recipe, what.metric, tried.definition)):
        raise StationError(
            "what is to be tried is what the recipe has. Give another limit, another guard band or another definition"
        )
    return Rules(run, before, after, recipe)


def _differs(recipe: Recipe, metric: str, definition: str) -> bool:
    """Return whether a definition is another one than that of the recipe."""
    reference_nm = recipe.measurement.reference_torque_nm
    wanted, _ = definition_of(recipe, metric, definition)
    return wanted.key(reference_nm) != recipe.metrics[place_of(recipe, metric)].key(reference_nm)


def _limit(tried: float | None, there: float | None) -> float | None:
    if tried is None:
        return there
    return None if math.isnan(tried) else tried


def recipe_of(production: Production, lot: Lot) -> Recipe:
    """Return the recipe of the newest run of a lot; StationError where there is none, or as `recipe_bytes`."""
    path, content = recipe_bytes(production.chain.data, newest_run(production, lot))
    return parse_recipe(content, str(path))


def side_risks(
    side: str, rows: Sequence[ValueRow], before: Rule, after: Rule, tried: Sequence[ValueRow] | None = None
) -> SideRisks:
    """Return the risks of a side: the spread of the values is that of the process and of the measuring together.

    tried: its values by another definition, which the rule after is for; None: the same values.
    """
    now, of_now, why = _risks_of(rows, before)
    then, of_then, why_then = _risks_of(rows if tried is None else tried, after)
    why = why or why_then
    if why:
        of_now = of_then = None
    return SideRisks(side, *now, of_now, of_then, why, None if tried is None else then)


def _risks_of(rows: Sequence[ValueRow], rule: Rule) -> tuple[Spread, Risks | None, str]:
    """Return the process that values are of, and its risks under a rule with u and U of each value, or why none."""
    guard_factor = rule.guard_factor or 0.0
    measured = [
        Measured(row.uncertainty / (row.coverage_factor or USUAL.factor), guard_factor * row.uncertainty)
        for row in rows
        if row.uncertainty is not None
    ]
    numbers = [row.value for row in rows]
    mean = sum(numbers) / len(numbers) if numbers else math.nan
    if len(numbers) < LEAST_VALUES or len(measured) < len(numbers):
        return Spread(mean, math.nan, math.nan), None, f"needs {LEAST_VALUES} values with U"
    variance = sum((one - mean) ** 2 for one in numbers) / (len(numbers) - 1)
    u = math.sqrt(sum(one.u**2 for one in measured) / len(measured))
    if not variance > u**2 > 0.0:
        return Spread(mean, math.nan, u), None, "the values scatter no more than U explains"
    found = Spread(mean, math.sqrt(variance - u**2), u)
    try:
        process = normal_process(mean, found.sd_process)
        return found, risks_of_each(process, rule.limit_min, rule.limit_max, measured), ""
    except AnalysisError as error:
        return found, None, str(error)


def check_entry(data: Path, run: str, recipe: Recipe, what: Characteristic) -> None:
    """Refuse a metric that is not what the entry of its id in the recipe of a run asks for: that would be changed.

    Raises:
        StationError: a preset of the recipe asks for the metric, and its entry for another definition of it; as
        `place_of`.

    """
    named = f"run {run}: recipe.yaml"
    place, metrics = place_of(recipe, what.metric, named), RunRecord(data / run).read(Result, RESULT).metrics
    if sum(one.id == what.metric for one in metrics) == 1:
        return
    entry = metrics[place]
    if number_of(meaning_of(entry)) not in numbers_of(what.meaning):
        there = " ".join((entry.id, *entry.choices, entry.branch))
        raise StationError(
            f"{named}: a preset asks for {what.name}; the entry of {what.metric} under 'metrics' is {there}. Choose "
            "that one, or put the other into the recipe by hand on the page Recipes"
        )


def draft_of(data: Path, found: Trial, person: str) -> Revision:
    """Save the recipe of the newest run with what was tried as the draft of its next revision; as `draft_text`.

    Raises RevisionError too: it cannot be saved.
    """
    return save_draft(data, draft_text(data, found), person)


def draft_text(data: Path, found: Trial) -> bytes:
    """Return the recipe of the newest run with what was tried, as the text of its next revision.

    Raises:
        StationError: the recipe does not ask for the metric itself, or more than once, or is not as it was.
        RecipeError: the text is none.

    """
    path, content = recipe_bytes(data, found.recipe_run)
    recipe = parse_recipe(content, str(path))
    metric = found.metric.metric
    check_entry(data, found.recipe_run, recipe, found.metric)
    definition = definition_of(recipe, metric, found.definition)[1] if found.definition else ()
    change = change_of(metric, found.before, found.after, definition)
    content = changed_recipe(content, change, f"run {found.recipe_run}: {path.name}")
    revision = max(History(data).next_revision(recipe.recipe.name), recipe.recipe.revision + 1)
    content = changed(content, ("recipe", "revision"), str(revision))
    parse_recipe(content, str(path))
    return content
