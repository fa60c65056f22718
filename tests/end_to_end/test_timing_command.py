"""`lostmotion timing` over wires: the whole scan without a unit under test."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import pytest
from kills import LASTS_S
from patient import patient_bench, short_recipe

from station.cli.bench.timing import explain, lines
from station.documents.reading import of_plain
from station.documents.scan_report import Realtime
from station.timing.report import TimingReport

pytestmark = [pytest.mark.wires, pytest.mark.wall_clock]
SECONDS = 1.5
PERIODS = 1500
LARGEST_KB = 150 * 1024
SLACK_KB = 4 * 1024
"""Far above what a scan process gains (some 100 KiB, once), far below one that keeps a record of every scan."""


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
    asked = {"fifo", "mlock", "timer_slack", "affinity", "gc_off", "prefault", "spin_tail"}
    assert set(found["realtime"]["details"]) == asked
    assert found["records"] == {"checked": found["scans"], "problem": ""}
    assert set(found["realtime"]["details"]) <= {one.name for one in fields(Realtime)}, "the record keeps every answer"
    memory = found["resident_kb"]
    assert 0 < memory["before"] <= memory["after"] + SLACK_KB < LARGEST_KB
    assert memory["after"] - memory["before"] < SLACK_KB
    assert sum(gap["missed"] for gap in found["gaps"]) == found["missed"] or found["gaps_in_all"] > len(found["gaps"])
    assert found["counters"], "the bench was not talked to"
    assert found["latest_scans"][0]["lateness_us"] == found["lateness_us"]["max"], "the worst scan has a name"
    report = of_plain(TimingReport, found, Path("lostmotion timing --json"))
    assert found["explanation"] == explain(report)
    text = "\n".join(lines(report))
    for word in (
        "wake-up latency",
        "read",
        "step",
        "write",
        "record",
        "what stands in the way",
        "granted",
        "MiB at its end",
        "2439 Hz",
    ):
        assert word in text


def test_two_kilohertz_by_the_recipe(lostmotion, tmp_path):
    path = str(short_recipe(tmp_path, {"sampling": {"period": "500 us"}}))
    bench = str(patient_bench(tmp_path))
    ran = lostmotion("timing", "--recipe", path, "--bench", bench, "--seconds", "1", "--json")
    assert (ran.json["period_ns"], ran.json["records"]["problem"]) == (500_000, "")
    assert ran.json["periods"] >= 2000
    ran = lostmotion("run", path, "--bench", bench, "--virtual-time", "--json", "--serial", "FAST")
    assert (ran.json["state"], ran.json["verdict"]) == ("complete", "PASS")
    assert ran.json["timing"]["period_ns"] == 500_000
    assert ran.json["timing"]["scans"] * 500e-6 == pytest.approx(LASTS_S["run"], abs=1.0)


def test_an_unknown_bench_is_bad_input(lostmotion):
    assert lostmotion("timing", "--bench", "no-such-bench").exit_code == 2
