"""Work of a scan here and in another checkout, measured in turn: `python -m benchmarks.paired_scan FOLDER [--pairs N]`.

Only ratios of one run mean anything: what else the machine does changes the figures of both by half. Each checkout
brings its own virtual bench; both run in this environment. Nothing is spun, so that what counts is work.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
from pathlib import Path

from benchmarks.wakeups import ROOT

NAMES = ("work", "read", "step", "write", "record")


def medians_us(checkout: Path, seconds: float, period_us: int) -> dict[str, float]:
    """Return the median of each part of a scan as the checkout's own `lostmotion timing` sees it [µs]."""
    options = ("--json", "--seconds", str(seconds), "--period-us", str(period_us), "--spin-us", "0")
    done = subprocess.run(  # noqa: S603
        [sys.executable, "-m", "station", "timing", *options],
        cwd=checkout,
        env=os.environ | {"PYTHONPATH": str(checkout)},
        capture_output=True,
        text=True,
        check=False,
    )
    if not done.stdout:
        raise SystemExit(f"lostmotion timing failed in {checkout}: {done.stderr}")
    report = json.loads(done.stdout)
    return {name: (report["work_us"] if name == "work" else report["parts_us"][name])["p50"] for name in NAMES}


def main() -> None:
    """Measure in turn, here first in every second pair, and print medians and their ratios."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.paired_scan", description=__doc__)
    parser.add_argument("other", type=Path, help="folder of the other checkout")
    parser.add_argument("--pairs", type=int, default=6)
    parser.add_argument("--seconds", type=float, default=3.0, help="length of each measurement (default 3)")
    parser.add_argument("--period-us", type=int, default=1000)
    asked = parser.parse_args()
    here, other = ROOT, asked.other.resolve()
    rows: dict[Path, list[dict[str, float]]] = {here: [], other: []}
    for pair in range(asked.pairs):
        for checkout in (other, here) if pair % 2 else (here, other):
            rows[checkout].append(medians_us(checkout, asked.seconds, asked.period_us))
    print(
        f"{asked.pairs} pairs of {asked.seconds:g} s at {asked.period_us} µs, load {os.getloadavg()[0]:.1f}; median µs"
    )
    print(f"  {'':8}{'other':>9}{'here':>9}{'here / other':>15}{'least':>8}{'most':>8}")
    for name in NAMES:
        mine, theirs = ([row[name] for row in rows[checkout]] for checkout in (here, other))
        ratios = [a / b for a, b in zip(mine, theirs, strict=True)]
        figures = f"{statistics.median(theirs):9.1f}{statistics.median(mine):9.1f}{statistics.median(ratios):15.2f}"
        print(f"  {name:8}{figures}{min(ratios):8.2f}{max(ratios):8.2f}")


if __name__ == "__main__":
    main()
