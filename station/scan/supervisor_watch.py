"""The scan's watch over its supervisor: a unit is not kept under load for a supervisor that is gone or stands still."""

from __future__ import annotations

from station.documents.events import Note
from station.records.ring.ring import StopCause
from station.records.ring.writer import RingWriter
from station.scan.scan_loop import Stop

LONGEST_SILENCE_S = 2.0
"""A supervisor looks 50 times per second; a supervisor that takes a run over has this long to begin."""

SUPERVISOR_SILENT = (
    f"no sign of life from the supervisor process for {LONGEST_SILENCE_S:g} s: stop ordered, unit unloaded"
)
SUPERVISOR_GONE = "the supervisor process ended before the run started: stop ordered, nothing moved"
STRANGE_COMMANDS = "{} invalid command(s) ignored"


class SupervisorWatch:
    """Takes the supervisor's commands and asks for a stop, once, when the supervisor has been silent for too long."""

    def __init__(self, ring: RingWriter, stop: Stop, period_ns: int, *, commands_from: int = 0) -> None:
        """Watch; commands wait until the scan `commands_from`, so that a run can begin in the same scan every time."""
        self._ring, self._stop = ring, stop
        self._scans_to_wait = commands_from
        self._beats = ring.supervisor_beats
        self._limit_scans = round(LONGEST_SILENCE_S * 1e9 / period_ns)
        self._silent_scans = 0
        self.silent_at: int | None = None
        """Scan at which the supervisor was given up."""

    def take_command(self) -> int:
        """Return the next command of the supervisor, and count the scans since its last sign."""
        ring = self._ring
        beats = ring.supervisor_beats
        if beats != self._beats:
            self._beats, self._silent_scans = beats, 0
        else:
            self._silent_scans += 1
            if self._silent_scans > self._limit_scans and self.silent_at is None:
                self.silent_at = ring.last_scan
                ring.note_stop(StopCause.DESK_SILENT)
                self._stop.ask()
        if self._scans_to_wait:
            self._scans_to_wait -= 1
            return 0
        return ring.take_command()

    def notes(self) -> tuple[Note, ...]:
        """Return what the record has to say of the supervisor."""
        said = [] if self.silent_at is None else [(max(self.silent_at, 0), SUPERVISOR_SILENT)]
        if self._stop.supervisor_gone:
            said.append((max(self._ring.last_scan, 0), SUPERVISOR_GONE))
        if self._ring.strange_commands:
            said.append((max(self._ring.last_scan, 0), STRANGE_COMMANDS.format(self._ring.strange_commands)))
        return tuple(Note(scan=scan, kind="note", text=text) for scan, text in said)
