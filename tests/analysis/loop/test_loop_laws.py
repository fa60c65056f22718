"""Laws that hold for every loop: mirroring, scaling, shifting, resampling."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference_unit import ReferenceUnit, exact_trace

from analysis.evaluation.pipeline import analyse
from analysis.loop.method import Method, MetricWanted
from analysis.trace.errors import AnalysisError
from analysis.trace.trace import SegmentInfo, Trace
from definitions.metrics import METRICS

METHOD = Method(ratio=121, rated_torque_nm=412)
WANTED = [MetricWanted(name) for name, row in METRICS.items() if not row.calibration]
EVERY = [
    MetricWanted(name, branch=branch, variant=variant, fit=fit)
    for name, row in METRICS.items()
    for branch in row.branches
    for variant in row.variants
    for fit in (row.fits if variant != "direct" and row.fits else (None,))
]
"""Every choice of every metric."""
STIFFNESSES = {name for name, row in METRICS.items() if row.unit == "N·m/arcmin"}

units = st.builds(
    ReferenceUnit,
    k_inf=st.floats(90, 130),
    b=st.floats(0.6, 0.95),
    f_c=st.floats(18, 30),
    j=st.floats(0.1, 0.4),
    negative_softer=st.floats(0.8, 1.25),
)


def values(trace: Trace, method: Method = METHOD) -> dict[tuple[str, str], float]:
    found = {}
    for metric in analyse(trace, method, WANTED).metrics:
        for side in metric.sides:
            assert side.value is not None, side.reason
            found[metric.wanted.id, side.side] = side.value
    return found


def near(expected: dict[tuple[str, str], float], rel: float) -> dict[tuple[str, str], object]:
    """The asymmetry is a small difference of two large angles: it is as exact as they are, not as itself."""
    windup_arcsec = 60.0 * expected["windup", "both"]
    least = {"asymmetry_at_rated": rel * windup_arcsec}
    return {key: pytest.approx(value, rel=rel, abs=least.get(key[0])) for key, value in expected.items()}


def loop(unit: ReferenceUnit, points: int = 2001) -> tuple[Trace, np.ndarray, np.ndarray]:
    trace = exact_trace(unit, 470.0, points)
    assert trace.torque_out_nm is not None
    assert trace.angle_out_rad is not None
    return trace, trace.torque_out_nm, trace.angle_out_rad


@settings(max_examples=15, deadline=None)
@given(units)
def test_mirroring_the_loop_mirrors_the_sides(unit: ReferenceUnit) -> None:
    trace, torque, angle = loop(unit)
    table = {key: SegmentInfo(info.role, -info.direction, info.cycle) for key, info in trace.segments.items()}
    mirrored = dataclasses.replace(trace, torque_out_nm=-torque, angle_out_rad=-angle, segments=table)
    swapped = {"+": "-", "-": "+", "both": "both"}
    expected = {(name, swapped[side]): value for (name, side), value in values(trace).items()}
    assert values(mirrored) == near(expected, 1e-9)


@settings(max_examples=15, deadline=None)
@given(units, st.floats(0.1, 10))
def test_scaling_torque_scales_stiffness_and_energy_and_nothing_else(unit: ReferenceUnit, factor: float) -> None:
    trace, torque, _ = loop(unit)
    scaled = dataclasses.replace(trace, torque_out_nm=factor * torque)
    method = Method(ratio=121, rated_torque_nm=412 * factor, spring_step_nm=10 * factor)
    expected = {
        key: value * (factor if key[0] in STIFFNESSES or key[0] == "hysteresis_energy" else 1.0)
        for key, value in values(trace).items()
    }
    assert values(scaled, method) == near(expected, 1e-6)


@settings(max_examples=15, deadline=None)
@given(units, st.floats(-1.0, 1.0))
def test_where_the_angle_is_zero_does_not_matter(unit: ReferenceUnit, shift: float) -> None:
    trace, _, angle = loop(unit)
    shifted = dataclasses.replace(trace, angle_out_rad=angle + shift)
    assert values(shifted) == near(values(trace), 1e-6)


@settings(max_examples=10, deadline=None)
@given(units, st.integers(1500, 40_000))
def test_a_loop_equals_itself_resampled(unit: ReferenceUnit, points: int) -> None:
    trace, _, _ = loop(unit, 2500)
    again, _, _ = loop(unit, points)
    assert values(again) == near(values(trace), 2e-3)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=0, max_size=60),
    st.lists(st.floats(-1e9, 1e9), min_size=0, max_size=60),
    st.booleans(),
)
def test_no_input_raises_anything_else(torque: list[float], angle: list[float], named: bool) -> None:  # noqa: FBT001
    segment = np.arange(len(torque)) * 2 // max(1, len(torque)) if named else None
    table = {0: SegmentInfo("measure", 1, 1), 1: SegmentInfo("measure", -1, 1)} if named else {}
    try:
        trace = Trace(torque_out_nm=np.array(torque), angle_out_rad=np.array(angle), segment=segment, segments=table)
        analyse(trace, METHOD, EVERY)
    except AnalysisError as error:
        assert str(error)  # noqa: PT017 - anything else would get through


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1e-9, 1.0, 1e9]), st.booleans())
def test_noise_instead_of_a_loop_raises_nothing_else(seed: int, scale: float, named: bool) -> None:  # noqa: FBT001
    random = np.random.default_rng(seed)
    torque, angle = random.uniform(-scale, scale, (2, 400))
    segment = np.arange(400) // 200 if named else None
    table = {0: SegmentInfo("measure", 1, 1), 1: SegmentInfo("measure", -1, 1)} if named else {}
    trace = Trace(torque_out_nm=torque, angle_out_rad=angle, segment=segment, segments=table)
    try:
        result = analyse(trace, METHOD, [*EVERY, MetricWanted("lost_motion", max=1.0)])
    except AnalysisError:
        return
    assert result.verdict in {"FAIL", "NOT DECIDABLE", "PASS"}
