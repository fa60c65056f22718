"""`lostmotion timing` over wires: the whole scan without a unit under test."""

from __future__ import annotations

import pytest

from station.command_timing import explain, lines

pytestmark = pytest.mark.wires
SECONDS = 1.5
PERIODS = 1500


def test_every_period_is_counted_or_missed_and_the_figures_are_explained(lostmotion):
    ran = lostmotion("timing", "--seconds", str(SECONDS), "--json")
    found = ran.json
    assert found["periods"] >= PERIODS
    assert found["scans"] + found["missed"] == found["periods"]
    assert ran.exit_code == (1 if found["missed"] > 0.001 * found["periods"] else 0)
    for series in ("lateness", "work"):
        assert sum(count for _, count in found["histograms_us"][series]) == found["scans"]
        row = found[f"{series}_us"]
        assert 0 < row["p50"] <= row["p99"] <= row["p999"] <= row["max"]
    parts = sum(found["parts_us"][part]["p50"] for part in ("read", "step", "write"))
    assert parts == pytest.approx(found["work_us"]["p50"], rel=0.3)
    assert set(found["realtime"]["details"]) >= {"fifo", "mlock", "timer_slack", "affinity"}
    assert sum(gap["missed"] for gap in found["gaps"]) == found["missed"] or found["gaps_in_all"] > len(found["gaps"])
    assert found["counters"], "the bench was not talked to"
    assert found["explanation"] == explain(found)
    text = "\n".join(lines(found))
    for word in ("lateness", "read", "step", "write", "record", "what stands in the way", "granted"):
        assert word in text


def test_an_unknown_bench_is_bad_input(lostmotion):
    assert lostmotion("timing", "--bench", "no-such-bench").exit_code == 2
