"""The ring between the two processes: records from scan to supervisor, commands from supervisor to scan.

A file of prefaulted shared memory with one writer and one reader for each word:

=========================  =======  ==========================================================
word                       writer   meaning
=========================  =======  ==========================================================
magic, version, layout     scan     refuse a ring of another program or another record layout
state, pid                 scan     `ScanState` and process id (the supervisor sets `DIED` afterwards)
written, lost              scan     records appended; records that found the ring full
started                    scan     monotonic time [ns] from which its deadlines count, 0 before
ended for                  scan     `StopCause` of the scan process's own wish to end the run
read                       supervisor     records taken
supervisor beats                 supervisor     looks at the ring so far: a supervisor that is there counts on
stopped for                supervisor     `StopCause` of the supervisor's own wish to end the run
run, its disk's number     supervisor     whose ring it is: folder, and the device that the folder is on
gone since                 anybody  when its run's folder was first missed, in seconds since 1970 (see `run_ring`)
commands written           supervisor     commands put into the mailbox's slots
commands taken             scan     commands seen by a scan, one per scan
=========================  =======  ==========================================================

A record is complete before `written` grows, so a killed scan process loses none that was written. A full ring never
overwrites: the record is dropped, `lost` grows, its sequence number is missing, and the run cannot pass.
The scan's end is `RingWriter`, the supervisor's `RingReader`.
"""

from __future__ import annotations

import mmap
import os
import tempfile
from enum import IntEnum
from pathlib import Path

from station.errors import StationError
from station.records.samples.scan_record import RECORD_BYTES

MAGIC = 0x4C4D52494E473031
VERSION = 2
HEADER_BYTES = 4096
WORD_BYTES = 8
DEFAULT_CAPACITY = 60_000
"""Records: one minute at 1 ms, the longest stall of the supervisor that loses nothing."""

MAILBOX_SLOTS = 16
SHARED_MEMORY = Path("/dev/shm")  # noqa: S108 - the kernel's shared memory, not a temporary folder
FILE_PREFIX = "lostmotion-ring-"
CHECK_RUN = "Check that the run is still in progress; if it is not, start it again"

# Words of the header, each 8 bytes and written by one process only.
W_MAGIC, W_VERSION, W_RECORD_BYTES, W_CAPACITY = 0, 1, 2, 3
W_STATE, W_PID, W_WRITTEN, W_LOST, W_STARTED = 8, 9, 10, 11, 12
W_ENDED_FOR = 13
W_READ, W_SUPERVISOR_BEATS, W_STOPPED_FOR = 16, 17, 18
W_RUN_DEVICE, W_GONE_SINCE = 20, 21
W_COMMANDS_WRITTEN, W_COMMANDS_TAKEN = 24, 32
W_SLOTS = 40
RUN_AT, RUN_BYTES = 2048, 2048
"""Where the header names the folder of the run that the ring belongs to: UTF-8, zeroes behind it."""


class ScanState(IntEnum):
    """What the scan process says of itself; `DIED` is set by the supervisor when it ended without saying so."""

    STARTING = 0
    ARMED = 1
    RUNNING = 2
    FINISHED = 3
    REFUSED = 4
    DIED = 5


class StopCause(IntEnum):
    """Why supervisor or scan process asked for a stop, where it was not the operator who did."""

    NONE = 0
    DISK = 1
    DESK_SILENT = 2
    DESK_GONE = 3
    """Before it had started the run: nothing has moved."""
    RECORDS_LOST = 4
    """Nobody notes it: the ring counts them."""


class RingError(StationError):
    """The ring cannot be created, or is not one of this program."""


def create(folder: Path, capacity: int = DEFAULT_CAPACITY, run: Path | None = None) -> Path:
    """Create an empty, completely allocated ring file in shared memory, else in `folder`; return its path.

    `run` is the folder of the run that it belongs to, by which a ring that was left behind is known.

    Raises:
        RingError: neither place has room for it.

    """
    size = HEADER_BYTES + capacity * RECORD_BYTES
    reasons = []
    for place in (SHARED_MEMORY, folder):
        if not place.is_dir():
            continue
        try:
            handle, name = tempfile.mkstemp(prefix=FILE_PREFIX, dir=place)
        except OSError as error:
            reasons.append(f"{place}: {error.strerror}")
            continue
        path = Path(name)
        try:
            # Allocated now: a sparse file on a full disk would end the scan process by SIGBUS in the middle of a run.
            os.posix_fallocate(handle, 0, size)
            with mmap.mmap(handle, size) as memory:
                words = memoryview(memory)[:HEADER_BYTES].cast("Q")  # records need not fill whole words
                words[W_VERSION], words[W_RECORD_BYTES], words[W_CAPACITY] = VERSION, RECORD_BYTES, capacity
                words[W_RUN_DEVICE] = 0 if run is None else run.stat().st_dev
                words[W_MAGIC] = MAGIC
                words.release()
                owner = b"" if run is None else os.fsencode(run.resolve())[:RUN_BYTES]
                memory[RUN_AT : RUN_AT + len(owner)] = owner
        except OSError as error:
            path.unlink(missing_ok=True)
            reasons.append(f"{place}: {error.strerror}")
        else:
            return path
        finally:
            os.close(handle)
    raise RingError(
        f"no room for the record buffer of {size // 1_000_000} MB: {'; '.join(reasons)}. Free memory or disk space"
    )


class MappedRing:
    """The mapped file and its header words, common to both ends."""

    def __init__(self, path: Path) -> None:
        try:
            with path.open("r+b") as file:
                flags = mmap.MAP_SHARED | getattr(mmap, "MAP_POPULATE", 0)
                self._memory = mmap.mmap(file.fileno(), 0, flags=flags)
        except (OSError, ValueError) as error:
            raise RingError(f"{path}: the record buffer of the run cannot be opened: {error}. {CHECK_RUN}") from error
        if len(self._memory) < HEADER_BYTES:
            self._memory.close()
            raise RingError(
                f"{path}: this file is not the record buffer of a run: found {path.stat().st_size} bytes; allowed: "
                f"{HEADER_BYTES} or more. {CHECK_RUN}"
            )
        self._bytes = memoryview(self._memory)
        self._words = self._bytes[:HEADER_BYTES].cast("Q")
        words = self._words
        found = (words[W_MAGIC], words[W_VERSION], words[W_RECORD_BYTES])
        self.capacity: int = words[W_CAPACITY]
        whole = len(self._bytes) == HEADER_BYTES + self.capacity * RECORD_BYTES and self.capacity > 0
        if found != (MAGIC, VERSION, RECORD_BYTES) or not whole:
            self.close()
            raise RingError(
                f"{path}: another version of lostmotion made this record buffer (found {found}). Use the version that "
                "started the run"
            )

    def close(self) -> None:
        """Unmap the file; the file itself stays."""
        self._words.release()
        self._bytes.release()
        self._memory.close()
