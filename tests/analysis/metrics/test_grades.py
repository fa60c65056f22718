"""Precision grades: the table, the grade of a backlash, and how a limit on it is judged."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from definition_support import LOOP_OF_P1, METHOD, sides, trace_of
from printed_numbers import reads

from analysis.evaluation.pipeline import analyse
from analysis.loop.method import Decision, MetricWanted
from analysis.metrics.estimators import backlash_limits, grade_of, grade_uncertainty
from definitions.metrics import GRADES


def test_grades_are_a_whole_table() -> None:
    assert [row.grade for row in GRADES] == list(range(1, len(GRADES) + 1))
    assert all(one.most_arcmin < other.most_arcmin for one, other in itertools.pairwise(GRADES))
    assert GRADES[0].most_arcmin == 1.0
    assert GRADES[-1].most_arcmin == np.inf


@pytest.mark.parametrize(("backlash", "grade"), [(0.0, 1), (32 / 60, 1), (1.0, 1), (1.0001, 2), (50.0, 2)])
def test_grade_of_a_backlash(backlash: float, grade: int) -> None:
    assert grade_of(backlash) == grade


@pytest.mark.parametrize(
    ("backlash", "expanded", "steps"), [(0.9, 0.05, 0), (0.9, 0.11, 1), (1.1, 0.11, 1), (1.2, 0.1, 0), (0.01, 0.5, 0)]
)
def test_grade_is_as_uncertain_as_its_backlash(backlash: float, expanded: float, steps: float) -> None:
    assert grade_uncertainty(backlash, expanded) == steps


@pytest.mark.parametrize(
    ("widths", "grade", "simple", "guarded"),
    [
        ((0.50, 0.52), 1, "PASS", "PASS"),
        ((0.94, 1.04), 1, "PASS", "NOT DECIDABLE"),
        ((0.97, 1.07), 2, "FAIL", "NOT DECIDABLE"),
        ((1.30, 1.32), 2, "FAIL", "FAIL"),
    ],
)
def test_grade_is_of_the_mean_and_judged_with_its_uncertainty(
    widths: tuple[float, float], grade: int, simple: str, guarded: str
) -> None:
    torque = np.linspace(-440.0, 440.0, 2001)
    closing = (1.0 - (torque / 440.0) ** 4) / 2.0  # none winds up while its torque falls, or has a kink
    trace = trace_of(torque, [torque / 100 + sign * width * closing for width in widths for sign in (-1, 1)])
    wanted = [MetricWanted("grade", max=1.0)]
    result = analyse(trace, METHOD, wanted)
    assert (result.metrics[0].headline.value, str(result.verdict)) == (grade, simple)
    assert [grade_of(width) for width in widths] == list(result.metrics[0].headline.per_cycle)
    assert str(analyse(trace, METHOD, wanted, Decision("guard_band")).verdict) == guarded


@pytest.mark.parametrize(
    ("grades", "backlashes"),
    [((None, 1), (None, 1.0)), ((None, 2), (None, None)), ((2, None), (1.0, None)), ((1, 1), (None, 1.0)),
     ((None, 0.5), (None, 0.0)), ((None, None), (None, None))],
)  # fmt: skip
def test_limits_on_a_grade_are_limits_on_the_backlash(
    grades: tuple[float | None, float | None], backlashes: tuple[float | None, float | None]
) -> None:
    assert backlash_limits(*grades) == backlashes


def test_a_grade_that_fails_says_by_which_backlash() -> None:
    result = analyse(LOOP_OF_P1, METHOD, [MetricWanted("grade", variant="branches", max=1.0)])
    assert result.verdict == "FAIL"
    (reason,) = result.reasons
    assert reads(reason, "grade: backlash_branches_3pct: 1.316 arcmin is above the limit of 1 arcmin: ")


def test_backlash_in_force_of_a_grade() -> None:
    """P1 has 0.95 arcmin at zero torque, and 1.32 arcmin between the paths at ±3 %."""
    for variant, grade in (("width_zero", 1), ("width_3pct", 1), ("branches", 2), ("lost_motion", 1)):
        assert sides(MetricWanted("grade", variant=variant), LOOP_OF_P1) == {"both": grade}
