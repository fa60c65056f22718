"""Every metric of unit P1: exact on the closed form, and within what is promised on a noisy run of the bench."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from reference_unit import ARC, RATIO, ReferenceUnit, bench_trace, exact_trace

from analysis.evaluation.pipeline import Result, analyse
from analysis.loop.method import Method, MetricWanted
from analysis.trace.errors import AnalysisError
from analysis.trace.runs import found_runs
from analysis.trace.trace import SegmentInfo, Trace

METHOD = Method(ratio=121, rated_torque_nm=412)
P1 = ReferenceUnit()

EXACT = [
    (MetricWanted("backlash_width_3pct"), 0.9400, 5e-5),
    (MetricWanted("lost_motion"), 0.3756, 5e-5),
    (MetricWanted("backlash_width_zero"), 0.9494, 5e-5),
    (MetricWanted("spring_constant"), 115.170, 5e-4),
    (MetricWanted("stiffness_at", torque_nm=206.0), 98.000, 5e-4),
    (MetricWanted("stiffness_50_100", branch="load"), 104.70, 5e-3),
    (MetricWanted("stiffness_50_100", branch="mean"), 105.80, 5e-3),
    (MetricWanted("stiffness_lsq"), 95.42, 5e-3),
    (MetricWanted("stiffness_two_point"), 94.16, 5e-3),
    (MetricWanted("stiffness_end_point"), 105.84, 5e-3),
    (MetricWanted("windup"), 9.1376, 5e-5),
]


def values(result: Result) -> dict[str, float]:
    found = {}
    for metric in result.metrics:
        for side in metric.sides:
            assert side.value is not None, side.reason
            found[f"{metric.wanted.id} {metric.branch} {side.side}"] = side.value
    return found


def test_exact_loop_to_480() -> None:
    result = analyse(exact_trace(P1, 480.0), METHOD, [wanted for wanted, _, _ in EXACT])
    for metric, (wanted, value, digits) in zip(result.metrics, EXACT, strict=True):
        for side in metric.sides:
            assert side.value == pytest.approx(value, abs=digits), (wanted, side)


def test_energy_of_the_exact_loop_is_that_of_the_whole_loop() -> None:
    result = analyse(exact_trace(P1, 480.0, points=3000), METHOD, [MetricWanted("hysteresis_energy")])
    assert result.metrics[0].to_dict()["value_j"] == pytest.approx(0.1359, abs=5e-5)


@pytest.mark.parametrize(("fixture", "uncorrected"), [(5000.0, 112.58), (2000.0, 108.90), (500.0, 93.61)])
def test_fixture_is_taken_out(fixture: float, uncorrected: float) -> None:
    exact = exact_trace(P1, 480.0)
    assert exact.torque_out_nm is not None
    assert exact.angle_out_rad is not None
    angle_in = (exact.angle_out_rad + exact.torque_out_nm / fixture * ARC) * RATIO
    trace = dataclasses.replace(exact, angle_in_rad=angle_in, angle_out_rad=None)
    wanted = [MetricWanted("spring_constant"), MetricWanted("backlash_width_3pct")]
    raw = analyse(trace, METHOD, wanted)
    corrected = analyse(trace, dataclasses.replace(METHOD, fixture_stiffness_nm_per_arcmin=fixture), wanted)
    assert raw.metrics[0].headline.value == pytest.approx(uncorrected, abs=5e-3)
    assert corrected.metrics[0].headline.value == pytest.approx(115.170, abs=5e-4)
    for result in (raw, corrected):
        assert result.metrics[1].headline.value == pytest.approx(0.94, abs=5e-5)


def test_fixture_is_not_taken_out_twice() -> None:
    """The locked shaft's own angle holds the deflection of the lock already."""
    trace = bench_trace(P1, 453.2, cycles=1)
    wanted = [MetricWanted("spring_constant")]
    stiff = dataclasses.replace(METHOD, fixture_stiffness_nm_per_arcmin=1e4)
    assert values(analyse(trace, METHOD, wanted)) == values(analyse(trace, stiff, wanted))


BENCH = {
    "backlash_width_3pct": (0.940, 0.03),
    "lost_motion": (0.376, 0.03),
    "spring_constant": (115.17, 0.02 * 115.17),
    "stiffness_50_100": (104.70, 0.01 * 104.70),
    "windup": (9.1376, 0.05),
    "stiffness_at": (98.0, 0.98),
}


@pytest.mark.parametrize("seed", [1, 2])
def test_noisy_run_of_the_bench(seed: int) -> None:
    result = analyse(bench_trace(P1, 453.2, seed=seed), METHOD, [MetricWanted(name) for name in BENCH])
    for metric in result.metrics:
        value, tolerance = BENCH[metric.wanted.id]
        for side in metric.sides:
            assert side.value == pytest.approx(value, abs=tolerance), side
            assert len(side.per_cycle) == 3
            assert side.uncertainty is not None
            assert 0 < side.uncertainty < tolerance


def test_turning_points_found_agree_with_commanded_ones() -> None:
    trace = bench_trace(P1, 453.2, cycles=2)
    assert trace.segment is not None
    first = int(np.flatnonzero([trace.segments[int(key)].role == "measure" for key in trace.segment])[0])
    cut = {
        name: getattr(trace, name)[first - 7000 :]
        for name in ("t_s", "torque_in_nm", "torque_out_nm", "angle_in_rad", "angle_out_rad", "segment")
    }
    named = Trace(**cut, segments=trace.segments)
    found = dataclasses.replace(named, segment=None, segments={})
    wanted = [MetricWanted(name) for name in ("backlash_width_3pct", "spring_constant", "stiffness_lsq")]
    one, other = values(analyse(named, METHOD, wanted)), values(analyse(found, METHOD, wanted))
    for name, value in one.items():
        assert other[name] == pytest.approx(value, rel=2e-3)


def test_steps_with_dwell_are_one_branch() -> None:
    """Each level is a ramp and a dwell of its own; the loop is the same."""
    trace = bench_trace(P1, 453.2, cycles=2)
    segment, table = trace.segment.copy(), dict(trace.segments)
    for key, info in trace.segments.items():
        if info.role == "measure":
            samples = np.flatnonzero(segment == key)
            for step in range(1, 10):
                ramp, dwell = len(table), len(table) + 1
                table |= {ramp: info, dwell: SegmentInfo("dwell")}
                begin = samples.size * step // 10
                segment[samples[begin:]] = ramp
                segment[samples[begin : begin + 20]] = dwell
    stepped = dataclasses.replace(trace, segment=segment, segments=table)
    wanted = [MetricWanted(name) for name in BENCH]
    one, other = analyse(trace, METHOD, wanted), analyse(stepped, METHOD, wanted)
    assert [len(metric.headline.per_cycle) for metric in other.metrics] == [2] * len(wanted)
    for name, value in values(one).items():
        assert values(other)[name] == pytest.approx(value, rel=1e-2)


def test_the_virgin_quarter_does_not_count() -> None:
    trace = bench_trace(P1, 453.2, cycles=1)
    roles = {key: info for key, info in trace.segments.items() if info.role == "measure"}
    assert trace.segment is not None
    keep = np.isin(trace.segment, list(roles))
    channels = ("t_s", "torque_out_nm", "angle_in_rad", "angle_out_rad", "segment")
    alone = Trace(**{name: getattr(trace, name)[keep] for name in channels}, segments=trace.segments)
    wanted = [MetricWanted(name) for name in BENCH]
    assert values(analyse(alone, METHOD, wanted)) == values(analyse(trace, METHOD, wanted))


def test_a_cracked_unit_fails_on_its_soft_side() -> None:
    cracked = ReferenceUnit(negative_softer=1.2)
    wanted = [MetricWanted("stiffness_50_100", branch="load", min=95.0)]
    result = analyse(exact_trace(cracked, 480.0), METHOD, wanted)
    assert result.metrics[0].headline.value == pytest.approx(104.7, abs=0.01)
    assert result.verdict == "FAIL"
    assert "side -" in result.reasons[0]
    assert "softer than allowed" in result.reasons[0]


def test_loading_at_the_output() -> None:
    """Input locked: wind-up is output minus input over ratio, the same loop gives the same values."""
    trace = exact_trace(P1, 480.0)
    assert trace.angle_out_rad is not None
    twisted = 0.05 * trace.angle_out_rad
    output = dataclasses.replace(trace, angle_out_rad=trace.angle_out_rad + twisted / RATIO, angle_in_rad=twisted)
    wanted = [MetricWanted("backlash_width_3pct"), MetricWanted("spring_constant")]
    found = values(analyse(output, dataclasses.replace(METHOD, loading="output"), wanted))
    assert found == pytest.approx(values(analyse(trace, METHOD, wanted)), rel=1e-9)


def test_no_branch_that_is_found_in_noise_is_empty() -> None:
    """Two turns were found at the same row, and the largest torque between them ended the program."""
    noise = np.random.default_rng(0).normal(size=(5, 12_000))
    runs = found_runs(noise[0])
    rows = [run.pieces[0] for run in runs]
    assert [one.stop for one in rows] == [*(one.start for one in rows[1:]), noise.shape[1]]
    assert min(one.stop - one.start for one in rows) > 0
    assert {one.direction + other.direction for one, other in pairwise(runs)} == {0}
    names = ("t_s", "torque_in_nm", "torque_out_nm", "angle_in_rad", "angle_out_rad")
    trace = Trace(**dict(zip(names, noise, strict=True)) | {"t_s": np.arange(noise.shape[1]) * 1e-3})
    with pytest.raises(AnalysisError, match="raise the sampling rate"):
        analyse(trace, METHOD, [MetricWanted("backlash_width_3pct")])
