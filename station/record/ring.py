"""The ring between the two processes: records from the scan to the desk, commands from the desk to the scan.

A file of prefaulted shared memory with one writer and one reader for each word:

=========================  =======  ==========================================================
word                       writer   meaning
=========================  =======  ==========================================================
magic, version, layout     scan     refuse a ring of another program or another record layout
state, pid                 scan     `ScanState` and process id (the desk sets `DIED` afterwards)
written, lost              scan     records appended; records that found the ring full
started                    scan     monotonic time [ns] from which its deadlines count, 0 before
read                       desk     records taken
desk beats                 desk     looks at the ring so far: a desk that is there counts on
stopped for                desk     `StopCause` of the desk's own wish to end the run
commands written           desk     commands put into the mailbox's slots
commands taken             scan     commands seen by a scan, one per scan
=========================  =======  ==========================================================

A record is complete before `written` grows, so a killed scan process loses none that was written. A full ring never
overwrites: the record is dropped, `lost` grows, its sequence number is missing, and the run cannot pass.
"""

from __future__ import annotations

import mmap
import os
import tempfile
import zlib
from collections.abc import Callable
from enum import IntEnum
from pathlib import Path

from controller.image import Command, Image, Orders
from station.errors import StationError
from station.record.scan_record import BODY_BYTES, BODY_STRUCT, CHECK_STRUCT, MAX_WORK_NS, RECORD_BYTES

MAGIC = 0x4C4D52494E473031
VERSION = 2
HEADER_BYTES = 4096
DEFAULT_CAPACITY = 60_000
"""Records: one minute at 1 ms, the longest stall of the desk that loses nothing."""

MAILBOX_SLOTS = 16
SHARED_MEMORY = Path("/dev/shm")  # noqa: S108 - the kernel's shared memory, not a temporary folder
FILE_PREFIX = "lostmotion-ring-"

# Words of the header, each 8 bytes and written by one process only.
W_MAGIC, W_VERSION, W_RECORD_BYTES, W_CAPACITY = 0, 1, 2, 3
W_STATE, W_PID, W_WRITTEN, W_LOST, W_STARTED = 8, 9, 10, 11, 12
W_READ, W_DESK_BEATS, W_STOPPED_FOR = 16, 17, 18
W_COMMANDS_WRITTEN, W_COMMANDS_TAKEN = 24, 32
W_SLOTS = 40


_COMMANDS = frozenset(map(int, Command))


class ScanState(IntEnum):
    """What the scan process says of itself; `DIED` is set by the desk when it ended without saying so."""

    STARTING = 0
    ARMED = 1
    RUNNING = 2
    FINISHED = 3
    REFUSED = 4
    DIED = 5


class StopCause(IntEnum):
    """Why the desk asked for a stop, where it was not the operator who did."""

    NONE = 0
    DISK = 1


class RingError(StationError):
    """The ring cannot be created, or is not one of this program."""


def create(folder: Path, capacity: int = DEFAULT_CAPACITY) -> Path:
    """Create an empty, completely allocated ring file in shared memory, else in `folder`; return its path.

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
                words = memoryview(memory).cast("Q")
                words[W_VERSION], words[W_RECORD_BYTES], words[W_CAPACITY] = VERSION, RECORD_BYTES, capacity
                words[W_MAGIC] = MAGIC
                words.release()
        except OSError as error:
            path.unlink(missing_ok=True)
            reasons.append(f"{place}: {error.strerror}")
        else:
            return path
        finally:
            os.close(handle)
    raise RingError(f"no room for the ring of {size // 1_000_000} MB: {'; '.join(reasons)}. Free some memory or disk")


class _Mapped:
    """The mapped file and its header words, common to both ends."""

    def __init__(self, path: Path) -> None:
        try:
            with path.open("r+b") as file:
                flags = mmap.MAP_SHARED | getattr(mmap, "MAP_POPULATE", 0)
                self._memory = mmap.mmap(file.fileno(), 0, flags=flags)
        except (OSError, ValueError) as error:
            raise RingError(f"{path}: cannot be mapped: {error}") from error
        self._bytes = memoryview(self._memory)
        self._words = self._bytes.cast("Q")
        words = self._words
        found = (words[W_MAGIC], words[W_VERSION], words[W_RECORD_BYTES])
        if found != (MAGIC, VERSION, RECORD_BYTES):
            self.close()
            raise RingError(f"{path}: is not a ring of this version of the program (found {found})")
        self.capacity: int = words[W_CAPACITY]

    def close(self) -> None:
        """Unmap the file; the file itself stays."""
        self._words.release()
        self._bytes.release()
        self._memory.close()


class RingWriter(_Mapped):
    """The scan's end: appends records and takes commands. Nothing here waits, and nothing allocates but ints."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.sequence: int = 0
        self.lost: int = 0
        self.last_scan: int = -1
        self.strange_commands: int = 0
        self._taken: int = self._words[W_COMMANDS_TAKEN]
        self._words[W_PID] = os.getpid()

    @property
    def commands_given(self) -> int:
        """Commands that the desk has given so far, seen by a scan or not."""
        return int(self._words[W_COMMANDS_WRITTEN])

    @property
    def desk_beats(self) -> int:
        """Looks of the desk so far."""
        beats: int = self._words[W_DESK_BEATS]
        return beats

    def set_state(self, state: ScanState) -> None:
        """Tell the desk where the scan process is."""
        self._words[W_STATE] = int(state)

    def note_start(self, started_ns: int) -> None:
        """Keep the moment from which the scan's deadlines count, for the case that it cannot be told at the end."""
        self._words[W_STARTED] = started_ns

    def append(self, scan: int, lateness_ns: int, work_ns: int, image: Image, orders: Orders) -> bool:
        """Append one record; return False when the ring was full and the record was lost."""
        sequence = self.sequence
        self.sequence = sequence + 1
        self.last_scan = scan
        words = self._words
        written = words[W_WRITTEN]
        if written - words[W_READ] >= self.capacity:
            self.lost += 1
            words[W_LOST] = self.lost
            return False
        at = HEADER_BYTES + (written % self.capacity) * RECORD_BYTES
        end = at + BODY_BYTES
        view = self._bytes
        BODY_STRUCT.pack_into(view, at, sequence, scan, lateness_ns, min(work_ns, MAX_WORK_NS), *image, *orders)
        CHECK_STRUCT.pack_into(view, end, zlib.crc32(view[at:end]))
        words[W_WRITTEN] = written + 1
        return True

    def take_command(self) -> int:
        """Return the oldest command not seen yet, and never the same one again; `Command.NONE` when there is none.

        What is no command is taken and counted: it must end neither the scan nor its record.
        """
        taken = self._taken
        words = self._words
        written: int = words[W_COMMANDS_WRITTEN]
        if written == taken:
            return 0
        if not 0 < written - taken <= MAILBOX_SLOTS:  # no desk of this program counts so
            self.strange_commands += 1
            self._taken = words[W_COMMANDS_TAKEN] = written
            return 0
        command: int = words[W_SLOTS + taken % MAILBOX_SLOTS]
        self._taken = words[W_COMMANDS_TAKEN] = taken + 1
        if command not in _COMMANDS:
            self.strange_commands += 1
            return 0
        return command


class RingReader(_Mapped):
    """The desk's end: drains records and sends commands."""

    @property
    def state(self) -> ScanState:
        """State of the scan process."""
        return ScanState(self._words[W_STATE])

    def beat(self) -> None:
        """Say that the desk is there; called at every look."""
        self._words[W_DESK_BEATS] += 1

    def note_stop(self, cause: StopCause) -> None:
        """Keep why the desk asks for a stop, for whoever concludes the run."""
        self._words[W_STOPPED_FOR] = int(cause)

    @property
    def stop_cause(self) -> StopCause:
        """Why the desk asked for a stop."""
        return StopCause(self._words[W_STOPPED_FOR])

    @property
    def stopped_because(self) -> str:
        """Why the run was stopped although nobody asked for it; empty when nothing here says so."""
        if self.stop_cause is StopCause.DISK:
            return "the disk did not take the records, so the desk"
        if self.lost:
            return f"{self.lost} records found no room, because they were not taken in time, so the scan process"
        return ""

    def mark_died(self) -> None:
        """Note that the scan process ended without saying so."""
        self._words[W_STATE] = int(ScanState.DIED)

    @property
    def pid(self) -> int:
        """Process id of the scan process, 0 before it has started."""
        return int(self._words[W_PID])

    @property
    def written(self) -> int:
        """Records appended so far."""
        return int(self._words[W_WRITTEN])

    @property
    def lost(self) -> int:
        """Records that found the ring full."""
        return int(self._words[W_LOST])

    @property
    def started_ns(self) -> int:
        """Monotonic time from which the scan's deadlines count; 0 before its first scan."""
        return int(self._words[W_STARTED])

    @property
    def taken(self) -> int:
        """Records that were appended and taken."""
        return int(self._words[W_READ])

    @property
    def waiting(self) -> int:
        """Records that were appended and not taken yet."""
        words = self._words
        return int(words[W_WRITTEN] - words[W_READ])

    def last(self) -> bytes:
        """Return the newest record, taken or not; empty before the first. For a scan that has ended."""
        written = self._words[W_WRITTEN]
        at = HEADER_BYTES + ((written - 1) % self.capacity) * RECORD_BYTES
        return bytes(self._bytes[at : at + RECORD_BYTES]) if written else b""

    def drain(self, keep: Callable[[bytes], None]) -> None:
        """Hand all records appended since the last call to `keep`; their room is free once it has returned."""
        words = self._words
        written, read = words[W_WRITTEN], words[W_READ]
        if written == read:
            return
        first, last = read % self.capacity, written % self.capacity
        start = HEADER_BYTES + first * RECORD_BYTES
        if first < last:
            data = bytes(self._bytes[start : HEADER_BYTES + last * RECORD_BYTES])
        else:
            end = HEADER_BYTES + self.capacity * RECORD_BYTES
            data = bytes(self._bytes[start:end]) + bytes(self._bytes[HEADER_BYTES : HEADER_BYTES + last * RECORD_BYTES])
        keep(data)
        words[W_READ] = written

    def send(self, command: Command) -> None:
        """Put a command into the mailbox; the scan takes one per scan, in this order.

        Raises:
            RingError: the scan has not taken the last 16 commands.

        """
        words = self._words
        count = words[W_COMMANDS_WRITTEN]
        if count - words[W_COMMANDS_TAKEN] >= MAILBOX_SLOTS:
            raise RingError("the scan process does not take commands any more")
        words[W_SLOTS + count % MAILBOX_SLOTS] = int(command)
        words[W_COMMANDS_WRITTEN] = count + 1
