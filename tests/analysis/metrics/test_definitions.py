"""Definitions whose value follows from the closed form of a loop, derived here a second time."""

from __future__ import annotations

import numpy as np
import pytest
from definition_support import CRACKED, LOOP_OF_P1, METHOD, P1, sides, trace_of
from numpy.polynomial.polynomial import polyder, polyval
from reference_unit import ARC, RATED_NM, exact_trace

from analysis.evaluation.pipeline import analyse
from analysis.loop.branches import Branch
from analysis.loop.fits import fit_three_regions
from analysis.loop.method import Method, MetricWanted
from analysis.trace.errors import AnalysisError
from analysis.trace.trace import Trace
from definitions.metrics import FITS


def forward(torque: float) -> float:
    """f(T): torque rising, friction is lost on the way up."""
    return float(CRACKED.elastic(np.array([torque - CRACKED.f_c]))[0])


def backward(torque: float) -> float:
    """r(T): torque falling, friction holds the wind-up."""
    return float(CRACKED.elastic(np.array([torque + CRACKED.f_c]))[0])


def centre(torque: float) -> float:
    return (forward(torque) + backward(torque)) / 2


BAND, HALF, RATED = 0.03 * RATED_NM, 0.5 * RATED_NM, RATED_NM
T1, T2 = 0.2 * RATED_NM, 0.7 * RATED_NM

CLOSED = {
    "backlash_branches_3pct": (MetricWanted("backlash_branches_3pct"), {"both": backward(BAND) - forward(-BAND)}),
    "gear_clearance": (
        MetricWanted("gear_clearance"), dict.fromkeys(("both", "+", "-"), (backward(0) - forward(0)) / 2),
    ),
    "gear_clearance intercept": (
        MetricWanted("gear_clearance", variant="intercept"),
        {"both": (backward(0) - forward(0)) / 2, "+": backward(0), "-": -forward(0)},
    ),
    "hysteresis_angle": (
        MetricWanted("hysteresis_angle"),
        {"+": 60 * (backward(HALF) - forward(HALF)), "-": 60 * (backward(-HALF) - forward(-HALF))},
    ),
    "hysteresis_angle at 100 N·m": (
        MetricWanted("hysteresis_angle", torque_nm=100.0),
        {"+": 60 * (backward(100) - forward(100)), "-": 60 * (backward(-100) - forward(-100))},
    ),
    "stiffness_estimate": (
        MetricWanted("stiffness_estimate"),
        {"+": RATED / (forward(RATED) - forward(0)), "-": -RATED / (backward(-RATED) - backward(0))},
    ),
    "asymmetry_at_rated": (
        MetricWanted("asymmetry_at_rated"), {"both": 30 * abs(centre(RATED) + centre(-RATED) - 2 * centre(0))},
    ),
    "k1 chord": (
        MetricWanted("k1", variant="chord"),
        {"+": T1 / (forward(T1) - forward(0)), "-": -T1 / (backward(-T1) - backward(0))},
    ),
    "k2 chord, unloading": (
        MetricWanted("k2", variant="chord", branch="unload"),
        {"+": (T2 - T1) / (backward(T2) - backward(T1)), "-": (T2 - T1) / (forward(-T1) - forward(-T2))},
    ),
    "k3 chord, mean": (
        MetricWanted("k3", variant="chord", branch="mean"),
        {"+": (RATED - T2) / (centre(RATED) - centre(T2)), "-": (RATED - T2) / (centre(-T2) - centre(-RATED))},
    ),
    "spring_constant direct, loading": (
        MetricWanted("spring_constant", variant="direct", branch="load"),
        {"+": 10 / (forward(RATED) - forward(402)), "-": 10 / (backward(-402) - backward(-RATED))},
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CLOSED)
def test_closed_form(case: str) -> None:
    wanted, expected = CLOSED[case]
    found = sides(wanted)
    assert set(found) == set(expected)
    assert found == {side: pytest.approx(value, rel=2e-4) for side, value in expected.items()}


def test_both_sides_differ_on_the_cracked_unit() -> None:
    """Or the closed forms above would not tell one side from the other."""
    for wanted, expected in CLOSED.values():
        if "+" in expected and wanted.variant != "centred" and wanted.id != "gear_clearance":
            assert abs(expected["+"] / expected["-"] - 1) > 0.02, wanted


def test_backlash_between_the_paths_is_lost_motion_and_width_together() -> None:
    wanted = [MetricWanted(name) for name in ("backlash_branches_3pct", "lost_motion", "backlash_width_3pct")]
    branches, lost_motion, width = analyse(LOOP_OF_P1, METHOD, wanted).metrics
    assert branches.headline.value == pytest.approx(0.3756 + 0.9400, abs=1e-4)
    mean_width = sum(side.value or 0.0 for side in width.sides) / 2
    assert branches.headline.value == pytest.approx((lost_motion.headline.value or 0.0) + mean_width)


def test_true_elastic_stiffness_of_p1_is_none_of_the_metrics() -> None:
    for torque, stiffness in ((206.0, 99.88), (412.0, 109.34)):
        turned = np.diff(P1.elastic(np.array([torque - 0.01, torque + 0.01])))[0]
        assert 0.02 / turned == pytest.approx(stiffness, abs=5e-3)


def test_spring_constant_of_p1_by_every_fit() -> None:
    """The documentation prints these: the fit is part of the number."""
    expected = {"six_segment": 115.17, "six_segment_20pct": 115.75, "three_region": 109.28}
    assert set(expected) == set(FITS)
    for fit, value in expected.items():
        found = sides(MetricWanted("spring_constant", fit=fit), LOOP_OF_P1)
        assert found == {"+": pytest.approx(value, abs=5e-3), "-": pytest.approx(value, abs=5e-3)}


# A loop whose branches are polynomials by regions: borders ±80 and ±320 of 400 N·m. Coefficients in rising powers.
REGIONS = {
    "forward": ([-0.9, 0.015, 0.8e-5], [-0.7, 0.011], [-0.3, 0.010, -0.9e-5],
                [-0.3, 0.013, -0.7e-5], [-0.2, 0.012], [-0.4, 0.016, -1.1e-5]),
    "backward": ([0.5, 0.013, 0.5e-5], [0.6, 0.012], [0.3, 0.012, 1.1e-5],
                 [0.3, 0.009, 0.6e-5], [0.4, 0.010], [0.1, 0.015, -0.7e-5]),
}  # fmt: skip

POINTS = 2800
"""Few enough that none are averaged, and none on a border: there these branches jump."""

BORDERS = np.array([-320.0, -80.0, 0.0, 80.0, 320.0])


def region_loop() -> Trace:
    torque = np.linspace(-440.0, 440.0, POINTS)
    curves = []
    for pieces in REGIONS.values():
        region = np.searchsorted(BORDERS, torque)
        curves.append(sum(polyval(torque, piece) * (region == n)
                          for n, piece in enumerate(pieces)))  # fmt: skip
    return trace_of(torque, curves)


OF_400 = Method(ratio=121, rated_torque_nm=400.0, fit_end_nm=420.0)


def piece(branch: str, region: int) -> np.ndarray:
    if branch == "mean":
        return (np.array(REGIONS["forward"][region]) + np.array(REGIONS["backward"][region])) / 2
    return np.array(REGIONS[branch][region])


@pytest.mark.parametrize(("branch", "curves"), [
    ("mean", {"+": "mean", "-": "mean"}),
    ("load", {"+": "forward", "-": "backward"}),
    ("unload", {"+": "backward", "-": "forward"}),
])  # fmt: skip
def test_three_regions_are_found_back_side_by_side_and_branch_by_branch(branch: str, curves: dict[str, str]) -> None:
    trace = region_loop()
    for torque, low, high in ((40.0, 3, 2), (200.0, 4, 1), (380.0, 5, 0)):
        found = sides(MetricWanted("stiffness_at", torque_nm=torque, branch=branch, fit="three_region"), trace, OF_400)
        for side, region, at in (("+", low, torque), ("-", high, -torque)):
            slope = polyval(at, polyder(piece(curves[side], region)))
            assert found[side] == pytest.approx(1 / slope, rel=1e-3), (torque, side)
    found = sides(MetricWanted("spring_constant", branch=branch, fit="three_region"), trace, OF_400)
    for side, region, ends in (("+", 5, (390.0, 400.0)), ("-", 0, (-400.0, -390.0))):
        low_angle, high_angle = polyval(np.array(ends), piece(curves[side], region))
        assert found[side] == pytest.approx(10 / (high_angle - low_angle), rel=1e-3)


def test_windup_by_three_regions() -> None:
    positive, negative = (polyval(torque, piece("mean", region)) for torque, region in ((400.0, 5), (-400.0, 0)))
    found = sides(MetricWanted("windup", fit="three_region"), region_loop(), OF_400)
    assert found["both"] == pytest.approx(positive - negative, rel=1e-5)


def test_gaps_between_regions() -> None:
    pieces = REGIONS["forward"]
    torque = np.linspace(-440.0, 440.0, POINTS)
    trace = region_loop()
    assert trace.angle_out_rad is not None
    curve = fit_three_regions(Branch(torque, trace.angle_out_rad[: torque.size] / ARC), 400.0, 420.0, (0.0, 0.0))
    below, above = ([float(polyval(at, piece)) for at, piece in zip(BORDERS, half, strict=True)]
                    for half in (pieces[:-1], pieces[1:]))  # fmt: skip
    outward = [1 if at >= 0 else -1 for at in BORDERS]
    gaps = [sign * (high - low) for sign, low, high in zip(outward, below, above, strict=True)]
    assert curve.gaps_arcmin == pytest.approx(gaps, abs=2e-4)
    for at, value in ((-320.0, above[0]), (-80.0, above[1]), (80.0, below[3]), (320.0, below[4])):
        assert curve.at(at) == pytest.approx(value, abs=2e-4), "a border belongs to the region towards zero"


def test_a_branch_that_is_too_short_for_the_regions_is_said() -> None:
    (metric,) = analyse(exact_trace(P1, 390.0), METHOD, [MetricWanted("stiffness_at", fit="three_region")]).metrics
    assert metric.headline.value is None
    assert "the three-region fit needs a branch from -352.2 to 352.2 N·m at least" in metric.reasons[0]


def segmented_loop(width: float = 0.8) -> Trace:
    """Straight lines of 40, 80 and 120 N·m/arcmin on the positive, 50, 90 and 110 on the negative side."""
    torque = np.linspace(-440.0, 440.0, 8801)
    windup = np.zeros_like(torque)
    for side, stiffnesses in ((1, (40.0, 80.0, 120.0)), (-1, (50.0, 90.0, 110.0))):
        amount = np.maximum(side * torque, 0.0)
        first, middle, last = np.minimum(amount, 60), np.clip(amount - 60, 0, 180), np.maximum(amount - 240, 0)
        windup += side * sum(part / k for part, k in zip((first, middle, last), stiffnesses, strict=True))
    return trace_of(torque, [windup - width / 2, windup + width / 2])


@pytest.mark.parametrize("variant", ["fitted", "chord"])
@pytest.mark.parametrize("branch", ["load", "unload", "mean"])
def test_three_segments_are_found_back(variant: str, branch: str) -> None:
    method = Method(ratio=121, rated_torque_nm=400.0, stiffness_break_t1_nm=60.0, stiffness_break_t2_nm=240.0)
    wanted = [MetricWanted(name, variant=variant, branch=branch) for name in ("k1", "k2", "k3")]
    result = analyse(segmented_loop(), method, wanted)
    found = [[side.value for side in metric.sides] for metric in result.metrics]
    assert found == [
        [pytest.approx(40.0, rel=1e-3), pytest.approx(50.0, rel=1e-3)],
        [pytest.approx(80.0, rel=1e-3), pytest.approx(90.0, rel=1e-3)],
        [pytest.approx(120.0, rel=1e-3), pytest.approx(110.0, rel=1e-3)],
    ]
    assert {metric.estimator for metric in result.metrics} == {f"three-segment fit, {variant}, T1 60 and T2 240 N·m"}


@pytest.mark.parametrize(("first", "second"), [(300.0, 200.0), (60.0, 400.0), (None, 50.0)])
def test_break_torques_out_of_order_are_said(first: float | None, second: float | None) -> None:
    with pytest.raises(AnalysisError, match="expected T1 < T2 < reference"):
        Method(ratio=121, rated_torque_nm=400.0, stiffness_break_t1_nm=first, stiffness_break_t2_nm=second)


@pytest.mark.parametrize(
    ("wanted", "said"),
    [
        (MetricWanted("windup", variant="mean"), "variant: found 'mean'; allowed: fitted, direct"),
        (MetricWanted("windup", fit="two_region"), "fit: found 'two_region'; allowed: six_segment, six_segment_20pct"),
        (MetricWanted("lost_motion", fit="six_segment"), "fit: found 'six_segment'; allowed: none"),
        (
            MetricWanted("windup", variant="direct", fit="six_segment"),
            "with variant direct, which uses no fit",
        ),
        (MetricWanted("hysteresis_angle", band=0.1), "band: found 0.1; this value is fixed by the definition"),
    ],
)
def test_choices_that_are_not_there_are_said(wanted: MetricWanted, said: str) -> None:
    with pytest.raises(AnalysisError, match=said):
        analyse(LOOP_OF_P1, METHOD, [wanted])


def test_what_was_chosen_is_part_of_the_result() -> None:
    asked = [
        MetricWanted("lost_motion", band=0.04),
        MetricWanted("lost_motion", band=0.03),
        MetricWanted("spring_constant", variant="centred", fit="three_region"),
        MetricWanted("spring_constant", variant="ending", fit="six_segment"),
        MetricWanted("windup", variant="direct"),
    ]
    found = [metric.to_dict() for metric in analyse(LOOP_OF_P1, METHOD, asked).metrics]
    assert [metric["choices"] for metric in found] == [
        ["band 4 %"], [], ["centred", "three_region"], [], ["direct"],
    ]  # fmt: skip
    assert [metric["estimator"] for metric in found] == [
        "interpolation",
        "interpolation",
        "chord, centred, three-region fit with segments that meet at 82.4 and 329.6 N·m",
        "chord, ending, six-segment fit with segments that meet at 90 N·m",
        "branches as measured",
    ]
