"""Shares, control charts, their rules and run lengths, type 1 study, groups: published figures and known processes."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from analysis.line.chart_run_length import chart_run_length, spread_alarm
from analysis.line.control_chart import Limits, control_chart, limits_of, sd_constants, spread_constants
from analysis.line.gage_study import range_constants
from analysis.line.groups import Sums, compare_groups
from analysis.line.proportions import pareto, proportion
from analysis.line.run_rules import (
    RULE_SETS,
    RULES,
    Signal,
    _simulated,
    average_run_length,
    rules_of,
    signals,
)
from analysis.line.type_one import CAPABLE, type_one
from analysis.trace.errors import AnalysisError


@pytest.mark.parametrize(
    ("count", "of", "low", "high"),
    [(4, 20, 0.057334, 0.436614), (0, 10, 0.0, 1.0 - 0.025**0.1), (10, 10, 0.025**0.1, 1.0)],
)
def test_exact_interval_of_a_share(count: int, of: int, low: float, high: float) -> None:
    """C. Clopper and E. Pearson; 4 of 20 as binom.test of R gives it, the ends by their closed form."""
    found = proportion(count, of)
    assert (found.low, found.high) == pytest.approx((low, high), abs=1e-6)
    assert found.share == count / of


def test_a_share_of_nothing_says_nothing() -> None:
    assert proportion(0, 0) == (0, 0, None, 0.0, 1.0)
    with pytest.raises(AnalysisError, match="3 out of 2"):
        proportion(3, 2)


@given(st.dictionaries(st.text(min_size=1, max_size=5), st.integers(0, 50), max_size=8))
@settings(max_examples=30, deadline=None)
def test_causes_come_by_their_counts_and_add_up(counts: dict[str, int]) -> None:
    found = pareto(counts)
    assert [one.number for one in found] == sorted((count for count in counts.values() if count), reverse=True)
    assert all(one.number == counts[one.name] for one in found)
    assert not found or found[-1].cumulative == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("count", "c4", "d2", "d3"),
    [(2, 0.7979, 1.128, 0.853), (3, 0.8862, 1.693, 0.888), (5, 0.9400, 2.326, 0.864), (10, 0.9727, 3.078, 0.797)],
)
def test_constants_are_those_of_the_tables(count: int, c4: float, d2: float, d3: float) -> None:
    """D. Montgomery, Introduction to Statistical Quality Control, appendix VI."""
    assert sd_constants(count)[0] == pytest.approx(c4, abs=5e-5)
    assert spread_constants("range", count) == pytest.approx((d2, d3), abs=6e-4)
    assert spread_constants("range", count)[0] == range_constants(count)[0]


@pytest.mark.parametrize(
    ("mean", "spread", "kind", "subgroup", "of_means", "of_spreads"),
    [
        (1.5056, 0.32521, "range", 5, (1.31795, 1.69325), (0.0, 0.68749)),
        (74.001, 0.0094, "standard deviation", 5, (73.988, 74.014), (0.0, 0.0196)),
        (300.5, 7.79, "moving range", 1, (279.78, 321.22), (0.0, 25.45)),
    ],
    ids=["flow width", "piston rings", "single values"],
)
def test_limits_of_published_charts(  # noqa: PLR0917 - a row of a table
    mean: float, spread: float, kind: str, subgroup: int, of_means: tuple[float, float], of_spreads: tuple[float, float]
) -> None:
    """D. Montgomery, Introduction to Statistical Quality Control, 6th edition, examples 6.1, 6.3 and 6.5."""
    sd, means, spreads = limits_of(mean, spread, kind, subgroup)
    assert means[1:] == pytest.approx(of_means, rel=1e-4)
    assert spreads[1:] == pytest.approx(of_spreads, rel=3e-3)
    if kind == "range":
        assert sd == pytest.approx(0.1398, abs=5e-5)
        assert (2.0 - 1.0) / (6.0 * sd) == pytest.approx(1.192, abs=5e-4)


def test_a_chart_of_a_steady_process_and_of_one_that_moves() -> None:
    random = np.random.default_rng(11)
    steady = random.normal(10.0, 0.2, 500)
    chart = control_chart(steady)
    assert len(chart.means) == 100
    assert chart.sd_within == pytest.approx(0.2, rel=0.1)
    assert not chart.signals
    assert len(chart.spread_signals) <= 1, "370 points to a false alarm, and these are 100"
    assert min(chart.spreads) >= chart.spread_limits.low == 0.0
    moved = control_chart([*steady, *random.normal(10.5, 0.2, 25)], baseline=100)
    assert moved.mean_limits == chart.mean_limits
    assert {one.rule for one in moved.signals} == {"limit"}
    assert min(one.point for one in moved.signals) > 100
    wider = control_chart([*steady, *random.normal(10.0, 0.8, 25)], baseline=100)
    assert set(wider.spread_signals) - set(chart.spread_signals) == {101, 102, 103, 104, 105}


def test_single_values_beside_their_moving_range() -> None:
    values = [*np.random.default_rng(12).normal(5.0, 0.1, 60), 9.0]
    chart = control_chart(values, subgroup=1, baseline=60)
    assert (chart.kind, len(chart.means), len(chart.spreads)) == ("moving range", 61, 60)
    assert chart.signals[-1] == Signal("limit", 61)
    assert chart.spread_signals[-1] == 61, "the moving range stands at the later value"
    assert control_chart(values, subgroup=12).kind == "standard deviation"
    assert control_chart(values, subgroup=3).left_over == 1


@pytest.mark.parametrize(
    ("values", "changes", "said"),
    [
        ([1.0, 2.0, 3.0], {"subgroup": 2}, "3 values fill 1 subgroups of 2"),
        ([1.0] * 10, {}, "are identical"),
        ([1.0, 2.0] * 10, {"subgroup": 26}, "subgroups of 26"),
        ([1.0, 2.0] * 10, {"baseline": 5}, "first 5 of 4"),
        ([1.0, math.nan] * 10, {}, "value 2 is nan"),
    ],
)
def test_what_is_no_chart_is_refused(values: list[float], changes: dict[str, int], said: str) -> None:
    with pytest.raises(AnalysisError, match=said):
        control_chart(values, **changes)


@pytest.mark.parametrize(
    ("rules", "points"),
    [
        (("limit",), 370.40),
        (("limit", "two-of-three"), 225.44),
        (("limit", "four-of-five"), 166.05),
        (("limit", "eight-on-a-side"), 152.73),
        (RULE_SETS["western-electric"], 91.75),
    ],
)
def test_run_lengths_are_the_published_ones(rules: tuple[str, ...], points: float) -> None:
    """C. Champ and W. Woodall (1987), Technometrics 29, table 1."""
    found = average_run_length(rules)
    assert found.points == pytest.approx(points, abs=5e-3)
    assert found.standard_error == 0.0


def test_a_shift_is_found_sooner_by_more_rules() -> None:
    assert average_run_length(("limit",), 1.0).points == pytest.approx(43.89, abs=5e-3)
    assert average_run_length(RULE_SETS["western-electric"], 1.0).points == pytest.approx(9.22, abs=5e-3)


def test_eight_metrics_by_four_rules_give_five_false_alarms_an_hour() -> None:
    assert 8 * 60 / average_run_length(RULE_SETS["western-electric"]).points == pytest.approx(5.2, abs=0.05)


def test_what_is_simulated_agrees_with_what_is_computed() -> None:
    for rules in (RULE_SETS["western-electric"], ("fifteen-within",)):
        found = _simulated(rules, 0.0)
        assert abs(found.points - average_run_length(rules).points) < 4.0 * found.standard_error
    all_of_nelson = average_run_length(RULE_SETS["nelson"])
    assert 0.0 < all_of_nelson.standard_error < 0.02 * all_of_nelson.points
    assert all_of_nelson.points < 91.75


@pytest.mark.parametrize(
    ("subgroup", "kind", "rules"),
    [
        (1, None, "shewhart"), (1, None, "western-electric"), (2, None, "shewhart"), (5, None, "shewhart"),
        (5, "standard deviation", "shewhart"), (5, None, "western-electric"), (5, None, "nelson"),
    ],
)  # fmt: skip
def test_run_lengths_of_a_whole_chart_are_those_of_its_signals(
    subgroup: int, kind: Literal["standard deviation"] | None, rules: str
) -> None:
    """Simulated charts of a steady process, judged by `control_chart`: the first signal of each of 1000 pieces.

    A piece is some ten run lengths long. The mean of so many run lengths has a standard error of about 3 %, and limits
    from a million values have next to none.
    """
    pieces, length = 1000, 1500
    values = np.random.default_rng(19_870_208).standard_normal(pieces * length * subgroup)
    chart = control_chart(values, subgroup, RULE_SETS[rules], kind=kind)
    points = np.unique([*(one.point for one in chart.signals), *chart.spread_signals]) - 1
    of_piece, first = np.unique(points // length, return_index=True)
    assert of_piece.size == pieces, "no piece is without a signal"
    lengths = points[first] % length + 1
    found = chart_run_length(RULE_SETS[rules], chart.kind, subgroup)
    error = math.hypot(lengths.std(ddof=1) / math.sqrt(pieces), found.standard_error)
    assert abs(lengths.mean() - found.points) < 4.0 * error
    assert found.points < average_run_length(RULE_SETS[rules]).points - 4.0 * error, "sooner than by the means alone"


def test_a_spread_beyond_its_limits_is_as_likely_as_its_distribution_says() -> None:
    for subgroup in (2, 5, 10):
        expected, scatter = spread_constants("range", subgroup)
        high, low = expected + 3.0 * scatter, max(0.0, expected - 3.0 * scatter)
        of_ranges = stats.studentized_range.sf(high, subgroup, np.inf) + stats.studentized_range.cdf(
            low, subgroup, np.inf
        )
        assert spread_alarm("range", subgroup) == pytest.approx(of_ranges, abs=1e-7)
    draws = np.random.default_rng(4).standard_normal((400_000, 12)).std(axis=1, ddof=1)
    expected, scatter = spread_constants("standard deviation", 12)
    share = float((np.abs(draws - expected) > 3.0 * scatter).mean())
    of_theory = spread_alarm("standard deviation", 12)
    assert abs(share - of_theory) < 4.0 * math.sqrt(of_theory / draws.size)


COMPLETED = {
    "limit": ([0.0, 3.1], [0.0, 2.9]),
    "two-of-three": ([0.0, 2.1, 0.0, 2.1], [2.1, 0.0, 0.0, 2.1, -2.1]),
    "four-of-five": ([1.1, 1.1, 0.0, 1.1, 1.1], [1.1, 1.1, 0.0, 1.1, 0.9, 1.1]),
    "eight-on-a-side": ([-0.1] * 8, [0.1] * 7 + [-0.1] * 7),
    "nine-on-a-side": ([0.1] * 9, [0.1] * 8),
    "six-rising": ([0.5, 0.0, 0.1, 0.2, 0.3, 0.4, 0.5], [0.5, 0.0, 0.1, 0.2, 0.3, 0.4, 0.4]),
    "fourteen-alternating": ([0.0, 0.0, *[0.1, 0.0] * 6, 0.1], [0.0, 0.0, *[0.1, 0.0] * 6]),
    "fifteen-within": ([2.0] + [0.1, -0.1] * 7 + [0.1], [2.0] + [0.1, -0.1] * 7),
    "eight-outside": ([1.1, -1.1] * 4, [1.1, -1.1] * 3 + [1.1]),
}
"""For each rule points of which the last one completes it, and points that do not."""


def test_every_rule_has_points_that_complete_it_and_points_that_do_not() -> None:
    assert set(COMPLETED) == set(RULES)
    assert set().union(*RULE_SETS.values()) == set(RULES)
    for name, (yes, no) in COMPLETED.items():
        assert signals(np.array(yes), (name,))[0] == Signal(name, len(yes)), name
        assert signals(np.array(no), (name,)) == (), name


def test_rules_are_named_by_set_or_one_by_one() -> None:
    assert rules_of("shewhart") == ("limit",)
    assert rules_of(["limit", "six-rising", "shewhart"]) == ("limit", "six-rising")
    with pytest.raises(AnalysisError, match=r"'nelsen'; allowed: the rule sets shewhart, western-electric, nelson"):
        rules_of(["nelsen"])


def test_type_one_by_its_formulas() -> None:
    """ISO 22514-7: 20 % of the tolerance over 6 σ, and half of it less the bias over 3 σ."""
    values = stats.norm.ppf((np.arange(50) + 0.5) / 50)
    values = 6.001 + 0.001 * values / values.std(ddof=1)
    found = type_one(values, 6.000, 0.06)
    assert (found.cg, found.cgk) == pytest.approx((2.0, (0.006 - 0.001) / 0.003))
    assert found.cg_low < found.cg < found.cg_high
    assert found.capable
    assert found.p_no_bias < 1e-6
    at_the_limit = type_one(values, 6.000, found.least_tolerance)
    assert min(at_the_limit.cg, at_the_limit.cgk) == pytest.approx(CAPABLE)
    assert type_one(values, 6.001, 0.06).p_no_bias == pytest.approx(1.0)
    coarse = type_one(np.round(values, 2) + np.array([0.0, 0.01] * 25), 6.0, 0.06)
    assert not coarse.fine_enough
    assert not type_one(values, 6.005, 0.06).capable


@pytest.mark.parametrize(
    ("values", "tolerance", "said"),
    [
        (np.arange(24.0), 1.0, "found 24 values; expected 25"),
        (np.ones(25), 1.0, "every reading is 1"),
        (np.arange(25.0), 0.0, "tolerance 0"),
        (np.arange(25.0), math.nan, "tolerance nan"),
    ],
)
def test_what_is_no_type_one_study_is_refused(values: np.ndarray, tolerance: float, said: str) -> None:
    with pytest.raises(AnalysisError, match=said):
        type_one(values, 0.0, tolerance)


def sums_of(values: list[float], origin: float) -> Sums:
    away = np.array(values) - origin
    return Sums(len(values), float(away.sum()), float(np.square(away).sum()))


def test_groups_by_their_sums_are_the_published_analysis_of_variance() -> None:
    """D. Montgomery, Design and Analysis of Experiments, table 3.1: plasma etching, F = 66.80 on 3 and 16."""
    rates = {
        "160 W": [575.0, 542.0, 530.0, 539.0, 570.0], "180 W": [565.0, 593.0, 590.0, 579.0, 610.0],
        "200 W": [600.0, 651.0, 610.0, 637.0, 629.0], "220 W": [725.0, 700.0, 715.0, 685.0, 710.0],
    }  # fmt: skip
    found = compare_groups({name: sums_of(values, 600.0) for name, values in rates.items()}, 600.0)
    assert [one.mean for one in found.groups] == pytest.approx([551.2, 587.4, 625.4, 707.0])
    assert found.sd_within**2 == pytest.approx(333.70, abs=5e-3)
    assert found.p_same == pytest.approx(stats.f_oneway(*rates.values()).pvalue, rel=1e-9)
    assert found.share_between == pytest.approx(66870.55 / 72209.75, abs=1e-6)
    assert found.groups[0].low < 551.2 < found.groups[0].high < 617.75


def test_groups_that_are_none_are_refused() -> None:
    with pytest.raises(AnalysisError, match=r"found 1 to compare \(A\)"):
        compare_groups({"A": Sums(3, 1.0, 1.0)})
    with pytest.raises(AnalysisError, match="every group has one value"):
        compare_groups({"A": Sums(1, 1.0, 1.0), "B": Sums(1, 2.0, 4.0)})
    assert isinstance(control_chart([1.0, 2.0, 3.0, 5.0], 2).mean_limits, Limits)
