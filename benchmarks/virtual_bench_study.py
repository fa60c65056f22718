"""`python -m benchmarks.virtual_bench_study [--units N]`: whether the stated uncertainty holds on the virtual bench.

Seeded units of the virtual bench go through the whole of a recipe in virtual time: controller, drive, friction and all.
Each run is evaluated twice: by what the bench's sensors showed, and by what was there at the same instants. That loop
is what is true of the unit, as it was loaded: another run, by sensors without errors, takes another way where friction
reverses, for its drive takes other steps.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from analysis.evaluation.pipeline import analyse
from analysis.loop.method import MetricWanted
from analysis.trace.trace import Trace
from analysis.trace.units import FloatArray
from benchmarks.coverage_study import HEAD, line, wanted
from benchmarks.simulated.coverage import Pair, coverage
from controller.controller import Controller
from definitions.image import Image, Orders, State
from drivers.config import ALL_CHANNELS
from station.atomic_file import Appender
from station.bench.assemble_virtual import choose_unit, virtual_config
from station.bench.figures import figures_of
from station.bench.request import Job, load_job
from station.records.samples.table import Table, table_of
from station.records.samples.zeroes import ZEROES
from station.results.evaluation import method_of, trace_of
from station.run.virtual_run import VirtualRecorder
from station.scan.realtime import quiet_collector
from station.scan.scan_loop import run_virtual, start_once
from virtual_bench.config import BenchConfig
from virtual_bench.in_process import VirtualTimeBench
from virtual_bench.physics.plant_numbers import CH

RECIPE = "rv-40e-121-inverse"
TORQUES = {"reaction": "torque measured at the locked output", "calibrated": "torque converted from the input torque"}
UNMASKED = MetricWanted("spring_constant", branch="load")
"""Beside the metrics of the other study: the spring constant where no transition is masked."""


class Both(NamedTuple):
    """One run: the trace that the sensors show, and the trace of what was there."""

    seen: Trace
    true: Trace


class WatchedBench(VirtualTimeBench):
    """A virtual bench that also tells what was there when the newest sample was taken; the controller never sees it."""

    def __init__(self, config: BenchConfig, period_ns: int) -> None:
        super().__init__(config, period_ns)
        self._sources = self.plant.channels[:, CH.SOURCE].astype(int)
        self.there = (0.0,) * len(ALL_CHANNELS)
        """Torques [N·m] and angles [rad] in the order of `ALL_CHANNELS`, of the sample that the next image brings."""

    def write(self, orders: Orders, scan: int) -> None:
        """Take the orders of a scan, and keep what was there if the amplifier answers."""
        super().write(orders, scan)
        if self.slow.sample_scan == scan + 1:
            self.there = tuple(self.plant.state[self._sources].tolist())


def run(job: Job, config: BenchConfig) -> Both:
    """Run a job in virtual time and return its traces; SystemExit when it did not come to its end."""
    controller = Controller(job.program)
    there: list[tuple[float, ...]] = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "samples.bin"
        file = Appender(path)
        recorder = VirtualRecorder(file)
        bench = WatchedBench(config, job.recipe.sampling.period_ns)

        def append(scan: int, lateness_ns: int, work_ns: int, image: Image, orders: Orders) -> bool:
            there.append(bench.there)
            return recorder.append(scan, lateness_ns, work_ns, image, orders)

        with quiet_collector():
            run_virtual(bench, controller, append, start_once)
        recorder.flush()
        file.close()
        seen = table_of(path.read_bytes())
    if controller.state is not State.COMPLETE:
        raise SystemExit(f"unit {config.unit}: the run ended as {controller.state.name.lower()}")
    true = _with(seen, np.array(there), job.program.tare.samples)
    traces = [
        trace_of(table, job.program.segments, job.bench, job.recipe.sampling.period_ns, config.unit)
        for table in (seen, true)
    ]
    return Both(*traces)


def _with(seen: Table, there: FloatArray, tare_samples: int) -> Table:
    """Return the records with what was there in the place of what the sensors showed, counted from zeroes of its own.

    there: rows by `ALL_CHANNELS`. A tare is the mean of so many samples; an angle counts from one.
    """
    true = Table(seen.rows.copy(), seen.layout)
    counter = seen["image"]["sample_counter"]
    fresh = np.append(0, np.flatnonzero(np.diff(counter)) + 1)
    for channel, values in zip(ALL_CHANNELS, there.T, strict=True):
        true.rows["image"][channel] = values
        zero = true.rows["orders"][ZEROES[channel]]
        for first in np.flatnonzero(np.diff(zero)) + 1:
            samples = fresh[fresh <= first][-(tare_samples if channel.endswith("_nm") else 1) :]
            zero[first:] = values[samples].mean()
    return true


def pairs(runs: Sequence[Both], job: Job, torque: str, asked: Sequence[MetricWanted]) -> Iterator[Pair]:
    """Yield true and measured metrics of each run."""
    method, figures = method_of(job.recipe, job.bench), figures_of(job.bench)
    for seen, true in runs:
        truth = analyse(true, replace(method, output_torque="reaction"), asked).metrics
        yield truth, analyse(seen, replace(method, output_torque=torque), asked, figures=figures).metrics


def main() -> None:
    """Run the units and print a table for each torque."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.virtual_bench_study", description=__doc__)
    parser.add_argument("--units", type=int, default=40, help="units measured (default 40)")
    parser.add_argument("--recipe", default=RECIPE, help=f"recipe that calibrates and measures (default {RECIPE})")
    asked = parser.parse_args()
    job = load_job(asked.recipe, None)
    metrics = [*wanted(), UNMASKED]
    start = time.perf_counter()
    runs = []
    for seed in range(1, asked.units + 1):
        unit = choose_unit(f"P1:{seed}", job.recipe, seed)
        # another bench each time: the errors of the sensors are what the stated uncertainty must hold
        config = replace(virtual_config(job.bench, job.profile_paths, unit), sensor_seed=seed)
        runs.append(run(job, config))
        print(f"\r{seed} of {asked.units} units, {time.perf_counter() - start:.0f} s", end="", file=sys.stderr)
    for torque, text in TORQUES.items():
        print(f"\n{asked.units} units, {text}, recipe {job.recipe.recipe.name}, virtual time\n\n{HEAD}")
        print("\n".join(line(row) for row in coverage(metrics, pairs(runs, job, torque, metrics))), flush=True)


if __name__ == "__main__":
    main()
