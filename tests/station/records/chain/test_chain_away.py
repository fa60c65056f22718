"""A folder whose chain was taken away: a run that names one is not believed without it, however sound its own files."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from chain_folders import another_computer, folder
from lostmotion_command import here
from run_copies import alone, from_before
from stored_runs import metric, store_run

from station.records.certificate_code import code_of
from station.records.chain.chain_file import CHAIN, Chain
from station.records.chain.keys import FOLDER_KEYS, own_key
from station.records.data_folder import Store
from station.records.run_record import RunRecord
from station.records.seal import alterations, fingerprint
from station.records.verify import verify_folder
from station.reports.stored_result import stored_result
from station.run.jog.jogs import FOLDER as JOGS
from station.run.run_list import row


def forged(data: Path) -> RunRecord:
    """Make a PASS of the first run, a FAIL, with every hash that anybody can make."""
    run = RunRecord(folder(data, 0))
    assert run.manifest().verdict == "FAIL"
    run.write_json("result.json", json.loads(json.dumps(run.read_json("result.json")).replace("FAIL", "PASS")))
    files = run.read_json("run.json")["files"]
    found = fingerprint(run.folder / "result.json")
    files["result.json"] = {"sha256": found.sha256, "bytes": found.bytes}
    run.update(verdict="PASS", files=files)
    return run


@pytest.fixture
def bare(data: Path) -> Path:
    """A copy of the folder with the forged run, without the chain and the keys."""
    copy = Path(shutil.copytree(data, data.with_name("bare")))
    (copy / CHAIN).unlink()
    (copy / FOLDER_KEYS).unlink()
    forged(copy)
    return copy


def strip(data: Path) -> None:
    for run in Store(data).runs():
        from_before(run)


@pytest.fixture
def elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[[], str]:
    """Go to a computer that knows nothing of the folder; return the public key of its bench."""

    def go() -> str:
        key = own_key().public
        another_computer(monkeypatch, tmp_path)
        return key

    return go


@pytest.mark.parametrize("known", [True, False], ids=["own computer", "another"])
@pytest.mark.parametrize("named", [True, False])
def test_runs_that_name_a_chain_are_not_believed_without_it(
    bare: Path, elsewhere: Callable[[], str], *, known: bool, named: bool
) -> None:
    key = own_key().public if known else elsewhere()
    words = ("--data", str(bare), *(("--key", key) if named else ()))
    ran = here("verify", *words, "--json")
    assert (ran.exit_code, ran.json["passed"], ran.json["chain"]) == (1, False, None)
    said = [one for one in ran.json["problems"] if one["kind"] == "no_chain"]
    assert [one["run"] for one in said] == [run.id for run in Store(bare).runs()]
    run = RunRecord(folder(bare, 0))
    place = run.manifest().chain
    assert place is not None
    assert f"names entry {place.counter} of chain {place.id}, which is not in this folder" in said[0]["text"]
    certificate = here("verify", *words, "--code", code_of(run))
    assert certificate.exit_code == 1
    assert "ALTERED" in certificate.out
    assert "PASS" not in certificate.out


def test_it_has_no_verdict_in_any_command_and_is_not_counted(bare: Path, elsewhere: Callable[[], str]) -> None:
    elsewhere()
    data, run = ("--data", str(bare)), RunRecord(folder(bare, 0))
    assert {one["verdict"] for one in here("list", *data, "--json").json} == {None}
    for name in (run.id, str(run.folder)):
        shown = here("show", name, *data, "--json")
        assert (shown.exit_code, shown.json["verdict"]) == (3, "NOT DECIDABLE")
        assert "which is not in this folder" in shown.json["altered"][0]
    assert here("export", run.id, *data, "--format", "dfq", "--out", str(bare.parent / "x.dfq")).exit_code == 3
    told = here("quality", "yield", *data)
    assert told.exit_code == 2
    assert "Not counted, because their records are not believed: 4" in told.out + told.err


@pytest.mark.usefixtures("place")
def test_a_report_of_it_says_so(worn_run: Any, tmp_path: Path) -> None:
    run = RunRecord(worn_run.copy(tmp_path / "runs"))
    (tmp_path / "runs" / CHAIN).unlink()
    for name in (run.id, str(run.folder)):
        reported = here("report", name, "--data", str(tmp_path / "runs"), "--out", str(tmp_path))
        assert reported.exit_code == 3
        assert "which is not in this folder" in reported.out
        assert "which is not in this folder" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_a_backup_of_such_a_folder_does_not_pass(bare: Path, elsewhere: Callable[[], str]) -> None:
    elsewhere()
    file, again = str(bare.parent / "b.tar"), str(bare.parent / "again")
    for ran in (here("backup", file, "--data", str(bare)), here("restore", file, "--data", again)):
        assert ran.exit_code == 1
        assert "'verify' finds problems" in ran.out


def test_a_folder_that_was_moved_needs_its_chain_on_its_own_computer(data: Path) -> None:
    moved = Path(shutil.move(data, data.with_name("moved")))
    assert verify_folder(moved).problems == []
    chain = (moved / CHAIN).rename(moved.parent / "kept")
    assert {one.kind for one in verify_folder(moved).problems} == {"no_chain"}
    assert {row(run).verdict for run in Store(moved).runs()} == {None}
    chain.rename(moved / CHAIN)
    assert verify_folder(moved).problems == []
    assert [row(run).verdict for run in Store(moved).runs()] == ["FAIL", "PASS", "PASS", "PASS"]


def test_a_new_chain_in_a_moved_folder_says_that_it_replaces_another(data: Path) -> None:
    moved = Path(shutil.move(data, data.with_name("moved")))
    (moved / CHAIN).unlink()
    new = store_run(moved, "D", [metric(0.4)])
    assert "replaced" in {one.kind for one in verify_folder(moved).problems}
    assert {run.id: row(run).verdict for run in Store(moved).runs() if row(run).verdict} == {new.id: "PASS"}


def test_without_any_chain_a_named_key_has_signed_nothing(bare: Path, elsewhere: Callable[[], str]) -> None:
    key = elsewhere()
    strip(bare)
    run, data = RunRecord(folder(bare, 0)), ("--data", str(bare))
    ran = here("verify", *data, "--key", key)
    assert ran.exit_code == 1
    assert f"nothing here is signed by {key}" in ran.out
    certificate = here("verify", *data, "--key", key, "--code", code_of(run))
    assert certificate.exit_code == 1
    assert "UNKNOWN" in certificate.out
    assert "verdict" not in certificate.out
    # As a folder from before there were chains, where no key is demanded.
    assert here("verify", *data).exit_code == 0


def test_a_certificate_of_a_run_that_nothing_signed_says_so(bare: Path, elsewhere: Callable[[], str]) -> None:
    elsewhere()
    strip(bare)
    told = here("verify", "--data", str(bare), "--code", code_of(RunRecord(folder(bare, 0))))
    assert "nothing signed vouches for it" in told.out


def test_a_certificate_counts_for_the_key_that_signed_it_and_for_no_other(
    data: Path, elsewhere: Callable[[], str]
) -> None:
    code = code_of(RunRecord(folder(data, 1)))
    other, key = f"ed25519:{'0' * 64}", elsewhere()
    for named, code_is in ((key, 0), (other, 1)):
        assert here("verify", "--data", str(data), "--key", named, "--code", code).exit_code == code_is


def test_this_computer_knows_a_run_from_the_chain_that_it_keeps_elsewhere(bare: Path, data: Path) -> None:
    strip(bare)
    found = verify_folder(bare)
    assert {one.kind for one in found.problems} == {"no_chain"}
    assert f"the one in {data} begins this run" in found.problems[0].text
    assert {row(run).verdict for run in Store(bare).runs()} == {None}


def test_jogs_without_their_chain_pass_no_key_and_a_folder_without_jogs_does(data: Path) -> None:
    words = ("verify", "--data", str(data), "--key", own_key().public)
    (data / JOGS).mkdir()
    assert here(*words).exit_code == 0
    store_run(data / JOGS, "J", [metric(0.1)])
    assert here(*words).exit_code == 0
    (data / JOGS / CHAIN).unlink()
    assert here(*words).exit_code == 1


@pytest.mark.parametrize("known", [True, False])
def test_a_single_run_is_shown_by_its_own_files_and_is_no_evidence(
    data: Path, elsewhere: Callable[[], str], *, known: bool
) -> None:
    copy = alone(RunRecord(folder(data, 1)))
    if not known:
        elsewhere()
    shown = here("show", str(copy.folder))
    assert shown.exit_code == 0
    assert "PASS" in shown.out
    assert f"file {CHAIN} is missing" in shown.out
    asked = here("show", str(copy.folder), "--json")
    assert (asked.exit_code, asked.json["verdict"]) == (0, "PASS")
    assert f"no {CHAIN} vouches for this record" in asked.err
    assert here("show", copy.id, "--data", str(copy.folder.parent)).exit_code == 3
    assert alterations(copy)
    (copy.folder.parent / FOLDER_KEYS).touch()  # what lies in a data folder alone
    assert here("show", str(copy.folder)).exit_code == 3


def test_runs_that_name_no_chain_are_believed_as_ever(data: Path, elsewhere: Callable[[], str]) -> None:
    elsewhere()
    strip(data)
    (data / CHAIN).unlink()
    assert not Chain(data).there
    assert verify_folder(data).problems == []
    assert [stored_result(run).verdict for run in Store(data).runs()] == ["FAIL", "PASS", "PASS", "PASS"]
