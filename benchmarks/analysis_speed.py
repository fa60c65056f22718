"""How long the analysis takes: every metric of three cycles of 600 000 samples each, calibration included.

Beside it one `np.sort` of the same torque, and energy and slope by the package `hysteresis`, if it is installed.
"""

from __future__ import annotations

import importlib.metadata
import time
import tracemalloc
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from analysis.evaluation.pipeline import Result, analyse
from analysis.loop.method import Method, MetricWanted
from analysis.trace.trace import SegmentInfo, Trace
from definitions.metrics import METRICS

SAMPLES = 600_000
CYCLES = 3
PEAK_NM = 453.2
RATED_NM = 412.0
RATIO = 121.0
ARC = np.pi / 10_800.0
LAG_S = 1e-3
REPEATS = 3


class Speed(NamedTuple):
    """Samples, size of the trace [bytes], seconds of the analysis and of one sort, peak of memory, and the result."""

    samples: int
    trace_bytes: int
    analysis_s: float
    sort_s: float
    peak_bytes: int
    result: Result


def channels(per_cycle: int = SAMPLES, cycles: int = CYCLES) -> tuple[dict[str, np.ndarray], dict[int, SegmentInfo]]:
    """Channels of a noisy loop with friction on both sides of the reducer, and its segment table."""
    half = per_cycle // 2
    up = np.linspace(-PEAK_NM, PEAK_NM, half)
    ramps = [("calibrate", 1, 0, up[half // 2 :]), ("calibrate", -1, 0, up[::-1]), ("calibrate", 1, 0, up)]
    for cycle in range(1, cycles + 1):
        ramps += [("measure", -1, cycle, up[::-1]), ("measure", 1, cycle, up)]
    torque = np.concatenate([ramp for *_, ramp in ramps])
    segment = np.repeat(np.arange(len(ramps)), [ramp.size for *_, ramp in ramps])
    table = {number: SegmentInfo(role, way, cycle) for number, (role, way, cycle, _) in enumerate(ramps)}
    direction = np.repeat([float(way) for _, way, _, _ in ramps], [ramp.size for *_, ramp in ramps])
    since_turn = np.abs(torque + direction * PEAK_NM)
    elastic = torque - direction * 23.0 * (1.0 - 2.0 * np.exp(-since_turn / 10.0))
    windup = elastic / 110.0 + 0.78 * np.sign(elastic) * (1.0 - np.exp(-np.abs(elastic) / 100.0))
    friction = direction * (0.147 + 0.28 * np.abs(torque) / RATIO)
    random = np.random.default_rng(1)
    found = {
        "t_s": np.arange(torque.size) * 1e-3,
        "torque_in_nm": torque / RATIO + friction + random.normal(0, 1e-3, torque.size),
        "torque_out_nm": torque + random.normal(0, 0.2, torque.size),
        "angle_in_rad": (windup + torque / 1e4) * RATIO * ARC,
        "angle_out_rad": torque / 1e4 * ARC,
        "segment": segment,
    }
    return found, table


def best(work: Callable[[], object]) -> float:
    """Processor time of the fastest of three [s]: what other programs take from the machine is not counted."""
    times = []
    for _ in range(REPEATS):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def measure(per_cycle: int = SAMPLES, cycles: int = CYCLES) -> Speed:
    """Analyse the loop by every metric, from raw arrays to the result."""
    raw, table = channels(per_cycle, cycles)
    lags = {name: LAG_S for name in raw if name not in ("t_s", "segment")}
    method = Method(ratio=RATIO, rated_torque_nm=RATED_NM, lags_s=lags)
    wanted = [MetricWanted(name) for name in METRICS]

    def work() -> Result:
        return analyse(Trace(**raw, segments=table), method, wanted)

    tracemalloc.start()
    result = work()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    torque = raw["torque_out_nm"]
    size = sum(values.nbytes for values in raw.values())
    return Speed(torque.size, size, best(work), best(lambda: np.sort(torque)), peak, result)


def by_package(per_cycle: int = SAMPLES, cycles: int = CYCLES) -> tuple[float, float, float] | None:
    """Seconds, energy [N·m·arcmin] of a cycle and median slope at 20–80 % [N·m/arcmin] by `hysteresis`, or None."""
    try:
        from hysteresis import Hysteresis  # noqa: PLC0415 - an optional package
    except ImportError:
        return None
    raw, table = channels(per_cycle, cycles)
    measured = np.isin(raw["segment"], [key for key, info in table.items() if info.role == "measure"])
    windup = (raw["angle_in_rad"] / RATIO - raw["angle_out_rad"]) / ARC
    curve = np.column_stack((windup[measured], raw["torque_out_nm"][measured]))

    def work() -> tuple[float, float]:
        loop = Hysteresis(curve, revProminence=2.0)
        last = loop.cycles[-1]
        last.setSlope()
        inside = (last.xy[:, 1] > 0.2 * RATED_NM) & (last.xy[:, 1] < 0.8 * RATED_NM)
        return float(loop.getNetArea()) / cycles, float(np.median(last.slope[inside[: last.slope.size]]))

    energy, slope = work()
    return best(work), energy, slope


def value(result: Result, name: str) -> float | None:
    """Value of a metric."""
    return next(metric.headline.value for metric in result.metrics if metric.wanted.id == name)


def show() -> None:
    """Print the figures."""
    found = measure()
    size = found.trace_bytes / 1e6
    print(f"\nanalysis of {CYCLES} cycles of {SAMPLES} samples ({found.samples} with calibration, {size:.0f} MB)")
    print(f"  {len(METRICS)} metrics, checks of the trace included: {found.analysis_s:.3f} s of processor time")
    print(f"  {found.analysis_s / found.sort_s:.1f} x one np.sort of its torque ({found.sort_s:.3f} s)")
    print(
        f"  memory beside the trace: {found.peak_bytes / 1e6:.0f} MB, {found.peak_bytes / found.trace_bytes:.2f} x it"
    )
    energy, stiffness = value(found.result, "hysteresis_energy"), value(found.result, "stiffness_lsq")
    print(f"  energy {energy:.1f} N·m·arcmin, stiffness {stiffness:.1f} N·m/arcmin")
    other = by_package()
    if other is None:
        print("  the package hysteresis: skipped, it is not installed (pip install hysteresis)")
        return
    seconds, energy, slope = other
    version = importlib.metadata.version("hysteresis")
    print(f"  hysteresis {version}, energy and slope alone: {seconds:.3f} s, {seconds / found.analysis_s:.1f} x ours")
    print(f"  energy {energy:.1f} N·m·arcmin, median slope {slope:.1f} N·m/arcmin (sample by sample, noise included)")


if __name__ == "__main__":
    show()
