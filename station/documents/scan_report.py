"""What the scan process says of itself, `scan-report.json`: that it is there, and at its end how the scan was.

The process writes these classes with the libraries it has locked into memory: nothing here brings a reader along.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from station.documents.entries import Count, Number, left_out, one_of
from station.documents.events import Note

CAUSE_NAMES = ("read", "step", "write", "record", "waking")
"""What can make a period pass (`station.records.scan_times` says what each means)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Percentiles:
    """Percentiles and maximum of times [µs]; p999 is 99.9 %."""

    p50: Number = 0.0
    p99: Number = 0.0
    p999: Number = 0.0
    max: Number = 0.0


@dataclass(frozen=True, slots=True)
class MachineFinding:
    """One look at a computer: what was looked at, whether it is as it should be, what was found, how to mend it."""

    name: str
    in_order: bool
    found: str
    mend: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Realtime:
    """What was asked of the operating system: whether it was granted, and the details of each answer."""

    affinity: bool | None = left_out()
    timer_slack: bool | None = left_out()
    prefault: bool | None = left_out()
    mlock: bool | None = left_out()
    gc_off: bool | None = left_out()
    fifo: bool | None = left_out()
    spin_tail: bool | None = left_out()
    details: Mapping[str, str] = field(default_factory=dict)
    machine: tuple[MachineFinding, ...] | None = left_out()

    def granted(self, name: str) -> bool:
        """Whether a request was granted."""
        return bool(getattr(self, name, None))


@dataclass(frozen=True, slots=True, kw_only=True)
class Pace:
    """What became of the periods on a bench that waited for the scan; `unit`: its unit, as the bench names it."""

    unit: str = ""
    unanswered: int = 0
    frames_sent_by_bench: int = 0
    frames_received: int = 0
    fast: bool = False
    stretched: int = 0
    stretched_s: Number = 0.0
    longest_s: Number = 0.0
    would_have_missed: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanRow:
    """One scan: what took most of its time, its wake-up latency and the time of its parts [µs]."""

    scan: int
    cause: Annotated[str, one_of(*CAUSE_NAMES)]
    lateness_us: Number
    read_us: Number
    step_us: Number
    write_us: Number
    record_us: Number


@dataclass(frozen=True, slots=True, kw_only=True)
class Gap:
    """Missed periods: the scan that came after them, and the one before, which made them pass."""

    scan: int
    missed: int
    before: ScanRow


@dataclass(frozen=True, slots=True, kw_only=True)
class Memory:
    """Resident memory of the scan process at its start and at its end [KiB]."""

    before: int
    after: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanTimes:
    """What the scan process counts beside its records; `gaps` are the first ones, `gaps_in_all` says how many."""

    parts_us: Mapping[str, Percentiles] | None = left_out()
    histograms_us: Mapping[str, tuple[tuple[Number, int], ...]] | None = left_out()
    gaps: tuple[Gap, ...] | None = left_out()
    gaps_in_all: int | None = left_out()
    longest_scans: tuple[ScanRow, ...] | None = left_out()
    latest_scans: tuple[ScanRow, ...] | None = left_out()
    resident_kb: Memory | None = left_out()


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanReport:
    """None, '' or nothing stands for what the process could not say any more.

    state: `running`, `finished`, `refused` (the bench could not be opened) or `failed`; `error` says why.
    written: records, the lost ones among them. verified: what was verified of the bench's devices, one line each.
    """

    state: str = ""
    error: str = ""
    traceback: str | None = left_out()
    pid: int | None = None
    birth: str = ""
    scans: int | None = None
    started_ns: int | None = None
    written: Count | None = None
    lost: Count = 0
    realtime: Realtime = field(default_factory=Realtime)
    verified: tuple[str, ...] = ()
    counters: Mapping[str, int] | None = None
    times: ScanTimes = field(default_factory=ScanTimes)
    pace: Pace | None = None
    notes: tuple[Note, ...] = ()
    stopped_by_signal: bool | None = None
