"""`python -m benchmarks.coverage_study [--units N] [--types] [--left-open]`: whether the stated uncertainty holds.

With --types: units of six types by a generator that shares nothing with the analysis, in one table. With --left-open:
such units with errors as large as the checks of a run leave open, told beside the verdict and in the budget.

Seeded units around the default one, every parameter ± 20 % and the sides ± 5 % apart, are measured by a simulated bench
with errors drawn from the figures of a bench file, and compared with their own loops without errors. The table is
Markdown.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

from analysis.loop.method import Method, MetricWanted
from analysis.uncertainty.distributions import STATED_BY
from analysis.uncertainty.figures import SensorFigures, StatedBy
from benchmarks.page import put
from benchmarks.simulated import left_open_units
from benchmarks.simulated.coverage import CoverageRow, coverage, simulated_pairs
from benchmarks.simulated.simulated_run import SimulatedBench
from benchmarks.simulated.types_of_units import table
from definitions.metrics import METRICS
from recipes import load_bench
from station.bench.figures import figures_of

HEAD = (
    "| metric | value | bias / U | 2·s / U | U | largest U | of value | covered | of all units | n |\n|" + " --- |" * 10
)
TORQUES = {
    "reaction": "torque measured at the locked output",
    "calibrated": "torque converted from the input torque, by the lines of the run",
    "stored": "torque converted from the input torque, by stored lines",
}
CALIBRATED_UNITS = 8
"""Units whose mean lines are stored."""


def wanted() -> list[MetricWanted]:
    """Every metric that is read from a loop and counts in a unit of its own."""
    loops = [MetricWanted(name) for name, row in METRICS.items() if not row.calibration and not row.graded]
    return [*loops, MetricWanted("stiffness_50_100", branch="mean")]


def line(row: CoverageRow) -> str:
    """One row of the table."""
    share = f"{row.largest_relative:.2%}" if row.largest_relative < 1.0 else ""  # near zero it means nothing
    low, high = row.covered_between
    return (
        f"| `{row.metric}` | {row.value:.4g} {row.unit} | {row.bias / row.expanded:+.2f} | "
        f"{2 * row.deviation / row.expanded:.2f} | {row.expanded:.2g} | {row.largest:.2g} | "
        f"{share} | {row.covered:.1%} | {100 * low:.1f}–{high:.1%} | {row.count} |"
    )


def stated(figures: SensorFigures, by: StatedBy | None) -> SensorFigures:
    """Return figures whose torque sensors are stated by a data sheet or a certificate; None: as they are."""
    if by is None:
        return figures
    sensors = {name: getattr(figures, name) for name in ("torque_in", "torque_out")}
    return replace(figures, **{name: one and replace(one, stated_by=by) for name, one in sensors.items()})


def main() -> None:
    """Run the study for both kinds of torque and print its tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.coverage_study", description=__doc__)
    parser.add_argument("--units", type=int, default=200, help="units measured (default 200)")
    parser.add_argument("--bench", default="virtual", help="bench file or shipped bench (default virtual)")
    parser.add_argument("--torque", choices=[*TORQUES], action="append", help="default: all")
    parser.add_argument("--stated-by", choices=STATED_BY, help="of the torque sensors' figures (default: the bench's)")
    parser.add_argument("--types", action="store_true", help="units of six types, by the independent generator")
    parser.add_argument("--left-open", action="store_true", help="units with errors that the checks leave open")
    parser.add_argument("--page", type=Path, help="with --types or --left-open: put the table into this page")
    asked = parser.parse_args()
    if asked.left_open:
        found = left_open_units.table(asked.units)
        print(found)
        if asked.page:
            put(asked.page, "left open", found)
        return
    if asked.types:
        found = table(asked.units)
        print(found)
        if asked.page:
            put(asked.page, "types of units", found)
        return
    bench = load_bench(asked.bench)
    figures = stated(figures_of(bench), asked.stated_by)
    by = figures.torque_out.stated_by.replace("_", " ") if figures.torque_out else "nobody"
    simulated = SimulatedBench(fixture_nm_per_arcmin=bench.fixture.stiffness_nm_per_arcmin)
    for torque in asked.torque or TORQUES:
        start = time.perf_counter()
        method = Method(
            ratio=simulated.ratio,
            rated_torque_nm=412.0,
            fixture_stiffness_nm_per_arcmin=simulated.fixture_nm_per_arcmin,
            output_torque="reaction" if torque == "reaction" else "calibrated",
        )
        stored = CALIBRATED_UNITS if torque == "stored" else 0
        pairs = simulated_pairs(asked.units, figures, wanted(), method, simulated, calibrated_units=stored)
        rows = coverage(wanted(), pairs)
        print(f"\n{asked.units} units, {TORQUES[torque]}, bench {bench.bench.name}, by {by}\n\n{HEAD}")
        print("\n".join(line(row) for row in rows))
        print(f"\n{time.perf_counter() - start:.0f} s", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
