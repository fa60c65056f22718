"""Repeatability over cycles and runs: by hand, by simulation, and what cannot be."""

import numpy as np
import pytest
from reference_unit import ReferenceUnit, exact_trace

from analysis.evaluation.pipeline import analyse
from analysis.line.spread import repeatability
from analysis.loop.method import Method, MetricWanted
from analysis.trace.errors import AnalysisError


def test_by_hand() -> None:
    found = repeatability([[1.0, 3.0], [4.0, 6.0], [6.0, 10.0]])
    assert (found.runs, found.cycles, found.run_values) == (3, 6, (2.0, 5.0, 8.0))
    assert found.mean == pytest.approx(5.0)
    assert found.sd_runs == pytest.approx(3.0)
    assert found.sd_cycles == pytest.approx(2.0)  # (2 + 2 + 8) / 3 = 4
    assert found.sd_between == pytest.approx(np.sqrt(9 - 4 / 2))


def test_published_repeats_of_the_static_bench() -> None:
    """Three repeats of one cycle each: standard deviation over runs only."""
    found = repeatability([[2.4], [2.5], [2.6]])
    assert (found.mean, found.sd_runs) == (pytest.approx(2.5), pytest.approx(0.1))
    assert (found.sd_cycles, found.sd_between) == (None, None)


def test_runs_that_differ_by_their_cycles_alone_have_nothing_between_them() -> None:
    assert repeatability([[1.0, 5.0], [5.0, 1.0]]).sd_between == 0.0


def test_both_components_are_found_in_a_simulation() -> None:
    random = np.random.default_rng(5)
    offsets = random.normal(0.0, 0.3, 4000)
    runs = [offset + random.normal(0.0, 0.2, 3) for offset in offsets]
    found = repeatability(runs)
    assert found.sd_cycles == pytest.approx(0.2, rel=0.032)  # four standard errors
    assert found.sd_between == pytest.approx(0.3, rel=0.04)
    assert found.sd_runs == pytest.approx(np.hypot(0.3, 0.2 / np.sqrt(3)), rel=0.04)


def test_of_results() -> None:
    """Cycles of a result go in as they are; units that differ stand for runs that differ."""
    values = []
    for width in (23.0, 24.0):
        trace = exact_trace(ReferenceUnit(f_c=width), 480.0, points=3001, cycles=2)
        (metric,) = analyse(trace, Method(ratio=121, rated_torque_nm=412), [MetricWanted("gear_clearance")]).metrics
        values.append(metric.headline.per_cycle)
    found = repeatability(values)
    assert found.cycles == 4
    assert found.sd_cycles == pytest.approx(0.0, abs=1e-9)
    assert found.sd_runs == pytest.approx(abs(np.mean(values[0]) - np.mean(values[1])) / np.sqrt(2))


@pytest.mark.parametrize(
    ("runs", "said"),
    [
        ([], "found 0 runs"),
        ([[1.0, 2.0]], "found 1 runs; expected 2"),
        ([[1.0], []], "run 2: found 0 values"),
        ([[1.0], [np.nan]], "run 2: value 1 is nan"),
    ],
)
def test_what_cannot_be_is_said(runs: list[list[float]], said: str) -> None:
    with pytest.raises(AnalysisError, match=said):
        repeatability(runs)
