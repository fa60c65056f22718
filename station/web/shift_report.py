"""The shift report: what was measured in a time, what hindered it, and the head of the audit trail."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import NamedTuple

from sqlalchemy import Connection, select

from station.counted import counted
from station.documents.result import Result
from station.errors import StationError
from station.records.run_record import RESULT, RunRecord
from station.store.run_table import RunTableRow
from station.store.stored_runs import StoredRun
from station.web.people.audit import DONE, REFUSED, Head, head_of
from station.web.people.database import AUDIT

PASS = "PASS"  # noqa: S105 - a verdict
NO_VERDICT = "no verdict"
UNREADABLE = "result that cannot be read"


class Yield(NamedTuple):
    """Units that passed, of those that were measured."""

    passed: int
    units: int

    def __str__(self) -> str:
        share = f" ({100 * self.passed / self.units:.1f} %)" if self.units else ""
        return f"{self.passed} of {self.units}{share}"


class EndedOtherwise(NamedTuple):
    """A run that was stopped, interrupted or ended with a fault."""

    run: str
    state: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Shift:
    """A shift: verdicts of its production runs, yields, master parts, runs that ended otherwise, and the audit trail.

    Runs of virtual units, and those that only simulated their bench, are no production: `virtual` has them alone.
    first_pass: of units measured for the first time. final: of all units, each by its newest run. ended_otherwise:
    run and state of those that were stopped, interrupted or ended with a fault. refused: refused starts by the ids of
    their reasons.
    """

    begin: str
    end: str
    verdicts: dict[str, int]
    first_pass: Yield
    final: Yield
    master_parts: dict[str, int]
    virtual: dict[str, int]
    ended_otherwise: tuple[EndedOtherwise, ...]
    alarms: dict[str, int]
    bypasses: tuple[str, ...]
    refused: dict[str, int]
    audit: Head

    def as_text(self) -> str:
        """Return the report for people."""
        lines = [f"Shift    {self.begin} to {self.end}", f"Runs     {_counts(self.verdicts)}"]
        lines += [f"Yield    first pass {self.first_pass}", f"         final      {self.final}"]
        lines += [f"Master parts  {_counts(self.master_parts)}"]
        lines += [f"Virtual bench  {_counts(self.virtual)}"] if self.virtual else []
        lines += [f"Ended with '{state}'  {run}" for run, state in self.ended_otherwise]
        lines += [f"Alarms   {_counts(self.alarms)}"]
        lines += [f"Bypass   {one}" for one in self.bypasses]
        lines += [f"Refused starts  {_counts(self.refused)}"]
        lines += [f"Audit trail  {counted(self.audit.lines, 'line')}, head {self.audit.head_sha256}"]
        return "\n".join(lines) + "\n"


def shift_of(
    rows: Sequence[RunTableRow], alarms: dict[str, int], connection: Connection, begin: str, end: str
) -> Shift:
    """Return the report of a time.

    rows: runs from `begin` on, oldest first. alarms: of them, as `alarms_of`. Both moments in UTC as runs have them.
    """
    runs = [row.run for row in rows if row.run.scenario is None and begin <= str(row.run.started) < end]
    real = [run for run in runs if not _is_virtual(run)]
    # An altered run is none of the production either, and stays here with no verdict: somebody has to look at it.
    production = [run for run in real if not run.master and (run.in_production or run.altered)]
    first = [run for run in production if run.first]
    final = {run.serial: run for run in production}
    said = connection.execute(select(AUDIT).where(AUDIT.c.at < end).order_by(AUDIT.c.number))
    detail = [(row, json.loads(row.detail)) for row in said if row.action in ("add_bypass", "start_run")]
    return Shift(
        begin=begin,
        end=end,
        verdicts=_by_verdict(production),
        first_pass=_yield(first),
        final=_yield(list(final.values())),
        master_parts=_by_verdict([run for run in real if run.master]),
        virtual=_by_verdict([run for run in runs if _is_virtual(run)]),
        ended_otherwise=tuple(EndedOtherwise(run.run, run.state) for run in runs if run.state != "complete"),
        bypasses=tuple(
            f"{row.at} {row.name}: {told['condition']}, {told['hours']:g} h: {told['reason']}"
            for row, told in detail
            if (row.action, row.outcome) == ("add_bypass", DONE) and _reaches(row.at, told["hours"], begin)
        ),
        alarms=alarms,
        refused=dict(
            Counter(
                reason
                for row, told in detail
                if (row.action, row.outcome) == ("start_run", REFUSED) and row.at >= begin
                for reason in told["reasons"]
            )
        ),
        audit=head_of(connection),
    )


def _is_virtual(run: StoredRun) -> bool:
    """Say whether a run says nothing of a real unit; of an altered one its own word for that does not count."""
    return bool(run.virtual) and not run.altered


def _reaches(at: str, hours: float, begin: str) -> bool:
    """Say whether a bypass that was added before the shift may still have counted in it."""
    return datetime.fromisoformat(at) + timedelta(hours=hours) > datetime.fromisoformat(begin)


def alarms_of(data: Path, rows: Sequence[RunTableRow], end: str) -> dict[str, int]:
    """Return how often each alarm came in these runs, without those of fault injection and of the virtual bench."""
    counts: Counter[str] = Counter()
    for row in rows:
        run = RunRecord(data / row.run.run)
        aside = row.run.scenario is not None or _is_virtual(row.run)
        if aside or str(row.run.started) >= end or not run.has(RESULT):
            continue
        try:
            counts.update(one.id for one in run.read(Result, RESULT).alarms if one.kind == "alarm")
        except StationError:
            counts[UNREADABLE] += 1  # one damaged record keeps no report from the others
    return dict(counts)


def _by_verdict(runs: Sequence[StoredRun]) -> dict[str, int]:
    return dict(Counter(str(run.verdict or NO_VERDICT) for run in runs))


def _yield(runs: Sequence[StoredRun]) -> Yield:
    return Yield(sum(run.verdict == PASS for run in runs), len(runs))


def _counts(counts: dict[str, int]) -> str:
    return ", ".join(f"{count} {name}" for name, count in sorted(counts.items())) or "none"
