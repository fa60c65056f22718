"""What `lostmotion timing` says of a computer: the report of the process that scanned, and all of it.

The process writes its part with the libraries it has locked into memory: nothing here brings a reader along.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from station.documents.entries import Number
from station.documents.scan_report import Gap, MachineFinding, Memory, Percentiles, Realtime, ScanRow


@dataclass(frozen=True, slots=True, kw_only=True)
class Scanned:
    """What the scan counted, as in the proof of timing of a run; `preempted`: involuntary context switches."""

    periods: int
    scans: int
    lost: int
    missed: int
    realtime: Realtime
    lateness_us: Percentiles
    work_us: Percentiles
    parts_us: Mapping[str, Percentiles]
    histograms_us: Mapping[str, tuple[tuple[Number, int], ...]]
    gaps: tuple[Gap, ...]
    gaps_in_all: int
    longest_scans: tuple[ScanRow, ...]
    latest_scans: tuple[ScanRow, ...]
    counters: Mapping[str, int]
    resident_kb: Memory
    preempted: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessReport:
    """What the process that scanned has to say: what it counted, or why it refused the bench."""

    error: str = ""
    scanned: Scanned | None = None


@dataclass(frozen=True, slots=True)
class Asked:
    """What is to be measured: how long, at which period (None: the recipe's), with which spin tail (None: usual)."""

    seconds: Number
    period_ns: int | None = None
    spin_ns: int | None = None


@dataclass(frozen=True, slots=True)
class CheckedRecords:
    """Records that came out of the ring, and the first thing that was wrong with one of them."""

    checked: int
    problem: str


@dataclass(frozen=True, slots=True, kw_only=True)
class TimingReport(Scanned):
    """All of it. bus_us: how long the frames of a scan occupy the bus. virtual_bench_cpu_s: of an embedded bench."""

    period_ns: int
    spin_ns: int
    bench: str
    embedded: bool
    bitrate: int
    bus_us: Number
    records: CheckedRecords
    virtual_bench_cpu_s: Number | None
    machine: tuple[MachineFinding, ...]
    asked: Asked
    explanation: tuple[str, ...] = ()
