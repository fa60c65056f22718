"""Capability indices: known distributions, samples, one limit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from analysis.line.capability import capability, indices, interval_of_both, interval_of_nearest
from analysis.line.control_chart import control_chart
from analysis.trace.errors import AnalysisError


@pytest.mark.parametrize(
    ("mean", "sd", "lower", "upper", "both", "nearest"),
    [
        (10.0, 0.4, 9.0, 11.0, 0.8333, 0.8333),
        (10.5, 0.4, 9.0, 11.0, 0.8333, 0.416667),
        # one limit: the side without a limit does not count, however near zero the value is
        (0.3, 0.1, None, 1.0, None, 7.0 / 3.0),
        (0.3, 0.1, 0.0, None, None, 1.0),
        (1.2, 0.1, None, 1.0, None, -2.0 / 3.0),
    ],
)
def test_known_distributions(
    mean: float, sd: float, lower: float | None, upper: float | None, *, both: float | None, nearest: float
) -> None:
    found = indices(mean, sd, lower, upper)
    assert found.both == (None if both is None else pytest.approx(both, abs=5e-5))
    assert found.nearest == pytest.approx(nearest, abs=5e-7 if nearest == 0.416667 else 5e-5)


def test_sample_of_a_steady_process() -> None:
    values = stats.norm.ppf((np.arange(2000) + 0.5) / 2000, 10.5, 0.4)
    found = capability(np.random.default_rng(1).permutation(values), 9.0, 11.0)
    assert found.overall.nearest == pytest.approx(0.416667, rel=0.01)
    assert found.within.nearest == pytest.approx(0.416667, rel=0.05)
    assert found.outside_fraction == pytest.approx(stats.norm.sf(1.25) + stats.norm.cdf(-3.75), rel=0.01)
    assert found.cpk_low < 0.416667 < found.cpk_high


def test_a_drifting_process_is_capable_within_only() -> None:
    random = np.random.default_rng(2)
    values = np.linspace(9.0, 11.0, 300) + random.normal(0.0, 0.05, 300)
    for subgroup in (1, 5):
        found = capability(values, 8.5, 11.5, subgroup)
        assert found.sd_within == pytest.approx(0.05, rel=0.15)
        assert found.within.nearest > 3.0 * found.overall.nearest


def test_confidence_interval_covers() -> None:
    random = np.random.default_rng(3)
    hits = 0
    for _ in range(300):
        found = capability(random.normal(10.0, 0.4, 60), 9.0, 11.0, 5)
        hits += found.cpk_low <= 0.8333 <= found.cpk_high
    assert 0.90 < hits / 300 <= 1.0


def test_published_intervals() -> None:
    """Montgomery, Introduction to Statistical Quality Control: 20 values, Cp 2.29 and Cpk 1.33, 95 %."""
    assert interval_of_both(2.29, 19, 0.95) == pytest.approx((1.57, 3.01), abs=5e-3)
    assert interval_of_nearest(1.33, 20, 19, 0.95) == pytest.approx((0.88, 1.78), abs=1e-2)


def test_intervals_of_all_indices_cover() -> None:
    """3000 samples of a known process: 95 % of the intervals hold the true index, to 0.4 % and what Bissell leaves."""
    random = np.random.default_rng(6)
    true = {"cp": 0.8333, "pp": 0.8333, "cpk": 0.8333, "ppk": 0.8333}
    hits = dict.fromkeys(true, 0)
    for _ in range(3000):
        found = capability(random.normal(10.0, 0.4, 60), 9.0, 11.0, 5)
        for name, index in true.items():
            hits[name] += getattr(found, f"{name}_low") <= index <= getattr(found, f"{name}_high")
    assert {name: hits[name] / 3000 for name in ("cp", "pp")} == pytest.approx({"cp": 0.95, "pp": 0.95}, abs=0.012)
    # two equal sides: the nearer one of a sample reads low, and its interval with it
    assert all(0.92 < hits[name] / 3000 < 0.98 for name in ("cpk", "ppk"))


def test_one_limit_has_no_interval_of_both_sides() -> None:
    found = capability(np.random.default_rng(7).normal(0.3, 0.1, 30), None, 1.0)
    assert (found.cp_low, found.cp_high, found.pp_low, found.pp_high) == (None, None, None, None)
    assert found.ppk_low < found.overall.nearest < found.ppk_high


@given(shift=st.floats(-5, 5), scale=st.floats(0.1, 10))
def test_indices_do_not_depend_on_the_unit(shift: float, scale: float) -> None:
    values = np.random.default_rng(4).normal(10.0, 0.4, 30)
    one, other = (
        capability(values, 9.0, 11.0),
        capability(shift + scale * values, shift + scale * 9, shift + scale * 11),
    )
    assert other.within.nearest == pytest.approx(one.within.nearest, rel=1e-6)
    assert other.overall.both == pytest.approx(one.overall.both or 0.0, rel=1e-6)


@pytest.mark.parametrize(
    ("values", "lower", "upper", "subgroup", "said"),
    [
        ([1.0, 2.0, 3.0], None, None, 1, "no limit"),
        ([1.0, 2.0, 3.0], 2.0, 1.0, 1, "lower limit must be smaller"),
        ([1.0, 2.0, 3.0], 0.0, np.inf, 1, "must be finite numbers"),
        ([1.0, 1.0, 1.0], 0.0, 2.0, 1, "standard deviation"),
        ([1.0, 2.0], 0.0, 2.0, 1, "found 2 values"),
        ([1.0, np.nan, 2.0], 0.0, 2.0, 1, "value 2 is nan"),
        ([1.0, 2.0, 3.0], 0.0, 2.0, 2, "2 whole subgroups"),
        ([1.0, 2.0, 3.0], 0.0, 2.0, 0, "subgroups of 0"),
        (["a", "b", "c"], 0.0, 2.0, 1, "expected numbers"),
    ],
)
def test_wrong_samples_are_said(values: list[float], lower: float, upper: float, *, subgroup: int, said: str) -> None:
    with pytest.raises(AnalysisError, match=said):
        capability(values, lower, upper, subgroup)


def test_level_of_confidence_is_checked() -> None:
    with pytest.raises(AnalysisError, match="level of confidence: found 95"):
        capability([1.0, 2.0, 4.0], 0.0, 5.0, level=95)


@pytest.mark.parametrize("value", [0.1, 0.7, 0.83, 1.0 / 3.0, 5.0])
@pytest.mark.parametrize("subgroup", [1, 2, 3, 5, 7])
def test_values_without_spread_within_have_neither_indices_nor_a_chart(value: float, subgroup: int) -> None:
    """Rounding of the computer leaves a variance of 1e-34 in identical values, which gave a Cpk of 1e16."""
    alike = [value] * 35
    steps = [value + 0.1 * (row // subgroup) for row in range(35)]
    for row in (alike, steps) if subgroup > 1 else (alike,):
        with pytest.raises(AnalysisError, match="identical"):
            capability(row, None, 9.0, subgroup)
        for kind in ("range", "standard deviation"):
            with pytest.raises(AnalysisError, match="identical"):
                control_chart(row, subgroup, kind=kind)
