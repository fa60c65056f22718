"""`python -m benchmarks.ten_minutes [--seconds 600]`: a long scan over wires with cyclictest beside it.

CAN and Modbus of the virtual bench at 1 ms, the drive never enabled. What must hold: every record there, memory that
does not grow, and no more periods missed than the machine itself is late by, which cyclictest measures at the same
priority and period in the same minutes. It shares the two cores: of two programs at one priority one waits.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys

from benchmarks.wakeups import HEAD, LARGEST_US, Histogram, cyclictest_command, full_scan, of_report
from station.cli.bench.timing import GAPS_SHOWN, footing, lost_records
from station.records.scan_times import CAUSES
from station.timing.rates import MISSED_ALLOWED
from station.timing.report import TimingReport

PERIOD_US = 1000
GROWTH_ALLOWED_KB = 4 * 1024
"""What is touched for the first time late in the run; a record per scan that stayed would be 180 MB in ten minutes."""


def beside(seconds: float) -> subprocess.Popen[str] | None:
    """Start cyclictest at the scan's priority and period; None where it is not installed."""
    command = cyclictest_command(seconds)
    if command is None:
        return None
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)  # noqa: S603


def overruns(histogram: Histogram, period_us: int) -> int:
    """Return how many wake-ups of cyclictest were late by a whole period and more."""
    return histogram.beyond + sum(count for us, count in histogram.counted if us >= period_us)


def machine(process: subprocess.Popen[str] | None) -> Histogram | None:
    """Wait for cyclictest and return what it saw; None where it saw nothing."""
    if process is None:
        return None
    out, said = process.communicate(timeout=120)
    histogram = Histogram.parse(out)
    if histogram is None:
        print(f"  cyclictest saw nothing: {said.strip() or 'it said nothing'}")
    return histogram


def failures(report: TimingReport) -> list[str]:
    """Return what must not be; empty when the run was as it should be."""
    found = []
    if report.missed > MISSED_ALLOWED * report.periods:
        found.append(f"{report.missed} of {report.periods} periods were missed, allowed are 0.1 %")
    if lost_records(report):
        found.append(lost_records(report))
    grown_kb = report.resident_kb.after - report.resident_kb.before
    if grown_kb > GROWTH_ALLOWED_KB:
        found.append(f"the scan process grew by {grown_kb} KiB, allowed {GROWTH_ALLOWED_KB} KiB")
    return found


def main() -> int:
    """Measure and print; 1 when something was as it must not be."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.ten_minutes", description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0, help="how long to scan (default 600)")
    seconds: float = parser.parse_args().seconds
    load = ", ".join(f"{one:.1f}" for one in os.getloadavg())
    print(f"{seconds:g} s over wires at {PERIOD_US} µs, {os.cpu_count()} cores, load {load}", flush=True)
    process = beside(seconds)
    report = full_scan(seconds, period_us=PERIOD_US)
    seen = machine(process)
    print(HEAD)
    base = None if seen is None else seen.lateness("cyclictest beside it")
    if base is not None:
        print(base.row(None))
    print(of_report("whole scan", report).row(base))
    print(f"\nours: {report.missed} of {report.periods} periods missed, in {report.gaps_in_all} gaps")
    for gap in report.gaps[:GAPS_SHOWN]:
        before = gap.before
        late = f"{before.lateness_us:.0f} µs late: {CAUSES[before.cause]}"
        print(f"  {gap.missed} before scan {gap.scan}, {late}")
    if seen is None:
        why = "refused" if shutil.which("cyclictest") else "not installed (Debian: apt-get install rt-tests)"
        print(f"the machine: not measured, cyclictest is {why}")
    else:
        late = overruns(seen, PERIOD_US)
        print(f"the machine: {late} of {seen.total} wake-ups of cyclictest late by a period and more, ", end="")
        print(f"worst {seen.largest_us:.0f} µs (counted up to {LARGEST_US} µs)")
    print("\n".join(footing(report)))
    wrong = failures(report)
    for text in wrong:
        print(f"FAILED: {text}")
    print("as it should be" if not wrong else "not as it should be")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
