"""Laws that hold for any loop: scaling, mirroring, sampling and the order of rows; and only one kind of refusal."""

from __future__ import annotations

import contextlib
import dataclasses

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from reference_unit import RATIO, ReferenceUnit, bench_trace, timed_trace

from analysis.evaluation.pipeline import Result, analyse
from analysis.loop.method import Method, MetricWanted
from analysis.trace.errors import AnalysisError
from analysis.trace.trace import SegmentInfo, Trace

FEW = settings(max_examples=12, deadline=None, suppress_health_check=list(HealthCheck))
METHOD = Method(ratio=RATIO, rated_torque_nm=412)
STIFFNESSES = ("stiffness_lsq", "stiffness_two_point", "stiffness_50_100", "spring_constant")
ANGLES = ("backlash_width_3pct", "backlash_width_zero", "lost_motion", "windup")
WANTED = [MetricWanted(name) for name in (*STIFFNESSES, *ANGLES, "hysteresis_energy")]
P1 = ReferenceUnit(negative_softer=1.1)
EXACT = timed_trace(P1, 480.0, cycles=2, speed_arcmin_s=2.0)
NOISY = bench_trace(P1, 453.2, cycles=3)
REPORT = dataclasses.replace(METHOD, drift="report")


def values(result: Result) -> dict[tuple[str, str], float]:
    found = {(metric.wanted.id, side.side): side.value for metric in result.metrics for side in metric.sides}
    assert None not in found.values(), [side.reason for metric in result.metrics for side in metric.sides]
    return found


def uncertainties(result: Result) -> dict[tuple[str, str], float]:
    return {(metric.wanted.id, side.side): side.uncertainty for metric in result.metrics for side in metric.sides}


PLAIN = values(analyse(EXACT, METHOD, WANTED))
MEASURED = analyse(NOISY, REPORT, WANTED)


@FEW
@given(factor=st.floats(0.05, 20.0))
def test_scaling_torque_scales_stiffness_and_leaves_angles(factor: float) -> None:
    scaled = dataclasses.replace(EXACT, torque_out_nm=EXACT.torque_out_nm * factor)
    step = METHOD.spring_step_nm * factor
    method = dataclasses.replace(METHOD, rated_torque_nm=412 * factor, spring_step_nm=step)
    found = values(analyse(scaled, method, WANTED))
    for key, plain in PLAIN.items():
        power = factor if key[0] in STIFFNESSES or key[0] == "hysteresis_energy" else 1.0
        assert found[key] == pytest.approx(plain * power, rel=1e-6), key


@FEW
@given(factor=st.floats(0.05, 20.0))
def test_scaling_angle_scales_angles_and_stiffness_the_other_way(factor: float) -> None:
    scaled = dataclasses.replace(EXACT, angle_out_rad=EXACT.angle_out_rad * factor)
    found = values(analyse(scaled, METHOD, WANTED))
    for key, plain in PLAIN.items():
        assert found[key] == pytest.approx(plain / factor if key[0] in STIFFNESSES else plain * factor, rel=1e-6), key


@FEW
@given(offset=st.floats(-100.0, 100.0), late=st.floats(0.0, 1e5))
def test_zero_of_angle_and_clock_do_not_matter(offset: float, late: float) -> None:
    moved = dataclasses.replace(EXACT, angle_out_rad=EXACT.angle_out_rad + offset, t_s=EXACT.t_s + late)
    found = values(analyse(moved, METHOD, WANTED))
    for key, plain in PLAIN.items():
        assert found[key] == pytest.approx(plain, rel=1e-6, abs=1e-6), key


def mirrored(trace: Trace) -> Trace:
    """Everything turned round: torques, angles and the directions of the segments."""
    table = {key: SegmentInfo(info.role, -info.direction, info.cycle) for key, info in trace.segments.items()}
    names = ("torque_in_nm", "torque_out_nm", "angle_in_rad", "angle_out_rad")
    turned = {name: -getattr(trace, name) for name in names if getattr(trace, name) is not None}
    return dataclasses.replace(trace, segments=table, **turned)


@pytest.mark.parametrize("trace", [EXACT, NOISY])
def test_mirroring_exchanges_the_sides(trace: Trace) -> None:
    other = {"+": "-", "-": "+", "both": "both"}
    plain, turned = (values(analyse(one, METHOD, WANTED)) for one in (trace, mirrored(trace)))
    for (name, side), value in plain.items():
        assert turned[name, other[side]] == pytest.approx(value, rel=1e-9), name


def only(trace: Trace, rows: np.ndarray | slice) -> Trace:
    names = ("t_s", "torque_in_nm", "torque_out_nm", "angle_in_rad", "angle_out_rad", "temperature_c", "segment")
    there = {name: getattr(trace, name)[rows] for name in names if getattr(trace, name) is not None}
    return dataclasses.replace(trace, **there)


def allowed(name: str, value: float, uncertainty: float) -> float:
    """U, but not less than what noise moves a reading by.

    U is of the repeatability of three cycles, itself uncertain by half. The noise of a block of samples is 0.1 N·m,
    which is 0.003 arcmin where the loop is softest; a metric is read at up to four such places.
    """
    return max(uncertainty, 3 * 0.006 if name in ANGLES else 0.01 * abs(value))


@FEW
@given(every=st.integers(2, 4), seed=st.integers(0, 2**32 - 1))
def test_resampling_moves_no_metric_by_more_than_its_uncertainty(every: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    thinned = only(NOISY, np.flatnonzero(random.random(NOISY.samples) < 1 / every))
    found, uncertainty = values(analyse(thinned, REPORT, WANTED)), uncertainties(MEASURED)
    for key, value in values(MEASURED).items():
        assert abs(found[key] - value) <= allowed(key[0], value, uncertainty[key]), key


@settings(FEW, max_examples=4)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_order_of_rows_of_one_time_does_not_matter(seed: int) -> None:
    """Rows in groups of four of the same time, shuffled within each group that lies in one segment."""
    random = np.random.default_rng(seed)
    time = NOISY.t_s[(np.arange(NOISY.samples) // 4) * 4]
    order = np.lexsort((random.random(NOISY.samples), NOISY.segment, np.arange(NOISY.samples) // 4))
    grouped = dataclasses.replace(NOISY, t_s=time)
    found = values(analyse(only(grouped, order), REPORT, WANTED))
    for key, value in values(MEASURED).items():
        assert abs(found[key] - value) <= allowed(key[0], value, uncertainties(MEASURED)[key]), key


numbers = st.floats(allow_nan=True, allow_infinity=True, width=64) | st.sampled_from([0.0, 1.0, -1.0, 400.0, 1e9])
arrays = st.none() | st.lists(numbers, max_size=60)
names = st.sampled_from(["virgin", "measure", "calibrate", "unload", "dwell", "fatigue", "other", "nonsense"])
tables = st.dictionaries(
    st.integers(0, 3), st.builds(SegmentInfo, names, st.integers(-2, 2), st.integers(0, 3)), max_size=4
)


@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_any_input_raises_nothing_but_an_analysis_error(data: st.DataObject) -> None:
    length = data.draw(st.integers(0, 60))
    column = st.none() | st.lists(numbers, min_size=length, max_size=length) | arrays
    channels = ("torque_in_nm", "torque_out_nm", "angle_in_rad", "angle_out_rad", "temperature_c")
    with contextlib.suppress(AnalysisError):
        trace = Trace(
            t_s=data.draw(st.none() | st.just(list(np.arange(length) * 1e-3)) | column),
            **{name: data.draw(column) for name in channels},
            segment=data.draw(st.none() | st.lists(st.integers(0, 3), min_size=length, max_size=length)),
            segments=data.draw(tables),
        )
        method = dataclasses.replace(
            METHOD,
            rated_torque_nm=data.draw(st.floats(-10, 1e6)),
            output_torque=data.draw(st.sampled_from(["reaction", "calibrated"])),
            loading=data.draw(st.sampled_from(["input", "output"])),
            alignment=data.draw(st.sampled_from(["correct", "report", "two_speeds"])),
            lags_s=data.draw(st.none() | st.just({"torque_out_nm": 0.1, "angle_out_rad": 0.0})),
        )
        analyse(trace, method, WANTED)


@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_a_damaged_run_raises_nothing_but_an_analysis_error(data: st.DataObject) -> None:
    """A good run with columns constant, cut, missing, reversed or scaled beyond sense."""
    small = only(EXACT, np.arange(0, EXACT.samples, 20))
    small = dataclasses.replace(small, temperature_c=np.zeros(small.samples)) if data.draw(st.booleans()) else small
    start, stop = sorted(data.draw(st.tuples(st.integers(0, small.samples - 1), st.integers(1, small.samples))))
    changes: dict = {}
    for name in ("torque_out_nm", "angle_out_rad", "t_s"):
        array = getattr(small, name)
        choice = data.draw(st.sampled_from(["as it is", "constant", "reversed", "huge", "tiny", "missing", "noise"]))
        changes[name] = {
            "as it is": array, "constant": np.full_like(array, 3.0), "reversed": array[::-1], "huge": array * 1e6,
            "tiny": array * 1e-300, "missing": None, "noise": np.random.default_rng(1).normal(size=array.size),
        }[choice]  # fmt: skip
    segment = small.segment if data.draw(st.booleans()) else None
    with contextlib.suppress(AnalysisError):
        trace = dataclasses.replace(small, **changes, segment=segment)
        trace = only(trace, slice(start, max(stop, start + 1)))
        result = analyse(
            trace, dataclasses.replace(METHOD, lags_s={"torque_out_nm": 0.1, "angle_out_rad": 0.0}), WANTED
        )
        assert all(check.text for check in result.checks)
