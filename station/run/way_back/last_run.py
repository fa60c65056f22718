"""The run by which a bench was left: the newest of this bench, whatever other benches of the folder did since."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

from station.bench.request import Job
from station.errors import RecordError, StationError
from station.records.chain.chain_file import Chain
from station.records.chain.entries import CREATED, SEALED, Entry
from station.records.chain.lookup import begun_on_bench, entries_of_run, last_begun_on_each_bench
from station.records.folder_check import runs_before
from station.records.newest_runs import KnownRun, newest_runs
from station.records.run_record import NOT_CONCLUDED, RECORDING, RunRecord
from station.run.way_back.how_left import NEEDS_WAY_BACK, STOPPED, HowLeft, how_left, left_as_found
from station.run.way_back.recoveries import is_under_way, newest_recovery, was_recovered

LOOKED_INTO = 100
"""Runs: of a bench that has none among them, the chain says which was its last."""

UNDER_WAY = "The recovery after a fault is in progress. Wait until the unit is unloaded and the lock is open."


class LastRun(RunRecord):
    """The last run of a bench; how it ended says the chain where it was concluded, else its run.json."""

    def __init__(self, folder: Path, sealed: Entry | None, *, begun: bool) -> None:
        """Take the line that concludes it, None for none; begun: whether the chain has one that begins it."""
        super().__init__(folder)
        self._sealed, self._begun = sealed, begun

    @property
    def ended_well(self) -> bool:
        """Whether the chain says that the run ended with the unit unloaded; of one that was stopped it does not."""
        return self._sealed is not None and self._sealed.fields["state"] not in {*NEEDS_WAY_BACK, STOPPED}

    def state(self) -> str:
        """State of the run, as `RunRecord.state`; what only run.json says to have ended has not, for the chain."""
        if self._sealed is not None:
            return str(self._sealed.fields["state"])
        said = super().state()
        return NOT_CONCLUDED if self._begun and said != RECORDING else said


def last_run_of(data: Path, job: Job) -> RunRecord | None:
    """Return the newest run on the bench of a job that changed anything of it; None where there is none.

    One whose run.json cannot be read may be of this bench, unless a later one is: it counts. One in virtual time on a
    real bench's file was not on it, where its run.json is as it was sealed. A folder that the chain does not know may
    be a copy, or from elsewhere: that such a run ended well frees no bench.

    Raises:
        StationError: the chain of the folder cannot be read.

    """
    for run in islice(newest_runs(data), LOOKED_INTO):
        if _may_be_on(run, job) and (_is_known(data, run) or not _says_that_it_ended_well(run.record)):
            last = LastRun(run.record.folder, run.sealed, begun=run.created is not None)
            if not left_as_found(last):
                return last
    begun = last_begun_on_each_bench(data)
    files = [sha256 for sha256, run in begun.items() if _is_on(RunRecord(data / run), job)]
    own = max((_last_used(data, sha256) for sha256 in files), default="")
    if not own:
        return None
    sealed = (one for one in entries_of_run(data, own) if one.kind == SEALED)
    return LastRun(data / own, next(sealed, None), begun=True)


def why_not_free(data: Path, run: RunRecord, what_to_do: str) -> str:
    """Return why a bench is not free after its last run, and what to do where it has to be recovered; '' where it is.

    Raises:
        StationError: the recovery after the run cannot be read.

    """
    try:
        state, _ = run.state(), run.manifest()
    except RecordError as error:
        if isinstance(run, LastRun) and run.ended_well:
            return ""
        return (
            f"The last run of this bench, {run.id}, cannot be read ({error}), so its unit may be wound up. A "
            "technician makes sure that it is unloaded and the lock is open, then measures it with 'lostmotion run'."
        )
    way_back = newest_recovery(data, run)
    if way_back is not None and is_under_way(way_back):
        return UNDER_WAY
    if how_left(run) is not HowLeft.IN_NEED or was_recovered(data, run):
        return ""
    return f"Run {run.id} ended with '{state}'. {what_to_do}"


def _last_used(data: Path, bench_sha256: str) -> str:
    """Return the last run with this text of a bench file that used the bench, '' for none."""
    chain = Chain(data).id
    for run in reversed(begun_on_bench(data, bench_sha256)):
        lines = {one.kind: one for one in entries_of_run(data, run)}
        if KnownRun(RunRecord(data / run), lines.get(CREATED), lines.get(SEALED), chain).only_simulated():
            continue
        if not left_as_found(LastRun(data / run, lines.get(SEALED), begun=True)):
            return run
    return ""


def _is_known(data: Path, run: KnownRun) -> bool:
    """Whether a run is one of its folder: begun in its chain, from before that, or nobody keeps a chain there."""
    if run.created is not None:
        return True
    chain = Chain(data)
    return not chain.there or run.id in runs_before(chain)[0]


def _says_that_it_ended_well(run: RunRecord) -> bool:
    try:
        return run.state() not in NEEDS_WAY_BACK
    except RecordError:
        return False


def _may_be_on(run: KnownRun, job: Job) -> bool:
    if run.only_simulated():
        return False
    if run.created is not None and run.created.fields["bench"] == job.bench_source.sha256:
        return True
    return _is_on(run.record, job) if run.can_be_read() else run.created is None or run.here


def _is_on(run: RunRecord, job: Job) -> bool:
    try:
        bench = run.manifest().bench
    except StationError:
        return False
    return bench.name == job.bench.bench.name and bench.embedded == job.bench.bench.embedded
