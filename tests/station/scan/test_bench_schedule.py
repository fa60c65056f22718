"""Deadlines before a bench that waits: what is stretched, what would have been missed, and when nobody waits."""

from __future__ import annotations

import pytest

from station.documents.scan_report import Pace
from station.scan import schedule as of_schedule
from station.scan.schedule import BenchSchedule

MS = 1_000_000


class Clock:
    """A monotonic clock that moves when somebody sleeps, oversleeps or works."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_ns = 5_000 * MS
        self.oversleep_ns = 0
        monkeypatch.setattr(of_schedule.time, "monotonic_ns", lambda: self.now_ns)
        monkeypatch.setattr(of_schedule.time, "sleep", self.sleep)

    def sleep(self, seconds: float) -> None:
        self.now_ns += round(seconds * 1e9) + self.oversleep_ns
        self.oversleep_ns = 0


class WaitingBench:
    """A bench that takes as long as the test says, and orders periods to be missed."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.takes_ns = 0
        self.missed = 0
        self.in_step = True
        self.waits = 0

    def wait(self) -> int:
        self.waits += 1
        self.clock.now_ns += self.takes_ns
        missed, self.takes_ns, self.missed = self.missed, 0, 0
        return missed


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return Clock(monkeypatch)


@pytest.fixture
def bench(clock: Clock) -> WaitingBench:
    return WaitingBench(clock)


def test_in_time_deadlines_stay_on_their_grid(clock, bench):
    schedule = BenchSchedule(MS, bench)
    schedule.start()
    for number in range(1, 11):
        clock.oversleep_ns = 70_000
        woken = schedule.wait()
        assert woken == schedule.started_ns + number * MS + 70_000
        assert (schedule.missed, schedule.lateness_ns) == (0, 70_000)
    assert schedule.pace() == Pace()


def test_a_late_scan_stretches_its_period_and_moves_the_grid(clock, bench):
    schedule = BenchSchedule(MS, bench)
    schedule.start()
    schedule.wait()
    clock.oversleep_ns = 5 * MS + 300_000
    late = schedule.wait()
    assert (schedule.missed, schedule.stretched, schedule.would_have_missed) == (0, 1, 5)
    assert schedule.longest_ns == schedule.stretched_ns == 5 * MS + 300_000
    assert schedule.wait() == late + MS, "no burst follows"
    assert (schedule.lateness_ns, schedule.stretched) == (0, 1)


def test_a_late_bench_stretches_too_but_is_no_miss_of_this_computer(bench):
    schedule = BenchSchedule(MS, bench)
    schedule.start()
    bench.takes_ns = 30 * MS
    schedule.wait()
    assert (schedule.missed, schedule.stretched, schedule.would_have_missed) == (0, 1, 0)
    assert schedule.longest_ns == 30 * MS


def test_less_than_a_period_late_is_not_stretched(clock, bench):
    schedule = BenchSchedule(MS, bench)
    schedule.start()
    clock.oversleep_ns = MS - 1
    schedule.wait()
    assert schedule.stretched == 0
    assert schedule.wait() == schedule.started_ns + 2 * MS


def test_periods_that_a_fault_orders_are_missed(bench):
    schedule = BenchSchedule(MS, bench)
    schedule.start()
    bench.missed = 45
    schedule.wait()
    assert schedule.missed == 45
    schedule.wait()
    assert schedule.missed == 0


def test_fast_waits_for_the_bench_alone_and_for_deadlines_where_that_does_not_answer(clock, bench):
    schedule = BenchSchedule(MS, bench, fast=True)
    schedule.start()
    begin_ns = clock.now_ns
    for _ in range(100):
        schedule.wait()
    assert (clock.now_ns, bench.waits) == (begin_ns, 100)
    bench.in_step = False
    for _ in range(100):
        schedule.wait()
    assert clock.now_ns == begin_ns + 100 * MS
