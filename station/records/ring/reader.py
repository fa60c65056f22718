"""The supervisor's end of the ring: what the scan process says of itself, its records, and commands to it."""

from __future__ import annotations

from collections.abc import Callable

from definitions.image import Command
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
    W_STOPPED_FOR,
    W_SUPERVISOR_BEATS,
    W_WRITTEN,
    MappedRing,
    RingError,
    ScanState,
    StopCause,
)
from station.records.samples.scan_record import RECORD_BYTES


class RingReader(MappedRing):
    """The supervisor's end: drains records and sends commands."""

    @property
    def state(self) -> ScanState:
        """State of the scan process."""
        return ScanState(self._words[W_STATE])

    def beat(self) -> None:
        """Say that the supervisor is there; called at every look."""
        self._words[W_SUPERVISOR_BEATS] += 1

    def note_stop(self, cause: StopCause) -> None:
        """Keep why the supervisor asks for a stop, for whoever concludes the run."""
        self._words[W_STOPPED_FOR] = int(cause)

    @property
    def stop_cause(self) -> StopCause:
        """Why the run was stopped although nobody asked for it; the supervisor's word comes first."""
        cause = StopCause(self._words[W_STOPPED_FOR] or self._words[W_ENDED_FOR])
        return StopCause.RECORDS_LOST if cause is StopCause.NONE and self.lost else cause

    @property
    def stopped_because(self) -> str:
        """Say the same as the subject of a sentence; empty when nothing here says so."""
        texts = {
            StopCause.DISK: "the supervisor, because records could not be written to disk,",
            StopCause.DESK_SILENT: "the scan process, because the supervisor process ended,",
            StopCause.DESK_GONE: "the scan process, because the supervisor process ended,",
            StopCause.RECORDS_LOST: (
                f"the scan process, because {self.lost} records were lost (the supervisor was too slow),"
            ),
        }
        return texts.get(self.stop_cause, "")

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
        """Return the newest record, taken or not; empty before the first."""
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

    @property
    def commands_waiting(self) -> int:
        """Commands that were sent and not taken by a scan yet."""
        words = self._words
        return int(words[W_COMMANDS_WRITTEN] - words[W_COMMANDS_TAKEN])

    def send(self, command: Command) -> None:
        """Put a command into the mailbox; the scan takes one per scan, in this order.

        Raises:
            RingError: the scan has not taken the last 16 commands.

        """
        words = self._words
        count = words[W_COMMANDS_WRITTEN]
        if self.commands_waiting >= MAILBOX_SLOTS:
            raise RingError(
                "the scan process no longer accepts commands. Press the emergency stop if the shaft is under torque"
            )
        words[W_SLOTS + count % MAILBOX_SLOTS] = int(command)
        words[W_COMMANDS_WRITTEN] = count + 1
