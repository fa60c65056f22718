"""The proof of timing where people read it: which periods were missed and why, in report and on the screen."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path
from typing import Any

import pytest
from made_documents import made, manifest, result, timing
from rich.console import Console
from scan_marks import scan

from station.documents.entries import plain
from station.documents.result import Result
from station.documents.timing import Timing
from station.records.run_record import RunRecord
from station.records.scan_times import GAPS_KEPT, ScanTimes
from station.reports.content import Content
from station.reports.html_page import report_html
from station.reports.pdf_pages.document import report_pdf
from station.reports.result_view import show_result
from station.reports.timing_tables import MISSED_SHOWN, TimingTables, timing_details, timing_proof, timing_tables

LATE = {"p50": 1.0, "p99": 2.0, "p999": 3.0, "max": 1019.6}


def proof(gaps: int = 1) -> dict[str, Any]:
    """timing.json of a run; scan 3 sent for long, scan 5 woke late, and further gaps of one period each follow."""
    times = ScanTimes()
    for number in range(3):
        scan(times, number)
    if gaps:
        scan(times, 3, write=2500)
        scan(times, 6, missed=2)
    for further in range(1, gaps):
        scan(times, 10 * further, lateness_us=1500 + further)
        scan(times, 10 * further + 2, missed=1)
    counted = {name: value for name, value in plain(times.counted()).items() if value is not None}
    return plain(timing(clock="real", scans=100, missed=times.missed, lateness_us=LATE, work_us=LATE, **counted))


def test_each_missed_period_has_its_scan_and_what_took_the_time() -> None:
    found = timing_tables(made(Timing, proof(gaps=2)))
    assert found.missed == (
        ("3", "0.003 s", "2", "long write", "10", "20", "20", "2500", "20"),
        ("10", "0.010 s", "1", "woken late", "1501", "20", "20", "20", "20"),
    )
    assert found.more == ""
    assert [name for name, *_ in found.percentiles] == ["wake-up latency", "work", "read", "step", "write", "record"]
    assert found.percentiles[0] == ("wake-up latency", "1.0", "2.0", "3.0", "1019.6")
    assert found.scans[0][:4] == ("longest", "3", "0.003 s", "long write")
    assert ("latest", "10", "0.010 s", "woken late") in [row[:4] for row in found.scans]
    assert dict(found.causes)["long write"] == "sending to the bus took long"


@pytest.mark.parametrize(
    ("gaps", "more"),
    [
        (MISSED_SHOWN, ""),
        (13, "3 more gaps are in timing.json"),
        (
            GAPS_KEPT + 4,
            f"{GAPS_KEPT + 4 - MISSED_SHOWN} more gaps are in timing.json, which has the first {GAPS_KEPT}",
        ),
    ],
)
def test_more_missed_periods_than_fit_are_counted(gaps: int, more: str) -> None:
    found = timing_tables(made(Timing, proof(gaps)))
    assert (len(found.missed), found.more) == (MISSED_SHOWN, more)
    assert found.missed[0][0] == "3", "the longest gaps are shown"
    times = [float(row[1].split()[0]) for row in found.missed]
    assert times == sorted(times)


def shown(found: Result) -> list[str]:
    stream = io.StringIO()
    show_result(Console(file=stream, width=110), found)
    return stream.getvalue().partition("╭")[0].splitlines()


def test_the_screen_has_two_more_lines_and_neither_is_wrapped(tmp_path: Path) -> None:
    whole = proof(gaps=4)
    block = timing(clock="real", scans=100, missed=whole["missed"], lateness_us=LATE, work_us=LATE)
    before = shown(result(timing=block, record=str(tmp_path)))
    (tmp_path / "timing.json").write_text(json.dumps(whole), encoding="utf-8")
    lines = shown(result(timing=block, record=str(tmp_path)))
    assert len(lines) == len(before) + 2
    assert "4 gaps: missed 2 after scan 3 (long write), 1 after scan 10 (woken late); more in timing.json" in lines
    parts = next(line for line in lines if line.startswith("scan time by part (p99): read "))
    assert parts.endswith("longest scan 3 (long write)")
    for gap in whole["gaps"]:
        gap["before"] |= {"scan": gap["before"]["scan"] + 1_234_000}
    whole["longest_scans"][0]["scan"] += 1_234_000
    (tmp_path / "timing.json").write_text(json.dumps(whole | {"gaps_in_all": 1234}), encoding="utf-8")
    assert len(shown(result(timing=block, record=str(tmp_path)))) == len(before) + 2, "the scans of a long run"
    assert len(shown(result(timing=proof(gaps=0), record=None))) == len(before), "no gap, no line"


def test_html_and_pdf_have_the_tables() -> None:
    found, run = result(attempt=1, timing=proof(gaps=13)), manifest(clock="real")
    content = Content("", timing=timing_tables(found.timing))
    text = re.sub(r"<[^>]+>", " ", report_html(found, run, [], {}, {}, content=content).decode())
    words = " ".join(text.split())
    assert "µs p50 p99 p99.9 max wake-up latency 1.0 2.0 3.0 1019.6" in words
    assert "after scan time missed what took the time late read step write record 3 0.003 s 2 long write" in words
    assert "3 more gaps are in timing.json" in words
    assert "longest 3 0.003 s long write" in words
    without = report_pdf(found, run, Content(""), {}, {})
    assert len(report_pdf(found, run, content, {}, {})) > len(without)


@pytest.mark.parametrize(
    "damaged",
    [
        [],
        {},
        {"clock": "virtual"},
        {"clock": "real"},
        proof() | {"gaps": [1]},
        proof() | {"parts_us": {"read": {}}, "longest_scans": 3},
        proof() | {"gaps": [{"scan": 1, "missed": 1, "before": {"cause": "sabotage"}}]},
    ],
)
def test_a_proof_that_says_nothing_or_is_damaged_is_left_out(damaged: Any, tmp_path: Path) -> None:
    (tmp_path / "timing.json").write_text(json.dumps(damaged), encoding="utf-8")
    assert timing_proof(RunRecord(tmp_path)) is None
    assert timing_proof(RunRecord(tmp_path / "gone")) is None
    for nothing in (None, timing(), timing(clock="real")):
        assert timing_tables(nothing).scans == timing_tables(nothing).missed == ()
        assert timing_details(nothing) == []
    assert timing_tables(None) == timing_tables(timing()) == TimingTables()


def test_a_record_of_an_older_version_has_what_it_knows() -> None:
    old = {key: value for key, value in proof().items() if key != "latest_scans"}
    assert {row[0] for row in timing_tables(made(Timing, old)).scans} == {"longest", ""}
