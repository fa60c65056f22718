"""`python -m benchmarks [--seconds N]`: the figures of the scan, measured in one run on one machine.

Compare ratios, never figures of different machines: cyclictest is measured in the same minutes, beside the same load.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from benchmarks import analysis_speed, virtual_time
from benchmarks.wakeups import HEAD, ROOT, Lateness, cyclictest, full_scan, in_child, of_report

MISSED_ALLOWED = 0.001
PERIODS_US = (1000, 667, 500, 400)
FRAME_BITS = 135
"""An 8-byte frame with worst-case bit stuffing; a SYNC without data has 55."""

SYNC_BITS = 55
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


def wakeups(seconds: float, title: str) -> dict[str, Any]:
    """Print lateness of cyclictest, of plain Python, and of the scan with and without a spin tail."""
    print(f"\n{title}")
    print(HEAD)
    base = cyclictest(seconds)
    if base is None:
        print("  cyclictest: skipped, it is not installed or not allowed (Debian: apt-get install rt-tests; root)")
    else:
        print(base.row(None))
    for kind in ("plain", "schedule"):
        print(in_child(kind, seconds).row(base), flush=True)
    report: dict[str, Any] = {}
    for spin_us in (100, 0):
        report = full_scan(seconds, spin_us=spin_us)
        late = of_report(f"whole scan, spin tail {spin_us} µs", report)
        missed = f"  missed {report['missed']} of {report['periods']}"
        print(late.row(base) + missed, flush=True)
    after = cyclictest(seconds)
    if base is not None and after is not None:
        print(Lateness("cyclictest again", after.p50, after.p99, after.p999, after.largest).row(base))
    return report


def work(report: dict[str, Any]) -> None:
    """Print what a scan's time goes into."""
    print("\nwork per scan in µs (controller idle)")
    print(f"  {'':34}{'p50':>9}{'p99':>9}{'p99.9':>9}{'max':>9}")
    for name, row in {"work": report["work_us"], **report["parts_us"]}.items():
        print(f"  {name:34}{row['p50']:9.1f}{row['p99']:9.1f}{row['p999']:9.1f}{row['max']:9.1f}")
    memory = report["resident_kb"]
    print(f"  resident {memory['after'] / 1024:.0f} MiB, grown by {memory['after'] - memory['before']} KiB")


def highest_rate(seconds: float) -> None:
    """Print which scan rates hold, and what limits them."""
    frame_us = (SYNC_BITS + 3 * FRAME_BITS) * 1e6 / BITRATE
    print(
        f"\nscan rate (bus: SYNC, RPDO and 2 TPDO take {frame_us:.0f} µs at 1 Mbit/s: {1e6 / frame_us:.0f} Hz at most)"
    )
    print(f"  {'rate':>9}{'missed':>10}{'work p99':>11}{'of period':>11}{'bench CPU':>11}{'bus':>7}   limit")
    for period_us in PERIODS_US:
        report = full_scan(seconds, period_us=period_us)
        share = report["missed"] / report["periods"]
        duration_s = report["periods"] * period_us * 1e-6
        used, cpu = report["work_us"]["p99"] / period_us, report["virtual_bench_cpu_s"] / duration_s
        causes = [gap["before"]["cause"] for gap in report["gaps"]]
        limit = "holds" if share < MISSED_ALLOWED else f"fails: {max(set(causes), key=causes.count)}"
        rate = f"{1e6 / period_us:.0f} Hz"
        print(
            f"  {rate:>9}{share:>10.3%}{report['work_us']['p99']:>8.0f} µs{used:>11.0%}{cpu:>11.0%}"
            f"{frame_us / period_us:>7.0%}   {limit}",
            flush=True,
        )


def help_time() -> float:
    """Return how long `lostmotion --help` takes, the best of three [s]."""
    best = float("inf")
    for _ in range(3):
        start = time.perf_counter()
        subprocess.run([sys.executable, "-m", "station", "--help"], stdout=subprocess.DEVNULL, check=True, cwd=ROOT)
        best = min(best, time.perf_counter() - start)
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
    print(f"lostmotion --help: {help_time():.2f} s")
    analysis_speed.show()
    print()
    sys.stdout.flush()
    subprocess.run([sys.executable, "benchmarks/virtual_bench_load.py", "3"], check=True, cwd=ROOT)


if __name__ == "__main__":
    main()
