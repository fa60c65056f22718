"""`python -m benchmarks.slow_amplifier [--runs N] [--holds N] [--seed N]`: what an amplifier that answers late costs.

Unit P1 in virtual time. First each delay in several runs, with other errors of the sensors and other noise in each;
then a gap of 34 ms in the samples, which holds the ramp, at places spread over the measured branches. The truth is
what torque and wind-up of the unit really did in that run, evaluated the same way; of a run with a gap it is that of
the same run without one. A run counts as false when it says PASS and a value lies farther from the truth than its U.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from analysis.evaluation.metric_result import MetricResult, SideValue
from analysis.evaluation.pipeline import analyse
from analysis.trace.errors import AnalysisError
from analysis.trace.trace import Trace
from controller.controller import Controller
from definitions.image import Image, Orders, State
from definitions.units import RAD_PER_ARCMIN
from station.atomic_file import Appender
from station.bench.assemble_virtual import choose_unit, virtual_config
from station.bench.request import Job, load_job
from station.documents.scan_report import Realtime
from station.records.clocks import VIRTUAL
from station.records.samples.table import Table, table_of
from station.records.timing_proof import run_facts, timing_block
from station.results.evaluation import evaluate_trace, method_of, segment_table, trace_of, wanted_of
from station.run.virtual_run import VirtualRecorder
from station.scan.realtime import quiet_collector
from station.scan.scan_loop import run_virtual, start_once
from virtual_bench.config import BenchConfig
from virtual_bench.faults.scenario import Scenario
from virtual_bench.in_process import POWER_ON_NS, VirtualTimeBench
from virtual_bench.physics.plant_numbers import S

RECIPE = "rv-40e-121-quick"
DELAYS_MS = (0, 3, 5, 10, 20)
FIRST_SLOW_SCAN = 60
POWER_ON_S = POWER_ON_NS * 1e-9
GAP_MS, GAP_LASTS_MS = 34, 50
"""Longer than half of the recipe's sample age of 40 ms, so that the ramp is held, and shorter than the whole."""


@dataclass(frozen=True)
class Outcome:
    """One run: how it ended, its verdict, and how far each value is from the truth, in U."""

    state: str
    verdict: str
    errors: Mapping[str, float]

    @property
    def false_pass(self) -> bool:
        """Whether it says PASS with a value beyond U."""
        return self.verdict == "PASS" and any(error > 1.0 for error in self.errors.values())


def slow(delay_ms: int, when_scan: int, for_ms: int | None = None) -> Scenario:
    """Return a scenario in which the amplifier answers late from a scan on, for a time or for good."""
    fault: dict[str, object] = {"target": "modbus.amplifier", "verb": "slow", "value": float(delay_ms)}
    fault["when"] = {"time_s": POWER_ON_S + when_scan * 1e-3}  # the recipe's scan is 1 ms
    if for_ms is not None:
        fault["for_ms"] = float(for_ms)
    return Scenario.model_validate({"scenario": {"name": "slow amplifier"}, "faults": (fault,)})


Values = dict[str, float]


def samples(job: Job, config: BenchConfig, scenario: Scenario | None) -> tuple[Table, State, Values]:
    """Run a job in virtual time; its record, the state in which it ended, and the true values of the unit in it."""
    controller = Controller(job.program)
    there: list[tuple[int, float, float]] = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "samples.bin"
        file = Appender(path)
        recorder = VirtualRecorder(file)
        bench = VirtualTimeBench(config, job.recipe.sampling.period_ns, scenario)
        state = bench.plant.state

        def append(scan: int, late_ns: int, work_ns: int, image: Image, orders: Orders) -> None:
            recorder.append(scan, late_ns, work_ns, image, orders)
            if orders.segment:
                there.append((orders.segment, float(state[S.TORQUE_NM]), float(state[S.WINDUP_ARCMIN])))

        with quiet_collector():
            run_virtual(bench, controller, append, start_once)
        if scenario is not None and ("modbus.amplifier", "slow") not in bench.faults.since_ns:
            raise SystemExit("the amplifier was never slow: the fault did not act")
        recorder.flush()
        file.close()
        return table_of(path.read_bytes()), controller.state, _true_values(job, there)


def _true_values(job: Job, there: Sequence[tuple[int, float, float]]) -> Values:
    """Evaluate segment, torque [N·m] and wind-up [arcmin] of the unit itself, scan by scan."""
    segment, torque_nm, windup_arcmin = np.array(there).T
    ratio = job.recipe.unit_under_test.ratio
    trace = Trace(
        t_s=np.arange(segment.size) * job.program.period_s,
        torque_out_nm=torque_nm,
        angle_in_rad=windup_arcmin * (ratio * RAD_PER_ARCMIN),
        angle_out_rad=np.zeros(segment.size),
        segment=segment.astype(np.int64),
        segments=segment_table(job.program.segments),
    )
    own = method_of(job.recipe, job.bench)
    method = replace(own, lags_s=dict.fromkeys(own.lags_s or {}, 0.0), fixture_stiffness_nm_per_arcmin=None)
    wanted = [one for one in wanted_of(job.recipe) if not one.id.startswith("torque_ratio")]
    return {
        name: side.value for name, side in sides_of(analyse(trace, method, wanted).metrics) if side.value is not None
    }


def sides_of(metrics: Sequence[MetricResult]) -> Iterator[tuple[str, SideValue]]:
    """Yield each value with the name of its metric and side."""
    for metric in metrics:
        for side in metric.sides:
            yield f"{metric.definition.id} {side.side}", side


def judged(job: Job, table: Table, state: State, truth: Values) -> Outcome:
    """Evaluate a record and hold its values against the truth; a run that did not complete has no verdict."""
    if state is not State.COMPLETE:
        return Outcome(state.name.lower(), "", {})
    trace = trace_of(table, job.program.segments, job.bench, job.recipe.sampling.period_ns, "study")
    try:
        timing = timing_block(table, job.recipe.sampling.period_ns, VIRTUAL, Realtime())
        facts = run_facts(table, timing, job.recipe.sampling)
        result = evaluate_trace(trace, job.recipe, job.bench, [], facts)
    except AnalysisError as error:
        return Outcome("complete", f"no values: {error}"[:60], {})
    errors = {
        name: abs(side.value - truth[name]) / side.uncertainty
        for name, side in sides_of(result.metrics)
        if side.value is not None and side.uncertainty is not None and name in truth
    }
    return Outcome("complete", result.verdict.value, errors)


def bench_of(job: Job, seed: int) -> BenchConfig:
    """Return the bench of one run: errors of its sensors and their noise by its seed."""
    config = virtual_config(job.bench, job.profile_paths, choose_unit("P1", job.recipe, seed))
    return replace(config, sensor_seed=seed)


def delayed(job: Job, delay_ms: int, count: int, first: int) -> Iterator[Outcome]:
    """Yield the outcomes of runs with an amplifier that is late all the time."""
    scenario = slow(delay_ms, FIRST_SLOW_SCAN) if delay_ms else None
    for seed in range(first, first + count):
        yield judged(job, *samples(job, bench_of(job, seed), scenario))


def held(job: Job, count: int, first: int) -> Iterator[Outcome]:
    """Yield the outcomes of runs with a gap, each elsewhere in the measured ramps."""
    for place in range(count):
        config = bench_of(job, first + place)
        table, _, truth = samples(job, config, None)
        states = (int(State.RAMP_POS), int(State.RAMP_NEG))
        ramps = table["scan"][np.flatnonzero(np.isin(table["orders"]["state"], states))]
        scan = int(ramps[int((place + 0.5) * len(ramps) / count)])
        table, state, _ = samples(job, config, slow(GAP_MS, scan, GAP_LASTS_MS))
        yield judged(job, table, state, truth)


def told(title: str, outcomes: list[Outcome]) -> str:
    """Return the line of a group of runs."""
    errors = [error for outcome in outcomes for error in outcome.errors.values()]
    beyond = Counter(name for outcome in outcomes for name, error in outcome.errors.items() if error > 1.0)
    stopped = sum(outcome.state != "complete" for outcome in outcomes)
    false = sum(outcome.false_pass for outcome in outcomes)
    verdicts = ", ".join(f"{count} {name}" for name, count in Counter(o.verdict or o.state for o in outcomes).items())
    names = ", ".join(f"{name} {count}" for name, count in beyond.items()) or "none"
    share = f"{sum(error <= 1.0 for error in errors)} of {len(errors)}"
    worst = f"worst error {max(errors, default=0.0):.2f} U"
    head = f"{title:>8}  stopped {stopped:2d}  within U {share:>10}  {worst}  false PASS {false:2d}"
    return f"{head}  {verdicts}; beyond U: {names}"


def main() -> None:
    """Run the delays, then the holds, and print a line for each."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.slow_amplifier", description=__doc__)
    parser.add_argument("--runs", type=int, default=10, help="runs of each delay (default 10)")
    parser.add_argument("--holds", type=int, default=20, help="placements of a gap of 34 ms (default 20)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the first run of each line (default 1)")
    asked = parser.parse_args()
    job = load_job(RECIPE, None)
    for delay_ms in DELAYS_MS:
        print(told(f"{delay_ms} ms", list(delayed(job, delay_ms, asked.runs, asked.seed))), flush=True)
    print(told("hold", list(held(job, asked.holds, asked.seed))))


if __name__ == "__main__":
    main()
