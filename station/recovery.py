"""Runs whose desk died: what their scan process still wrote is in the ring, and belongs to the record.

The scan process goes on without its desk: it finishes the run, or unloads and stops when the ring is full. Afterwards
any command that looks at the runs brings the rest of the ring to disk and concludes the run: it gets the state that it
came to, and its verdict when it came to its end. While the scan process is still at work, `resume` is its new desk.
"""

from __future__ import annotations

import fcntl
import json
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from recipes import RecipeError
from station.durable import Appender
from station.errors import StationError
from station.record_store import INTERRUPTED, RECORDING, RunRecord, Store, process_birth
from station.request import load_job
from station.ring import RingReader
from station.scan_record import BODY_STRUCT, RECORD_BYTES

DESK_DIED = "the desk ended in the middle of the run; the scan process went on without it"
BOTH_DIED = "desk and scan process ended in the middle of the run"
REPORT = "scan-report.json"
LOOK_EVERY_S = 0.02
SYNC_EVERY_S = 1.0

Attend = Callable[[RingReader], None]


@contextmanager
def _alone(run: RunRecord) -> Iterator[bool]:
    """Yield whether no other process is recovering this run."""
    handle = os.open(run.folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            yield False
        else:
            yield True
    finally:
        os.close(handle)


def _deserted(run: RunRecord) -> bool:
    return run.state() == INTERRUPTED and run.manifest()["state"] == RECORDING


def recover(run: RunRecord) -> int:
    """Bring the rest of a deserted run's ring to disk and conclude the run; return how many records came.

    Nothing happens while its desk or its scan process is alive.
    """
    if not _deserted(run):
        return 0
    with _alone(run) as alone:
        if not alone or not _deserted(run):
            return 0
        path = _ring_of(run)
        if path is None:
            _conclude(run, run.records(), 0)
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
    with _alone(run) as alone:
        path = _ring_of(run) if alone and _deserted(run) else None
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
    taken = 0

    def keep(data: bytes) -> None:
        # A desk that died between writing and noting it in the ring has written these already: no record twice.
        nonlocal taken
        first = BODY_STRUCT.unpack_from(data)[0]
        fresh = data[max(on_disk - first, 0) * RECORD_BYTES :] if not taken else data
        file.write(fresh)
        taken += len(fresh) // RECORD_BYTES

    try:
        synced = time.monotonic()
        while attend is not None and _alive(ring):
            time.sleep(LOOK_EVERY_S)
            ring.drain(keep)
            attend(ring)
            if time.monotonic() - synced > SYNC_EVERY_S:
                synced = time.monotonic()
                file.sync()
        ring.drain(keep)
    finally:
        file.close()
    written, lost = ring.written, ring.lost
    run.update(ring=None, trouble=DESK_DIED)
    path.unlink()
    _conclude(run, written, lost)
    return taken


def _conclude(run: RunRecord, written: int, lost: int) -> None:
    """Give the run its state, and its verdict when its scan came to its end."""
    from station.conclusion import Ending, conclude  # noqa: PLC0415 - the analysis; runs are rarely deserted

    report = run.folder / REPORT
    said = json.loads(report.read_bytes()) if report.exists() else {}
    finished = said.get("state") == "finished"
    run.samples.touch()
    try:
        job = load_job(str(run.folder / "recipe.yaml"), str(run.folder / "bench.yaml"))
    except RecipeError as error:
        run.update(state=INTERRUPTED, trouble=f"{DESK_DIED}; it cannot be evaluated: {error}")
        return
    ending = Ending(
        written=written,
        lost=lost,
        realtime=said.get("realtime", {"details": {}}),
        notes=said.get("notes", []),
        trouble="" if finished else BOTH_DIED,
        counters=said.get("counters", {}),
        times=said.get("times", {}),
    )
    conclude(run, job, ending)


def recover_all(store: Store) -> None:
    """Recover every run of a store; what cannot be recovered stays as it is."""
    for run in store.runs():
        try:
            recover(run)
        except (StationError, KeyError, OSError):
            continue
