"""One short run in virtual time, then everything that may go wrong with its record."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import Ran, here
from patient import patient_bench, short_recipe
from printed_numbers import alike
from run_copies import begun_anew, copy_of
from run_samples import as_recorded, flip, read_back

import station.reports.illustrate
import station.run.conclusion
from recipes import load_recipe
from station.bench.request import load_job
from station.cli.measure.run import recipe_notes
from station.documents.entries import plain
from station.records.data_folder import Store
from station.records.run_record import RunRecord
from station.records.samples.scan_record import RECORD_BYTES
from station.run.conclusion import conclude
from station.run.outcome import RunOutcome

NAME = "rv-40e-121-quick"
REVISION = load_recipe(NAME).recipe.revision

RESULT_KEYS = {"run", "serial", "recipe", "state", "verdict", "reasons", "metrics", "timing", "alarms", "record"}
METRIC_KEYS = {
    "id",
    "definition",
    "value",
    "unit",
    "uncertainty",
    "coverage_factor",
    "branch",
    "side",
    "estimator",
    "cycles",
    "limits",
    "verdict",
}
TIMING_KEYS = {"period_ns", "scans", "missed", "lateness_us", "work_us", "oldest_sample_scans", "realtime"}


@pytest.fixture
def recipe(quarter: Callable[[str], str]) -> Path:
    """The recipe of `quick_run`."""
    return Path(quarter(NAME))


@pytest.fixture(scope="module")
def finished(quick_run: Any) -> tuple[dict[str, Any], Ran]:
    return quick_run.ran.json, quick_run.ran


@pytest.fixture
def copied(quick_run: Any, tmp_path: Path) -> RunRecord:
    return copy_of(quick_run.record, tmp_path)


@pytest.fixture
def in_its_folder(quick_run: Any, tmp_path: Path) -> RunRecord:
    """The same with the chain beside it: without it, nothing in a data folder is believed of the run."""
    return RunRecord(quick_run.copy(tmp_path / "runs"))


def again(record: RunRecord, **changes: Any) -> dict[str, Any]:
    written = changes.pop("written", record.records())
    as_recorded(record)
    begun_anew(record)
    job = load_job(str(record.folder / "recipe.yaml"), str(record.folder / "bench.yaml"))
    result: dict[str, Any] = plain(conclude(record, job, RunOutcome(written=written, **changes)).result)
    return result


def test_the_json_object_keeps_the_contract(finished: tuple[dict[str, Any], Any]) -> None:
    result, done = finished
    assert done.exit_code == 0
    assert done.out.count("\n") == 1
    assert set(result) >= RESULT_KEYS
    assert result["state"] == "complete"
    assert result["verdict"] == "PASS"
    assert result["serial"] == "SN 1"
    assert all(set(metric) >= METRIC_KEYS for metric in result["metrics"])
    assert set(result["timing"]) >= TIMING_KEYS
    assert set(result["timing"]["lateness_us"]) >= {"p50", "p99", "p999", "max"}
    assert {"p50", "p99", "max"} <= set(result["timing"]["work_us"])


def test_the_record_stands_alone(finished: tuple[dict[str, Any], Any], recipe: Path) -> None:
    folder = Path(finished[0]["record"])
    names = {path.name for path in folder.iterdir()}
    assert names >= {
        "run.json",
        "recipe.yaml",
        "bench.yaml",
        "profiles",
        "program.json",
        "samples.parquet",
        "samples.json",
        "events.jsonl",
        "timing.json",
        "calibration.json",
        "result.json",
        "loop.png",
        "report.html",
        "log.jsonl",
    }
    assert (folder / "recipe.yaml").read_bytes() == recipe.read_bytes()
    assert json.loads((folder / "result.json").read_text()) == finished[0]
    assert read_back(folder, json.loads((folder / "run.json").read_text())["records"]).sound
    page = (folder / "report.html").read_text()
    assert "PASS" in page
    assert "data:image/png;base64," in page
    assert "http://" not in page
    assert "https://" not in page
    for line in (folder / "log.jsonl").read_text().splitlines():
        assert {"event", "level", "timestamp"} <= set(json.loads(line))


def test_the_same_record_gives_the_same_verdict(copied: RunRecord, finished: tuple[dict[str, Any], Any]) -> None:
    result = again(copied)
    assert result["verdict"] == "PASS"
    assert alike(result["metrics"], finished[0]["metrics"])


def test_a_clock_that_was_set_is_told_and_decides_nothing(copied: RunRecord) -> None:
    result = again(copied, clock_jumped_s=-3600.0)
    assert (result["verdict"], result["reasons"]) == ("PASS", [])
    assert result["timing"]["wall_clock_jumped_s"] == -3600.0
    assert any("was set by -3600.0 s" in note for note in result["notes"])


def test_one_flipped_bit_and_there_is_no_verdict(copied: RunRecord) -> None:
    as_recorded(copied)
    flip(copied, 1000 * RECORD_BYTES + 100)
    result = again(copied)
    assert result["verdict"] == "NOT DECIDABLE"
    assert "fail their CRC" in " ".join(result["reasons"])


def test_a_record_cut_short_is_not_a_complete_run(copied: RunRecord) -> None:
    content = as_recorded(copied)
    copied.samples.write_bytes(content[: 5_000 * RECORD_BYTES])
    result = again(copied, written=len(content) // RECORD_BYTES)
    assert result["state"] == "interrupted"
    assert result["verdict"] == "NOT DECIDABLE"


def test_lost_records_are_never_a_pass(copied: RunRecord) -> None:
    result = again(copied, lost=3)
    assert result["verdict"] == "NOT DECIDABLE"
    assert "3 records were lost" in " ".join(result["reasons"])


def test_a_scan_process_lost_after_its_last_record_is_never_a_pass(copied: RunRecord) -> None:
    result = again(copied, trouble="the scan process was lost (killed by SIGKILL)")
    assert result["state"] == "complete"
    assert result["verdict"] == "NOT DECIDABLE"
    assert sum("the scan process was lost" in reason for reason in result["reasons"]) == 1


@pytest.mark.parametrize("cut", [False, True])
def test_a_scan_that_was_lost_by_the_scan_clock_has_its_loss_for_a_reason_and_no_other(
    copied: RunRecord, *, cut: bool
) -> None:
    copied.update(clock="scan")
    content = as_recorded(copied)
    kept = 5_000 if cut else len(content) // RECORD_BYTES
    copied.samples.write_bytes(content[: kept * RECORD_BYTES])
    trouble = "the scan process was lost (killed by SIGKILL)"
    result = again(copied, written=kept, trouble=trouble)
    assert (result["state"], result["verdict"]) == ("interrupted" if cut else "complete", "NOT DECIDABLE")
    assert all(trouble in reason for reason in result["reasons"])
    assert any("scan clock" in reason for reason in again(copied, written=kept)["reasons"])


def test_too_many_missed_periods_invalidate_the_measurement(
    copied: RunRecord,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    honest = station.run.conclusion.timing_block
    monkeypatch.setattr(station.run.conclusion, "timing_block", lambda *args: replace(honest(*args), missed=1000))
    result = again(copied)
    assert result["verdict"] == "NOT DECIDABLE"
    assert "scan periods were missed" in " ".join(result["reasons"])


def test_a_disk_that_is_full_for_the_report_does_not_hide_the_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_room(*_: Any, **__: Any) -> bytes:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(station.reports.illustrate, "png", no_room)
    words = ("--virtual-time", "--json", "--serial", "F", "--report", "--data", str(tmp_path))
    done = here("run", str(short_recipe(tmp_path)), "--bench", str(patient_bench(tmp_path)), *words)
    assert done.exit_code == 0
    assert done.json["verdict"] == "PASS"
    assert "warning" in done.err
    assert "No space left on device" in done.err
    assert "Traceback" not in done.err


def test_show_reads_the_record_back(in_its_folder: RunRecord) -> None:
    data = str(in_its_folder.folder.parent)
    assert here("show", "last", "--data", data, "--json").json["verdict"] == "PASS"
    flip(in_its_folder, -30)
    shown = here("show", "last", "--data", data, "--json").json
    assert shown["verdict"] == "NOT DECIDABLE"
    assert any("the record is damaged" in reason for reason in shown["reasons"])


def test_analyze_finds_in_the_record_what_the_run_found(
    copied: RunRecord, finished: tuple[dict[str, Any], Any]
) -> None:
    done = here("analyze", str(copied.folder), "--json")
    found = json.loads(done.out)
    assert done.exit_code == 0
    assert alike(found["metrics"], finished[0]["metrics"])


def test_a_recipe_changed_without_a_new_revision_is_noted(copied: RunRecord, recipe: Path, tmp_path: Path) -> None:
    store = Store(copied.folder.parent)
    assert recipe_notes(store.data, load_job(str(recipe), None)) == []
    changed = tmp_path / "changed.yaml"
    changed.write_bytes(recipe.read_bytes() + b"# changed\n")
    (note,) = recipe_notes(store.data, load_job(str(changed), None))
    assert copied.id in note
    assert f"revision {REVISION}" in note
    raised = tmp_path / "raised.yaml"
    raised.write_text(recipe.read_text().replace(f"revision: {REVISION}", f"revision: {REVISION + 1}"))
    assert recipe_notes(store.data, load_job(str(raised), None)) == []
    copied.update(notes=[note])
    assert again(copied)["notes"][0] == note


def test_the_warning_is_there_before_the_run_starts(copied: RunRecord, recipe: Path, tmp_path: Path) -> None:
    changed = tmp_path / "changed.yaml"
    changed.write_bytes(recipe.read_bytes() + b"# changed\n")
    data = str(copied.folder.parent)
    words = ("--virtual-time", "--json", "--no-report", "--serial", "SN 1", "--data", data)
    done = here("run", str(changed), *words)
    assert done.err.startswith(f"WARNING  recipe rv-40e-121-quick revision {REVISION}")
    assert copied.id in json.loads(done.out)["notes"][0]


def test_list_has_a_row_for_every_run_even_a_damaged_one(in_its_folder: RunRecord) -> None:
    other = in_its_folder.folder.parent / "20990101T000000.000Z-X"
    other.mkdir()
    (other / "run.json").write_text("{")
    rows = here("list", "--data", str(in_its_folder.folder.parent), "--json").json
    assert [row["state"] for row in rows] == ["complete", "damaged"]


def test_events_tell_the_story_in_order(copied: RunRecord) -> None:
    events = [json.loads(line) for line in (copied.folder / "events.jsonl").read_text().splitlines()]
    assert [event["to"] for event in events if event["kind"] == "transition"][:3] == ["home", "lock", "calibrate"]
    assert [event["to"] for event in events if event["kind"] == "transition"][-3:] == ["unload", "release", "complete"]
    assert all(first["scan"] <= second["scan"] for first, second in itertools.pairwise(events))
