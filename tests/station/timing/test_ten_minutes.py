"""What `make ten-minutes` makes of cyclictest's output and of a report that is not as it should be."""

from __future__ import annotations

import pytest
from made_reports import report

from benchmarks.ten_minutes import failures, overruns
from benchmarks.wakeups import Histogram

SAID = """# /dev/cpu_dma_latency set to 0us
# Histogram
000000 000000
000003 000900
000010 000090
000999 000007
001000 000001
001500 000001
# Total: 000000999
# Min Latencies: 00003
# Avg Latencies: 00012
# Max Latencies: 23456
# Histogram Overflows: 00001
"""


def test_cyclictest_is_read_with_what_was_beyond_its_histogram() -> None:
    seen = Histogram.parse(SAID)
    assert seen is not None
    assert (seen.total, seen.largest_us, seen.beyond) == (1000, 23456.0, 1)
    assert overruns(seen, 1000) == 3
    late = seen.lateness("cyclictest")
    assert (late.p50, late.p99, late.largest) == (3.0, 10.0, 23456.0)
    assert Histogram.parse("cannot set scheduler\n") is None


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({}, ""),
        ({"missed": 600}, ""),
        ({"missed": 601}, "601 of 600000"),
        ({"records": {"checked": 599_399, "problem": ""}}, "were lost in the record buffer"),
        ({"records": {"checked": 599_400, "problem": "record 7 fails its CRC"}}, "CRC"),
        ({"resident_kb": {"before": 70_000, "after": 74_097}}, "grew by 4097 KiB"),
    ],
)
def test_a_long_run_fails_for_missed_periods_lost_records_and_growth(change: dict, said: str) -> None:
    good = {"periods": 600_000, "scans": 599_400, "records": {"checked": 599_400, "problem": ""}}
    found = failures(report(**good | change))
    assert said in " ".join(found)
    assert len(found) == (1 if said else 0)
