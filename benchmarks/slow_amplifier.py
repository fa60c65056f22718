"""`python -m benchmarks.slow_amplifier [--runs N] [--holds N]`: what an amplifier that answers late costs.

Unit P1 in virtual time. First each delay in several runs, with other errors of the sensors and other noise in each;
then a gap of 34 ms in the samples, which holds the ramp, at places spread over the measured branches. The truth is the
same unit on a bench whose sensors show what is there and answer at once. A run counts as false when it says PASS and a
value lies farther from the truth than its U.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from analysis.evaluation.metric_result import MetricResult, SideValue
from analysis.evaluation.pipeline import analyse
from analysis.trace.errors import AnalysisError
from benchmarks.virtual_bench_study import without_errors
from controller.controller import Controller
from definitions.image import State
from station.bench.assemble_virtual import choose_unit, virtual_config
from station.bench.request import Job, load_job
from station.durable import Appender
from station.records.samples.table import Table, table_of
from station.results.evaluation import evaluate_trace, method_of, trace_of, wanted_of
from station.run.virtual_recorder import VirtualRecorder
from station.scan.realtime import quiet_collector
from station.scan.scan_loop import run_virtual, start_once
from virtual_bench.config import BenchConfig
from virtual_bench.faults.scenario import Scenario
from virtual_bench.in_process import POWER_ON_NS, VirtualTimeBench

RECIPE = "rv-40e-121-quick"
DELAYS_MS = (0, 3, 5, 10, 20)
FIRST_SLOW_SCAN = 60
POWER_ON_S = POWER_ON_NS * 1e-9
GAP_MS, GAP_LASTS_MS = 34, 50
"""Longer than half of the recipe's sample age of 40 ms, so that the ramp is held, and shorter than the whole."""


@dataclass(frozen=True)
class Outcome:
    """One run: how it ended, its verdict, and which values lie within U of the truth."""

    state: str
    verdict: str
    within: Mapping[str, bool]

    @property
    def false_pass(self) -> bool:
        """Whether it says PASS with a value beyond U."""
        return self.verdict == "PASS" and not all(self.within.values())


def slow(delay_ms: int, when_scan: int, for_ms: int | None = None) -> Scenario:
    """Return a scenario in which the amplifier answers late from a scan on, for a time or for good."""
    fault: dict[str, object] = {"target": "modbus.amplifier", "verb": "slow", "value": float(delay_ms)}
    fault["when"] = {"time_s": POWER_ON_S + when_scan * 1e-3}  # the recipe's scan is 1 ms
    if for_ms is not None:
        fault["for_ms"] = float(for_ms)
    return Scenario.model_validate({"scenario": {"name": "slow amplifier"}, "faults": (fault,)})


def samples(job: Job, config: BenchConfig, scenario: Scenario | None) -> tuple[Table, State]:
    """Run a job in virtual time; its record and the state in which it ended."""
    controller = Controller(job.program)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "samples.bin"
        file = Appender(path)
        recorder = VirtualRecorder(file)
        bench = VirtualTimeBench(config, job.recipe.sampling.period_ns, scenario)
        with quiet_collector():
            run_virtual(bench, controller, recorder.append, start_once)
        if scenario is not None and ("modbus.amplifier", "slow") not in bench.faults.since_ns:
            raise SystemExit("the amplifier was never slow: the fault did not act")
        recorder.flush()
        file.close()
        return table_of(path.read_bytes()), controller.state


def sides_of(metrics: Sequence[MetricResult]) -> Iterator[tuple[str, SideValue]]:
    """Yield each value with the name of its metric and side."""
    for metric in metrics:
        for side in metric.sides:
            yield f"{metric.definition.id} {side.side}", side


def judged(job: Job, table: Table, state: State, truth: Mapping[str, float]) -> Outcome:
    """Evaluate a record and hold its values against the truth; a run that did not complete has no verdict."""
    if state is not State.COMPLETE:
        return Outcome(state.name.lower(), "", {})
    trace = trace_of(table, job.program.segments, job.bench, job.recipe.sampling.period_ns, "study")
    try:
        result = evaluate_trace(trace, job.recipe, job.bench, [])
    except AnalysisError as error:
        return Outcome("complete", f"no values: {error}"[:60], {})
    within = {
        name: abs(side.value - truth[name]) <= side.uncertainty
        for name, side in sides_of(result.metrics)
        if side.value is not None and side.uncertainty is not None and name in truth
    }
    return Outcome("complete", result.verdict.value, within)


def truth_of(job: Job) -> tuple[dict[str, float], list[int]]:
    """Return the true values of P1 on this bench, and the scans of its measured ramps."""
    config = without_errors(virtual_config(job.bench, job.profile_paths, choose_unit("P1", job.recipe, 1)))
    table, state = samples(job, config, None)
    if state is not State.COMPLETE:
        raise SystemExit(f"the run without errors ended as {state.name.lower()}")
    trace = trace_of(table, job.program.segments, job.bench, job.recipe.sampling.period_ns, "truth")
    sides = sides_of(analyse(trace, method_of(job.recipe, job.bench), wanted_of(job.recipe)).metrics)
    values = {name: side.value for name, side in sides if side.value is not None}
    ramps = np.flatnonzero(np.isin(table["orders"]["state"], (int(State.RAMP_POS), int(State.RAMP_NEG))))
    return values, [int(table["scan"][at]) for at in ramps]


def runs(job: Job, truth: Mapping[str, float], scenarios: Sequence[Scenario | None]) -> Iterator[Outcome]:
    """Yield the outcome of each scenario, each on a bench with other errors and another noise."""
    for seed, scenario in enumerate(scenarios, 1):
        config = virtual_config(job.bench, job.profile_paths, choose_unit("P1", job.recipe, seed))
        yield judged(job, *samples(job, replace(config, sensor_seed=seed), scenario), truth)
        print(f"\r{seed} of {len(scenarios)} runs", end="", file=sys.stderr)


def told(title: str, outcomes: list[Outcome]) -> str:
    """Return the line of a group of runs."""
    held = [fits for outcome in outcomes for fits in outcome.within.values()]
    beyond = Counter(name for outcome in outcomes for name, fits in outcome.within.items() if not fits)
    stopped = sum(outcome.state != "complete" for outcome in outcomes)
    false = sum(outcome.false_pass for outcome in outcomes)
    verdicts = ", ".join(f"{count} {name}" for name, count in Counter(o.verdict or o.state for o in outcomes).items())
    names = ", ".join(f"{name} {count}" for name, count in beyond.items()) or "none"
    share = f"{sum(held)} of {len(held)}"
    head = f"{title:>8}  stopped {stopped:2d}  within U {share:>10}  false PASS {false:2d}"
    return f"{head}  {verdicts}; beyond U: {names}"


def main() -> None:
    """Run the delays, then the holds, and print a line for each."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.slow_amplifier", description=__doc__)
    parser.add_argument("--runs", type=int, default=10, help="runs of each delay (default 10)")
    parser.add_argument("--holds", type=int, default=20, help="placements of a gap of 34 ms (default 20)")
    asked = parser.parse_args()
    job = load_job(RECIPE, None)
    truth, ramps = truth_of(job)
    for delay_ms in DELAYS_MS:
        scenario = slow(delay_ms, FIRST_SLOW_SCAN) if delay_ms else None
        outcomes = list(runs(job, truth, [scenario] * asked.runs))
        print(f"\r{told(f'{delay_ms} ms', outcomes)}", flush=True)
    places = [ramps[int((place + 0.5) * len(ramps) / asked.holds)] for place in range(asked.holds)]
    outcomes = list(runs(job, truth, [slow(GAP_MS, place, GAP_LASTS_MS) for place in places]))
    print(f"\r{told('hold', outcomes)}")


if __name__ == "__main__":
    main()
