"""The published mean curve of an RV-40E-121 and a loop around it, to the digits."""

import dataclasses

import numpy as np
import pytest
from published import DATA

from analysis.evaluation.pipeline import analyse
from analysis.loop.fits import MeanCurve
from analysis.loop.method import Method, MetricWanted
from analysis.trace.trace_files import read_trace

METHOD = Method(ratio=121, rated_torque_nm=412)

PUBLISHED = MeanCurve(
    break_nm=90.0,
    negative=np.array([3.8277, 0.0579, 4.4273e-5]),
    middle=np.array([1.6274, 0.0388]),
    positive=np.array([1.4151, 0.0576, -6.0095e-5]),
)


def chord(low_nm: float, high_nm: float) -> float:
    low, high = PUBLISHED.at(np.array([low_nm, high_nm]))
    return (high_nm - low_nm) / float(high - low)


def test_seams_of_the_published_mean_curve() -> None:
    assert PUBLISHED.gaps_arcmin == (pytest.approx(0.83991, abs=5e-6), pytest.approx(0.99293, abs=5e-6))
    assert PUBLISHED.offset_arcmin == pytest.approx(0.91642, abs=5e-6)


@pytest.mark.parametrize(
    ("low_nm", "high_nm", "stiffness"),
    [
        (402, 412, 115.172),
        (407, 417, 123.736),
        (412, 422, 133.676),
        (-412, -402, 45.742),
        (206, 412, 48.873),
        (-412, -206, 32.745),
    ],
)
def test_chords_of_the_published_mean_curve(low_nm: float, high_nm: float, stiffness: float) -> None:
    assert chord(low_nm, high_nm) == pytest.approx(stiffness, abs=5e-4)


def test_stiffness_and_windup_of_the_published_mean_curve() -> None:
    assert PUBLISHED.stiffness_at(206) == pytest.approx(30.450, abs=5e-4)
    assert PUBLISHED.stiffness_at(0) == pytest.approx(1 / 0.0388)
    low, high = PUBLISHED.at(np.array([-412.0, 412.0]))
    assert high - low == pytest.approx(27.4576, abs=5e-5)


LOOP = [
    (MetricWanted("backlash_width_3pct"), 0.9400, 5e-5),
    (MetricWanted("backlash_width_zero"), 0.9408, 5e-5),
    (MetricWanted("lost_motion"), 0.9591, 5e-5),
    (MetricWanted("spring_constant", variant="direct"), 115.17, 5e-3),
    (MetricWanted("spring_constant"), 115.172, 1e-3),
    (MetricWanted("spring_constant", variant="centred"), 123.736, 2e-3),
    (MetricWanted("spring_constant", variant="from"), 133.677, 2e-3),
    (MetricWanted("spring_constant", side="-"), 45.742, 1e-3),
    (MetricWanted("stiffness_at", torque_nm=206.0), 30.450, 1e-3),
    (MetricWanted("stiffness_50_100", branch="mean"), 48.873, 1e-3),
    (MetricWanted("stiffness_50_100", branch="mean", side="-"), 32.745, 1e-3),
    (MetricWanted("hysteresis_energy"), 526.86, 5e-3),
    (MetricWanted("windup"), 27.4576, 1e-4),
]


@pytest.mark.parametrize("segments", ["named", "found"])
def test_loop_around_the_published_curve(segments: str) -> None:
    trace = read_trace(DATA / "loop_published_curve.csv")
    if segments == "found":
        trace = dataclasses.replace(trace, segment=None, segments={})
    result = analyse(trace, METHOD, [wanted for wanted, _, _ in LOOP])
    for metric, (wanted, value, digits) in zip(result.metrics, LOOP, strict=True):
        assert metric.headline.value == pytest.approx(value, abs=digits), wanted
    energy = next(metric for metric in result.metrics if metric.wanted.id == "hysteresis_energy")
    assert energy.to_dict()["value_j"] == pytest.approx(0.15326, abs=5e-6)
    assert result.curves.fit is not None
    assert result.curves.fit.offset_arcmin == pytest.approx(0.0, abs=0.1)
