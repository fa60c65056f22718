"""What a scan's time went into: counters that are allocated before the scan, longest and latest scans by name.

Four marks per scan give four parts: read, step, write, record. Each part, the wake-up latency and the work have a
histogram of fixed size; the longest scans, the latest ones and the gaps are kept with their numbers, so that a missed
period and the worst latency can be explained.
All of it costs less than 2 µs per scan (`benchmarks` prints the figure).
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

from station.documents.scan_report import Gap, Memory, Percentiles, ScanRow
from station.documents.scan_report import ScanTimes as CountedTimes

PARTS = ("read", "step", "write", "record")
SERIES = ("lateness", *PARTS)

FINE_NS = 1 << 10
"""Width of the fine bins: 1.024 µs up to about a millisecond."""

FINE_BINS = 1 << 10
COARSE_BINS = 24
"""One bin per doubling above the fine ones: up to several hours."""

LONGEST_KEPT = 16
GAPS_KEPT = 256

CAUSES = {
    "read": "reading from CAN and Modbus took long",
    "step": "the controller itself took long",
    "write": "sending to the bus took long",
    "record": "writing the record took long: memory pressure, or a page fault",
    "waking": "late wake-up: another process, an interrupt, or the virtual machine's host",
}
"""What can make a period pass, and what it means."""


class Counts:
    """A histogram of times: 1 µs bins up to 1 ms, doublings above. Nothing is allocated after the start."""

    __slots__ = ("_bins", "largest_ns")

    def __init__(self) -> None:
        self._bins = [0] * (FINE_BINS + COARSE_BINS)
        self.largest_ns = 0

    def add(self, ns: int) -> None:
        """Count one time [ns]."""
        index = ns >> 10
        if index >= FINE_BINS:
            index = min(FINE_BINS + index.bit_length() - FINE_BINS.bit_length(), FINE_BINS + COARSE_BINS - 1)
        self._bins[index] += 1
        if ns > self.largest_ns:  # noqa: PLR1730 - a comparison is a fifth of a call of max()
            self.largest_ns = ns

    @property
    def total(self) -> int:
        """How many times were counted."""
        return sum(self._bins)

    def edges_us(self) -> list[tuple[float, int]]:
        """Return the upper edge [µs] and count of every bin that is not empty."""
        return [(_upper_ns(index) / 1000.0, count) for index, count in enumerate(self._bins) if count]

    def percentile_us(self, percent: float) -> float:
        """Return the upper edge of the bin that holds this percentile, never above the largest time seen [µs]."""
        total, seen = self.total, 0
        for index, count in enumerate(self._bins):
            seen += count
            if count and seen * 100 >= percent * total:
                return min(_upper_ns(index), self.largest_ns) / 1000.0
        return 0.0

    def percentiles(self) -> Percentiles:
        """Return percentiles and maximum [µs]."""
        p50, p99, p999 = (round(self.percentile_us(percent), 3) for percent in (50.0, 99.0, 99.9))
        return Percentiles(p50=p50, p99=p99, p999=p999, max=round(self.largest_ns / 1000.0, 3))


def _upper_ns(index: int) -> int:
    return (index + 1) * FINE_NS if index < FINE_BINS else FINE_BINS * FINE_NS << (index - FINE_BINS + 1)


class LongScan(NamedTuple):
    """One scan, its wake-up latency and its parts [ns]."""

    scan: int
    lateness_ns: int
    read_ns: int
    step_ns: int
    write_ns: int
    record_ns: int

    @property
    def longest_part(self) -> str:
        """Name of the part that took most."""
        return max(PARTS, key=lambda part: int(getattr(self, f"{part}_ns")))

    @property
    def cause(self) -> str:
        """Name of what took most: waking late, or one of the parts."""
        part = self.longest_part
        return "waking" if self.lateness_ns > getattr(self, f"{part}_ns") else part

    def row(self) -> ScanRow:
        """Return it in µs, with what took most."""
        times = {f"{name}_us": round(getattr(self, f"{name}_ns") / 1000.0, 3) for name in SERIES}
        return ScanRow(scan=self.scan, cause=self.cause, **times)


class ScanTimes:
    """Everything that is counted in one run; `add` is called once per scan and allocates nothing lasting."""

    def __init__(self) -> None:
        self.counts = {name: Counts() for name in (*SERIES, "work")}
        self._lateness = self.counts["lateness"].add
        self._read, self._step = self.counts["read"].add, self.counts["step"].add
        self._write, self._record = self.counts["write"].add, self.counts["record"].add
        self._work = self.counts["work"].add
        self._longest: list[LongScan] = [LongScan(0, 0, 0, 0, 0, 0)] * LONGEST_KEPT
        self._shortest_kept_ns = 0
        self._latest: list[LongScan] = [LongScan(0, 0, 0, 0, 0, 0)] * LONGEST_KEPT
        self._least_late_kept_ns = 0
        self._gaps: list[tuple[int, int, LongScan]] = []
        self._waking_ns = 0
        self._marks = (0, 0, 0, 0, 0)
        self.missed = 0
        self.gaps = 0

    def add(
        self,
        scan: int,
        missed: int,
        lateness_ns: int,
        marks: tuple[int, int, int, int, int],
    ) -> None:
        """Count one scan; `marks` are the times of waking, read, stepped, written and recorded [ns]."""
        woken, was_read, stepped, written, recorded = marks
        read_ns, step_ns, write_ns = was_read - woken, stepped - was_read, written - stepped
        record_ns = recorded - written
        if missed:
            self._gap(scan, missed)
        self._waking_ns, self._marks = lateness_ns, marks
        self._lateness(lateness_ns)
        self._read(read_ns)
        self._step(step_ns)
        self._write(write_ns)
        self._record(record_ns)
        self._work(written - woken)
        if recorded - woken > self._shortest_kept_ns:
            self._keep(LongScan(scan, lateness_ns, read_ns, step_ns, write_ns, record_ns))
        if lateness_ns > self._least_late_kept_ns:
            self._keep_late(LongScan(scan, lateness_ns, read_ns, step_ns, write_ns, record_ns))

    def _keep_late(self, late: LongScan) -> None:
        """Put a scan among the latest, in place of the least late of them: long work is not what made it late."""
        times = [one.lateness_ns for one in self._latest]
        self._latest[times.index(self._least_late_kept_ns)] = late
        self._least_late_kept_ns = min(one.lateness_ns for one in self._latest)

    def _keep(self, long: LongScan) -> None:
        """Put a scan among the longest, in place of the shortest of them."""
        durations = [sum(one[2:]) for one in self._longest]
        self._longest[durations.index(min(durations))] = long
        self._shortest_kept_ns = min(sum(one[2:]) for one in self._longest)

    def _gap(self, scan: int, missed: int) -> None:
        """Note missed periods; the scan before them is what made them pass."""
        self.missed += missed
        self.gaps += 1
        if len(self._gaps) < GAPS_KEPT:
            parts = (after - before for before, after in pairwise(self._marks))
            self._gaps.append((scan, missed, LongScan(scan - missed - 1, self._waking_ns, *parts)))

    def gap_list(self) -> tuple[Gap, ...]:
        """Return the first gaps: scan that followed, periods missed, and the scan before with its cause."""
        return tuple(Gap(scan=scan, missed=missed, before=before.row()) for scan, missed, before in self._gaps)

    def longest(self) -> list[LongScan]:
        """Return the longest scans, longest first."""
        kept = [one for one in self._longest if sum(one[2:])]
        return sorted(kept, key=lambda one: -sum(one[2:]))

    def latest(self) -> list[LongScan]:
        """Return the scans that began latest after their deadline, latest first."""
        kept = [one for one in self._latest if one.lateness_ns]
        return sorted(kept, key=lambda one: -one.lateness_ns)

    def parts_us(self) -> dict[str, Percentiles]:
        """Return percentiles and maximum of every part."""
        return {name: self.counts[name].percentiles() for name in PARTS}

    def histograms_us(self) -> dict[str, tuple[tuple[float, int], ...]]:
        """Return the histograms of wake-up latency and work: upper edge and count of every bin that is not empty."""
        return {name: tuple(self.counts[name].edges_us()) for name in ("lateness", "work")}

    def counted(self, resident_kb: Memory | None = None) -> CountedTimes:
        """Return it for the timing proof: percentiles of every part, histograms, gaps, longest and latest scans.

        resident_kb: memory of the process, where somebody looked at it.
        """
        return CountedTimes(
            parts_us=self.parts_us(),
            histograms_us=self.histograms_us(),
            gaps=self.gap_list(),
            gaps_in_all=self.gaps,
            longest_scans=tuple(one.row() for one in self.longest()),
            latest_scans=tuple(one.row() for one in self.latest()),
            resident_kb=resident_kb,
        )
