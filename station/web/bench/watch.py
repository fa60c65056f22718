"""What the bench shows now: live while a run or the recovery is on, otherwise as the newest record left it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime
from itertools import islice
from pathlib import Path
from threading import Lock

from recipes import RecipeError
from station.bench.request import stored_job
from station.errors import StationError
from station.records.data_folder import Store
from station.records.run_record import RunRecord, was_simulated
from station.run.way_back.begins_at import LOOKED_INTO
from station.run.way_back.recoveries import recoveries
from station.wall_clock import WALL_CLOCK
from station.web.bench.jogging import Jogging
from station.web.bench.sight import Sight, sight_of
from station.web.bench.way_back import Standing, WayBack
from station.web.evaluations import Evaluations
from station.web.running import RUNNING, STARTING, Now, Running


@dataclass(frozen=True)
class Seen:
    """What is seen of the bench. live: the values are those of now; else of the end of a run, so many seconds ago.

    sight: None where there are no values; why_none says so then. run: whose values they are, '' for none.
    """

    live: bool = False
    run: str = ""
    recovery: bool = False
    ago_s: float = 0.0
    sight: Sight | None = None
    why_none: str = ""


class BenchWatch:
    """The bench of one data folder, and the recovery from a fault of it."""

    def __init__(self, data: Path, running: Running, evaluations: Evaluations, jogging: Jogging) -> None:
        self.way_back = WayBack(data)
        self._data, self._running, self._evaluations = data, running, evaluations
        self._jogging = jogging
        self._kept = Seen(why_none="No run was made yet.")
        self._one_at_a_time = Lock()

    def look(self) -> Seen:
        """Return what is seen now. What a run left is read once, however many look."""
        for now, recovery in ((self.way_back.now(), True), (self._running.now(), False)):
            if now.stage in (STARTING, RUNNING):
                return _live(now, recovery=recovery)
        if (jog := self._jogging.standing()).on:
            return _live(replace(jog.now, program=jog.program), recovery=False)
        with self._one_at_a_time:
            return self._left()

    def standing(self) -> Standing:
        """Return how the recovery stands."""
        return self.way_back.standing()

    def _left(self) -> Seen:
        used = (run for run in islice(Store(self._data).newest_first(), LOOKED_INTO) if not was_simulated(run))
        there = [*islice(used, 1), *recoveries(self._data).newest(1)]
        if not there:
            return self._kept
        newest = max(there, key=lambda run: run.id)
        if self._kept.run != newest.id:
            self._kept = self._read(newest)
        kept = self._kept
        ago_s = WALL_CLOCK.now().timestamp() - _ended_s(newest)
        return Seen(False, kept.run, newest.folder.parent != self._data, ago_s, kept.sight, kept.why_none)  # noqa: FBT003

    def _read(self, run: RunRecord) -> Seen:
        try:
            record = self._evaluations.last_record(run)
            if not record:
                return Seen(run=run.id, why_none="The newest run has no values that this version can show.")
            return Seen(run=run.id, sight=sight_of(record, stored_job(run).program))
        except (StationError, RecipeError) as error:
            return Seen(run=run.id, why_none=f"The values of the newest run cannot be read: {error}")


def _ended_s(run: RunRecord) -> float:
    """Return when a run ended, in seconds since 1970: what was written last where nobody has concluded it."""
    with suppress(StationError, OSError):
        ended = run.manifest().ended
        return run.samples.stat().st_mtime if ended is None else datetime.fromisoformat(ended).timestamp()
    return run.folder.stat().st_mtime


def _live(now: Now, *, recovery: bool) -> Seen:
    if not now.record or now.program is None:
        return Seen(live=True, run=now.run, recovery=recovery, why_none="The devices are being opened.")
    return Seen(live=True, run=now.run, recovery=recovery, sight=sight_of(now.record, now.program))
