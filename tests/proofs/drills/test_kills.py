"""SIGKILL of the scan process and of the supervisor at odd moments; `make kill-tests` does it a hundred times each."""

from __future__ import annotations

import json

import pytest
from kills import kill, wait_for
from lostmotion_command import here
from made_documents import made
from warm_supervisor import load, warm

from station.documents.result import Result
from station.records.process_birth import process_birth
from station.records.samples.scan_record import RECORD_BYTES
from station.reports.headline import headline

pytestmark = pytest.mark.wires


@pytest.fixture(scope="module", autouse=True)
def _loaded():
    """What the commands load, once for all that are forked: half of what they take is that."""
    load()


SLOW = "4 ms"
"""Period of runs that are killed late or go on: when that is counts, and not how many scans there have been."""


@pytest.mark.parametrize(("after_s", "period"), [(0.003, "1 ms"), (0.8, "1 ms"), (7.31, SLOW)])
def test_a_killed_scan_process_loses_no_written_record(after_s, period, tmp_path):
    left = kill("scan", after_s, tmp_path, period=period, start=warm)
    assert left.problems() == []
    assert left.state == "interrupted"


def test_a_run_whose_supervisor_was_killed_is_unloaded_without_it(tmp_path):
    left = kill("desk", 4.27, tmp_path, period=SLOW)
    assert left.problems() == []
    assert left.state == "stopped"
    assert any("no sign of life from the supervisor process" in note for note in left.notes)
    assert not any("operator" in text for text in (*left.notes, *left.reasons))


def test_a_run_whose_supervisor_was_killed_and_whose_folder_was_moved_says_who_stopped_it(start, one_ramp, tmp_path):
    """The scan process cannot write its report then: what it knows is in the ring."""
    run = start("run", *one_ramp, "--serial", "M", data=tmp_path / "runs")
    run.wait_for(lambda: any(p.stat().st_size > 500 * RECORD_BYTES for p in tmp_path.glob("runs/*/samples.bin")))
    (folder,) = (path.parent for path in tmp_path.glob("runs/*/run.json"))
    scan = json.loads((folder / "scan-report.json").read_bytes())["pid"]
    run.kill()
    moved = tmp_path / "moved" / folder.name
    folder.parent.rename(moved.parent)
    wait_for(lambda: not process_birth(scan), "end of the scan process")
    assert here("show", "M", "--data", str(moved.parent), "--json").json["state"] == "not concluded"
    assert here("conclude", "M", "--data", str(moved.parent)).exit_code == 0
    shown = here("show", "M", "--data", str(moved.parent), "--json").json
    assert (shown["state"], shown["stopped_by"]) == ("stopped", "desk_silent")
    assert headline(made(Result, shown)).text == "STOPPED: the supervisor process ended during the run"
    assert not any("operator" in reason or "ended in the middle" in reason for reason in shown["reasons"])


def test_a_new_supervisor_takes_over_a_run_that_goes_on(tmp_path):
    # the scan waits 2 s for a new supervisor: a command that starts cold takes half of that to load itself
    left = kill("desk", 1.9, tmp_path, resume=True, period=SLOW, start=warm)
    assert left.problems() == []
    assert left.state == "complete"
    result = json.loads((left.folder / "result.json").read_bytes())
    assert any("the supervisor process ended during the run; a new one took over" in note for note in result["notes"])
    disk = result["timing"]["disk"]
    assert disk["flushes"] > 0
    assert 0 < disk["from_record"] < left.on_disk
    assert "bringing the torque to zero" in (tmp_path / "resume.txt").read_text(encoding="utf-8")
    assert (left.folder / "report.html").exists()


def test_a_scan_that_nobody_can_start_any_more_ends(tmp_path):
    left = kill("desk", 0.0, tmp_path, since="opening", start=warm)
    assert left.problems() == []
    # Stopped where the scan could still say so, before anything was enabled.
    assert left.state in ("interrupted", "stopped")
    assert left.verdict == "NOT DECIDABLE"
    assert not any("operator" in reason for reason in left.reasons), left.reasons
    if left.state == "stopped":
        assert any("the supervisor process ended before the run started" in reason for reason in left.reasons)
