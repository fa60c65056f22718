"""Runs whose desk died: what their scan process still wrote is in the ring, and belongs to the record.

The scan process goes on without its desk: it finishes the run, or unloads and stops when the ring is full. Afterwards
any command that looks at the runs brings the rest of the ring to disk.
"""

from __future__ import annotations

from pathlib import Path

from station.durable import Appender
from station.errors import StationError
from station.record_store import INTERRUPTED, RunRecord, Store, process_birth
from station.ring import RingReader
from station.scan_record import BODY_STRUCT, RECORD_BYTES


def recover(run: RunRecord) -> int:
    """Bring the rest of an interrupted run's ring to disk and remove the ring; return how many records came.

    Nothing happens while its scan process is alive, or when there is no ring.
    """
    ring_name = run.manifest().get("ring")
    if not ring_name or run.state() != INTERRUPTED:
        return 0
    path = Path(ring_name)
    if not path.exists():
        return 0
    ring = RingReader(path)
    try:
        if ring.pid and process_birth(ring.pid):
            return 0
        return _take(run, ring, path)
    finally:
        ring.close()


def _take(run: RunRecord, ring: RingReader, path: Path) -> int:
    on_disk = run.records()
    file = Appender(run.samples)
    taken = 0

    def keep(data: bytes) -> None:
        # A desk that died between writing and noting it in the ring has written these already: no record twice.
        nonlocal taken
        first = BODY_STRUCT.unpack_from(data)[0]
        fresh = data[max(on_disk - first, 0) * RECORD_BYTES :]
        file.write(fresh)
        taken += len(fresh) // RECORD_BYTES

    try:
        ring.drain(keep)
    finally:
        file.close()
    run.update(ring=None, trouble="the desk ended in the middle of the run; the scan process went on without it")
    path.unlink()
    return taken


def recover_all(store: Store) -> None:
    """Recover every run of a store; what cannot be recovered stays as it is."""
    for run in store.runs():
        try:
            recover(run)
        except (StationError, KeyError, OSError):
            continue
