"""Folders from before there were chains: their runs keep their verdicts, and what is done to them is named."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from chain_folders import a_key, another_computer, folder, lines, write
from station_samples import SETUP
from stored_runs import metric, store_run

from station.documents.manifest import INJECTED, SIMULATED
from station.records.chain.chain_file import CHAIN
from station.records.chain.entries import REMOVED, signed_entry
from station.records.chain.keys import FOLDER_KEYS
from station.records.chain.writing import writing_to
from station.records.data_folder import Store
from station.records.run_record import RunRecord
from station.records.seal import fingerprint, seal
from station.records.traces import keep_trace
from station.records.verify import verify_folder
from station.run.run_list import row
from station.store.retention import Planned, apply
from station.store.view import look_at


def old_folder(data: Path) -> list[RunRecord]:
    """Turn a folder into one of the time before chains: an index, and no word of a chain in any run.json."""
    runs = Store(data).runs()
    for run in runs:
        manifest = {key: value for key, value in run.read_json("run.json").items() if key != "chain"}
        run.write_json("run.json", manifest)
        content = (run.folder / "run.json").read_bytes()
        line = {"run": run.id, "sha256": hashlib.sha256(content).hexdigest(), "verdict": manifest["verdict"]}
        with (data / "index.jsonl").open("a") as index:
            index.write(json.dumps(line | {"time": "then"}) + "\n")
    (data / CHAIN).unlink()
    (data / FOLDER_KEYS).unlink()
    return runs


@pytest.fixture
def old(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    old_folder(data)
    another_computer(monkeypatch, tmp_path)
    return data


def test_runs_from_before_the_chain_keep_their_verdicts(old: Path) -> None:
    before = [row(run).verdict for run in Store(old).runs()]
    assert before == ["FAIL", "PASS", "PASS", "PASS"]
    assert verify_folder(old).problems == []
    new = store_run(old, "A", [metric(0.4)])
    assert new.manifest().attempt == 3
    assert [row(run).verdict for run in Store(old).runs()] == [*before, "PASS"]
    assert verify_folder(old).problems == []


@pytest.mark.parametrize(
    ("deed", "kind"),
    [
        (lambda data: shutil.rmtree(folder(data, 0)), "missing"),
        (lambda data: (data / "index.jsonl").write_bytes(b""), "old_index"),
        (lambda data: (data / "index.jsonl").unlink(), "old_index"),
        (lambda data: RunRecord(folder(data, 0)).update(verdict="PASS"), "altered"),
    ],
)
def test_what_is_done_to_runs_from_before_the_chain_is_named(
    old: Path, deed: Callable[[Path], object], kind: str
) -> None:
    store_run(old, "D", [metric(0.4)])
    deed(old)
    assert kind in {problem.kind for problem in verify_folder(old).problems}


def test_a_run_from_before_the_chain_that_a_rule_has_removed_is_not_missing(old: Path) -> None:
    store_run(old, "A", [metric(0.4)])
    gone, lost = folder(old, 0), folder(old, 1)
    with writing_to(old) as chain:
        trace = keep_trace(old, gone.name, {one: (gone / one).read_bytes() for one in ("run.json", "result.json")})
        chain.append(REMOVED, run=gone.name, serial="A", sha256="0", rule="r", person="p", trace=trace)
    told = Store(old).attempts_of("A")
    shutil.rmtree(gone)
    assert [(one.attempt, one.verdict) for one in told] == [(1, "FAIL"), (2, "PASS"), (3, "PASS")]
    assert Store(old).attempts_of("A") == told
    with look_at(old) as view:
        assert view.problems == verify_folder(old).problems == []
    foreign = {"run": gone.name, "serial": "A", "sha256": "0", "rule": "x", "person": "p", "trace": ""}
    write(old, [*lines(old), signed_entry(REMOVED, 99, "", "then", a_key(), **foreign).line + b"\n"])
    with look_at(old) as view:
        assert "missing" not in {one.kind for one in view.problems}
    write(old, lines(old)[:-1])
    shutil.rmtree(lost)
    with look_at(old) as view:
        assert [(one.kind, one.run) for one in view.problems] == [("missing", lost.name)]


@pytest.mark.parametrize("before_the_chain", [True, False])
def test_what_set_a_removed_attempt_aside_is_told_by_its_removal(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, before_the_chain: bool
) -> None:
    gone = [store_run(data, "Z", [metric(0.4)], scenario="x").folder, store_run(data, "Z", [], virtual="P1").folder]
    if before_the_chain:
        old_folder(data)
        another_computer(monkeypatch, tmp_path)
    store_run(data, "Z", [metric(0.4)])
    told = Store(data).attempts_of("Z")
    assert [one.aside for one in told] == [INJECTED, SIMULATED, None]
    wanted = [Planned(one.name, "Z", "r", "nothing", days=9, bytes=9) for one in gone]
    files = {one.relative_to(data).as_posix(): fingerprint(one).sha256 for one in data.rglob("*") if one.is_file()}
    assert len(apply(data, wanted, files, "A. Tester").removed) == len(gone)
    assert Store(data).attempts_of("Z") == told
    assert verify_folder(data).problems == []


def test_an_attempt_from_before_the_chain_that_left_no_trace_is_told_by_its_removal(old: Path) -> None:
    store_run(old, "A", [metric(0.4)])
    gone = folder(old, 0)
    told = [(one.attempt, one.run, one.state, one.verdict) for one in Store(old).attempts_of("A")]
    assert told[0] == (1, gone.name, "complete", "FAIL")
    wanted = Planned(gone.name, "A", "r", "nothing", days=9, bytes=9, why_not="", kept_in="backup")
    files = {one.relative_to(old).as_posix(): fingerprint(one).sha256 for one in gone.rglob("*") if one.is_file()}
    assert apply(old, [wanted], files, "A. Tester").removed
    assert [(one.attempt, one.run, one.state, one.verdict) for one in Store(old).attempts_of("A")] == told
    assert verify_folder(old).problems == []


def test_an_open_run_from_before_the_chain_can_be_concluded(old: Path) -> None:
    run = Store(old).runs()[0]
    manifest = {key: value for key, value in run.read_json("run.json").items() if key != "files"}
    run.write_json("run.json", manifest | {"state": "interrupted", "verdict": None})
    (old / "index.jsonl").write_text("".join((old / "index.jsonl").read_text().splitlines(keepends=True)[1:]))
    Store(old).create("D", SETUP, {})
    assert verify_folder(old).problems == []
    seal(run, state="complete", verdict="FAIL")
    assert verify_folder(old).problems == []
    assert run.manifest().verdict == "FAIL"


@pytest.mark.parametrize("chained", [True, False])
def test_a_run_that_the_index_has_as_concluded_is_not_made_open(old: Path, *, chained: bool) -> None:
    if chained:
        store_run(old, "D", [metric(0.4)])
    run = Store(old).runs()[0]
    opened = {name: said for name, said in run.read_json("run.json").items() if name != "files"}
    run.write_json("run.json", opened | {"state": "interrupted", "verdict": None})
    with look_at(old) as view:
        assert [(one.kind, one.run) for one in view.problems] == [("altered", run.id)]
    assert [(one.kind, one.run) for one in verify_folder(old).problems] == [("altered", run.id)]
    assert (row(run).state, row(run).verdict) == ("altered", None)
