"""`python -m benchmarks [--seconds N]`: the figures of the scan, measured in one run on one machine.

Compare ratios, never figures of different machines: cyclictest is measured in the same minutes, beside the same load.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from benchmarks import analysis_speed, monte_carlo_speed, virtual_time
from benchmarks.wakeups import HEAD, ROOT, WakeUpLatency, cyclictest, full_scan, in_child, of_report
from station.bench.request import load_job
from station.timing.rates import HEAD as RATES_HEAD
from station.timing.rates import limit, measured
from station.timing.report import TimingReport

BITRATE = 1_000_000


@contextmanager
def stress() -> Iterator[None]:
    """Keep one core busy with ordinary work."""
    with subprocess.Popen(["stress-ng", "--cpu", "1", "--quiet"]) as process:  # noqa: S607
        try:
            time.sleep(0.5)
            yield
        finally:
            process.terminate()


def wakeups(seconds: float, title: str) -> TimingReport:
    """Print wake-up latency of cyclictest, of plain Python, and of the scan with and without a spin tail."""
    print(f"\n{title}")
    print(HEAD)
    base = cyclictest(seconds)
    if base is None:
        print("  cyclictest: skipped, it is not installed or not allowed (Debian: apt-get install rt-tests; root)")
    else:
        print(base.row(None))
    for kind in ("plain", "schedule"):
        print(in_child(kind, seconds).row(base), flush=True)
    reports = {spin_us: full_scan(seconds, spin_us=spin_us) for spin_us in (100, 0)}
    for spin_us, report in reports.items():
        late = of_report(f"whole scan, spin tail {spin_us} µs", report)
        missed = f"  missed {report.missed} of {report.periods}"
        print(late.row(base) + missed, flush=True)
    after = cyclictest(seconds)
    if base is not None and after is not None:
        print(WakeUpLatency("cyclictest again", after.p50, after.p99, after.p999, after.largest).row(base))
    return reports[0]


def work(report: TimingReport) -> None:
    """Print what a scan's time goes into."""
    print("\nwork per scan in µs (controller idle)")
    print(f"  {'':34}{'p50':>9}{'p99':>9}{'p99.9':>9}{'max':>9}")
    for name, row in {"work": report.work_us, **report.parts_us}.items():
        print(f"  {name:34}{row.p50:9.1f}{row.p99:9.1f}{row.p999:9.1f}{row.max:9.1f}")
    memory = report.resident_kb
    resident = f"{memory.before / 1024:.1f} MiB at the start of the scan, {memory.after / 1024:.1f} MiB at its end"
    print(f"  memory of the scan process: {resident} (grown by {memory.after - memory.before} KiB)")


def highest_rate(seconds: float) -> None:
    """Print which scan rates hold, what a bus carries, and which of the two is the limit."""
    taken_us = load_job("rv-40e-121-quick", "virtual").bus_us
    print(f"\nscan rate (bus: SYNC, RPDO and 2 TPDO take {taken_us:.0f} µs at {BITRATE / 1e6:g} Mbit/s)")
    print(RATES_HEAD)
    rates = []
    for rate in measured(lambda period_us: full_scan(seconds, period_us=period_us)):
        rates.append(rate)
        print(rate.row(taken_us), flush=True)
    print("\n".join(f"  {line}" for line in limit(rates, taken_us, BITRATE)))


def help_time() -> float:
    """Return the processor time that `lostmotion --help` takes, the best of three [s]."""
    best = float("inf")
    for _ in range(3):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-m", "station", "--help"], stdout=subprocess.DEVNULL, check=True, cwd=ROOT)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        best = min(best, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return best


def main() -> None:
    """Measure everything and print it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0, help="length of each measurement (default 10)")
    seconds: float = parser.parse_args().seconds
    load = ", ".join(f"{one:.1f}" for one in os.getloadavg())
    print(f"{os.cpu_count()} cores, load {load}, {seconds:g} s each; ratios are to the first cyclictest")
    report = wakeups(seconds, "idle")
    if shutil.which("stress-ng"):
        with stress():
            wakeups(seconds, "with stress-ng --cpu 1 beside it")
    else:
        print("\nwith stress-ng: skipped, it is not installed (Debian: apt-get install stress-ng)")
    work(report)
    highest_rate(min(seconds, 5.0))
    factor, replayed, scans = virtual_time.measure()
    print(f"\nvirtual time: {factor:.0f} x real time at 1 ms on one core ({scans} scans)")
    print(f"replay: {replayed:.0f} scans/s, {replayed / 1000:.0f} x real time at 1 ms")
    print(f"lostmotion --help: {help_time():.2f} s of processor time")
    analysis_speed.show()
    monte_carlo_speed.main()
    print()
    sys.stdout.flush()
    subprocess.run([sys.executable, "benchmarks/virtual_bench_load.py", "3"], check=True, cwd=ROOT)


if __name__ == "__main__":
    main()
