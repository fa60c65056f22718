"""Counts of a lot: verdicts of first attempts and of units as they left, and the causes of what did not pass."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from datetime import UTC, datetime, timedelta
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Integer, Select, Text, case, func, literal_column, null, select

from station.errors import StationError
from station.store.plant.hours import (
    ALARM,
    CHECK,
    COMPLETE,
    FAIL,
    HOUR_DIGITS,
    NEAR,
    NO_REVISION,
    UNDECIDED,
    UNNAMED,
    judged_as,
    whole_hours,
)
from station.store.plant.meanings import meaning_of_metrics, meanings_of
from station.store.quality.lot import Columns, Lot, Production
from station.store.tables import ALARMS, CAUSE_HOURS, CHECKS, MEANINGS, METRIC_HOURS, METRICS, OF_AGAIN, RUNS

HOUR = "hour"
SHIFT_HOURS = 8
SHIFTS_BEGIN = 6
"""Shifts of eight hours by the computer's clock, the first from 06:00."""

ZONE_YEARS = range(2020, 2051)
"""Years whose clock is looked at: runs are from these. A zone that was off by half hours is asked of its runs, too."""


def _as_it_is(key: Any) -> str:
    return "–" if key in (None, "", NO_REVISION) else str(key)


def _day(key: str) -> str:
    return _local(key, "%Y-%m-%d")


def _shift(key: str) -> str:
    hour = _local(key, "%H")
    if not hour.isdigit():
        return hour
    number = (int(hour) - SHIFTS_BEGIN) // SHIFT_HOURS % (24 // SHIFT_HOURS)
    begin = SHIFTS_BEGIN + number * SHIFT_HOURS
    return f"{begin % 24:02}:00 to {(begin + SHIFT_HOURS) % 24:02}:00"


def _month(key: str) -> str:
    return _local(key, "%Y-%m")


def _local(key: str, form: str) -> str:
    """Return what the computer's clock shows at the begin of an hour or quarter of an hour of UTC; '–' for none."""
    hour, minute = key[:HOUR_DIGITS], key[HOUR_DIGITS:] or "00"
    if len(hour) < HOUR_DIGITS:
        return _as_it_is(None)
    return f"{datetime.fromisoformat(f'{hour}:{minute}:00+00:00').astimezone():{form}}"


def whole_hour_zone() -> bool:
    """Whether the computer's clock is whole hours off UTC, in summer as in winter, so that no hour lies in two days."""
    moments = (datetime(year, month, 15, tzinfo=UTC).astimezone() for year in ZONE_YEARS for month in (1, 7))
    return all((moment.utcoffset() or timedelta()) % timedelta(hours=1) == timedelta() for moment in moments)


class Grouping(NamedTuple):
    """How runs are put together: by which column of a table of runs, and how what is in it is called.

    Times are grouped by the hour first, and the hours by the computer's clock. Where that is not whole hours off UTC,
    as in India, an hour of UTC lies in two shifts or days: then the runs are grouped by the quarter of an hour.
    of_hours: whether the tables by the hour have it; else the runs themselves are asked.
    """

    of: str
    column: Callable[[Any], ColumnElement[Any]]
    name: Callable[[Any], str]
    text: str
    of_hours: bool = True

    @property
    def by_hours(self) -> bool:
        """Whether the tables by the hour say it where this computer stands."""
        return self.of_hours and (self.of != HOUR or whole_hour_zone())

    @property
    def said(self) -> tuple[str, ...]:
        """Columns of a run that it is read from."""
        return (HOUR, "started") if self.of == HOUR else (self.of,)


def _hour(runs: Any) -> ColumnElement[Any]:
    column: ColumnElement[Any] = runs.c.hour
    if "started" not in runs.c or whole_hour_zone():
        return column
    # Without parameters: see `_sector`.
    minute = func.substr(runs.c.started, literal_column(str(HOUR_DIGITS + 2)), literal_column("2"))
    begins = [(minute < literal_column(f"'{end}'"), literal_column(f"'{end - 15:02}'", Text)) for end in (15, 30, 45)]
    found: ColumnElement[Any] = column.concat(case(*begins, else_=literal_column("'45'", Text)))
    return found


SECTOR_DEG = 30
"""Lock angles are put together in sectors of the locked shaft's turn."""


def _sector(runs: Any) -> ColumnElement[Any]:
    angle, ends = runs.c.lock_angle_deg, range(SECTOR_DEG, 360 + SECTOR_DEG, SECTOR_DEG)
    # Without parameters: a database does not see that two expressions with parameters are the same one.
    begins = [(angle < literal_column(str(end)), literal_column(str(end - SECTOR_DEG), Integer)) for end in ends]
    found: ColumnElement[Any] = case(*begins, else_=null())
    return found


def _sector_name(begin: int | None) -> str:
    return "–" if begin is None else f"{begin:03}° to {begin + SECTOR_DEG:03}°"


GROUPINGS: dict[str, Grouping] = {
    "bench": Grouping("bench", lambda runs: runs.c.bench, _as_it_is, "bench"),
    "fixture": Grouping("fixture", lambda runs: runs.c.fixture, _as_it_is, "fixture"),
    "operator": Grouping("operator", lambda runs: runs.c.operator, _as_it_is, "operator"),
    "recipe": Grouping("recipe", lambda runs: runs.c.recipe, _as_it_is, "recipe"),
    "revision": Grouping("revision", lambda runs: runs.c.revision, _as_it_is, "revision of the recipe"),
    "model": Grouping("model", lambda runs: runs.c.model, _as_it_is, "model"),
    "shift": Grouping(HOUR, _hour, _shift, "shift of eight hours from 06:00"),
    "day": Grouping(HOUR, _hour, _day, "day"),
    "month": Grouping(HOUR, _hour, _month, "month"),
    "lock-angle": Grouping("lock_angle_deg", _sector, _sector_name, "lock angle in sectors of 30°", of_hours=False),
}
"""What runs can be grouped by."""


def grouping(name: str) -> Grouping:
    """Return a way of grouping; StationError names those that there are."""
    if name not in GROUPINGS:
        raise StationError(f"--by: found '{name:.40}'; allowed are {', '.join(GROUPINGS)}")
    return GROUPINGS[name]


class Verdicts(NamedTuple):
    """Units by verdict; ended_otherwise: measured, and stopped, interrupted or ended with a fault."""

    passed: int = 0
    failed: int = 0
    undecided: int = 0
    ended_otherwise: int = 0

    @property
    def units(self) -> int:
        """All of them."""
        return sum(self)

    def plus(self, state: str, verdict: str | None, number: int) -> Verdicts:
        """Return these with units of one state and verdict more."""
        if state != COMPLETE:
            return self._replace(ended_otherwise=self.ended_otherwise + number)
        name = {"PASS": "passed", FAIL: "failed"}.get(verdict or "", "undecided")
        return self._replace(**{name: getattr(self, name) + number})


def sum_of(parts: Iterable[Verdicts]) -> Verdicts:
    """Return the units of several groups together."""
    return Verdicts(*(sum(column) for column in zip(*parts, strict=True)))


class LotYield(NamedTuple):
    """Units at their first attempt, and all units by the newest run of each, whichever attempt that was."""

    first: Verdicts
    final: Verdicts

    @classmethod
    def nothing(cls) -> LotYield:
        """Return the yield of no unit."""
        return cls(Verdicts(), Verdicts())


def yields(production: Production, lot: Lot, by: str | None = None) -> dict[str, LotYield]:
    """Return the verdicts of each group, in the order of their names; '' is the one group where none is asked for.

    As few units are measured again, the units as they left are the first attempts, those of units with a later attempt
    replaced by the newest of each.
    """
    group = None if by is None else grouping(by)

    def counted(runs: Any) -> tuple[ColumnElement[Any], ...]:
        key = runs.c.chain if group is None else group.column(runs)  # the same for all where no grouping is asked for
        return key, runs.c.state, runs.c.verdict

    names: dict[Any, str] = {}  # of a year there are 8760 hours, and few months
    totals: dict[tuple[str, str, str | None], list[int]] = defaultdict(lambda: [0, 0])

    def add(value: Any, state: str, verdict: str | None, first: int, final: int) -> None:
        name = names.get(value)
        if name is None:
            name = names[value] = "" if group is None else group.name(value)
        total = totals[name, state, verdict]
        total[0] += first
        total[1] += final

    for value, state, verdict, number in production.connection.execute(
        production.counted(counted, lot, by_hours=group is None or group.by_hours)
    ):
        add(value, state, verdict, number, number)
    for value, state, verdict, number in production.connection.execute(_as_they_left(production, lot, counted)):
        add(value, state, verdict, 0, number)
    found: dict[str, LotYield] = {}
    for (name, state, verdict), numbers in sorted(totals.items(), key=lambda item: item[0][0]):
        before = found.get(name, LotYield.nothing())
        found[name] = LotYield(*(one.plus(state, verdict, each) for one, each in zip(before, numbers, strict=True)))
    return found


def _as_they_left(production: Production, lot: Lot, columns: Columns) -> Select[Any]:
    """Return a statement for what units measured again add to and take from the counts of first attempts."""
    later = ~RUNS.c.first
    retested = func.max(case((later, 1), else_=0)).over(partition_by=RUNS.c.serial)
    newest = func.row_number().over(partition_by=(RUNS.c.serial, later), order_by=RUNS.c.run.desc())
    said = [one.label(f"by_{place}") for place, one in enumerate(columns(RUNS))]
    asked = select(*said, later.label("later"), retested.label("retested"), newest.label("newest"))
    runs = production.of(asked, lot, first=False).where(OF_AGAIN).subquery()
    number = case((runs.c.later, case((runs.c.newest == 1, 1), else_=0)), else_=-1)
    by = [runs.c[one.name] for one in said]
    return select(*by, func.sum(number)).where(runs.c.retested == 1).group_by(*by)


def first_verdicts(production: Production, lot: Lot) -> Verdicts:
    """Return the verdicts of the first attempts alone."""
    found = Verdicts()
    asked = production.counted(lambda runs: (runs.c.state, runs.c.verdict), lot)
    for state, verdict, number in production.connection.execute(asked):
        found = found.plus(state, verdict, number)
    return found


class FailedMetric(NamedTuple):
    """A metric with its choices, on one branch and side."""

    metric: str
    choices: str
    branch: str
    side: str

    @property
    def name(self) -> str:
        """Return how people call it."""
        side = "" if self.side == "both" else f"side {self.side.replace('-', '−')}"
        return " ".join(part for part in (self.metric, self.choices, self.branch, side) if part)


def failures(production: Production, lot: Lot) -> Counter[FailedMetric]:
    """Return how many first attempts failed by each metric and side; a run that fails by several counts for each."""
    if whole_hours(lot.since, lot.until):
        there = METRIC_HOURS.c
        asked = select(there.meaning, there.side, func.sum(there.failed)).select_from(METRIC_HOURS)
        asked = production.of_hours(asked, METRIC_HOURS, lot).where(there.failed > 0)
        asked = asked.group_by(there.meaning, there.side)
    else:
        runs = production.chosen(lot, RUNS.c.verdict == FAIL, said=())
        asked = select(METRICS.c.meaning, METRICS.c.side, func.count())
        asked = asked.select_from(runs).join(METRICS, _together(runs, METRICS))
        asked = asked.where(METRICS.c.verdict == FAIL).group_by(METRICS.c.meaning, METRICS.c.side)
    meanings = meanings_of(production.connection, production.chain.id)
    found: Counter[FailedMetric] = Counter()
    for meaning, side, number in production.connection.execute(asked):
        of = meanings[meaning]
        found[FailedMetric(of.metric, of.choices, of.branch, side)] += int(number)
    return found


def alarms(production: Production, lot: Lot) -> Counter[str]:
    """Return in how many runs of any attempt each alarm came: alarms are of the bench, and it measures retests too."""
    if whole_hours(lot.since, lot.until):
        return _causes(production, lot, ALARM)
    number = func.count(ALARMS.c.run.distinct())
    asked = select(ALARMS.c.id, number).select_from(ALARMS).join(RUNS, _together(RUNS, ALARMS))
    asked = production.of(asked, lot, first=False).where(ALARMS.c.chain == production.chain.id)
    return Counter({str(name): number for name, number in production.connection.execute(asked.group_by(ALARMS.c.id))})


def undecided(production: Production, lot: Lot) -> Counter[str]:
    """Return why first attempts have no verdict, by how many: how they ended, a check, or a metric too near its limit.

    A run counts once for each check that it did not pass, by its metrics only where all checks passed, and as an
    invalid measurement where its record names no check.
    """
    states = production.connection.execute(production.counted(lambda runs: (runs.c.state,), lot))
    found = Counter({f"ended as {state}": int(number) for state, number in states if state != COMPLETE})
    if whole_hours(lot.since, lot.until):
        for kind, text in ((CHECK, "check {}"), (UNNAMED, "measurement invalid"), (NEAR, "{} too near its limit")):
            found += Counter({text.format(name): number for name, number in _causes(production, lot, kind).items()})
        return found
    runs = production.chosen(lot, RUNS.c.verdict == UNDECIDED, RUNS.c.state == COMPLETE, said=())
    checks = select(CHECKS.c.id, func.count()).select_from(runs).join(CHECKS, _together(runs, CHECKS))
    checks = checks.where(CHECKS.c.passed.is_(False))
    found += Counter({f"check {name}": number for name, number in _pairs(production, checks, CHECKS.c.id)})
    unnamed = select(func.count()).select_from(runs).join(RUNS, _together(runs, RUNS)).where(RUNS.c.objection != "")
    named = select(CHECKS.c.run).where(CHECKS.c.chain == runs.c.chain, CHECKS.c.run == runs.c.run)
    unnamed = unnamed.where(~named.where(CHECKS.c.passed.is_(False)).exists())
    found += Counter({"measurement invalid": int(production.connection.execute(unnamed).scalar_one())})
    runs = production.chosen(lot, RUNS.c.verdict == UNDECIDED, RUNS.c.valid, said=())
    metrics = select(MEANINGS.c.metric, func.count()).select_from(runs).join(METRICS, _together(runs, METRICS))
    metrics = metrics.join(MEANINGS, meaning_of_metrics()).where(judged_as(UNDECIDED))
    near = _pairs(production, metrics, MEANINGS.c.metric)
    return found + Counter({f"{name} too near its limit": number for name, number in near})


def _causes(production: Production, lot: Lot, kind: str) -> Counter[str]:
    asked = select(CAUSE_HOURS.c.name, func.sum(CAUSE_HOURS.c.runs)).where(CAUSE_HOURS.c.kind == kind)
    rows = production.connection.execute(production.of_hours(asked, CAUSE_HOURS, lot).group_by(CAUSE_HOURS.c.name))
    return Counter({str(name): int(number) for name, number in rows})


def _pairs(production: Production, asked: Any, column: ColumnElement[Any]) -> list[tuple[str, int]]:
    return [(str(name), int(number)) for name, number in production.connection.execute(asked.group_by(column))]


def _together(runs: Any, table: Any) -> ColumnElement[bool]:
    found: ColumnElement[bool] = (table.c.chain == runs.c.chain) & (table.c.run == runs.c.run)
    return found
