"""The proof of timing, `timing.json`, of which a result has the first part: how the scan kept its periods."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from station.documents.manifest import ClockName, Period
from station.documents.reading import Number, left_out, one_of

CAUSE_NAMES = ("read", "step", "write", "record", "waking")
"""What can make a period pass (`station.records.scan_times` says what each means)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Percentiles:
    """Percentiles and maximum of times [µs]; p999 is 99.9 %."""

    p50: Number = 0.0
    p99: Number = 0.0
    p999: Number = 0.0
    max: Number = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineFinding:
    """What stands in the way of real time on a computer, and how to mend it."""

    name: str
    in_order: bool = False
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
class Disk:
    """What the disk did to a run; `from_record`: what came before belongs to another supervisor process."""

    flushes: int = 0
    longest_write_s: Number = 0.0
    longest_flush_s: Number = 0.0
    longest_unflushed_s: Number = 0.0
    most_waiting: int = 0
    refused: int = 0
    from_record: int | None = left_out()


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
class Timing:
    """Times in µs, ages in scans. What is left out of a result stands in timing.json of a run over wires."""

    period_ns: Period
    clock: ClockName
    scans: int
    missed: int
    longest_gap_periods: int
    lateness_us: Percentiles
    work_us: Percentiles
    oldest_sample_scans: int
    realtime: Realtime = field(default_factory=Realtime)
    wires: Mapping[str, int] = field(default_factory=dict)
    pace: Pace | None = left_out()
    disk: Disk | None = left_out()
    wall_clock_jumped_s: Number | None = left_out()
    parts_us: Mapping[str, Percentiles] | None = left_out()
    histograms_us: Mapping[str, tuple[tuple[Number, int], ...]] | None = left_out()
    gaps: tuple[Gap, ...] | None = left_out()
    gaps_in_all: int | None = left_out()
    longest_scans: tuple[ScanRow, ...] | None = left_out()
    latest_scans: tuple[ScanRow, ...] | None = left_out()
    resident_kb: Memory | None = left_out()
