"""`lostmotion resume`: what a new supervisor shows, passes on and leaves, where the scan goes on or has ended."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
from closed_pipe import read_by_nobody
from lostmotion_command import ROOT, here
from run_copies import desert
from run_samples import as_recorded

import station.records.ring.ring
from station.bench.request import stored_job
from station.cli.measure.resume import _kill, resume_run
from station.records.process_birth import process_birth
from station.records.ring.ring import create
from station.records.run_record import SCAN_REPORT, RunRecord
from station.records.samples.samples import check_samples
from station.records.samples.scan_record import RECORD_BYTES
from station.run.screen.progress import progress_of
from station.run.way_back.recover import _alive

ON_DISK = 1000
MADE_AT_THE_END = ("report.html", "report.pdf", "loop.png")

# A scan process that goes on where the record on disk ends: with the images and orders that were recorded, 10 per ms,
# once its new supervisor has been there for 2 s. Each state lasts for two looks at the screen, however busy the
# machine is: a real one lasts longer.
SCAN = """
import os, signal, sys, time
from pathlib import Path
from definitions.image import Image, Orders
from station.records.ring.ring import W_READ, W_WRITTEN, ScanState
from station.records.ring.writer import RingWriter
from station.records.samples.scan_record import RECORD_BYTES, unpack
from station.run.screen.late_screen import SHOW_EVERY_LOOKS
ring, samples, on_disk, interrupts = Path(sys.argv[1]), Path(sys.argv[2]).read_bytes(), *map(int, sys.argv[3:])
writer = RingWriter(ring)
writer.sequence = writer._words[W_WRITTEN] = writer._words[W_READ] = on_disk
writer.set_state(ScanState.RUNNING)
print("running", flush=True)
commands = []
def wait_for_beats(beats):
    while writer.supervisor_beats < beats:
        time.sleep(0.01)
state = None
wait_for_beats(100)
for number in range(on_disk, len(samples) // RECORD_BYTES):
    scan, image, orders = unpack(samples[number * RECORD_BYTES:][:RECORD_BYTES])
    orders = Orders(*orders)
    assert writer.append(scan, 0, 0, Image(*image), orders)
    commands += filter(None, [writer.take_command()])
    if orders.state != state and interrupts <= len(commands):
        state = orders.state
        wait_for_beats(writer.supervisor_beats + 2 * SHOW_EVERY_LOOKS)
    if interrupts > len(commands) and number % 500 == 0:
        os.kill(os.getppid(), signal.SIGINT)
    if number % 10 == 0:
        time.sleep(0.001)
writer.set_state(ScanState.FINISHED)
print(commands, flush=True)
"""


@pytest.fixture
def run(golden_run, tmp_path: Path) -> RunRecord:
    return RunRecord(golden_run.copy(tmp_path / "runs"))


@pytest.fixture
def scan(run: RunRecord, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[subprocess.Popen[str]]:
    """The scan process of a run whose supervisor is dead: it has written the rest of the record when it ends."""
    yield from _scan(run, tmp_path, monkeypatch, interrupts=0)


@pytest.fixture
def scan_and_ctrl_c(run: RunRecord, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[subprocess.Popen[str]]:
    """The same, and somebody presses Ctrl-C until two commands have come."""
    yield from _scan(run, tmp_path, monkeypatch, interrupts=2)


def _scan(
    run: RunRecord, folder: Path, monkeypatch: pytest.MonkeyPatch, *, interrupts: int
) -> Iterator[subprocess.Popen[str]]:
    monkeypatch.setattr(station.records.ring.ring, "SHARED_MEMORY", folder)
    progress_of(stored_job(run), "", as_json=True)  # loaded once: what a busy machine takes for it is not tested here
    whole, ring = folder / "whole.bin", create(folder)
    whole.write_bytes(as_recorded(run))
    run.samples.write_bytes(whole.read_bytes()[: ON_DISK * RECORD_BYTES])
    desert(run, ring=ring, report=None)
    words = [sys.executable, "-c", SCAN, str(ring), str(whole), str(ON_DISK), str(interrupts)]
    process = subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "running\n"
    yield process
    process.kill()
    process.communicate()


def without_reports(run: RunRecord) -> None:
    for name in MADE_AT_THE_END:
        (run.folder / name).unlink(missing_ok=True)


def test_a_new_supervisor_shows_the_run_and_leaves_result_and_report_as_a_run_does(
    run: RunRecord, scan: subprocess.Popen[str], golden_run
) -> None:
    without_reports(run)
    ran = here("resume", str(run.folder), "--report")
    assert ran.exit_code == golden_run.ran.exit_code
    for words in (f"{run.id}\n", "measuring the torque ratio", "bringing the torque to zero", "report"):
        assert words in ran.out
    assert check_samples(run, golden_run.ran.json["timing"]["scans"]).problems == ()
    assert all((run.folder / name).stat().st_size for name in MADE_AT_THE_END)
    said = [json.loads(line)["event"] for line in (run.folder / "log.jsonl").read_text().splitlines()]
    assert said[-2:] == ["run ended", "report written"]
    assert scan.wait(10) == 0


def test_another_process_that_has_got_the_id_of_the_scan_is_neither_waited_for_nor_ended(
    run: RunRecord,
) -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as other:
        own = process_birth(other.pid)
        ring = SimpleNamespace(pid=other.pid)
        for birth, lives in ((own, True), ("1", False)):
            run.write_json(SCAN_REPORT, {"state": "running", "pid": other.pid, "birth": birth})
            assert _alive(run, ring) is lives  # type: ignore[arg-type]
        _kill(run)
        assert other.poll() is None
        run.write_json(SCAN_REPORT, {"state": "running", "pid": other.pid, "birth": own})
        _kill(run)
        assert other.wait(10) == -signal.SIGKILL
    assert not _alive(run, ring)  # type: ignore[arg-type]
    _kill(run)


def test_progress_of_a_program_goes_to_standard_error(run: RunRecord, scan: subprocess.Popen[str]) -> None:
    without_reports(run)
    ran = here("resume", str(run.folder), "--json", "--no-report")
    assert ran.json["run"] == run.id
    assert "measuring the torque ratio" in ran.err
    assert scan.wait(10) == 0
    assert not any(run.has(name) for name in MADE_AT_THE_END)


def test_ctrl_c_is_passed_on_and_said(run: RunRecord, scan_and_ctrl_c: subprocess.Popen[str]) -> None:
    ran = here("resume", str(run.folder), "--no-report")
    out, _ = scan_and_ctrl_c.communicate(timeout=10)
    assert json.loads(out)[:2] == [2, 3], "a stop, then a quick stop"
    assert "stopping: the torque is brought to zero first" in ran.out
    assert "quick stop\n" in ran.out


def test_a_run_that_has_ended_is_concluded_with_its_report_once(run: RunRecord, tmp_path: Path) -> None:
    without_reports(run)
    report = {"state": "finished", "written": run.records(), "lost": 0, "realtime": {"details": {}}}
    desert(run, ring=tmp_path / "gone", report=report)
    ran = here("resume", str(run.folder), "--report", "--json")
    assert ran.json["state"] == "complete"
    made = {name: (run.folder / name).stat().st_mtime_ns for name in (*MADE_AT_THE_END, "log.jsonl")}
    again = here("resume", str(run.folder), "--report", "--json")
    assert again.json == ran.json
    assert "concluded before" in again.err
    assert made == {name: (run.folder / name).stat().st_mtime_ns for name in made}


def test_a_result_that_nobody_reads_is_stored_and_reported_all_the_same(
    run: RunRecord, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_reports(run)
    report = {"state": "finished", "written": run.records(), "lost": 0, "realtime": {"details": {}}}
    desert(run, ring=tmp_path / "gone", report=report)
    with monkeypatch.context() as patched, read_by_nobody() as stream:
        patched.setattr("sys.stdout", stream)
        with pytest.raises(BrokenPipeError):
            resume_run(str(run.folder), run.folder.parent, as_json=True, report=True)
    assert all((run.folder / name).stat().st_size for name in MADE_AT_THE_END)


def test_nothing_is_recovered_after_virtual_time(run: RunRecord) -> None:
    ran = here("recover", "--data", str(run.folder.parent))
    assert ran.exit_code == 2
    assert "were in virtual time, so there is no bench to recover" in ran.err


def test_a_recipe_that_cannot_be_read_any_more_costs_the_screen_and_not_the_records(
    run: RunRecord, scan: subprocess.Popen[str], golden_run
) -> None:
    (run.folder / "recipe.yaml").write_text("junk {")
    ran = here("resume", str(run.folder), "--json")
    assert scan.wait(10) == 0
    assert ran.err.count("the run continues, but its progress cannot be shown: ") == 1
    assert ran.exit_code == 4
    assert ran.json["state"] == "interrupted"
    assert check_samples(run, golden_run.ran.json["timing"]["scans"]).problems == ()
