"""What became of the attempts of a unit before each of its runs, as the store has them.

A run folder says it of itself (`before` in run.json). A list of thousands of runs does not read their folders for it.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from sqlalchemy import Connection, and_, or_, select

from definitions.metrics import METRICS as DEFINED
from station.documents.manifest import INJECTED, SIMULATED, EarlierAttempt, attempt_text
from station.records.attempts import MOST as MOST_BEFORE
from station.records.chain.chain_file import Chain
from station.records.chain.walk import Trust
from station.records.run_record import NOT_CONCLUDED
from station.store.plant.hours import FAIL, UNDECIDED
from station.store.plant.meanings import meaning_of_metrics
from station.store.stored_runs import COLUMNS, MOST_NAMED, StoredRun, believed
from station.store.tables import ATTEMPTS, MEANINGS, METRICS, RUNS

FIRST = 1
ALTERED = "altered"


class _Of(NamedTuple):
    """A run that was begun: which attempt at which unit it is."""

    run: str
    serial: str
    attempt: int


def attempts_told(connection: Connection, chain: Chain, trust: Trust, runs: Iterable[StoredRun]) -> dict[str, str]:
    """Return of each run which attempt it is and what became of those before, as 'attempt 2; attempt 1 FAIL Backlash'.

    An earlier attempt whose record is not as it was left has no verdict here either.
    """
    wanted = list(runs)
    again = [one for one in wanted if one.attempt > FIRST]
    before = _before(connection, chain, again) if again else []
    ended = _ended(connection, chain, trust, before)
    failed = _judged(connection, chain, {one.run: FAIL for one in ended.values() if one.verdict == FAIL})
    of_unit: dict[str, list[EarlierAttempt]] = {}
    for one in before:
        of_unit.setdefault(one.serial, []).append(_earlier(one, ended.get(one.run), failed.get(one.run, ())))
    told = {}
    for run in wanted:
        earlier = [one for one in of_unit.get(run.serial, ()) if one.attempt < run.attempt]
        told[run.run] = attempt_text(run.attempt, earlier[-MOST_BEFORE:], None)
    return told


def not_passed(connection: Connection, chain: Chain, runs: Iterable[StoredRun]) -> dict[str, tuple[str, ...]]:
    """Return of each run that failed, or is not decidable, the titles of the metrics that made it so, by run."""
    return _judged(connection, chain, {one.run: one.verdict for one in runs if one.verdict in (FAIL, UNDECIDED)})


def _before(connection: Connection, chain: Chain, again: list[StoredRun]) -> list[_Of]:
    """Return the attempts at the units of these runs, oldest first: those near before each, where the runs are few."""
    asked = select(ATTEMPTS.c.run, ATTEMPTS.c.serial, ATTEMPTS.c.attempt).where(ATTEMPTS.c.chain == chain.id)
    if len(again) <= MOST_NAMED:
        spans = [
            and_(ATTEMPTS.c.serial == one.serial, ATTEMPTS.c.attempt.between(one.attempt - MOST_BEFORE, one.attempt))
            for one in again
        ]
        asked = asked.where(or_(*spans))
    else:
        units = select(ATTEMPTS.c.serial).where(ATTEMPTS.c.chain == chain.id, ATTEMPTS.c.attempt > FIRST)
        asked = asked.where(ATTEMPTS.c.serial.in_(units))
    rows = connection.execute(asked.order_by(ATTEMPTS.c.serial, ATTEMPTS.c.attempt))
    return [_Of(*row) for row in rows]


def _ended(connection: Connection, chain: Chain, trust: Trust, before: list[_Of]) -> dict[str, StoredRun]:
    """Return the concluded ones of these runs, as far as they are believed."""
    found: dict[str, StoredRun] = {}
    names = [one.run for one in before]
    for first in range(0, len(names), MOST_NAMED):
        asked = select(*COLUMNS).where(RUNS.c.chain == chain.id, RUNS.c.run.in_(names[first : first + MOST_NAMED]))
        for row in map(StoredRun._make, connection.execute(asked).all()):
            found[row.run] = believed(row, chain, trust)
    return found


def _judged(connection: Connection, chain: Chain, wanted: dict[str, str]) -> dict[str, tuple[str, ...]]:
    """Return the titles of the metrics that have their run's verdict, without what stands in brackets, by run.

    The verdict of a metric is the worst of its sides': one that fails on a side does not count as undecided.
    """
    sides: dict[tuple[str, int], tuple[str, set[str]]] = {}
    runs = list(wanted)
    for first in range(0, len(runs), MOST_NAMED):
        asked = select(METRICS.c.run, METRICS.c.position, MEANINGS.c.metric, METRICS.c.verdict).select_from(METRICS)
        asked = asked.join(MEANINGS, meaning_of_metrics()).where(
            METRICS.c.chain == chain.id, METRICS.c.run.in_(runs[first : first + MOST_NAMED]),
            METRICS.c.verdict.in_((FAIL, UNDECIDED)),
        )  # fmt: skip
        for run, position, metric, verdict in connection.execute(asked.order_by(METRICS.c.run, METRICS.c.position)):
            sides.setdefault((run, position), (metric, set()))[1].add(verdict)
    found: dict[str, tuple[str, ...]] = {}
    for (run, _), (metric, verdicts) in sides.items():
        if wanted[run] == (FAIL if FAIL in verdicts else UNDECIDED):
            title = DEFINED[metric].title if metric in DEFINED else metric
            found[run] = (*found.get(run, ()), title.partition(" (")[0])
    return found


def _earlier(one: _Of, ended: StoredRun | None, failed: tuple[str, ...]) -> EarlierAttempt:
    if ended is None:
        return EarlierAttempt(attempt=one.attempt, run=one.run, state=NOT_CONCLUDED, verdict=None)
    aside = INJECTED if ended.scenario is not None else SIMULATED if ended.virtual else None
    return EarlierAttempt(
        attempt=one.attempt,
        run=one.run,
        state=ALTERED if ended.altered else ended.state,
        verdict=ended.verdict,
        failed=failed,
        aside=None if ended.altered else aside,
    )
