"""U holds for errors as large as the checks of a run leave open where these are in the budget, and only there."""

from __future__ import annotations

import pytest

from benchmarks.simulated.left_open_units import Share, study

METRICS = ("backlash_width_3pct", "stiffness_lsq", "hysteresis_energy")


@pytest.fixture(scope="module")
def shares() -> dict[str, Share]:
    return study(18, METRICS, ("RV-40E", "RV-50"))


@pytest.mark.parametrize("metric", METRICS)
def test_what_is_left_open_is_covered_in_the_budget_and_not_when_told(shares: dict[str, Share], metric: str) -> None:
    covered, expanded = shares[metric]
    assert covered["told"] < 0.5
    assert covered["drawn"] >= 0.92, "the rows of the errors that were drawn, without the others"
    assert covered["budget"] >= covered["drawn"]
    assert expanded["told"] < expanded["drawn"] < expanded["budget"]
