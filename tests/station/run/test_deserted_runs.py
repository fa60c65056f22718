"""Runs whose supervisor process ended: what the next look at them concludes, and what it cannot know."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lostmotion_command import here
from run_copies import begun_here, copy_of, desert
from run_samples import records_of

import station.records.ring.ring
import station.run.conclusion
import station.run.way_back.recover
from definitions.image import State
from station.errors import RecordError
from station.records.ring.reader import RingReader
from station.records.ring.ring import W_LOST, W_PID, W_READ, W_STATE, W_WRITTEN, ScanState, create
from station.records.ring.writer import RingWriter
from station.records.run_record import RunRecord
from station.records.samples.scan_record import RECORD_BYTES, pack, unpack
from station.records.seal import alterations
from station.reports.stored_result import stored_result
from station.run.outcome import RunOutcome
from station.run.way_back.recover import recover


@pytest.fixture
def copied(quick_run: Any, tmp_path: Path) -> RunRecord:
    return copy_of(quick_run.record, tmp_path)


def test_a_result_that_reads_back_differently_decides_nothing_and_is_not_sealed(
    copied: RunRecord, tmp_path: Path
) -> None:
    report = {"state": "finished", "written": copied.records(), "lost": 0, "realtime": {"details": {}}}
    desert(copied, ring=tmp_path / "gone", report=report)
    honest = station.run.conclusion.read_from_disk

    def forgetful(path: Path, **most: None) -> bytes:
        content = honest(path, **most)
        return content.replace(b'"PASS"', b'"FAIL"', 1) if path.name == "result.json" else content

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(station.run.conclusion, "read_from_disk", forgetful)
        with pytest.raises(RecordError, match="reads back differently"):
            recover(copied)
    manifest = copied.manifest()
    assert (manifest.state, manifest.verdict) == ("recording", None)
    shown = stored_result(copied)
    assert (shown.state, shown.verdict, shown.metrics) == ("not concluded", "NOT DECIDABLE", ())
    recover(copied)
    assert stored_result(copied).verdict == copied.manifest().verdict == "PASS"
    assert alterations(copied) == ()


def test_an_ending_that_the_version_before_kept_is_read_as_it_was_meant(copied: RunRecord) -> None:
    said = copied.read_json("desk-report.json") | {"disk": {}, "realtime": {"details": {}}}
    copied.write_json("desk-report.json", said)
    kept = RunOutcome.kept_in(copied)
    assert kept is not None
    assert (kept.written, kept.disk) == (copied.records(), None)
    copied.write_json("desk-report.json", said | {"disk": {"refused": 1}, "lost": "many"})
    assert RunOutcome.kept_in(copied) is None
    copied.write_json("desk-report.json", said | {"disk": {"refused": 1}})
    assert RunOutcome.kept_in(copied).disk.refused == 1


def test_a_supervisor_that_died_when_all_was_on_disk_costs_nothing(copied: RunRecord, tmp_path: Path) -> None:
    report = {"state": "finished", "written": copied.records(), "lost": 0, "realtime": {"details": {}}}
    desert(copied, ring=tmp_path / "gone", report=report)
    recover(copied)
    assert copied.read_json("result.json")["verdict"] == "PASS"


@pytest.mark.parametrize(
    ("missing", "report", "reason"),
    [
        (200, {"state": "finished", "lost": 0}, "the record is not sound"),
        (0, {"state": "finished", "lost": 2}, "2 records were lost"),
        (200, None, "supervisor and scan process ended"),
        (200, {"state": "running", "pid": 1}, "supervisor and scan process ended"),
    ],
)
def test_a_file_does_not_vouch_for_its_own_end_when_the_ring_is_gone(
    copied: RunRecord, tmp_path: Path, missing: int, report: dict[str, Any] | None, reason: str
) -> None:
    written = copied.records()
    if report is not None and "lost" in report:
        report = report | {"written": written + report["lost"]}
    desert(copied, ring=tmp_path / "gone", report=report)
    copied.samples.write_bytes(copied.samples.read_bytes()[: (written - missing) * RECORD_BYTES])
    recover(copied)
    result = copied.read_json("result.json")
    assert result["verdict"] == copied.manifest().verdict == "NOT DECIDABLE"
    assert reason in " ".join(result["reasons"])


@pytest.mark.parametrize(("end", "state"), [(State.FAULT, "fault"), (State.STOPPED, "stopped")])
@pytest.mark.parametrize("whole", [True, False])
def test_an_end_that_was_torn_off_is_how_the_bench_was_last_heard_of(
    copied: RunRecord, tmp_path: Path, end: State, state: str, *, whole: bool
) -> None:
    at = int(np.flatnonzero(records_of(copied.folder)["orders"]["state"] == State.RAMP_POS)[500])
    said = {"state": "finished", "written": at + 1, "lost": 0, "realtime": {"details": {}}}
    desert(copied, ring=tmp_path / "gone", report=said if whole else {"state": "running", "pid": 1})
    content = copied.samples.read_bytes()[: (at + 1) * RECORD_BYTES]
    scan, image, orders = unpack(content[-RECORD_BYTES:])
    last = pack((at, scan, 0, 0), image, orders._replace(state=int(end)))
    copied.samples.write_bytes(content[:-RECORD_BYTES] + last)
    recover(copied)
    assert copied.manifest().state == state
    left = stored_result(copied).left
    assert left is not None
    assert (left.drive_known, left.lock_known, left.torque_known) == (whole, whole, whole)


def test_a_report_without_a_count_cannot_make_a_run_complete(copied: RunRecord, tmp_path: Path) -> None:
    desert(copied, ring=tmp_path / "gone", report={"state": "finished"})
    recover(copied)
    result = copied.read_json("result.json")
    assert result["verdict"] == "NOT DECIDABLE"
    assert "the number of records that the scan process wrote is not known" in " ".join(result["reasons"])


def test_a_record_that_the_scan_appends_while_a_new_supervisor_looks_is_not_skipped(
    copied: RunRecord, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(station.records.ring.ring, "SHARED_MEMORY", tmp_path)
    path, count = create(tmp_path, 8), copied.records()
    writer = RingWriter(path)
    writer._words[W_WRITTEN] = writer._words[W_READ] = count

    def appended_then(reader: RingReader) -> int:
        reader._words[W_WRITTEN] += 1
        return int(reader._words[W_WRITTEN]) - 1

    class Asked(Exception):  # noqa: N818 - what the test wants to know
        pass

    def asked(*_: Any, skip: int) -> None:
        raise Asked(skip)

    desert(copied, ring=path, report=None)
    monkeypatch.setattr(RingReader, "written", property(appended_then))
    monkeypatch.setattr(station.run.way_back.recover, "RecordWriter", asked)
    with pytest.raises(Asked) as caught:
        station.run.way_back.recover.resume(copied, lambda _ring: None)
    assert caught.value.args == (0,)
    writer.close()


def test_a_recovery_that_is_killed_before_the_seal_leaves_the_ring_to_the_next(
    copied: RunRecord, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(station.records.ring.ring, "SHARED_MEMORY", tmp_path)
    path, count = create(tmp_path, 8), copied.records()
    writer = RingWriter(path)
    words = {W_PID: 0, W_WRITTEN: count, W_READ: count, W_LOST: 3, W_STATE: int(ScanState.FINISHED)}
    for word, value in words.items():
        writer._words[word] = value
    writer.close()
    desert(copied, ring=path, report=None)

    def killed(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(station.run.conclusion, "seal", killed)
        with pytest.raises(KeyboardInterrupt):
            recover(copied)
    assert path.exists()
    recover(copied)
    result = copied.read_json("result.json")
    assert result["verdict"] == "NOT DECIDABLE"
    assert "3 records were lost" in " ".join(result["reasons"])
    assert not path.exists()
    assert copied.manifest().ring is None


@pytest.mark.parametrize("manifest_too", [False, True])
@pytest.mark.parametrize("part", ["recipe", "bench"])
def test_by_a_file_that_was_altered_before_the_conclusion_nothing_is_judged_or_told(
    quick_run: Any, tmp_path: Path, part: str, *, manifest_too: bool
) -> None:
    record = RunRecord(quick_run.copy(tmp_path / "runs"))
    report = {"state": "finished", "written": record.records(), "lost": 0, "realtime": {"details": {}}}
    desert(record, ring=tmp_path / "gone", report=report)
    file = record.folder / f"{part}.yaml"
    file.write_bytes(file.read_bytes() + b"# another limit\n")
    if manifest_too:  # then only the line that begins the run knows better
        said = record.read_json("run.json")
        said[part]["sha256"] = hashlib.sha256(file.read_bytes()).hexdigest()
        record.write_json("run.json", said)
    ran = here("conclude", record.id, "--data", str(record.folder.parent), "--json")
    (row,) = ran.json["runs"]
    assert (ran.exit_code, row["outcome"], row["verdict"]) == (3, "concluded", None)
    assert here("show", record.id, "--data", str(record.folder.parent)).exit_code == 3, "one exit code for one thing"
    assert row["error"]
    assert "PASS" not in here("conclude", record.id, "--data", str(record.folder.parent)).out
    result = record.read_json("result.json")
    assert (result["state"], result["verdict"], result["metrics"]) == ("complete", "NOT DECIDABLE", [])
    assert record.manifest().verdict == "NOT DECIDABLE"
    assert "the record was altered" in result["reasons"][0]


@pytest.mark.parametrize("part", ["program.json", "profiles"])
def test_by_a_program_or_profile_that_was_altered_since_the_run_began_nothing_is_judged(
    quick_run: Any, tmp_path: Path, part: str
) -> None:
    record = RunRecord(quick_run.copy(tmp_path / "runs"))
    desert(record, ring=tmp_path / "gone", report={"state": "finished", "written": record.records(), "lost": 0})
    file = next((record.folder / part).iterdir()) if part == "profiles" else record.folder / part
    kept = file.read_bytes()
    file.write_bytes(kept.replace(b'"cycle": 1', b'"cycle": 2') if part == "program.json" else kept + b"# another\n")
    assert file.read_bytes() != kept
    recover(record)
    result = record.read_json("result.json")
    assert (result["state"], result["verdict"], result["metrics"]) == ("complete", "NOT DECIDABLE", [])
    assert f"the record was altered: {part}" in result["reasons"][0]
    assert alterations(record)


@pytest.mark.parametrize("lost", ["profiles", "profiles/virtual-drive.yaml", "program.json"])
def test_a_run_that_lacks_what_it_was_begun_with_waits_until_it_is_back(
    quick_run: Any, tmp_path: Path, lost: str
) -> None:
    record = RunRecord(quick_run.copy(tmp_path / "runs"))
    desert(record, ring=tmp_path / "gone", report={"state": "finished", "written": record.records(), "lost": 0})
    (record.folder / lost).rename(tmp_path / "moved")
    with pytest.raises(RecordError, match="virtual-drive.yaml" if lost == "profiles" else lost):
        recover(record)
    assert (record.state(), record.manifest().files) == ("not concluded", None)
    (tmp_path / "moved").rename(record.folder / lost)
    (record.folder / "profiles" / ".DS_Store").touch()
    (record.folder / "profiles" / "before").mkdir()
    recover(record)
    assert record.manifest().verdict == "PASS"
    assert [one for one in alterations(record) if not one.startswith("chain.jsonl: ")] == []


def test_a_profile_that_the_line_of_the_run_does_not_name_is_not_its_own(copied: RunRecord, tmp_path: Path) -> None:
    begun_here(
        copied, files={"program.json": hashlib.sha256((copied.folder / "program.json").read_bytes()).hexdigest()}
    )
    desert(copied, ring=tmp_path / "gone", report={"state": "finished", "written": copied.records(), "lost": 0})
    recover(copied)
    result = copied.read_json("result.json")
    assert result["verdict"] == "NOT DECIDABLE"
    assert "the record was altered: profiles/virtual-drive.yaml" in result["reasons"][0]


@pytest.mark.parametrize("measured", [False, True])
def test_a_run_of_before_that_was_killed_before_it_had_a_program_is_interrupted_where_nothing_was_measured(
    copied: RunRecord, tmp_path: Path, *, measured: bool
) -> None:
    desert(copied, ring=tmp_path / "gone", report=None)
    (copied.folder / "program.json").unlink()
    if measured:
        with pytest.raises(RecordError, match=r"program\.json"):
            recover(copied)
    else:
        copied.samples.write_bytes(b"")
        recover(copied)
    assert copied.state() == ("not concluded" if measured else "interrupted")
    assert copied.manifest().files is None


def test_run_json_that_names_another_recipe_than_its_line_in_the_chain_is_altered(
    quick_run: Any, tmp_path: Path
) -> None:
    record = RunRecord(quick_run.copy(tmp_path / "runs"))
    assert alterations(record) == ()
    said = record.read_json("run.json")
    said["recipe"]["sha256"] = "0" * 64
    record.write_json("run.json", said)
    assert any("names another recipe" in one for one in alterations(record))
