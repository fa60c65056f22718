from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from station.scan.schedule import RealTimeSchedule, next_due

MS = 1_000_000


def test_on_time_the_next_deadline_is_one_period_later() -> None:
    assert next_due(now_ns=10 * MS + 200_000, deadline_ns=10 * MS, period_ns=MS) == (11 * MS, 0)


def test_late_by_less_than_a_period_runs_at_once_and_keeps_the_grid() -> None:
    assert next_due(now_ns=11 * MS + 999_999, deadline_ns=10 * MS, period_ns=MS) == (11 * MS, 0)


def test_whole_periods_are_skipped_and_counted() -> None:
    assert next_due(now_ns=15 * MS + 300_000, deadline_ns=10 * MS, period_ns=MS) == (15 * MS, 4)


@given(
    late=st.integers(min_value=-5 * MS, max_value=10**12),
    deadline=st.integers(min_value=0, max_value=10**15),
    period=st.integers(min_value=100_000, max_value=100 * MS),
)
def test_deadlines_stay_on_the_grid_and_less_than_a_period_behind(late: int, deadline: int, period: int) -> None:
    now = deadline + late
    due = next_due(now, deadline, period)
    assert due.deadline_ns == deadline + (1 + due.missed) * period
    assert due.missed >= 0
    assert now - due.deadline_ns < period
    if due.missed:
        assert now >= due.deadline_ns


def test_the_real_clock_counts_a_hold_up() -> None:
    schedule = RealTimeSchedule(period_ns=200_000)
    schedule.start()
    first = schedule.wait()
    assert first >= schedule.deadline_ns
    assert schedule.lateness_ns == first - schedule.deadline_ns
    before = schedule.deadline_ns
    schedule.deadline_ns -= 50 * 200_000  # as if the last scan had taken 50 periods
    schedule.wait()
    assert schedule.missed >= 48
    assert (schedule.deadline_ns - before) % 200_000 == 0
