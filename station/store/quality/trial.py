"""Verdicts of a lot under other limits or another decision rule, as the database finds them from value and U.

The rules are those of `analysis.evaluation.verdict`, said in SQL: a test holds both against each other, run by run.

An evaluation may know more than value and U: a gap, an interrupted ramp or a converted torque that a PASS would owe
itself to. Where that left a metric not decidable whose value and U would have passed, no limit makes it a PASS here.
A run by a recipe whose guard band nobody knows is not known where its verdict may owe itself to such a doubt. The other
metrics of a run are judged by their own limits and the rule on trial.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Select, and_, case, false, func, literal, null, or_, select, true

from station.store.plant.meanings import numbers_of
from station.store.quality.guard_bands import GuardBands
from station.store.quality.lot import Lot, Production
from station.store.quality.values import Characteristic, metrics_from
from station.store.tables import METRICS, RUNS

RANKS = {"PASS": 0, "NOT DECIDABLE": 1, "FAIL": 2}
"""Verdicts from the best to the worst: the worst of several is that of all."""

NAMES = {rank: name for name, rank in RANKS.items()}


class Rule(NamedTuple):
    """Limits of a metric, and the guard band as a multiple of U; guard_factor None: the simple rule, without one."""

    limit_min: float | None
    limit_max: float | None
    guard_factor: float | None


class Flip(NamedTuple):
    """A run whose verdict is another under the new rule; why: what decides by the rule, in words."""

    run: str
    serial: str
    before: str
    after: str
    why: str = ""


def flips(
    production: Production, lot: Lot, what: Characteristic, rule: Rule, *, judged: GuardBands
) -> dict[tuple[str, str], int]:
    """Return how many valid first attempts there are of each verdict now and under the rule."""
    runs = _runs(production, lot, what, rule, judged)
    asked = select(runs.c.before, runs.c.after, func.count()).group_by(runs.c.before, runs.c.after)
    found = {(before, NAMES[after]): number for before, after, number in production.connection.execute(asked)}
    return dict(sorted(found.items()))


def flipped(
    production: Production, lot: Lot, what: Characteristic, rule: Rule, most: int, *, judged: GuardBands
) -> list[Flip]:
    """Return the newest runs that flip, newest first."""
    runs = _runs(production, lot, what, rule, judged)
    names = case(NAMES, value=runs.c.after)
    asked = select(runs.c.run, runs.c.serial, runs.c.before, names).where(runs.c.before != names)
    asked = asked.order_by(runs.c.run.desc()).limit(most)
    return [Flip(*row) for row in production.connection.execute(asked).tuples()]


class TriedRun(NamedTuple):
    """A run with its verdict, and the one under the rule; sha256: of its run.json."""

    run: str
    serial: str
    sha256: str
    before: str
    after: str


def tried_runs(
    production: Production, lot: Lot, what: Characteristic, rule: Rule, *, judged: GuardBands, known: bool = True
) -> list[TriedRun]:
    """Return every valid first attempt that has the metric, oldest first.

    known: False returns those, and only those, whose verdict under the rule is not known.
    """
    if not known and not judged.differ:
        return []
    runs = _runs(production, lot, what, rule, judged, known=known)
    together = (RUNS.c.chain == production.chain.id) & (RUNS.c.run == runs.c.run)
    columns = (
        runs.c.run,
        runs.c.serial,
        func.coalesce(RUNS.c.sha256, ""),
        runs.c.before,
        case(NAMES, value=runs.c.after),
    )
    asked = select(*columns).select_from(runs).join(RUNS, together).order_by(runs.c.run)
    return [TriedRun._make(row) for row in production.connection.execute(asked).tuples()]


class TriedSide(NamedTuple):
    """A side of the metric in a run, by which the rule judges it."""

    side: str
    value: float | None
    uncertainty: float | None


def tried_sides(production: Production, what: Characteristic, runs: Sequence[str]) -> dict[str, list[TriedSide]]:
    """Return the sides of a metric in each of some runs."""
    found: dict[str, list[TriedSide]] = {run: [] for run in runs}
    if not found:
        return found
    asked = select(METRICS.c.run, METRICS.c.side, METRICS.c.value, METRICS.c.uncertainty)
    asked = asked.where(metrics_from(production, min(found)), METRICS.c.run <= max(found))
    asked = asked.where(METRICS.c.meaning.in_(numbers_of(what.meaning)))
    for run, *side in production.connection.execute(asked.order_by(METRICS.c.run, METRICS.c.side)):
        if run in found:
            found[run].append(TriedSide(*side))
    return found


def _runs(
    production: Production, lot: Lot, what: Characteristic, rule: Rule, judged: GuardBands, *, known: bool = True
) -> Any:
    """Return a table of the runs that have the metric: their verdict, and the rank of the one under the rule."""
    runs = production.chosen(lot, RUNS.c.valid, newest=lot.newest)
    this = METRICS.c.meaning.in_(numbers_of(what.meaning))
    was, rank = judged.band(), rank_under(rule)
    limited = rule.limit_min is not None or rule.limit_max is not None
    rank = _or_undecided(_is_doubted(was), rank) if limited else rank
    new = func.max(case((this, rank), else_=null()))
    others = func.max(case((~this, _rank_of_other(rule, judged, was)), else_=null()))
    nowhere = and_(judged.is_unknown(), _is_doubted(literal(0.0)), or_(~this, literal(limited)))
    hidden = func.max(case((nowhere, 1), else_=0))
    oldest = production.oldest_of(lot, RUNS.c.valid, newest=lot.newest)
    together = (METRICS.c.chain == runs.c.chain) & (METRICS.c.run == runs.c.run)
    columns = (runs.c.run, runs.c.serial, new.label("new"), func.coalesce(others, 0).label("others"))
    grouped: Select[Any] = select(*columns, hidden.label("hidden")).select_from(runs).join(METRICS, together)
    grouped = judged.with_recipes(grouped, runs).where(metrics_from(production, oldest))
    of = grouped.group_by(runs.c.run, runs.c.serial).subquery()
    after = case((of.c.new > of.c.others, of.c.new), else_=of.c.others)
    asked = select(of.c.run, of.c.serial, RUNS.c.verdict.label("before"), after.label("after"))
    asked = asked.select_from(of).join(RUNS, (RUNS.c.chain == production.chain.id) & (RUNS.c.run == of.c.run))
    asked = asked.where(RUNS.c.run >= oldest, of.c.hidden == (0 if known else 1))
    return asked.where(of.c.new.is_not(None)).subquery()


def _rank_now() -> ColumnElement[Any]:
    return case(RANKS, value=METRICS.c.verdict)


def _rank_of_other(rule: Rule, judged: GuardBands, was: ColumnElement[Any]) -> ColumnElement[Any]:
    """Return the rank of a side of another metric by its own limits and the rule on trial.

    By the rule that it was judged by it is the stored one. A value that failed within its limits did so by its spread.
    """
    here = METRICS.c
    again = rank_by(here.limit_min, here.limit_max, rule.guard_factor)
    unlimited = and_(here.limit_min.is_(None), here.limit_max.is_(None))
    by_spread = and_(here.verdict == "FAIL", _is_within(literal(0.0)))
    stays = or_(here.verdict.is_(None), unlimited, by_spread, judged.is_judged_by(rule.guard_factor))
    return case((stays, _rank_now()), else_=_or_undecided(_is_doubted(was), again))


def _or_undecided(doubted: ColumnElement[bool], rank: ColumnElement[Any]) -> ColumnElement[Any]:
    """Return the rank of a side, or that it is not decidable where it was doubted and would pass."""
    undecided = RANKS["NOT DECIDABLE"]
    return case((and_(doubted, rank < undecided), literal(undecided)), else_=rank)


def _is_doubted(guard: ColumnElement[Any]) -> ColumnElement[bool]:
    """Whether a side was not decidable although value and U passed by the limits and the guard band of its run."""
    here = METRICS.c
    limited = or_(here.limit_min.is_not(None), here.limit_max.is_not(None))
    return and_(here.verdict == "NOT DECIDABLE", limited, _is_within(guard))


def _is_within(guard: ColumnElement[Any]) -> ColumnElement[bool]:
    """Whether value and U of a side pass by its own limits and a guard band in its unit."""
    here = METRICS.c
    return and_(
        or_(here.limit_min.is_(None), here.value - here.limit_min >= guard),
        or_(here.limit_max.is_(None), here.limit_max - here.value >= guard),
    )


def rank_under(rule: Rule) -> ColumnElement[Any]:
    """Return the rank of the verdict of a side under a rule."""
    low, high = (None if one is None else literal(one) for one in (rule.limit_min, rule.limit_max))
    return rank_by(low, high, rule.guard_factor)


def rank_by(
    low: ColumnElement[Any] | None, high: ColumnElement[Any] | None, guard_factor: float | None
) -> ColumnElement[Any]:
    """Return the rank of the verdict of a side by limits and a guard band; None, or NULL: no limit."""
    value, u = METRICS.c.value, METRICS.c.uncertainty
    guard = literal(0.0) if guard_factor is None else guard_factor * u
    overs = [low - value] if low is not None else []
    overs += [value - high] if high is not None else []
    if not overs:
        return literal(RANKS["PASS"])
    unknown = value.is_(None) if guard_factor is None else or_(value.is_(None), u.is_(None))
    beyond = or_(*(func.coalesce(over > guard, false()) for over in overs))
    within = and_(*(func.coalesce(over <= -guard, true()) for over in overs))
    ranks = ((unknown, RANKS["NOT DECIDABLE"]), (beyond, RANKS["FAIL"]), (within, RANKS["PASS"]))
    return case(*ranks, else_=RANKS["NOT DECIDABLE"])
