"""Gage study: the published example of AIAG by both methods, laws, and faults of the table."""

import csv

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from published import DATA

from analysis.line.gage_study import (
    GageDesign,
    analyse_average_range,
    analyse_gage_study,
    gage_design,
    range_constants,
)
from analysis.trace.errors import AnalysisError


def published() -> GageDesign:
    with (DATA / "gage_study.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    values = [float(row["value"]) for row in rows]
    return gage_design([row["operator"] for row in rows], [row["part"] for row in rows], values)


def test_published_study_by_analysis_of_variance() -> None:
    study = analyse_gage_study(published())
    assert study.part.sum_of_squares == pytest.approx(88.36193, abs=5e-6)
    assert study.operator.sum_of_squares == pytest.approx(3.16726, abs=5e-6)
    assert study.interaction.sum_of_squares == pytest.approx(0.35898, abs=5e-6)
    assert study.repeatability.sum_of_squares == pytest.approx(2.75893, abs=5e-6)
    assert [row.freedom for row in (study.part, study.operator, study.interaction, study.repeatability)] == [
        9,
        2,
        18,
        60,
    ]
    assert study.pooled
    assert study.grr_pct.value == pytest.approx(27.86, abs=5e-3)
    assert study.ndc == 4


def test_published_study_by_average_and_range() -> None:
    study = analyse_average_range(published())
    # AIAG prints EV 0.20188, AV 0.22963, GRR 0.30575, PV 1.10456 from constants rounded to four digits
    assert study.sd_repeatability.value == pytest.approx(0.20188, rel=2e-4)
    assert study.sd_reproducibility.value == pytest.approx(0.22963, rel=5e-4)
    assert study.sd_gage.value == pytest.approx(0.30575, rel=5e-4)
    assert study.sd_part.value == pytest.approx(1.10456, rel=5e-4)
    assert study.grr_pct.value == pytest.approx(26.68, abs=0.01)
    assert study.ndc == 5


def test_intervals_hold_their_estimates_and_repeat() -> None:
    for analyse in (analyse_gage_study, analyse_average_range):
        study, again = analyse(published()), analyse(published())
        assert study == again
        for interval in (study.sd_repeatability, study.sd_gage, study.sd_part, study.sd_total, study.grr_pct):
            assert interval.low < interval.value < interval.high


@pytest.mark.parametrize(("count", "k"), [(2, 0.8862), (3, 0.5908)])
def test_constants_of_trials(count: int, k: float) -> None:
    assert 1.0 / range_constants(count)[0] == pytest.approx(k, abs=6e-5)


@pytest.mark.parametrize(
    ("count", "k"), [(2, 0.7071), (3, 0.5231), (4, 0.4467), (5, 0.4030), (8, 0.3375), (10, 0.3146)]
)
def test_constants_of_operators_and_parts(count: int, k: float) -> None:
    assert 1.0 / range_constants(count)[1] == pytest.approx(k, abs=6e-5)


def simulated(
    random: np.random.Generator, part: float, operator: float, repeat: float, crossed: float = 0.0
) -> GageDesign:
    shape = (10, 3, 3)
    values = (
        random.normal(0, part, (10, 1, 1))
        + random.normal(0, operator, (1, 3, 1))
        + random.normal(0, crossed, (10, 3, 1))
        + random.normal(0, repeat, shape)
    )
    return GageDesign(values, tuple("abcdefghij"), ("A", "B", "C"))


def test_confidence_intervals_cover() -> None:
    random = np.random.default_rng(5)
    truth = np.hypot(0.2, 0.1)
    hits = {analyse_gage_study: 0, analyse_average_range: 0}
    for _ in range(120):
        design = simulated(random, 1.0, 0.1, 0.2)
        for analyse in hits:
            gage = analyse(design).sd_gage
            hits[analyse] += gage.low <= truth <= gage.high
    assert all(count / 120 > 0.88 for count in hits.values()), hits


def test_interaction_that_is_there_is_not_pooled() -> None:
    study = analyse_gage_study(simulated(np.random.default_rng(6), 1.0, 0.1, 0.1, crossed=0.5))
    assert not study.pooled
    assert study.p_interaction < 1e-6
    assert study.sd_gage.value > 0.3


@settings(max_examples=20)
@given(shift=st.floats(-100, 100), scale=st.floats(0.01, 100))
def test_share_of_the_gage_does_not_depend_on_the_unit(shift: float, scale: float) -> None:
    design = published()
    moved = GageDesign(shift + scale * design.values, design.parts, design.operators)
    assert analyse_gage_study(moved).grr_pct.value == pytest.approx(27.8607, abs=1e-3)


def test_tolerance() -> None:
    design = published()
    for study in (analyse_gage_study(design, tolerance=6.0), analyse_average_range(design, tolerance=6.0)):
        assert study.tolerance_pct == pytest.approx(100 * study.sd_gage.value)
    with pytest.raises(AnalysisError, match="tolerance -1"):
        analyse_gage_study(design, tolerance=-1)


def test_a_gage_without_spread() -> None:
    values = np.arange(3.0)[:, None, None] + np.zeros((3, 2, 2))
    study = analyse_gage_study(GageDesign(values, ("1", "2", "3"), ("A", "B")))
    assert (study.grr_pct.value, study.ndc) == (0.0, 1000)


def test_readings_that_all_are_the_same_are_no_study() -> None:
    """A dead gage: nothing differs, so nothing says that the gage is good."""
    with pytest.raises(AnalysisError, match=r"every reading is 0\.94"):
        analyse_gage_study(GageDesign(np.full((3, 2, 2), 0.94), ("1", "2", "3"), ("A", "B")))


def test_rows_in_any_order() -> None:
    design = published()
    rows = [
        (who, which, float(design.values[p, o, t]))
        for p, which in enumerate(design.parts)
        for o, who in enumerate(design.operators)
        for t in range(3)
    ]
    order = np.random.default_rng(7).permutation(len(rows))
    mixed = gage_design(*zip(*(rows[index] for index in order), strict=True))
    assert analyse_gage_study(mixed).grr_pct.value == pytest.approx(27.8607, abs=1e-3)


def test_names_and_lengths_are_checked() -> None:
    with pytest.raises(AnalysisError, match="1 names of parts"):
        GageDesign(np.zeros((2, 2, 2)), ("1",), ("A", "B"))
    with pytest.raises(AnalysisError, match="one value in each row"):
        gage_design(["A"], ["1", "2"], [1.0])
