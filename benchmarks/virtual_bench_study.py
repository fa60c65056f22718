"""`python -m benchmarks.virtual_bench_study [--units N]`: whether the stated uncertainty holds on the virtual bench.

Seeded units of the virtual bench go through the whole of a recipe twice in virtual time: controller, drive, friction
and all. Once with the bench's sensors, and once with sensors that have no error, no noise and steps of 2^-30 of a turn:
that loop is what is true of the unit, as this bench loads it.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from analysis.evaluation.pipeline import analyse
from analysis.loop.method import MetricWanted
from analysis.trace.trace import Trace
from benchmarks.coverage_study import HEAD, line, wanted
from benchmarks.simulated.coverage import Pair, coverage
from controller.controller import Controller
from definitions.image import State
from station.atomic_file import Appender
from station.bench.assemble_virtual import choose_unit, virtual_config
from station.bench.figures import figures_of
from station.bench.request import Job, load_job
from station.records.samples.table import table_of
from station.results.evaluation import method_of, trace_of
from station.run.virtual_run import VirtualRecorder
from station.scan.realtime import quiet_collector
from station.scan.scan_loop import run_virtual, start_once
from virtual_bench.config import AngleSensor, BenchConfig, TorqueSensor
from virtual_bench.in_process import VirtualTimeBench

RECIPE = "rv-40e-121-inverse"
FINE_BITS = 30
TORQUES = {"reaction": "torque measured at the locked output", "calibrated": "torque converted from the input torque"}
UNMASKED = MetricWanted("spring_constant", branch="load")
"""Beside the metrics of the other study: the spring constant where no transition is masked."""


def without_errors(config: BenchConfig) -> BenchConfig:
    """Return a bench whose sensors show what is there."""

    def exact(sensor: TorqueSensor | None) -> TorqueSensor | None:
        return sensor and replace(sensor, accuracy_fraction=0.0, noise_fraction=0.0)

    def fine(sensor: AngleSensor) -> AngleSensor:
        return replace(sensor, resolution_bits=FINE_BITS, noise_rad=0.0)

    return replace(
        config,
        torque_in=exact(config.torque_in),
        torque_out=exact(config.torque_out),
        angle_in=fine(config.angle_in),
        angle_out=config.angle_out and fine(config.angle_out),
    )


def run(job: Job, config: BenchConfig) -> Trace:
    """Run a job in virtual time and return its trace; SystemExit when it did not come to its end."""
    controller = Controller(job.program)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "samples.bin"
        file = Appender(path)
        recorder = VirtualRecorder(file)
        bench = VirtualTimeBench(config, job.recipe.sampling.period_ns)
        with quiet_collector():
            run_virtual(bench, controller, recorder.append, start_once)
        recorder.flush()
        file.close()
        table = table_of(path.read_bytes())
    if controller.state is not State.COMPLETE:
        raise SystemExit(f"unit {config.unit}: the run ended as {controller.state.name.lower()}")
    return trace_of(table, job.program.segments, job.bench, job.recipe.sampling.period_ns, config.unit)


def pairs(runs: Sequence[tuple[Trace, Trace]], job: Job, torque: str, asked: Sequence[MetricWanted]) -> Iterator[Pair]:
    """Yield true and measured metrics of each pair of runs."""
    method, figures = method_of(job.recipe, job.bench), figures_of(job.bench)
    for true, seen in runs:
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
        runs.append((run(job, without_errors(config)), run(job, config)))
        print(f"\r{seed} of {asked.units} units, {time.perf_counter() - start:.0f} s", end="", file=sys.stderr)
    for torque, text in TORQUES.items():
        print(f"\n{asked.units} units, {text}, recipe {job.recipe.recipe.name}, virtual time\n\n{HEAD}")
        print("\n".join(line(row) for row in coverage(metrics, pairs(runs, job, torque, metrics))), flush=True)


if __name__ == "__main__":
    main()
