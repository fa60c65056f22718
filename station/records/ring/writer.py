"""The scan's end of the ring: appends records and takes commands."""

from __future__ import annotations

import os
import zlib
from pathlib import Path

from definitions.image import Command, Image, Orders, image_values
from station.records.ring.ring import (
    HEADER_BYTES,
    MAILBOX_SLOTS,
    W_COMMANDS_TAKEN,
    W_COMMANDS_WRITTEN,
    W_ENDED_FOR,
    W_LOST,
    W_PID,
    W_READ,
    W_SLOTS,
    W_STARTED,
    W_STATE,
    W_SUPERVISOR_BEATS,
    W_WRITTEN,
    MappedRing,
    ScanState,
    StopCause,
)
from station.records.samples.scan_record import BODY_BYTES, BODY_STRUCT, CHECK_STRUCT, MAX_WORK_NS, RECORD_BYTES

_COMMANDS = frozenset(map(int, Command))


class RingWriter(MappedRing):
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
        """Commands that the supervisor has given so far, seen by a scan or not."""
        return int(self._words[W_COMMANDS_WRITTEN])

    @property
    def supervisor_beats(self) -> int:
        """Looks of the supervisor so far."""
        beats: int = self._words[W_SUPERVISOR_BEATS]
        return beats

    def set_state(self, state: ScanState) -> None:
        """Tell the supervisor where the scan process is."""
        self._words[W_STATE] = int(state)

    def note_stop(self, cause: StopCause) -> None:
        """Keep why the scan process asks for a stop, for the case that it cannot be told at the end."""
        self._words[W_ENDED_FOR] = int(cause)

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
        BODY_STRUCT.pack_into(
            view, at, sequence, scan, lateness_ns, min(work_ns, MAX_WORK_NS), *image_values(image), *orders
        )
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
        if not 0 < written - taken <= MAILBOX_SLOTS:  # no supervisor of this program counts so
            self.strange_commands += 1
            self._taken = words[W_COMMANDS_TAKEN] = written
            return 0
        command: int = words[W_SLOTS + taken % MAILBOX_SLOTS]
        self._taken = words[W_COMMANDS_TAKEN] = taken + 1
        if command not in _COMMANDS:
            self.strange_commands += 1
            return 0
        return command
