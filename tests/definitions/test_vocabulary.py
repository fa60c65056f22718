"""The tables of words are whole: ids, titles and symbols are each one row's own, and every default is allowed."""

from __future__ import annotations

import pytest

from definitions.checks import CHECKS
from definitions.faults import FAULT_BY_ID
from definitions.image import State
from definitions.metrics import BRANCHES, FIT_POINTS, FITS, GRADED, GRADES, LSQ_POINTS, METRICS, SIDED
from definitions.states import LOADED, LOCKED, OVER, RUNNING, STATES, row_of


@pytest.mark.parametrize("table", [METRICS, CHECKS])
def test_ids_and_titles_are_each_one_rows_own(table) -> None:
    rows = list(table.values())
    assert [row.id for row in rows] == list(table)
    assert len({row.title for row in rows}) == len(rows)
    assert all(row.unit for row in rows)


def test_symbols_are_each_one_metrics_own() -> None:
    assert len({row.symbol for row in METRICS.values()}) == len(METRICS)


@pytest.mark.parametrize("row", METRICS.values(), ids=list(METRICS))
def test_what_can_be_chosen_for_a_metric_exists(row) -> None:
    assert set(row.branches) <= {*BRANCHES, "width"}
    assert set(row.sides) <= {"both", *SIDED}
    assert set(row.fits) <= set(FITS)
    assert set(row.free) <= {name for name in ("band", "torque") if getattr(row, name) is not None}
    assert all(row.reach >= (at or 0.0) for at in (row.band, row.torque))
    assert row.usual.least < row.usual.most


def test_a_grade_is_read_off_a_metric_that_exists() -> None:
    assert set(GRADED.values()) <= set(METRICS)
    grade = METRICS["grade"]
    assert grade.variants == tuple(GRADED)
    assert (grade.usual.floor, grade.usual.ceiling) == (GRADES[0].grade, GRADES[-1].grade)


@pytest.mark.parametrize("row", CHECKS.values(), ids=list(CHECKS))
def test_the_limit_of_a_check_is_one_that_may_be_set(row) -> None:
    if row.settable:
        assert row.settable.least <= row.limit <= row.settable.most
    if row.below:
        other = CHECKS[row.below]
        assert row.limit < other.limit
        assert (row.kind, row.settable) == (other.kind, other.settable)


def test_every_state_has_its_row_and_its_words() -> None:
    assert [row.state for row in STATES] == list(State)
    assert all(row_of(state).state is state for state in State)
    assert all(row.words for row in STATES)
    assert {row.state for row in STATES if row.ended} == {State.IDLE, State.FAULT, *OVER}


def test_a_loaded_unit_is_locked_and_a_locked_one_belongs_to_a_run() -> None:
    assert LOADED < LOCKED < RUNNING < set(State)
    assert not RUNNING & {State.IDLE, State.FAULT, *OVER}


def test_a_definition_says_at_how_many_torques_it_is_fitted() -> None:
    assert f"{LSQ_POINTS} equally spaced torques" in METRICS["stiffness_lsq"].text
    assert f"{FIT_POINTS} equally spaced torques" in FITS["six_segment"].text
    assert f"{FIT_POINTS} equally spaced torques" in FITS["three_region"].text


def test_a_lock_that_was_found_closed_is_let_go_after_the_recovery_and_not_before() -> None:
    to_do = FAULT_BY_ID["brake_stays_closed"].next_action
    assert to_do.startswith("Leave the lock closed")
    assert to_do.index("'lostmotion recover'") < to_do.lower().index("supply off")
