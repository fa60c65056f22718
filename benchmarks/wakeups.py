"""How late a process wakes: cyclictest, a plain Python loop, the bare schedule of the scan, and the whole scan."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from station.documents.reading import document_in
from station.records.scan_times import Counts
from station.scan import realtime
from station.scan.schedule import RealTimeSchedule
from station.timing.report import TimingReport

ROOT = Path(__file__).parents[1]
PERIOD_NS = 1_000_000
LARGEST_US = 20_000


@dataclass(frozen=True)
class WakeUpLatency:
    """Wake-up latency of one way to wait [µs]."""

    name: str
    p50: float
    p99: float
    p999: float
    largest: float

    def row(self, base: WakeUpLatency | None) -> str:
        """Return it as a row, with p99 and p99.9 as multiples of those of `base`."""
        figures = "".join(f"{value:9.1f}" for value in (self.p50, self.p99, self.p999, self.largest))
        if base is None or base is self:
            return f"  {self.name:34}{figures}"
        ratios = (self.p99 / max(base.p99, 1.0), self.p999 / max(base.p999, 1.0))
        return f"  {self.name:34}{figures}" + "".join(f"{ratio:9.2f}" for ratio in ratios)


HEAD = f"  {'wake-up latency in µs':34}{'p50':>9}{'p99':>9}{'p99.9':>9}{'max':>9}{'p99/c':>9}{'p99.9/c':>9}"


def of_counts(name: str, counts: Counts) -> WakeUpLatency:
    """Return the figures of a histogram of ours."""
    found = [counts.percentile_us(percent) for percent in (50.0, 99.0, 99.9)]
    return WakeUpLatency(name, found[0], found[1], found[2], counts.largest_ns / 1000.0)


@dataclass(frozen=True)
class Histogram:
    """What cyclictest counted: pairs of latency [µs] and count, how many were beyond the last, and the largest."""

    counted: list[tuple[int, int]]
    beyond: int
    largest_us: float

    @classmethod
    def parse(cls, text: str) -> Histogram | None:
        """Read the output of `cyclictest -q -h`; None when it has no counts."""
        lines = text.splitlines()
        rows = [line.split() for line in lines if line[:1].isdigit()]
        counted = [(int(row[0]), int(row[1])) for row in rows if len(row) == 2]
        if not any(count for _, count in counted):
            return None
        named = {
            line.split(":")[0]: line.split(":")[1].split() for line in lines if line.startswith("# ") and ":" in line
        }
        overflows, maxima = named.get("# Histogram Overflows", []), named.get("# Max Latencies", [])
        seen = float(max(us for us, count in counted if count))
        return cls(counted, sum(int(word) for word in overflows[:1]), float(maxima[0]) if maxima else seen)

    @property
    def total(self) -> int:
        """How many wake-ups there were."""
        return sum(count for _, count in self.counted) + self.beyond

    def lateness(self, name: str) -> WakeUpLatency:
        """Return percentiles and maximum."""
        p50, p99, p999 = (_percentile(self.counted, self.total, percent) for percent in (50.0, 99.0, 99.9))
        return WakeUpLatency(name, p50, p99, p999, self.largest_us)


def cyclictest_command(seconds: float) -> list[str] | None:
    """Return cyclictest (rt-tests) at the scan's priority and period; None where it is not installed."""
    program = shutil.which("cyclictest")
    if program is None:
        return None
    command = [program, "-q", "-m", "-t1", f"-p{realtime.FIFO_PRIORITY}", f"-i{PERIOD_NS // 1000}", "--default-system"]
    return [*command, f"-l{round(seconds * 1e9 / PERIOD_NS)}", f"-h{LARGEST_US}"]


def cyclictest(seconds: float) -> WakeUpLatency | None:
    """Return what cyclictest sees; None where it is missing or refused."""
    command = cyclictest_command(seconds)
    if command is None:
        return None
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=seconds + 60)  # noqa: S603
    histogram = Histogram.parse(done.stdout)
    return None if histogram is None else histogram.lateness("cyclictest")


def _percentile(counted: list[tuple[int, int]], total: int, percent: float) -> float:
    seen = 0
    for us, count in counted:
        seen += count
        if seen * 100 >= percent * total:
            return float(us)
    return float(LARGEST_US)


def in_child(kind: str, seconds: float) -> WakeUpLatency:
    """Run a loop of ours in a process of its own: what it asks of the machine it asks for good."""
    command = [sys.executable, "-m", "benchmarks.wakeups", kind, str(seconds)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)  # noqa: S603
    return WakeUpLatency(**json.loads(done.stdout))


def full_scan(seconds: float, *, period_us: int = 1000, spin_us: int | None = None) -> TimingReport:
    """Return the report of `lostmotion timing`: CAN, Modbus, controller and record against the virtual bench."""
    command = [sys.executable, "-m", "station", "timing", "--json", "--seconds", str(seconds)]
    command += ["--period-us", str(period_us)]
    command += [] if spin_us is None else ["--spin-us", str(spin_us)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)  # noqa: S603
    if not done.stdout:
        raise SystemExit(f"lostmotion timing failed: {done.stderr}")
    return document_in(TimingReport, done.stdout.encode(), Path("lostmotion timing --json"))


def of_report(name: str, report: TimingReport) -> WakeUpLatency:
    """Return the wake-up latency in a report of `lostmotion timing`."""
    late = report.lateness_us
    return WakeUpLatency(name, late.p50, late.p99, late.p999, late.max)


def _plain(seconds: float) -> Counts:
    """Sleep until the next deadline, as anyone would write it."""
    counts = Counts()
    deadline = time.monotonic_ns()
    for _ in range(round(seconds * 1e9 / PERIOD_NS)):
        deadline += PERIOD_NS
        time.sleep(max(deadline - time.monotonic_ns(), 0) * 1e-9)
        counts.add(max(time.monotonic_ns() - deadline, 0))
    return counts


def _schedule(seconds: float) -> Counts:
    """Wait with the scan's own schedule and privileges, and do nothing."""
    counts = Counts()
    realtime.request_all()
    schedule = RealTimeSchedule(PERIOD_NS)
    schedule.start()
    for _ in range(round(seconds * 1e9 / PERIOD_NS)):
        schedule.wait()
        counts.add(schedule.lateness_ns)
    return counts


LOOPS = {"plain": ("Python, time.sleep", _plain), "schedule": ("our schedule, no work", _schedule)}


if __name__ == "__main__":
    label, loop = LOOPS[sys.argv[1]]
    json.dump(of_counts(label, loop(float(sys.argv[2]))).__dict__, sys.stdout)
    sys.stdout.flush()
    os._exit(0)
