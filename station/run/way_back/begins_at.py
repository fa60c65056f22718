"""The run that a recovery begins at, in a folder whose runs are on one bench or on several."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, islice
from pathlib import Path

from station.documents.manifest import RECORDING
from station.errors import StationError
from station.records.data_folder import Store
from station.records.newest_runs import newest_runs
from station.records.run_record import RunRecord
from station.run.way_back.how_left import HowLeft, how_left, left_as_found
from station.run.way_back.recoveries import FOLDER, recoveries, was_recovered

PASSED_OVER = 200
"""Newest runs that are looked at, with those that changed nothing."""

LOOKED_INTO = 20
"""Newest runs that did: a bench that none of them was on was left alone so long that a person recovers it by name."""


def recovery_begins_at(data: Path) -> RunRecord | None:
    """Return the run whose bench is to be recovered, or was recovered last; None in a folder without runs.

    That of the newest recovery, while no run came after it. Else the newest run whose bench is still as a fault left
    it, whatever other benches of the folder did since. Else the newest run. Runs that only simulated
    a bench, by a record that is as it was sealed, do not count, nor do those that ended before they changed anything.

    Raises:
        RecordError: the chain of the folder cannot be read.

    """
    there = (run for run in islice(newest_runs(data), PASSED_OVER) if run.here)
    newest = next(there, None)
    if newest is None:
        return None
    on_a_bench = (run.record for run in chain((newest,), there) if not run.only_simulated())
    runs = [*islice((run for run in on_a_bench if not left_as_found(run)), LOOKED_INTO)][::-1]
    last = runs[-1] if runs else newest.record
    recovery = next(iter(recoveries(data).newest(1)), None)
    if recovery is not None and recovery.id > last.id:
        return _recovered_by(data, recovery) or last
    return next(_in_need(data, runs), last) if _has_ended(last) else last


def _recovered_by(data: Path, recovery: RunRecord | None) -> RunRecord | None:
    """Return the run that a recovery, or the recovery before it, goes back to."""
    while recovery is not None:
        try:
            before = recovery.manifest().recovery_of
        except StationError:
            return None
        if before is None or before >= recovery.id:
            return None
        if (run := Store(data).by_id(before)) is not None:
            return run
        recovery = RunRecord(data / FOLDER / before)
    return None


def _in_need(data: Path, runs: list[RunRecord]) -> Iterator[RunRecord]:
    """Yield the last run of each bench, newest first, where that bench is as a fault left it."""
    seen: set[str] = set()
    for run in reversed(runs):
        try:
            bench = run.manifest().bench
            if bench.name in seen:
                continue
            seen.add(bench.name)
            if not bench.embedded and how_left(run) is HowLeft.IN_NEED and not was_recovered(data, run):
                yield run
        except StationError:
            continue  # it is told where it is the newest; which bench it was on nobody knows


def _has_ended(run: RunRecord) -> bool:
    try:
        return run.manifest().state != RECORDING or run.deserted()
    except StationError:
        return False
