"""Another definition of a metric on trial: every run of a lot evaluated anew, by its own recipe with this one change.

The store has no value by another definition, so the traces are evaluated, 0.2 to 0.4 s of a processor each. An
evaluation gives limits and decision rule their say too; so a verdict on trial is that of evaluating the run alone by
its recipe with the change, and what is saved as a draft is that recipe. The ledger of the question keeps each answer:
a trial that was ended goes on where it ended, and one that is known is there at once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from analysis.evaluation.verdict import check_limits
from station.archive.settings import load_settings
from station.counted import counted
from station.quality.limits_trial import Trial, Tried, check_entry, rules_of, side_risks
from station.quality.recipe_change import definition_of, place_of, whole_change
from station.records.archive_note import SETTINGS
from station.reevaluation.jobs import jobs_for
from station.reevaluation.ledger import LedgerLine
from station.reevaluation.question import Question
from station.reevaluation.run_question import Told, ask_of_jobs
from station.store.quality.guard_bands import GuardBands
from station.store.quality.lot import Lot, production
from station.store.quality.trial import Flip, tried_runs
from station.store.quality.values import ValueRow, characteristic, values

PASSES = "every metric of this run passes"
"""Why a run passes that did not."""


def definition_trial(  # noqa: PLR0917 - what is tried on what, and how
    data: Path, lot: Lot, tried: Tried, workers: int = 1, most: int = 20, told: Told = lambda _done, _of: None
) -> Trial:
    """Return what another definition of a metric does to the newest valid first attempts of a lot.

    workers: processes that evaluate. most: runs that flip which are named. told: hears of the runs that are done and of
    how many there are.

    Raises:
        StationError: as `limits_trial` and `check_entry`, or another process has the same on trial; the definition is
        in another unit. RecipeError: it is none. AnalysisError: the limits exclude each other.

    """
    with production(data) as look:
        lot = look.one_recipe(lot)
        what = characteristic(look, lot, tried.metric, tried.branch)
        run, before, after, recipe = rules_of(look, lot, what, tried)
        check_limits(what.name, after.limit_min, after.limit_max)
        check_entry(data, run, recipe, what)
        _, definition = definition_of(recipe, what.metric, tried.definition)
        rows = tried_runs(look, lot, what, after, judged=GuardBands.of_all(before.guard_factor))
        there = {side: values(look, lot, what, side) for side in what.sides}
        spread = recipe.metrics[place_of(recipe, what.metric)].max_standard_deviation
    question = Question(change=whole_change(what.metric, after, spread, definition))
    archive = load_settings(data) if (data / SETTINGS).is_file() else None
    wanted = jobs_for(data, [(one.run, one.serial, one.sha256, one.before) for one in rows], archive)
    found = ask_of_jobs(data, question, wanted, workers, told)
    flips = [line for line in found.lines if line.before != line.after]
    changes = sorted(Counter((line.before, line.after) for line in found.lines).items())
    then = _sides(found.lines)
    return Trial(
        lot,
        what,
        before,
        after,
        run,
        len(found.lines),
        tuple((was, new, number) for (was, new), number in changes),
        tuple(_flip(one) for one in reversed(flips[-most:])) if most else (),
        len(flips),
        tuple(
            side_risks(side, there.get(side, []), before, after, then.get(side, []))
            for side in dict.fromkeys((*there, *then))
        ),
        definition=" ".join(tried.definition.split()),
        not_evaluated=tuple(sorted(found.failed.items())),
        evaluated=found.evaluated,
        known=found.known,
    )


def _flip(line: LedgerLine) -> Flip:
    first, more = line.reasons[:1], len(line.reasons) - 1
    why = "".join((*first, f"; and {counted(more, 'further reason')}" if more > 0 else "")) or PASSES
    return Flip(line.run, line.serial, line.before, line.after, why)


def _sides(lines: Sequence[LedgerLine]) -> dict[str, list[ValueRow]]:
    """Return the values of each side by the other definition."""
    found: dict[str, list[ValueRow]] = {}
    for line in lines:
        for one in (side for metric in line.metrics for side in metric.sides):
            if one.value is not None:
                row = ValueRow(line.run, line.serial, "", "", one.value, one.uncertainty, one.coverage_factor)
                found.setdefault(one.side, []).append(row)
    return found
