"""Time of an analysis with Monte Carlo: 1 000 draws beside 3 cycles of 600 000 samples."""

from __future__ import annotations

import time

import numpy as np

from analysis.evaluation.pipeline import analyse
from analysis.loop.method import Method, MetricWanted
from benchmarks.simulated.simulated_run import SimulatedBench, course_of, measured_trace
from benchmarks.simulated.simulated_unit import SimulatedUnit
from definitions.metrics import METRICS
from recipes import load_bench
from station.bench.figures import figures_of

DRAWS = 1000
SAMPLES_PER_CYCLE = 600_000


def measure() -> tuple[float, float, int]:
    """Return processor seconds with budget and draws, those without draws, and the samples of the trace."""
    figures = figures_of(load_bench("virtual"))
    peak_nm = SimulatedBench().peak_nm
    bench = SimulatedBench(rate_nm_s=4.0 * peak_nm / (SAMPLES_PER_CYCLE * 1e-3))
    trace = measured_trace(course_of(SimulatedUnit(), bench), bench, figures, np.random.default_rng(1))
    wanted = [MetricWanted(name) for name in METRICS]
    method = Method(ratio=bench.ratio, rated_torque_nm=412.0, fixture_stiffness_nm_per_arcmin=1e4)
    seconds = []
    for draws in (DRAWS, 0):
        start = time.process_time()
        analyse(trace, method, wanted, figures=figures, draws=draws)
        seconds.append(time.process_time() - start)
    return seconds[0], seconds[1], trace.samples


def main() -> None:
    """Print the figures."""
    with_draws, without, samples = measure()
    print(
        f"analysis of {samples} samples with the budget of {len(METRICS)} metrics: {without:.1f} s of processor, "
        f"with {DRAWS} draws of Monte Carlo {with_draws:.1f} s"
    )


if __name__ == "__main__":
    main()
