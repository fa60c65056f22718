"""Brings the records of a run from the ring to the disk, in a thread of the supervisor's process.

A thread, because a slow disk may hold a write or a flush for seconds: the supervisor must meanwhile say that it is
there and pass the operator's wishes on. What the disk does not take stays in the ring, which holds a minute of records
at 1 ms, and is tried again: a disk that was slow or full for less than that costs no record. (The scan is another
process.)
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from station.atomic_file import Appender
from station.documents.timing import Disk
from station.errors import RecordError
from station.records.ring.reader import RingReader
from station.records.samples.scan_record import RECORD_BYTES

LOOK_EVERY_S = 0.02
SYNC_EVERY_S = 1.0
"""A power failure costs about this much of the record, and the time that the flush itself takes."""

RETRY_EVERY_S = 0.5
"""Time between two tries on a disk that refused."""


class RecordsWaitError(RecordError):
    """The disk refuses the rest of a record: it waits in the ring until the disk takes it."""


@dataclass
class DiskTimes:
    """What the disk did to a run; times in seconds."""

    flushes: int = 0
    longest_write_s: float = 0.0
    longest_flush_s: float = 0.0
    longest_unflushed_s: float = 0.0
    """Longest time for which a power failure would have cost records."""
    most_waiting: int = 0
    """Most records that waited in the ring at one time."""
    refused: int = 0
    """Times that the disk took nothing."""

    def document(self, from_record: int | None = None) -> Disk:
        """Return it for the proof of timing, times to the millisecond; `from_record` as in `Disk`."""
        return Disk(**{name: round(value, 3) for name, value in vars(self).items()}, from_record=from_record)


class RecordWriter:
    """The thread. `trouble` says why the disk takes nothing at the moment, and is empty while it does."""

    def __init__(
        self, ring: RingReader, file: Appender, skip: int = 0, seen: Callable[[bytes], object] | None = None
    ) -> None:
        """Prepare; the first `skip` records of the ring are on disk already, `seen` is told what has been written."""
        self._ring, self._file = ring, file
        self._seen = seen
        self._skip = skip
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._work, name="record-writer", daemon=True)
        self._again_at = 0.0
        self._flushed_at = time.monotonic()
        self._dirty = False
        self._failed: BaseException | None = None
        self.newest = b""
        self.written = 0
        self.trouble = ""
        self.first_trouble = ""
        self.times = DiskTimes()

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def finish(self) -> None:
        """Take the rest, flush it, and end the thread; safe to call twice.

        Raises:
            RecordsWaitError: the disk refuses it; what it did not take stays in the ring.

        """
        self._end.set()
        if self._thread.ident is not None:
            self._thread.join()
        if self._failed is not None:
            raise self._failed
        if self.trouble:
            raise RecordsWaitError(self.trouble)

    def _work(self) -> None:
        try:
            while not self._end.wait(LOOK_EVERY_S):
                if time.monotonic() >= self._again_at:
                    self._look(flush=time.monotonic() - self._flushed_at > SYNC_EVERY_S)
            self._look(flush=True)
        except BaseException as error:  # noqa: BLE001 - told by `finish`, in the thread that can tell it
            self._failed = error
            self.trouble = self.first_trouble = f"the records cannot be stored: {error!r}"

    def _look(self, *, flush: bool) -> None:
        started = time.monotonic()
        self.times.most_waiting = max(self.times.most_waiting, self._ring.waiting)
        try:
            self._ring.drain(self._keep)
            if flush and (self._dirty or self.trouble):
                self._flush(started)
            elif flush:
                self._flushed_at = started
        except RecordError as error:
            self.times.refused += 1
            self.trouble = str(error)
            self.first_trouble = self.first_trouble or self.trouble
            self._again_at = time.monotonic() + RETRY_EVERY_S
        else:
            self.trouble = ""

    def _keep(self, data: bytes) -> None:
        fresh = data[self._skip * RECORD_BYTES :]
        started = time.monotonic()
        self._file.write(fresh)
        self.times.longest_write_s = max(self.times.longest_write_s, time.monotonic() - started)
        self._skip = max(self._skip - len(data) // RECORD_BYTES, 0)
        self._dirty = True
        self.written += len(fresh) // RECORD_BYTES
        self.newest = data[-RECORD_BYTES:]
        if self._seen is not None:
            self._seen(data)

    def _flush(self, started: float) -> None:
        before = time.monotonic()
        self._file.sync()
        done = time.monotonic()
        times = self.times
        times.flushes += 1
        times.longest_flush_s = max(times.longest_flush_s, done - before)
        times.longest_unflushed_s = max(times.longest_unflushed_s, done - self._flushed_at)
        # What came after this look began to take records is not covered by this flush.
        self._flushed_at = started
        self._dirty = False
