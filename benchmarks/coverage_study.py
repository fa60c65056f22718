"""`python -m benchmarks.coverage_study [--units N]`: the study of whether the stated uncertainty holds.

Seeded units around the default one, every parameter ± 20 %, are measured by a simulated bench with errors drawn from
the figures of a bench file, and compared with their own loops without errors. The table is Markdown.
"""

from __future__ import annotations

import argparse
import sys
import time

from analysis import METRICS, Method, MetricWanted
from analysis.studies.coverage import CoverageRow, coverage
from analysis.studies.simulated_run import SimulatedBench
from recipes import load_bench
from station.figures import figures_of

HEAD = "| metric | value | bias / U | 2·s / U | U | largest U | of value | covered | n |\n|" + " --- |" * 9
TORQUES = {"reaction": "torque measured at the locked output", "calibrated": "torque converted from the input torque"}


def wanted() -> list[MetricWanted]:
    """Every metric that is read from a loop and counts in a unit of its own."""
    loops = [MetricWanted(name) for name, row in METRICS.items() if row.estimate is not None and not row.graded]
    return [*loops, MetricWanted("stiffness_50_100", branch="mean")]


def line(row: CoverageRow) -> str:
    """One row of the table."""
    nothing = abs(row.value) < 1e-3 * row.expanded
    share = "" if nothing else f"{row.largest_relative:.2%}"
    return (
        f"| `{row.metric}` | {0.0 if nothing else row.value:.4g} {row.unit} | {row.bias / row.expanded:+.2f} | "
        f"{2 * row.deviation / row.expanded:.2f} | {row.expanded:.2g} | {row.largest:.2g} | "
        f"{share} | {row.covered:.1%} | {row.count} |"
    )


def main() -> None:
    """Run the study for both kinds of torque and print its tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.coverage_study", description=__doc__)
    parser.add_argument("--units", type=int, default=200, help="units measured (default 200)")
    parser.add_argument("--bench", default="virtual", help="bench file or shipped bench (default virtual)")
    parser.add_argument("--torque", choices=[*TORQUES], action="append", help="default: both")
    asked = parser.parse_args()
    bench = load_bench(asked.bench)
    simulated = SimulatedBench(fixture_nm_per_arcmin=bench.fixture.stiffness_nm_per_arcmin)
    for torque in asked.torque or TORQUES:
        start = time.perf_counter()
        method = Method(
            ratio=simulated.ratio,
            rated_torque_nm=412.0,
            fixture_stiffness_nm_per_arcmin=simulated.fixture_nm_per_arcmin,
            output_torque=torque,
        )
        rows = coverage(asked.units, figures_of(bench), wanted(), method, bench=simulated)
        print(f"\n{asked.units} units, {TORQUES[torque]}, bench {bench.bench.name}\n\n{HEAD}")
        print("\n".join(line(row) for row in rows))
        print(f"\n{time.perf_counter() - start:.0f} s", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
