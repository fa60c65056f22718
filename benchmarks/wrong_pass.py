"""`python -m benchmarks.wrong_pass [--page P --before B]`: how large a defect may be and still pass a bad unit.

A unit that is 15 % beyond its limit is measured with one undeclared defect, in many sizes and both signs. Counted is
the largest size whose verdict is PASS. It runs on what another commit makes of the same traces, too: copy
`benchmarks/wrong_pass.py`, `benchmarks/page.py` and `benchmarks/simulated` into its tree and use --json there.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d

from analysis.evaluation.pipeline import Result, analyse
from analysis.evaluation.verdict import Verdict
from analysis.loop.method import Decision, MetricWanted
from analysis.trace.errors import AnalysisError
from analysis.trace.trace import Trace
from benchmarks.page import put
from benchmarks.simulated.kinds import KINDS
from benchmarks.simulated.loop_generator import (
    ARCMIN_RAD,
    SOUND,
    Bench,
    Course,
    Defect,
    course_of,
    figures_of,
    measured,
    method_of,
    without_segments,
)
from benchmarks.simulated.truth import truth

UNIT = KINDS["RV-40E"]
BENCHES = {"whole run": Bench(), "bare trace": Bench(dwell_s=0.0)}
"""A run with its segments, dwells and the drive's position, and what somebody exports without any of these."""

BUDGET = "whole run, left_open: budget"
"""The whole run once more, with what its checks leave open in U."""

SHOWN = (*BENCHES, BUDGET)

PEAK_NM = BENCHES["whole run"].peak * UNIT.rated_nm
BEYOND = 0.15
"""By how much of its limit the unit is beyond it."""

SEED = 7
PER_DECADE = 6
DECADES = 2.0
HALVINGS = 3
NOISE_SAMPLES = 51
"""Samples that are averaged to see a torque without its noise."""

METRICS = ("backlash_width_3pct", "lost_motion", "stiffness_50_100 load")
IMAGE = "wrong-pass.svg"


class Case(NamedTuple):
    """One kind of defect: the largest size tried, its unit, and what so much of it does to the measurement.

    defect, trace, ratio: what the generator, the recorded trace and the ratio of the recipe have wrong. Sizes go down
    from `largest` over `DECADES`; a case with `signed` is tried in both signs.
    """

    text: str
    unit: str
    largest: float
    defect: Callable[[float], Defect] = lambda _: SOUND
    trace: Callable[[Trace, float], Trace] = lambda trace, _: trace
    ratio: Callable[[float], float] = lambda _: 1.0
    signed: bool = True


def _torque(trace: Trace, by: np.ndarray | float) -> Trace:
    return replace(trace, torque_out_nm=trace.torque_out_nm + by)


def _angle(trace: Trace, arcmin: np.ndarray) -> Trace:
    return replace(trace, angle_in_rad=trace.angle_in_rad + arcmin * (UNIT.ratio * ARCMIN_RAD))


def _drawn(trace: Trace) -> np.ndarray:
    return np.random.default_rng(SEED).standard_normal(trace.t_s.size)


def _minutes(trace: Trace) -> np.ndarray:
    return (trace.t_s - trace.t_s[0]) / 60.0


def _late_within(trace: Trace, channels: Sequence[str], seconds: float) -> Trace:
    """Return the trace with channels that are late within each ramp, and not near its ends."""
    late = np.zeros(trace.samples)
    for key, info in trace.segments.items():
        if info.direction:
            rows = np.flatnonzero(trace.segment == key)
            at = np.linspace(0.0, 1.0, rows.size)
            late[rows] = seconds * np.clip(np.minimum(at - 0.05, 0.95 - at) / 0.1, 0.0, 1.0)
    times = trace.t_s - late
    return replace(trace, **{name: np.interp(times, trace.t_s, getattr(trace, name)) for name in channels})


def _borne(trace: Trace, most_nm: float) -> Trace:
    """Return the trace with an output torque that follows by a play of so much each way: a bearing bears the rest.

    A negative size is what the torque is ahead by. The noise is of the sensor, and follows by nothing.
    """
    torque = uniform_filter1d(trace.torque_out_nm, NOISE_SAMPLES, mode="nearest")
    shown, left, most = np.empty(trace.samples), 0.0, abs(most_nm)
    for row, now in enumerate(torque.tolist()):
        left = min(max(left, now - most), now + most)
        shown[row] = left
    return _torque(trace, np.sign(most_nm) * (shown - torque))


def _copied(trace: Trace, dither_nm: float) -> Trace:
    """Return the trace with its first cycle in the place of all others, the output torque with noise of so much."""
    channels = ("torque_in_nm", "torque_out_nm", "angle_in_rad", "angle_out_rad")
    values = {name: getattr(trace, name).copy() for name in channels}
    first = {info.direction: np.flatnonzero(trace.segment == key) for key, info in trace.segments.items()
             if info.role == "measure" and info.cycle == 1}  # fmt: skip
    for key, info in trace.segments.items():
        if info.role == "measure" and info.cycle > 1:
            rows = np.flatnonzero(trace.segment == key)
            for of in values.values():
                of[rows] = of[first[info.direction][: rows.size]]
    return _torque(replace(trace, **values), dither_nm * _drawn(trace))


CASES: dict[str, Case] = {
    "lag": Case("both torques filtered, time constant", "s", 1.0, lambda size: Defect(lag_s=size), signed=False),
    "delay": Case("both torques late", "s", 1.0, lambda size: Defect(delay_s=size)),
    "lag of one": Case("output torque filtered alone", "s", 1.0, lambda size: Defect(lag_out_s=size), signed=False),
    "angle late within": Case(
        "input angle late within each ramp", "s", 1.0,
        trace=lambda trace, size: _late_within(trace, ["angle_in_rad"], size),
    ),
    "torques late within": Case(
        "both torques late within each ramp", "s", 1.0,
        trace=lambda trace, size: _late_within(trace, ["torque_in_nm", "torque_out_nm"], size),
    ),
    "output late within": Case(
        "output torque late within each ramp", "s", 1.0,
        trace=lambda trace, size: _late_within(trace, ["torque_out_nm"], size),
    ),
    "gain": Case("gain of the output torque", "%", 50.0, lambda size: Defect(out_gain=1.0 + size / 100.0)),
    "gain of both": Case(
        "gain of both torques alike", "%", 50.0,
        lambda size: Defect(out_gain=1.0 + size / 100.0, in_gain=1.0 + size / 100.0),
    ),
    "gain of a side": Case(
        "gain of the output torque on one side", "%", 50.0, lambda size: Defect(out_gain_positive=1.0 + size / 100.0)
    ),
    "bend": Case("output torque bent", "%", 50.0, lambda size: Defect(bend=size / 100.0)),
    "hysteresis": Case("hysteresis of the output sensor", "N·m", 60.0, lambda size: Defect(hysteresis_nm=size)),
    "even hysteresis": Case("hysteresis of the output sensor, alike at every load", "N·m", 60.0, trace=_borne),
    "offset": Case("zero of the output torque", "N·m", 60.0, trace=_torque),
    "torque drift": Case(
        "drift of the output torque", "N·m/min", 120.0, trace=lambda trace, size: _torque(trace, size * _minutes(trace))
    ),
    "torque noise": Case(
        "noise of the output torque", "N·m", 60.0, trace=lambda trace, size: _torque(trace, size * _drawn(trace)),
        signed=False,
    ),
    "angle noise": Case(
        "noise of the input angle", "arcmin at the output", 2.0, signed=False,
        trace=lambda trace, size: _angle(trace, size * _drawn(trace)),
    ),
    "angle drift": Case(
        "drift of the wind-up", "arcmin/min", 10.0, trace=lambda trace, size: _angle(trace, size * _minutes(trace))
    ),
    "creep": Case("creep with the torque", "arcmin/min", 10.0, lambda size: Defect(creep_arcmin_per_min=size)),
    "ripple, sine": Case("input encoder, 8 per turn", "arcmin", 200.0, lambda size: Defect(ripple_arcmin=size)),
    "ripple, cosine": Case(
        "input encoder, 8 per turn, a quarter on", "arcmin", 200.0,
        lambda size: Defect(ripple_arcmin=size, ripple_phase_rad=np.pi / 2.0),
    ),
    "ripple, middle": Case(
        "input encoder, 36 per turn", "arcmin", 200.0,
        lambda size: Defect(ripple_arcmin=size, ripple_per_turn=36.0),
    ),
    "ripple, fast": Case(
        "input encoder, 60 per turn", "arcmin", 200.0,
        lambda size: Defect(ripple_arcmin=size, ripple_per_turn=60.0),
    ),
    "angle gain": Case(
        "gain of the input angle", "%", 50.0,
        trace=lambda trace, size: replace(trace, angle_in_rad=trace.angle_in_rad * (1.0 + size / 100.0)),
    ),
    "ratio": Case("ratio in the recipe", "%", 50.0, ratio=lambda size: 1.0 + size / 100.0),
    "time scale": Case(
        "time", "%", 90.0, trace=lambda trace, size: replace(trace, t_s=trace.t_s * (1.0 + size / 100.0))
    ),
    "copies": Case("copied cycles with noise of", "N·m", 10.0, trace=_copied, signed=False),
}  # fmt: skip
"""Defects that nobody declared. Time and copies move no reading: they are here so that it is seen."""


@cache
def _course(bench: Bench) -> Course:
    return course_of(UNIT, bench)


def limited(metric: str) -> MetricWanted:
    """Return a metric with a limit that the unit's better side breaks by `BEYOND`."""
    name, _, branch = metric.partition(" ")
    exact = [truth(UNIT, metric, side, PEAK_NM) for side in (1, -1)]
    if branch:
        return MetricWanted(name, branch=branch, min=max(exact) / (1.0 - BEYOND))
    return MetricWanted(name, max=min(exact) / (1.0 + BEYOND))


def _judged(case: Case, size: float, shown: str, wanted: list[MetricWanted]) -> Result:
    """Evaluate the bad unit as measured with so much of a defect."""
    bench = BENCHES["whole run" if shown == BUDGET else shown]
    trace = measured(UNIT, _course(bench), bench, np.random.default_rng(SEED), case.defect(size))
    trace = case.trace(trace, size)
    left_open = "budget" if shown == BUDGET else "told"
    method = method_of(UNIT, bench, ratio=UNIT.ratio * case.ratio(size), left_open=left_open)
    if shown == "bare trace":
        trace = without_segments(trace)
    return analyse(trace, method, wanted, Decision("guard_band"), figures=figures_of(UNIT))


def _disguised(result: Result) -> list[str]:
    """Return the metrics whose values are within their limits, whatever the checks say."""
    found = []
    for metric, one in zip(METRICS, result.metrics, strict=True):
        wanted, values = limited(metric), [side.value for side in one.sides]
        if all(
            value is not None
            and (wanted.min is None or value > wanted.min)
            and (wanted.max is None or value < wanted.max)
            for value in values
        ):
            found.append(metric)
    return found


class Passed(NamedTuple):
    """The largest size that passes, of which metric; None where none does. disguises: a reading was within."""

    size: float | None
    metric: str
    disguises: bool


def _sizes(case: Case) -> Iterator[float]:
    for step in range(round(PER_DECADE * DECADES) + 1):
        size = case.largest * 10.0 ** (-step / PER_DECADE)
        yield size
        if case.signed and not (case.unit == "%" and size >= 100.0):
            yield -size


def _passes(case: Case, size: float, shown: str) -> tuple[list[str], bool]:
    """Return the metrics that a size passes, and whether it disguises any."""
    try:
        free = [replace(limited(metric), min=None, max=None) for metric in METRICS]
        hidden = _disguised(_judged(case, size, shown, free))
    except AnalysisError as error:
        print(f"  {case.text} {size:.3g} {case.unit}: {error}", file=sys.stderr)
        return [], False
    passed = [one for one in hidden if _judged(case, size, shown, [limited(one)]).verdict is Verdict.PASS]
    return passed, bool(hidden)


def largest_passing(case: Case, shown: str, within: float | None = None) -> Passed:
    """Look for the largest size that passes, from the largest down, and closer between it and the next larger one.

    within: size beyond which none is tried.
    """
    disguises, above = False, {1.0: case.largest, -1.0: case.largest}
    for size in _sizes(case):
        if within is not None and abs(size) > abs(within):
            continue
        found, hides = _passes(case, size, shown)
        disguises |= hides
        sign = float(np.sign(size))
        if not found:
            above[sign] = abs(size)
            continue
        best, low, high = (size, found[0]), abs(size), above[sign]
        for _ in range(HALVINGS if high > low else 0):
            middle = float(np.sqrt(low * high))
            found, _ = _passes(case, sign * middle, shown)
            if found:
                best, low = (sign * middle, found[0]), middle
            else:
                high = middle
        return Passed(*best, disguises=True)
    return Passed(None, "", disguises)


def found_of(case: Case) -> dict[str, Passed]:
    """Return the largest sizes of a defect that pass. What does not pass by U does not by a larger one."""
    found = {shown: largest_passing(case, shown) for shown in BENCHES}
    told = found["whole run"]
    found[BUDGET] = told if told.size is None else largest_passing(case, BUDGET, told.size)
    return found


Found = dict[str, dict[str, Passed]]
"""Largest size that passes, by defect and by what is shown of the run."""


def table(now: Found, before: Found) -> str:
    """Return the page's table: a row per defect."""

    def cell(case: Case, passed: Passed | None) -> str:
        if passed is None:
            return ""
        if passed.size is None:
            return "none" if passed.disguises else "none, hides nothing"
        return f"{passed.size:+.3g} {case.unit}, `{passed.metric}`"

    shown_of = [("before", before, shown) for shown in BENCHES] + [("now", now, shown) for shown in SHOWN]
    head = ["defect", "tried up to", *(f"{when}, {shown}" for when, _, shown in shown_of)]
    lines = [f"| {' | '.join(head)} |", f"|{' --- |' * len(head)}"]
    for name in now:
        case = CASES[name]
        cells = [cell(case, of.get(name, {}).get(shown)) for _, of, shown in shown_of]
        sign = "±" if case.signed else ""
        lines.append(f"| {case.text} | {sign}{case.largest:g} {case.unit} | {' | '.join(cells)} |")
    return f"![Largest defects that pass](images/{IMAGE})\n\n" + "\n".join(lines)


def _share(name: str, found: Found, of: Sequence[str]) -> float:
    """Largest size that passes in any of some ways of showing the run, % of the largest tried."""
    sizes = [abs(one.size) for shown, one in found.get(name, {}).items() if shown in of and one.size is not None]
    return 100.0 * max(sizes, default=0.0) / CASES[name].largest


def draw(now: Found, before: Found, path: Path) -> None:
    """Draw both as bars: of the largest size tried, on a scale of two decades; no bar where none passes."""
    import matplotlib as mpl  # noqa: PLC0415 - for the picture alone

    mpl.use("Agg")
    mpl.rcParams["svg.hashsalt"] = "wrong-pass"
    from matplotlib import pyplot as plt  # noqa: PLC0415 - as above

    figure, axes = plt.subplots(figsize=(8.0, 0.34 * len(now) + 1.2), layout="constrained")
    places = np.arange(len(now))
    bars = (
        ("before", "#c8a06a", before, tuple(BENCHES)), ("now", "#2f6690", now, tuple(BENCHES)),
        (f"now, {BUDGET}", "#7fb069", now, (BUDGET,)),
    )  # fmt: skip
    for row, (label, colour, found, of) in enumerate(bars):
        shares = [_share(name, found, of) for name in now]
        axes.barh(places + 0.27 * (row - 1), shares, height=0.25, color=colour, label=label)
    axes.set_xscale("log")
    axes.set_xlim(100.0 * 10.0**-DECADES, 110.0)
    axes.set_yticks(
        places, [f"{CASES[name].text} (100 % = {CASES[name].largest:g} {CASES[name].unit})" for name in now]
    )
    axes.invert_yaxis()
    axes.set_xlabel("largest size that passes a unit 15 % beyond its limit, % of the largest tried; no bar: none")
    axes.legend(frameon=False)
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


def main() -> None:
    """Run all cases, or some, and print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.wrong_pass", description=__doc__)
    parser.add_argument("--case", choices=[*CASES], action="append", help="default: all")
    parser.add_argument("--json", type=Path, help="write the sizes into this file")
    parser.add_argument("--before", type=Path, help="file of --json, of another commit")
    parser.add_argument("--page", type=Path, help="put the table into this page, the figure beside it in images/")
    asked = parser.parse_args()
    now: Found = {}
    start = time.perf_counter()
    for name in asked.case or CASES:
        now[name] = found_of(CASES[name])
        print(f"{time.perf_counter() - start:4.0f} s  {name}: {now[name]}", file=sys.stderr, flush=True)
    if asked.json:
        asked.json.write_text(json.dumps(now, indent=1) + "\n", encoding="utf-8")
    before: Found = {}
    if asked.before:
        rows = json.loads(asked.before.read_text(encoding="utf-8"))
        before = {name: {shown: Passed(*one) for shown, one in of.items()} for name, of in rows.items()}
    print(table(now, before))
    if asked.page:
        put(asked.page, "wrong passes", table(now, before))
        draw(now, before, asked.page.parent / "images" / IMAGE)


if __name__ == "__main__":
    main()
