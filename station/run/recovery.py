"""Runs whose desk died: what their scan process still wrote is in the ring, and belongs to the record.

Without its desk the scan process unloads and stops after 2 s, unless it has a new desk by then. Afterwards
any command that looks at the runs brings the rest of the ring to disk and concludes the run: it gets the state that it
came to, and its verdict when it came to its end. While the scan process is still at work, `resume` is its new desk.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from controller.image import Command
from station.durable import Appender
from station.errors import StationError
from station.record.ring import ScanState, StopCause
from station.record.ring_reader import RingReader
from station.record.run_record import INTERRUPTED, RunRecord, process_birth
from station.record.scan_record import RECORD_BYTES
from station.record.seal import finish_seal
from station.record.store import Store
from station.record.writer import RecordWriter
from station.run.ending import Ending, cause_name, scan_report

DESK_DIED = "the desk ended in the middle of the run; the scan process went on without it"
TAKEN_OVER = "the desk ended in the middle of the run; a new one took it over, with {} records on disk"
BOTH_DIED = "desk and scan process ended in the middle of the run"
UNCOUNTED = "how many records the scan process wrote is not known: its ring is gone, and its report does not say it"
LOOK_EVERY_S = 0.02

Attend = Callable[[RingReader], None]


@contextmanager
def _owned(run: RunRecord) -> Iterator[bool]:
    """Own a run; yields whether it is ours now, and deserted still."""
    try:
        yield run.lock.take() and run.deserted()
    finally:
        run.lock.close()


def recover(run: RunRecord) -> int:
    """Bring the rest of a deserted run's ring to disk and conclude the run; return how many records came.

    Nothing happens while its desk or its scan process is alive.
    """
    if not run.deserted():
        return 0
    with _owned(run) as ours:
        if not ours or finish_seal(run):
            return 0
        path = _ring_of(run)
        if path is None:
            _conclude(run, Ended(None))
            return 0
        ring = RingReader(path)
        try:
            if _alive(ring):
                return 0
            return _take_all(run, ring, path)
        finally:
            ring.close()


def resume(run: RunRecord, attend: Attend) -> int:
    """Be the new desk of a run whose desk died: take its records until its scan ends, then conclude it.

    `attend` is called about 50 times per second, to show what there is and to pass commands on.
    """
    with _owned(run) as ours:
        path = _ring_of(run) if ours and not finish_seal(run) else None
        if path is None:
            return 0
        ring = RingReader(path)
        try:
            return _take_all(run, ring, path, attend)
        finally:
            ring.close()


def _ring_of(run: RunRecord) -> Path | None:
    name = run.manifest().get("ring")
    path = Path(name) if name else None
    return path if path is not None and path.exists() else None


def _alive(ring: RingReader) -> bool:
    return bool(ring.pid and process_birth(ring.pid))


def _take_all(run: RunRecord, ring: RingReader, path: Path, attend: Attend | None = None) -> int:
    on_disk = run.records()
    if run.samples.exists():
        # A desk that was killed while it wrote may have left part of a record.
        os.truncate(run.samples, on_disk * RECORD_BYTES)
    file = Appender(run.samples)
    # A desk that died between writing and noting it in the ring has written these already: no record twice.
    # One number, and not a difference of two: the scan may append between two looks, and its record would be skipped.
    writer = RecordWriter(ring, file, skip=max(on_disk - ring.taken, 0))
    with ExitStack() as ending:
        ending.callback(file.close)
        ending.callback(writer.finish)
        ring.beat()  # before anything else: the scan waits 2 s for a new desk, then it unloads and stops
        writer.start()
        taken_over = attend is not None and _alive(ring)
        while attend is not None and _alive(ring):
            time.sleep(LOOK_EVERY_S)
            ring.beat()
            attend(ring)
            if writer.first_trouble and not ring.stopped_because:
                ring.note_stop(StopCause.DISK)
                ring.send(Command.STOP)
    finished = ring.state is ScanState.FINISHED
    ended = Ended(ring.written, ring.lost, ring.stopped_because, cause_name(ring), finished=finished)
    if taken_over:
        # What the desk before measured went with it; its part of the record is bounded by this one's start.
        disk = writer.times.as_json() | {"from_record": on_disk}
        ended = replace(ended, desk_died=TAKEN_OVER.format(on_disk), disk=disk)
    run.update(trouble=ended.because or DESK_DIED)
    _conclude(run, ended)
    # The seal has removed it; whoever is killed before that leaves the next one what the ring knows.
    path.unlink(missing_ok=True)
    return writer.written


@dataclass(frozen=True)
class Ended:
    """What the ring says of a scan: records written and lost, why it was stopped, whether it came to its end.

    `written` is None where the ring is gone, as after a power failure.
    """

    written: int | None
    lost: int = 0
    because: str = ""
    cause: str = ""
    finished: bool = False
    desk_died: str = DESK_DIED
    disk: dict[str, float] = field(default_factory=dict)


def _counts(run: RunRecord, ended: Ended, said: dict[str, Any], kept: Ending | None) -> tuple[int, int, str]:
    """Return how many records ought to be on disk, how many were lost, and what stands against believing it.

    Ring, scan report and desk are asked, and the highest word counts. The file is no witness of its own completeness.
    """
    lost = max(ended.lost, int(said.get("lost", 0)), 0 if kept is None else kept.lost)
    # the report counts the lost ones too
    counted = [] if ended.written is None else [ended.written]
    counted += [int(said["written"]) - lost] if "written" in said else []
    counted += [] if kept is None else [kept.written]
    return (max(counted), lost, "") if counted else (run.records(), lost, UNCOUNTED)


def _conclude(run: RunRecord, ended: Ended) -> None:
    """Give the run its state, and its verdict when its scan came to its end."""
    # Here, because a new desk has 2 s to say that it is there, and loading the analysis takes a good part of them.
    from recipes import RecipeError  # noqa: PLC0415
    from station.bench.request import stored_job  # noqa: PLC0415
    from station.run.conclusion import conclude  # noqa: PLC0415

    said, kept = scan_report(run), Ending.kept_in(run)
    finished = ended.finished or said.get("state") == "finished"
    written, lost, uncounted = _counts(run, ended, said, kept)
    run.samples.touch()
    try:
        job = stored_job(run)
    except RecipeError as error:
        run.update(state=INTERRUPTED, ring=None, trouble=f"{DESK_DIED}; it cannot be evaluated: {error}")
        return
    kept = kept or Ending(
        written=written,
        lost=lost,
        realtime=said.get("realtime", {"details": {}}),
        notes=said.get("notes", []),
        trouble=uncounted if finished else BOTH_DIED,
        counters=said.get("counters", {}),
        times=said.get("times", {}),
        stopped_because=ended.because,
        stopped_by=ended.cause,
        desk_died=ended.desk_died if finished else "",
        disk=ended.disk,
    )
    conclude(run, job, replace(kept, written=written, lost=lost))


def recover_all(store: Store) -> None:
    """Recover every run of a store; what cannot be recovered stays as it is."""
    for run in store.runs():
        try:
            recover(run)
        except (StationError, KeyError, OSError):
            continue
