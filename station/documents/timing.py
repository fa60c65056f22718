"""The proof of timing, `timing.json`, of which a result has the first part: how the scan kept its periods."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from station.documents.entries import Number, left_out
from station.documents.manifest import ClockName, Period
from station.documents.scan_report import Gap, Memory, Pace, Percentiles, Realtime, ScanRow


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
