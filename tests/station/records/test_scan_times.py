"""The counters of the timing proof against numpy, and what they say of gaps."""

from __future__ import annotations

import time
from unittest import mock

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scan_marks import scan

from station.records.scan_times import LONGEST_KEPT, Counts, ScanTimes


@given(times=st.lists(st.integers(min_value=0, max_value=10**10), min_size=1, max_size=200))
def test_percentiles_lie_within_their_bin_and_nothing_is_lost(times: list[int]) -> None:
    counts = Counts()
    for ns in times:
        counts.add(ns)
    assert counts.total == len(times)
    assert counts.largest_ns == max(times)
    for percent in (50.0, 99.0, 99.9):
        true_us = float(np.percentile(times, percent, method="inverted_cdf")) / 1000.0
        found_us = counts.percentile_us(percent)
        assert true_us <= found_us * (1 + 1e-12)
        assert found_us <= max(true_us + 1.024, 2.0 * true_us)


def test_a_gap_names_its_scans_and_what_the_scan_before_it_spent() -> None:
    times = ScanTimes()
    scan(times, 0)
    scan(times, 1, write=2500)
    scan(times, 4, missed=2)
    scan(times, 5, lateness_us=1500)
    scan(times, 7, missed=1)
    assert (times.missed, times.gaps) == (3, 2)
    first, second = times.gap_list()
    assert (first.scan, first.missed, first.before.scan, first.before.cause) == (4, 2, 1, "write")
    assert (second.scan, second.before.scan, second.before.cause) == (7, 5, "waking")


def test_the_longest_scans_are_kept_and_no_others() -> None:
    times = ScanTimes()
    for number in range(200):
        scan(times, number, read=20 + (number * 37) % 200)
    kept = times.longest()
    assert [one.read_ns for one in kept] == [1000 * us for us in range(219, 219 - LONGEST_KEPT, -1)]
    assert {one.longest_part for one in kept} == {"read"}


def test_the_latest_scans_are_kept_though_their_work_was_short() -> None:
    times = ScanTimes()
    for number in range(200):
        late = number == 100
        scan(times, number, lateness_us=1019 if late else (number * 37) % 200, read=5 if late else 90)
    kept = times.latest()
    assert (kept[0].scan, kept[0].cause, kept[0].lateness_ns) == (100, "waking", 1_019_000)
    assert [one.lateness_ns for one in kept[1:]] == [1000 * us for us in range(199, 199 - LONGEST_KEPT + 1, -1)]
    assert max(one.lateness_ns for one in times.longest()) < 1_000_000
    latest = times.counted().latest_scans[0]
    assert (latest.scan, latest.lateness_us) == (100, times.counts["lateness"].percentiles().max)


def test_few_scans_are_looked_at_closely() -> None:
    """Keeping a scan by name is for the few: when all others are as usual it costs nothing."""
    times = ScanTimes()
    looked = mock.Mock(wraps=times._keep)
    late = mock.Mock(wraps=times._keep_late)
    times._keep, times._keep_late = looked, late  # type: ignore[method-assign]
    for number in range(5000):
        scan(times, number)
    assert (looked.call_count, late.call_count) == (LONGEST_KEPT, LONGEST_KEPT)


def test_counting_costs_less_than_the_budget_of_the_scan() -> None:
    times = ScanTimes()
    marks = (0, 90_000, 100_000, 170_000, 175_000)
    best = float("inf")
    for _ in range(5):
        start = time.perf_counter()
        for number in range(2000):
            times.add(number, 0, 12_000, marks)
        best = min(best, (time.perf_counter() - start) / 2000)
    assert best < 4e-6, f"{best * 1e6:.2f} us per scan"
