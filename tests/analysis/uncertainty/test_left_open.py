"""Errors that the checks of a run leave open, as rows of the budget: `left_open: budget`."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest
from check_support import CONVERTED, FACTS, FIGURES, GOOD, KNOWN

from analysis.evaluation.metric_result import MetricResult
from analysis.evaluation.pipeline import Result, analyse
from analysis.evaluation.verdict import Verdict
from analysis.loop.method import Decision, Method, MetricWanted
from analysis.trace.errors import AnalysisError
from analysis.trace.trace import Trace
from analysis.uncertainty.budget import Budget
from analysis.uncertainty.distributions import DISTRIBUTIONS
from analysis.uncertainty.figures import AngleFigures, SensorFigures
from analysis.uncertainty.left_open import FAST_WAVES, OPEN_SOURCES
from definitions.checks import CHECKS

WANTED = [
    MetricWanted("backlash_width_3pct", max=5.0),
    MetricWanted("windup", max=20.0),
    MetricWanted("torque_ratio_slope", max=200.0),
    MetricWanted("torque_ratio_offset", max=0.0),
]
ENCODER = AngleFigures(2.0 * np.pi / 2**20)
DECLARED = dataclasses.replace(FIGURES, angle_in=ENCODER, angle_out=ENCODER)
LIMIT = 1.0 / np.sqrt(3.0)


def evaluated(
    left_open: str = "budget", trace: Trace = GOOD, figures: SensorFigures | None = DECLARED, method: Method = KNOWN,
    draws: int = 0,
) -> Result:  # fmt: skip
    method = dataclasses.replace(method, left_open=left_open)
    return analyse(trace, method, WANTED, Decision("guard_band"), facts=FACTS, figures=figures, draws=draws)


@cache
def told() -> Result:
    return evaluated("told")


@cache
def in_budget() -> Result:
    return evaluated()


def budget_of(metric: MetricResult) -> Budget:
    assert metric.headline.budget is not None
    return metric.headline.budget


def row(result: Result, metric: int, quantity: str) -> float:
    (found,) = [one for one in budget_of(result.metrics[metric]).rows if one.quantity == quantity]
    return found.contribution


def test_every_check_that_leaves_an_error_open_has_its_rows() -> None:
    assert set(OPEN_SOURCES) == {name for name, check in CHECKS.items() if check.leaves_open is not None}
    known = {source.id for sources in OPEN_SOURCES.values() for source in sources}
    rows = {one.quantity for metric in in_budget().metrics for one in budget_of(metric).rows}
    assert known <= rows
    assert not known & {one.quantity for metric in told().metrics for one in budget_of(metric).rows}


def test_rows_have_the_size_that_the_check_leaves_open() -> None:
    sizes = {check.id: check.left_open.figure for check in in_budget().checks if check.left_open is not None}
    windup = in_budget().metrics[1].headline.value
    ratio = sizes["ratio_agreement"] / 100.0 * LIMIT
    assert row(in_budget(), 1, "open_ratio") == pytest.approx(ratio * windup, rel=0.05)
    # The wind-up is read at another torque then, on both sides.
    assert row(in_budget(), 1, "open_gain_of_both") == pytest.approx(2.0 * 0.1 * LIMIT * 412.0 / 115.0, rel=0.1)
    # By the compliances of both branches at ±3 % of the rated torque, 1/K_r + 1/K_f. All of a large error to the worse
    # side is a little more than a small one to both.
    small = row(in_budget(), 0, "torque_out_reversibility") / (0.2 * LIMIT)
    for quantity, check in (("open_hysteresis", "torque_bend"), ("open_even_hysteresis", "torque_out_zero")):
        width = row(in_budget(), 0, quantity) / (sizes[check] * LIMIT)
        assert small < width < 1.06 * small
    late = 2.0 * sizes["drive_angle_direction"] * LIMIT
    assert row(in_budget(), 0, "open_late_angle") == pytest.approx(late, rel=0.01)


def test_values_are_the_same_and_only_uncertainties_grow() -> None:
    for open_one, one in zip(told().metrics, in_budget().metrics, strict=True):
        assert one.headline.value == open_one.headline.value
        assert one.headline.uncertainty > open_one.headline.uncertainty
    assert [one["in_budget"] for one in in_budget().to_dict()["not_excluded"]] == [True] * len(OPEN_SOURCES)
    assert [one["in_budget"] for one in told().to_dict()["not_excluded"]] == [False] * len(OPEN_SOURCES)


@pytest.mark.parametrize(
    ("lacks", "check"),
    [
        ({"torque_in_nm": None}, "ratio_agreement"),
        ({"drive_torque_nm": None}, "drive_torque_agreement"),
        ({"drive_angle_rad": None}, "drive_angle_agreement"),
    ],
)
def test_an_error_that_nothing_limits_decides_nothing(lacks: dict[str, None], check: str) -> None:
    result = evaluated(trace=dataclasses.replace(GOOD, **lacks))
    for metric in result.metrics[:2]:
        assert metric.verdict is Verdict.NOT_DECIDABLE
        assert any(check in reason and "left_open: told" in reason for reason in metric.reasons)
    assert evaluated("told", dataclasses.replace(GOOD, **lacks)).metrics[0].verdict is Verdict.PASS


def test_a_metric_that_such_an_error_does_not_move_is_decided() -> None:
    result = evaluated(trace=dataclasses.replace(GOOD, drive_angle_rad=None))
    assert [metric.verdict for metric in result.metrics[2:]] == [Verdict.PASS, Verdict.PASS]


def test_without_a_bench_nothing_is_decided() -> None:
    result = evaluated(figures=None)
    for metric in result.metrics:
        assert metric.verdict is Verdict.NOT_DECIDABLE
        assert any("--bench" in reason for reason in metric.reasons)
    assert not any(one["in_budget"] for one in result.to_dict()["not_excluded"])


def test_a_converted_torque_has_the_output_sensors_errors_by_its_lines() -> None:
    result = evaluated(method=CONVERTED)
    for quantity in ("open_torque_out_gain", "open_gain_of_both", "open_hysteresis", "open_even_hysteresis"):
        assert row(result, 1, quantity) == pytest.approx(row(in_budget(), 1, quantity), rel=0.2)


def test_monte_carlo_draws_these_errors_too() -> None:
    for metric in evaluated(draws=200).metrics[:1]:
        budget = budget_of(metric)
        assert budget.monte_carlo is not None
        assert budget.monte_carlo.u == pytest.approx(budget.u, rel=0.2)


def test_a_wave_of_unknown_length_has_one_length_in_each_draw() -> None:
    draws, components = 4000, 2 * len(FAST_WAVES)
    drawn = DISTRIBUTIONS["cyclic"].draw(np.random.default_rng(1), 3.0, draws, components)
    assert drawn.shape == (draws, components)
    assert (np.count_nonzero(drawn, axis=1) == 2).all()
    # A component's size is scaled by 1/√(lengths) in its shape, so that all lengths together are one wave.
    assert np.mean(np.square(drawn), axis=0) == pytest.approx(np.full(components, 3.0**2 / 2.0), rel=0.1)


def test_another_word_is_refused() -> None:
    with pytest.raises(AnalysisError, match="left_open"):
        dataclasses.replace(KNOWN, left_open="ignored")
