"""What the scan process says of itself, `scan-report.json`: that it is there, and at its end how the scan was."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from station.documents.events import Note
from station.documents.manifest import Count
from station.documents.timing import Pace, Realtime, ScanTimes


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanReport:
    """None, '' or nothing stands for what the process could not say any more.

    state: `running`, `finished`, `refused` (the bench could not be opened) or `failed`; `error` says why.
    written: records, the lost ones among them.
    """

    state: str = ""
    error: str = ""
    pid: int | None = None
    birth: str = ""
    written: Count | None = None
    lost: Count = 0
    realtime: Realtime = field(default_factory=Realtime)
    counters: Mapping[str, int] | None = None
    times: ScanTimes = field(default_factory=ScanTimes)
    pace: Pace | None = None
    notes: tuple[Note, ...] = ()
