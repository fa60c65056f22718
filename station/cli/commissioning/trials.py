"""The steps of commissioning that need a run, and the timing of the computer, on the command line."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple, Protocol

from station.bench.request import load_job
from station.cli.commissioning.steps import Block, end, teller
from station.cli.out_file import refuse_records
from station.cli.say import Grid
from station.commissioning import direction as directions
from station.commissioning import latency as latencies
from station.commissioning import tune as gains
from station.commissioning.on_wires import OnWires, on_wires
from station.commissioning.steps_done import may_begin, write_down
from station.commissioning.trial_run import FOLDER, Plan, Tried, try_out
from station.documents.commissioning import Figure, Finding
from station.timing.rates import MISSED_ALLOWED
from station.timing.report import Asked
from station.timing.run import measure


class SaidOfDirection(NamedTuple):
    """What `direction` tells a program; ended: why the small run did not complete, '' where it did."""

    channels: list[directions.Seen]
    ended: str
    record: str


class SaidOfLatency(NamedTuple):
    """What `latency` tells a program; `ended` as above."""

    ages: list[latencies.Age]
    lags: list[latencies.Lag]
    ended: str


def direction(bench_name: str, recipe: str, data: Path, by: str | None, *, as_json: bool) -> int:
    """Do the step `direction`."""
    bench = on_wires(bench_name)
    may_begin(bench, "direction")
    tried = _run(bench, recipe, directions.PLAN, data, by, as_json=as_json)
    seen = directions.look(tried)
    findings = directions.judged(tried, seen, bench.scale_of)
    done = write_down(bench, "direction", by, findings, directions.figures(tried, seen))
    words = {1: "same way", -1: "OPPOSITE", 0: "not shown"}
    rows = [
        (
            one.channel,
            one.against,
            words[one.sign],
            f"{one.moved:.3g}",
            one.unit,
            f"{one.slope:.3g}" if one.sign else "",
        )
        for one in seen
    ]
    blocks: list[Block] = [
        Grid(("channel", "against", "direction", "moved", "", "over expected"), rows, right=(3, 5)),
        *_left(bench, data, [tried]),
    ]
    said = SaidOfDirection(seen, tried.why, str(tried.record.folder))
    return end(bench, done, blocks, said, as_json=as_json)


def latency(bench_name: str, recipe: str, data: Path, by: str | None, *, as_json: bool) -> int:
    """Do the step `latency`."""
    bench = on_wires(bench_name)
    may_begin(bench, "latency")
    tried = _run(bench, recipe, latencies.PLAN, data, by, as_json=as_json)
    ages, lags = latencies.ages(tried), latencies.lags(tried)
    findings = latencies.judged(tried, ages, lags)
    done = write_down(bench, "latency", by, findings, latencies.figures(tried, ages, lags))
    old = [
        (one.device, *(f"{value:.0f}" for value in (one.median_ms, one.p99_ms, one.most_ms, one.allowed_ms)))
        for one in ages
    ]
    late = [
        (
            one.channel,
            one.against,
            "not told" if one.measured_ms is None else f"{one.measured_ms:.1f}",
            f"{one.declared_ms:g}",
            f"± {one.allowed_ms:g}",
        )
        for one in lags
    ]
    blocks: list[Block] = [
        Grid(("age [ms]", "median", "99 %", "largest", "recipe allows"), old, right=(1, 2, 3, 4)),
        "",
        Grid(("lag [ms] of", "behind", "measured", "bench file", "allowed"), late, right=(2, 3, 4)),
        *_left(bench, data, [tried]),
    ]
    return end(bench, done, blocks, SaidOfLatency(ages, lags, tried.why), as_json=as_json)


def tune(bench_name: str, recipe: str, data: Path, by: str | None, *, as_json: bool) -> int:
    """Do the step `tune`."""
    bench = on_wires(bench_name)
    may_begin(bench, "tune")
    runs: list[Tried] = []

    def run(plan: Plan) -> Tried:
        runs.append(_run(bench, recipe, plan, data, by, as_json=as_json))
        return runs[-1]

    gain_per_s = bench.bench.torque_control.gain_per_s
    tuned = gains.tune(gain_per_s, run)
    done = write_down(bench, "tune", by, gains.judged(gain_per_s, tuned), gains.figures(tuned))
    rows = [
        (f"{step.gain_per_s:g}", f"{step.setback:.2%}", "quiet" if step.quiet else step.why or "NOT QUIET")
        for step in tuned.steps
    ]
    blocks: list[Block] = [Grid(("gain [1/s]", "set-back", ""), rows, right=(0, 1)), *_left(bench, data, runs)]
    if tuned.proposed_per_s is not None:
        blocks.append(
            f"Gain in the bench file {gain_per_s:g} 1/s, proposed {tuned.proposed_per_s:.2g} 1/s. Nothing was written"
        )
    return end(bench, done, blocks, tuned, as_json=as_json)


class SmallRun(Protocol):
    """A step that makes small runs: bench file, recipe, data folder, who does it."""

    def __call__(self, bench_name: str, recipe: str, data: Path, by: str | None, *, as_json: bool) -> int:
        """Do it; 1 when it has not passed."""


STEPS: Mapping[str, SmallRun] = {"direction": direction, "latency": latency, "tune": tune}


def timing(bench_name: str, recipe: str, seconds: float, by: str | None, *, as_json: bool) -> int:
    """Do the step `timing`: the measurement of `lostmotion timing`, with its share of missed periods."""
    bench = on_wires(bench_name)
    may_begin(bench, "timing")
    report = measure(load_job(recipe, str(bench.path)), Asked(seconds, None, None))
    share = report.missed / report.periods
    findings = []
    if share > MISSED_ALLOWED:
        what = f"{report.missed} of {report.periods} periods missed, {share:.2%}; {MISSED_ALLOWED:.1%} allowed."
        findings.append(
            Finding(what=what, cure="Run: lostmotion doctor. It shows what delays the scan, and what to do.")
        )
    late, work = report.lateness_us, report.work_us
    figures = (
        Figure(name="periods", value=report.periods),
        Figure(name="missed", value=report.missed),
        Figure(name="missed, allowed", value=int(MISSED_ALLOWED * report.periods)),
        Figure(name="wake-up latency, 99 %", value=round(late.p99, 1), unit="µs"),
        Figure(name="work of a scan, 99 %", value=round(work.p99, 1), unit="µs"),
    )
    done = write_down(bench, "timing", by, findings, figures)
    rows = [(one.name, str(one.value), one.unit) for one in figures]
    return end(bench, done, [Grid(("", "", ""), rows, right=(1,))], as_json=as_json)


def _run(bench: OnWires, recipe: str, plan: Plan, data: Path, by: str | None, *, as_json: bool) -> Tried:
    refuse_records(data / FOLDER, "--data")
    tell = teller(as_json=as_json)
    gain = "" if plan.gain_per_s is None else f", gain {plan.gain_per_s:g} 1/s"
    tell(
        f"test run with small torque: lock verified at {plan.proof:.0%}, then {plan.peak:.0%} of the rated torque{gain}"
    )
    return try_out(bench, recipe, plan, data, by, tell)


def _left(bench: OnWires, data: Path, runs: list[Tried]) -> list[Block]:
    """Say how a run that ended in a fault has left the bench, and the recovery."""
    if all(tried.complete for tried in runs):
        return []
    way_back = f"lostmotion recover --bench {bench.path} --data {data / FOLDER}"
    return ["", "The run ended in a fault and the lock may still be closed. Before anything else:", f"  {way_back}"]
