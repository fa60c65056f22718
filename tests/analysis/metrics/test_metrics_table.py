"""The table of metrics is whole: every row can be evaluated, judged and printed."""

import json

import pytest
from reference_unit import ReferenceUnit, bench_trace

from analysis.evaluation.pipeline import analyse
from analysis.loop.curves import MADE_BY
from analysis.loop.method import Method, MetricWanted
from analysis.metrics.estimators import ESTIMATORS
from definitions.metrics import FITS, METRICS

PUBLISHED_TERMS = {
    "backlash_branches_3pct",
    "gear_clearance",
    "hysteresis_angle",
    "stiffness_estimate",
    "k1",
    "k2",
    "k3",
    "asymmetry_at_rated",
    "grade",
    "backlash_width_3pct",
    "backlash_width_zero",
    "lost_motion",
    "stiffness_lsq",
    "stiffness_two_point",
    "stiffness_end_point",
    "stiffness_50_100",
    "stiffness_at",
    "spring_constant",
    "hysteresis_energy",
    "windup",
    "torque_ratio_slope",
    "torque_ratio_offset",
}

CONTRACT = {
    "id",
    "definition",
    "value",
    "unit",
    "uncertainty",
    "coverage_factor",
    "branch",
    "side",
    "estimator",
    "cycles",
    "limits",
    "verdict",
}

METHOD = Method(ratio=121, rated_torque_nm=412)
TRACE = bench_trace(ReferenceUnit(), 453.2, cycles=2)


def test_every_published_term_is_there() -> None:
    assert set(METRICS) >= PUBLISHED_TERMS


def test_every_metric_of_the_loop_has_its_estimator_and_no_other() -> None:
    assert list(ESTIMATORS) == [name for name, row in METRICS.items() if not row.calibration]


def test_every_fit_has_what_makes_it() -> None:
    assert list(MADE_BY) == list(FITS)


def test_units() -> None:
    assert {row.unit for row in METRICS.values()} == {"arcmin", "arcsec", "N·m/arcmin", "N·m·arcmin", "N·m", "1"}


@pytest.mark.parametrize("name", METRICS)
def test_a_row_is_complete_and_gives_a_value(name: str) -> None:
    row = METRICS[name]
    assert row.text
    assert row.source
    assert row.bad.too_low != row.bad.too_high
    asked = [
        MetricWanted(name, branch=branch, variant=variant)
        for branch in row.branches
        for variant in (None, *row.variants)
    ]
    result = analyse(TRACE, METHOD, asked)
    for metric in result.metrics:
        found = metric.to_dict()
        assert set(found) >= CONTRACT
        assert found["unit"] == row.unit
        assert found["definition"] == row.text
        assert isinstance(found["value"], float)
        assert set(found["sides"]) == set(row.sides)  # type: ignore[call-overload]


def test_result_is_plain_json() -> None:
    result = analyse(TRACE, METHOD, [MetricWanted(name) for name in METRICS])
    again = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert [metric["id"] for metric in again["metrics"]] == list(METRICS)
    assert {metric["coverage_factor"] for metric in again["metrics"]} == {2.0}


def test_choices_change_the_number() -> None:
    asked = [
        MetricWanted("lost_motion"),
        MetricWanted("lost_motion", band=0.05),
        MetricWanted("spring_constant"),
        MetricWanted("spring_constant", variant="from"),
        MetricWanted("stiffness_at"),
        MetricWanted("stiffness_at", torque_nm=300.0),
        MetricWanted("stiffness_50_100", branch="load"),
        MetricWanted("stiffness_50_100", branch="unload"),
    ]
    values = [metric.headline.value for metric in analyse(TRACE, METHOD, asked).metrics]
    for default, chosen in zip(values[::2], values[1::2], strict=True):
        assert default is not None
        assert chosen is not None
        assert chosen > default * 1.005


def test_one_side_alone() -> None:
    result = analyse(TRACE, METHOD, [MetricWanted("stiffness_lsq", side="-", min=90.0)])
    assert [side.side for side in result.metrics[0].sides] == ["-"]
    assert result.metrics[0].to_dict()["side"] == "-"
    assert result.verdict == "PASS"
