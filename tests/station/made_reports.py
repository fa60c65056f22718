"""Reports of `lostmotion timing` that were made up: a machine as it should be, and what a test changes of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from station.documents.reading import of_plain
from station.timing.report import TimingReport

TIMES = {"p50": 1.0, "p99": 1.0, "p999": 1.0, "max": 1.0}
SHORT = {"lateness_us": 1.0, "read_us": 1.0, "step_us": 1.0, "write_us": 1.0, "record_us": 1.0}
GOOD: dict[str, Any] = {
    "period_ns": 1_000_000, "spin_ns": 0, "bench": "virtual", "embedded": True, "bitrate": 1_000_000, "bus_us": 410.0,
    "periods": 1000, "scans": 1000, "lost": 0, "missed": 0, "realtime": {}, "lateness_us": TIMES, "work_us": TIMES,
    "parts_us": {}, "histograms_us": {}, "gaps": [], "gaps_in_all": 0, "longest_scans": [], "latest_scans": [],
    "counters": {}, "resident_kb": {"before": 70_000, "after": 70_100}, "preempted": 0,
    "records": {"checked": 1000, "problem": ""}, "virtual_bench_cpu_s": 1.0, "machine": [], "asked": {"seconds": 1.0},
}  # fmt: skip


def gap(scan: int, missed: int, cause: str) -> dict[str, Any]:
    """A gap after `scan`, which took long for that cause."""
    return {"scan": scan + 1 + missed, "missed": missed, "before": {"scan": scan, "cause": cause, **SHORT}}


def report(**changed: Any) -> TimingReport:
    return of_plain(TimingReport, GOOD | changed, Path("made up"))
