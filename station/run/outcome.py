"""How a scan ended, as its supervisor knows it: on disk before the run is concluded, so that others can conclude it.

The room for it is taken before the run starts: a disk that fills up in the meantime costs no verdict.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Self

from station.atomic_file import reserve
from station.documents.entries import Count, plain
from station.documents.events import Note
from station.documents.manifest import Finite, Large
from station.documents.scan_report import Pace, Realtime, ScanReport, ScanTimes
from station.documents.timing import Disk
from station.errors import BenchFaultError, RecordError
from station.records.ring.reader import RingReader
from station.records.ring.ring import StopCause
from station.records.run_record import SCAN_REPORT, RunRecord

SUPERVISOR_REPORT = "desk-report.json"
REPORT_BYTES = 1 << 18
"""Room that is taken for it: counters, histograms of the timing, the periods that were missed, notes."""

VIRTUAL_REALTIME = Realtime(
    fifo=False,
    mlock=False,
    details={"clock": "virtual time: scans follow each other as fast as they go, nothing is asked of the machine"},
)


@dataclass(frozen=True)
class RunOutcome:
    """How the scan ended: records it says it wrote, those it lost, its report, and why it ended early if it did.

    `refused`: the bench could not be opened, nothing has moved. `started_ns`: monotonic time; scan n was due n + 1
    periods after it.
    """

    written: Count
    lost: Count = 0
    realtime: Realtime = VIRTUAL_REALTIME
    notes: tuple[Note, ...] = ()
    trouble: str = ""
    refused: bool = False
    counters: Mapping[str, int] = field(default_factory=dict)
    times: ScanTimes = field(default_factory=ScanTimes)
    started_ns: Large = 0
    clock_jumped_s: Finite = 0.0
    """By how much the computer's wall clock was set in the middle."""
    stopped_because: str = ""
    """Subject of the sentence that tells who stopped the run and why; empty for the operator."""
    stopped_by: str = ""
    """Name of that cause (`StopCause`) in small letters; empty for the operator."""
    desk_died: str = ""
    """What became of a run whose supervisor ended in the middle; empty where it was there to the end."""
    disk: Disk | None = None
    pace: Pace | None = None
    """What the scan says of a bench that waited for it: its unit, and what was stretched; None for any other bench."""

    @classmethod
    def refused_by(cls, record: RunRecord, error: BenchFaultError) -> Self:
        """Return the outcome of a run whose bench could not be opened: nothing has moved."""
        return cls(written=record.records(), realtime=Realtime(), trouble=str(error), refused=True)

    @classmethod
    def kept_in(cls, record: RunRecord) -> Self | None:
        """Return what the supervisor has put on disk; None where it did not come so far, or nobody can read it."""
        with suppress(RecordError):
            kept = record.read(cls, SUPERVISOR_REPORT)
            # In virtual time nothing is measured of the disk, which versions before kept as an empty block.
            return replace(kept, disk=None) if kept.disk == Disk() else kept
        return None

    def keep(self, record: RunRecord) -> None:
        """Put the outcome on disk: from here on the run is concluded by it, whoever does that.

        Raises:
            RecordError: the disk refuses it.

        """
        record.write_json(SUPERVISOR_REPORT, plain(self))


def take_room(record: RunRecord) -> None:
    """Take the room for the outcome before the run starts; RecordError when the disk has none."""
    reserve(record.folder / SUPERVISOR_REPORT, REPORT_BYTES)


def scan_report(record: RunRecord) -> ScanReport:
    """Return what the scan process said at its end; nothing where a failing disk kept none of it, or half."""
    with suppress(RecordError):
        return record.read(ScanReport, SCAN_REPORT)
    return ScanReport()


def cause_name(ring: RingReader) -> str:
    """Return the name of what stopped a run although nobody asked for it; empty where the ring knows of nothing."""
    return "" if ring.stop_cause is StopCause.NONE else ring.stop_cause.name.lower()
