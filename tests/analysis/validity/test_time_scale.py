"""A time in another unit than seconds is no time: whatever it would do to lag, drift and creep is not judged."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from check_support import GOOD, KNOWN, changed, judged, of

from analysis.evaluation.verdict import Verdict
from analysis.trace.trace import Trace


@pytest.mark.parametrize(
    ("factor", "named"),
    [
        (1000.0, "milliseconds"),
        (1e6, "microseconds"),
        (1 / 60, "minutes"),
        (1 / 3600, "hours"),
        (10.0, ""),
        (1 / 10, ""),
        (30.0, ""),
        (1 / 30, "minutes"),
        (1 / 25, "minutes"),
    ],
)
def test_a_time_in_another_unit_decides_nothing(factor: float, named: str) -> None:
    result = judged(**changed(t_s=factor * GOOD.t_s))
    found = of(result, "time_scale")
    assert result.verdict is Verdict.NOT_DECIDABLE
    assert found.passed is False
    assert (f"as if the time were in {named}" if named else "are planned: ") in found.text
    assert found.figure == pytest.approx(max(factor, 1 / factor), rel=0.05)


@pytest.mark.parametrize("factor", [1 / 4, 0.5, 2.0, 4.0])
def test_a_load_that_is_slower_or_faster_than_planned_is_no_other_unit(factor: float) -> None:
    assert of(judged(**changed(t_s=factor * GOOD.t_s)), "time_scale").passed is True


def test_a_time_that_stands_decides_nothing() -> None:
    result = judged(**changed(t_s=np.zeros(GOOD.samples)))
    assert of(result, "time_scale").passed is False
    assert result.verdict is Verdict.NOT_DECIDABLE


def test_samples_too_far_apart_for_a_dwell_are_not_looked_at() -> None:
    rows = np.arange(0, GOOD.samples, 97)
    fields = {one.name: getattr(GOOD, one.name) for one in dataclasses.fields(Trace)}
    few = Trace(**{name: value[rows] if isinstance(value, np.ndarray) else value for name, value in fields.items()})
    for factor in (1.0, 30.0, 1000.0):
        result = judged(dataclasses.replace(few, t_s=factor * few.t_s))
        assert of(result, "time_scale").passed is (factor == 1.0)


def test_without_a_planned_rate_the_check_says_what_it_needs() -> None:
    result = judged(method=dataclasses.replace(KNOWN, planned_nm_s=None))
    assert of(result, "time_scale").passed is None
    assert "needs cycles with a torque rate" in of(result, "time_scale").text
