"""Runs whose supervisor process ended: what their scan process still wrote is in the ring, and belongs to the record.

Without its supervisor the scan process unloads and stops after 2 s, unless it has a new supervisor by then. Afterwards
`conclude` brings the rest of the ring to disk and concludes the run: it gets the state that it came to, and its
verdict when it came to its end. While the scan process is still at work, `resume` is its new supervisor. Nobody who
only looks at runs calls any of this, and an error that may pass (a file that is not there or cannot be read now)
leaves the run as it was.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from definitions.image import Command
from station.atomic_file import Appender, refused
from station.documents.scan_report import ScanReport
from station.documents.timing import Disk
from station.records.begun_by import beginning_of, begun_with
from station.records.chain.chain_file import Chain
from station.records.process_birth import process_birth
from station.records.program_file import PROGRAM
from station.records.ring.reader import RingReader
from station.records.ring.ring import ScanState, StopCause
from station.records.ring.to_disk import RecordWriter
from station.records.run_record import INTERRUPTED, RunRecord
from station.records.run_ring import ring_of
from station.records.seal import data_folder, finish_seal, is_sealed, refuse_second_seal
from station.run.outcome import RunOutcome, cause_name, scan_report

SUPERVISOR_DIED = "the supervisor process ended during the run; the scan process continued without it"
TAKEN_OVER = "the supervisor process ended during the run; a new one took over, with {} records on disk"
BOTH_DIED = "supervisor and scan process ended during the run"
NOT_BEGUN = (
    "the run is from before the data folder had a chain, so nothing proves that this bench recorded it: it cannot pass"
)
UNCOUNTED = (
    "the number of records that the scan process wrote is not known: its record buffer was removed and its report has "
    "no count"
)
NOTHING_BEGAN = "it has no program and no samples: nothing was measured"
LOOK_EVERY_S = 0.02

Attend = Callable[[RingReader], None]


@contextmanager
def _owned(run: RunRecord, *, again: bool = False) -> Iterator[bool]:
    """Own a run; yields whether it is ours now, and still to be concluded."""
    try:
        yield run.lock.take() and to_be_concluded(run, again=again)
    finally:
        run.lock.close()


def to_be_concluded(run: RunRecord, *, again: bool = False) -> bool:
    """Whether a run was deserted before it was concluded; `again`: also one that was left without a verdict.

    Such a one has its samples and no checksums: its recipe could not be read, or its supervisor failed.
    """
    manifest = run.manifest()
    undecided = manifest.state == INTERRUPTED and not is_sealed(manifest)
    return run.deserted() or (again and undecided)


def recover(run: RunRecord, *, again: bool = False) -> int:
    """Bring the rest of a deserted run's ring to disk and conclude the run; return how many records came.

    Nothing happens while its supervisor or its scan process is alive. `again` as in `to_be_concluded`.

    Raises:
        RecordError: something of the run cannot be read or written now. Nothing is decided: it can be tried again.
            Or the run may not be concluded here, as `refuse_second_seal` says.

    """
    if not to_be_concluded(run, again=again):
        return 0
    with _owned(run, again=again) as ours:
        if not ours or finish_seal(run):
            return 0
        refuse_second_seal(run, run.manifest(), Chain(data_folder(run)))
        path = ring_of(run)
        if path is None:
            _conclude(run, Ended(None))
            return 0
        ring = RingReader(path)
        try:
            if _alive(run, ring):
                return 0
            return _take_all(run, ring, path)
        finally:
            ring.close()


def resume(run: RunRecord, attend: Attend) -> int:
    """Supervise a run whose supervisor ended: take its records until its scan ends, then conclude it.

    `attend` is called about 50 times per second, to show what there is and to pass commands on.
    """
    with _owned(run) as ours:
        path = ring_of(run) if ours and not finish_seal(run) else None
        if path is None:
            return 0
        ring = RingReader(path)
        try:
            return _take_all(run, ring, path, attend)
        finally:
            ring.close()


def _alive(run: RunRecord, ring: RingReader) -> bool:
    """Whether the scan process lives; another one may have got its id since."""
    birth = process_birth(ring.pid) if ring.pid else ""
    said = run.scan_process() if birth else None
    return bool(birth) and (said is None or (said.pid, said.birth) == (ring.pid, birth))


def _complete_on_disk(run: RunRecord) -> int:
    """Return how many complete records are on disk; a last one that a killed supervisor left half written is cut off.

    Raises:
        RecordError: the samples are not there, or cannot be looked at. That may pass, so it decides nothing.

    """
    record_bytes = run.layout().record_bytes  # its own: a version before may have written records of another length
    try:
        size = run.samples.stat().st_size
        if size % record_bytes:
            os.truncate(run.samples, size - size % record_bytes)
    except OSError as error:
        raise refused(run.samples, error, "read") from error
    return size // record_bytes


def _take_all(run: RunRecord, ring: RingReader, path: Path, attend: Attend | None = None) -> int:
    on_disk = _complete_on_disk(run)
    file = Appender(run.samples, must_exist=True)
    # A supervisor that died between writing and noting it in the ring has written these already: no record twice.
    # One number, and not a difference of two: the scan may append between two looks, and its record would be skipped.
    writer = RecordWriter(ring, file, skip=max(on_disk - ring.taken, 0))
    with ExitStack() as cleanup:
        cleanup.callback(file.close)
        cleanup.callback(writer.finish)
        ring.beat()  # before anything else: the scan waits 2 s for a new supervisor, then it unloads and stops
        writer.start()
        taken_over = attend is not None and _alive(run, ring)
        while attend is not None and _alive(run, ring):
            time.sleep(LOOK_EVERY_S)
            ring.beat()
            attend(ring)
            if writer.first_trouble and not ring.stopped_because:
                ring.note_stop(StopCause.DISK)
                ring.send(Command.STOP)
    finished = ring.state is ScanState.FINISHED
    ended = Ended(ring.written, ring.lost, ring.stopped_because, cause_name(ring), finished=finished)
    if taken_over:
        # What the supervisor before measured went with it; its part of the record is bounded by this one's start.
        disk = writer.times.document(from_record=on_disk)
        ended = replace(ended, desk_died=TAKEN_OVER.format(on_disk), disk=disk)
    run.update(trouble=ended.because or SUPERVISOR_DIED)
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
    desk_died: str = SUPERVISOR_DIED
    disk: Disk | None = None


def _counts(run: RunRecord, ended: Ended, said: ScanReport, kept: RunOutcome | None) -> tuple[int, int, str]:
    """Return how many records ought to be on disk, how many were lost, and what stands against believing it.

    Ring, scan report and supervisor are asked, and the highest word counts. The file is no witness of its own
    completeness.
    """
    lost = max(ended.lost, said.lost, 0 if kept is None else kept.lost)
    # the report counts the lost ones too
    counted = [] if ended.written is None else [ended.written]
    counted += [] if said.written is None else [said.written - lost]
    counted += [] if kept is None else [kept.written]
    return (max(counted), lost, "") if counted else (run.records(), lost, UNCOUNTED)


def _has_no_program(run: RunRecord) -> bool:
    """Whether a run was killed before it had a program, which a version before wrote behind the line of the run."""
    created = beginning_of(Chain(data_folder(run)), run.id)
    return created is not None and not begun_with(created) and not run.has(PROGRAM)


def _conclude(run: RunRecord, ended: Ended) -> None:
    """Give the run its state, and its verdict when its scan came to its end."""
    # Here, because a new supervisor has 2 s to say that it is there, and loading the analysis takes a good part
    # of them.
    from recipes import RecipeError  # noqa: PLC0415
    from station.bench.request import stored_job  # noqa: PLC0415
    from station.run.conclusion import conclude  # noqa: PLC0415

    said, kept = scan_report(run), RunOutcome.kept_in(run)
    finished = ended.finished or said.state == "finished"
    if ended.written is None:
        _complete_on_disk(run)
    written, lost, uncounted = _counts(run, ended, said, kept)
    kept = kept or RunOutcome(
        written=written,
        lost=lost,
        realtime=said.realtime,
        notes=said.notes,
        trouble=uncounted if finished else BOTH_DIED,
        counters=said.counters or {},
        times=said.times,
        pace=said.pace,
        stopped_because=ended.because,
        stopped_by=ended.cause,
        desk_died=ended.desk_died if finished else "",
        disk=ended.disk,
    )
    kept = replace(kept, written=written, lost=lost)
    if run.manifest().chain is None:
        kept = replace(kept, trouble="; ".join(one for one in (kept.trouble, NOT_BEGUN) if one))
    if not written and not run.records() and _has_no_program(run):
        run.update(state=INTERRUPTED, ring=None, trouble=f"{SUPERVISOR_DIED}; {NOTHING_BEGAN}")
        return
    try:
        job = stored_job(run)
    except RecipeError as error:
        kept.keep(run)  # what the ring knew goes with it: whoever concludes the run again needs it
        run.update(state=INTERRUPTED, ring=None, trouble=f"{SUPERVISOR_DIED}; it cannot be evaluated: {error}")
        return
    conclude(run, job, kept)
