"""Limits on many runs: a statement on value and U in the store, and its answer as outcomes of the ledger."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from sqlalchemy import select

from analysis.evaluation.verdict import check_limits
from station.quality.judged_by import NOT_KNOWN, judged_by
from station.quality.limits_trial import Tried, rules_of, why_by_rule
from station.reevaluation.evaluate_one import Job, Outcome, software_key
from station.reevaluation.jobs import Where
from station.reevaluation.question import LimitsQuestion, ReevaluationError
from station.store.quality.lot import Lot, production
from station.store.quality.trial import TriedRun, tried_runs, tried_sides
from station.store.quality.values import characteristic
from station.store.tables import RUNS

CANNOT = ("serial", "operator", "verdict")


class LimitsAnswers(NamedTuple):
    """Each run with its verdict under other limits, and the hash of all that these depend on beside the run."""

    hash: str
    outcomes: list[tuple[Job, Outcome]]


def limits_outcomes(data: Path, question: LimitsQuestion, where: Where) -> LimitsAnswers:
    """Return the valid first attempts that fit, oldest first, each with its verdict under other limits.

    Real units, and those of the virtual bench where there are no others. What the question leaves open, another limit
    or the rule, is that of the newest run; so it is part of the hash. A run of which is not known by which rule it was
    judged has an error, where its answer depends on that.

    Raises:
        StationError: no run fits, or the metric is none of theirs; AnalysisError: the limits exclude each other.

    """
    named = next((name for name in CANNOT if getattr(where, name) is not None), None)
    if named is not None:
        raise ReevaluationError(
            f"--where {named}: cannot be used together with --limits; allowed are recipe, model, bench, since, until"
        )
    with production(data) as look:
        lot = Lot(where.recipe, where.model, where.bench, where.since, where.until, newest=None)
        if look.connection.execute(look.of(select(RUNS.c.run), lot).limit(1)).first() is None:
            lot = lot._replace(virtual=True)
        lot = look.one_recipe(lot)
        what = characteristic(look, lot, question.metric, question.branch)
        tried = Tried(question.metric, question.branch, question.minimum, question.maximum, question.guard)
        rule = rules_of(look, lot, what, tried).after
        check_limits(what.name, rule.limit_min, rule.limit_max)
        judged = judged_by(look, lot)
        rows = tried_runs(look, lot, what, rule, judged=judged)
        unknown = tried_runs(look, lot, what, rule, judged=judged, known=False)
        sides = tried_sides(look, what, [one.run for one in rows if one.before != one.after])
    why = {one.run: (why_by_rule(what, sides[one.run], rule, one.after),) for one in rows if one.run in sides}
    found = [
        (_job(one), Outcome(one.run, one.after, why.get(one.run, ()), software=software_key()))
        for one in rows
    ]  # fmt: skip
    found += [(_job(one), Outcome(one.run, error=NOT_KNOWN, software=software_key())) for one in unknown]
    return LimitsAnswers(question.hash_with((rule, what.meaning)), sorted(found, key=lambda one: one[0].run))


def _job(one: TriedRun) -> Job:
    return Job(one.run, one.serial, one.sha256, one.before)
