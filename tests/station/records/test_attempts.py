"""The attempts of a serial number come from the signed chain: no damaged, altered or lost record makes a unit new."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest
from station_samples import SETUP

from station.documents.manifest import EarlierAttempt
from station.records.attempts import MOST
from station.records.chain import blocks, lookup
from station.records.chain.lookup import ChainEnd
from station.records.data_folder import WORTH_KEEPING, Store
from station.records.run_record import RunRecord
from station.records.seal import seal
from station.records.verify import verify_folder


def measured(data: Path, verdict: str, serial: str = "SN-1") -> Path:
    run = Store(data).create(serial, SETUP, {})
    seal(run, state="complete", verdict=verdict)
    return run.folder


def damaged(run: Path) -> None:
    (run / "run.json").write_bytes(b"{")


def altered(run: Path) -> None:
    content = (run / "run.json").read_bytes()
    (run / "run.json").write_bytes(content.replace(b'"FAIL"', b'"PASS"').replace(b'"SN-1"', b'"SN-2"'))


@pytest.mark.parametrize("harm", [damaged, altered, shutil.rmtree, lambda run: (run / "run.json").unlink()])
def test_an_attempt_counts_whatever_became_of_its_record(tmp_path: Path, harm) -> None:
    first = measured(tmp_path, "FAIL")
    harm(first)
    before = (EarlierAttempt(attempt=1, run=first.name, state="complete", verdict="FAIL"),)
    assert Store(tmp_path).attempts_of("SN-1") == before
    second = Store(tmp_path).create("SN-1", SETUP, {}).manifest()
    assert (second.attempt, second.before) == (2, before)
    assert Store(tmp_path).attempts_of("SN-2") == ()


def test_an_attempt_that_was_begun_and_lost_counts_without_a_verdict(tmp_path: Path) -> None:
    first = Store(tmp_path).create("SN-1", SETUP, {})
    (recording,) = Store(tmp_path).attempts_of("SN-1")
    assert recording.state == "recording"
    shutil.rmtree(first.folder)
    (lost,) = Store(tmp_path).attempts_of("SN-1")
    assert (lost.attempt, lost.run, lost.state, lost.verdict) == (1, first.id, "interrupted", None)


def test_the_newest_attempts_are_told_also_where_a_line_that_nobody_signed_stands_behind_them(tmp_path: Path) -> None:
    runs = [measured(tmp_path, "FAIL").name for _ in range(MOST + 2)]
    measured(tmp_path, "PASS", "SN-10")
    chain = tmp_path / "chain.jsonl"
    last = [line for line in chain.read_bytes().splitlines(keepends=True) if runs[-1].encode() in line][-1]
    with chain.open("ab") as file:
        file.write(last.replace(b'"FAIL"', b'"PASS"'))
    told = Store(tmp_path).attempts_of("SN-1")
    assert [one.run for one in told] == runs[-MOST:]
    assert [one.attempt for one in told] == list(range(3, MOST + 3))
    assert {one.verdict for one in told} == {"FAIL"}


def test_a_record_that_no_chain_knows_counts_by_what_it_says(tmp_path: Path) -> None:
    measured(tmp_path / "there", "FAIL")
    (run,) = (one for one in (tmp_path / "there").iterdir() if one.is_dir() and one.name.endswith("SN-1"))
    shutil.copytree(run, tmp_path / "here" / run.name)
    (told,) = Store(tmp_path / "here").attempts_of("SN-1")
    assert (told.attempt, told.verdict) == (1, "FAIL")


def test_the_number_in_a_run_json_that_no_line_begins_is_none_of_the_chain(tmp_path: Path) -> None:
    first = measured(tmp_path, "FAIL")
    forged = RunRecord(Path(shutil.copytree(first, first.with_name(f"20260105T090000.000Z-{first.name[21:]}"))))
    for run in (forged, RunRecord(first)):  # nor does that of a run which the chain has begun say another one
        run.update(attempt=41)
        assert Store(tmp_path).create("SN-1", SETUP, {}).manifest().attempt == (2 if run is forged else 3)


def test_runs_whose_lines_were_lost_count_as_one_attempt_each_whatever_they_say(tmp_path: Path) -> None:
    first = measured(tmp_path, "FAIL")
    second = measured(tmp_path, "FAIL")
    chain = tmp_path / "chain.jsonl"
    chain.write_bytes(chain.read_bytes().splitlines(keepends=True)[0])
    RunRecord(second).update(attempt=41)
    again = Store(tmp_path).create("SN-1", SETUP, {}).manifest()
    assert again.attempt == 3
    assert {one.run for one in again.before or ()} == {first.name, second.name}
    assert Store(tmp_path).create("SN-1", SETUP, {}).manifest().attempt == 4, "they are counted once"
    assert {one.kind for one in verify_folder(tmp_path).problems if one.run == first.name} == {"lost_line"}


def test_a_copy_that_nobody_has_concluded_is_no_attempt(tmp_path: Path) -> None:
    first = Store(tmp_path).create("SN-1", SETUP, {})
    shutil.copytree(first.folder, first.folder.with_name(f"20300105T090000.000Z-{first.id[21:]}"))
    assert [one.run for one in Store(tmp_path).attempts_of("SN-1")] == [first.id]


@pytest.mark.parametrize("size", [1, 100, 5000])
def test_lines_are_found_wherever_the_blocks_of_a_reader_end(tmp_path: Path, monkeypatch, size: int) -> None:
    runs = [measured(tmp_path, "FAIL", f"SN-{number}").name for number in range(6)]
    monkeypatch.setattr(blocks, "BLOCK_BYTES", size)
    monkeypatch.setattr(lookup, "FIRST_BYTES", size)
    assert [one.run for one in Store(tmp_path).attempts_of("SN-3")] == [runs[3]]
    assert list(lookup.last_begun_on_each_bench(tmp_path).values()) == [runs[5]]
    assert len(lookup.entries_of_run(tmp_path, runs[0])) == 2
    end = ChainEnd(tmp_path)
    assert [end.sealed(run) is not None for run in reversed(runs)] == [True] * 6
    assert end.created("20200101T000000.000Z-SN") is None
    with (tmp_path / "chain.jsonl").open("ab") as file:
        file.write(b'{"kind":"created"')
    assert [one.run for one in Store(tmp_path).attempts_of("SN-5")] == [runs[5]], "a torn line is none"


def test_a_kept_listing_of_a_large_folder_is_dropped_when_a_run_comes(tmp_path: Path) -> None:
    for number in range(WORTH_KEEPING):
        (tmp_path / f"20200101T000000.{number:04}Z-x").mkdir()
    os.utime(tmp_path, (1e9, 1e9))
    assert Store(tmp_path).newest(1) == []
    assert Store(tmp_path).newest(1) == []
    run = measured(tmp_path, "PASS")
    assert [one.id for one in Store(tmp_path).newest(1)] == [run.name]
    shutil.rmtree(run)
    assert Store(tmp_path).newest(1) == []
