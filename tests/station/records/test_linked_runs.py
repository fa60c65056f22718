"""Runs that were moved and linked back: what vouches for them lies beside the link, and not beside its target."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import here
from station_samples import SETUP

from station.records.chain.chain_file import CHAIN, Chain
from station.records.data_folder import Store
from station.records.run_record import RunRecord
from station.records.seal import CONCLUDED, alterations, finish_seal, seal
from station.reevaluation.jobs import jobs_for


def move_and_link(run: Path, to: Path) -> Path:
    """Move a run's folder and leave a link in its place; return where it lies now."""
    to.mkdir()
    target = run.rename(to / run.name)
    run.symlink_to(target)
    return target


def say_pass(folder: Path) -> None:
    """Change a verdict to PASS in every file of a run that has it, with checksums that fit."""
    run = RunRecord(folder)
    result = run.read_json("result.json")
    result |= {"verdict": "PASS", "reasons": []}
    for metric in result["metrics"]:
        metric["verdict"] = "PASS"
        for side in metric["sides"].values():
            side["verdict"] = "PASS"
    run.write_json("result.json", result)
    content = (folder / "result.json").read_bytes()
    manifest = run.read_json("run.json")
    manifest["verdict"] = "PASS"
    manifest["files"]["result.json"] = {"sha256": hashlib.sha256(content).hexdigest(), "bytes": len(content)}
    run.write_json("run.json", manifest)


@pytest.fixture
def linked(worn_run: Any, tmp_path: Path) -> Path:
    """A run that failed, behind a link in its data folder."""
    run: Path = worn_run.copy(tmp_path / "data")
    move_and_link(run, tmp_path / "bigger")
    return run


@pytest.mark.parametrize("named", ["by id", "by folder"])
def test_a_fail_that_was_moved_and_altered_is_no_pass(linked: Path, tmp_path: Path, named: str) -> None:
    say_pass(linked.resolve())
    name, data = linked.name if named == "by id" else str(linked), ("--data", str(linked.parent))
    shown = here("show", name, *data)
    assert shown.exit_code == 3
    assert "RECORD ALTERED" in shown.out
    assert "NOT DECIDABLE" in shown.out
    assert here("show", name, *data, "--json").json["verdict"] == "NOT DECIDABLE"
    exported = here("export", name, *data, "--out", str(tmp_path / "x.csv"), "--format", "csv")
    assert exported.exit_code == 3, exported
    assert here("analyze", name, *data).exit_code == 3


def test_a_sound_run_that_was_moved_and_linked_back_is_sound(linked: Path, tmp_path: Path) -> None:
    assert alterations(RunRecord(linked)) == ()
    shown = here("show", str(linked), "--data", str(linked.parent))
    assert (shown.exit_code, "cannot be verified" in shown.out) == (0, False)
    assert "FAIL" in shown.out
    assert sorted(path.name for path in (tmp_path / "bigger").iterdir()) == [linked.name]


def test_a_link_from_elsewhere_only_leads_to_the_run(worn_run: Any, tmp_path: Path) -> None:
    run: Path = worn_run.copy(tmp_path / "data")
    link = tmp_path / "the-one-that-failed"
    link.symlink_to(run)
    assert Store(tmp_path / "data").find(str(link)).folder == run
    say_pass(run)
    assert here("show", str(link), "--data", str(tmp_path / "data")).exit_code == 3


def test_a_run_is_named_by_its_folder_whatever_the_path_ends_with(
    worn_run: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run: Path = worn_run.copy(tmp_path / "data")
    monkeypatch.chdir(run)
    assert Store(tmp_path / "data").find(".").folder == run
    monkeypatch.chdir(run / "profiles")
    assert Store(tmp_path / "data").find("..").folder == run


def test_a_run_behind_a_link_is_sealed_in_the_chain_of_its_data_folder(tmp_path: Path) -> None:
    data = tmp_path / "data"
    run = Store(data).create("S", SETUP, {})
    move_and_link(run.folder, tmp_path / "bigger")
    seal(run, state="complete", verdict="PASS")
    assert [entry.kind for entry in Chain(data).entries_of(run.id)] == ["created", "sealed"]
    assert not (tmp_path / "bigger" / CHAIN).exists()


def test_a_seal_behind_a_link_is_finished_by_the_chain_of_its_data_folder(tmp_path: Path) -> None:
    run = Store(tmp_path / "data").create("S", SETUP, {})
    seal(run, state="complete", verdict="PASS")
    (run.folder / "run.json").rename(run.folder / CONCLUDED)
    run.write_json("run.json", {**run.read_json(CONCLUDED), "state": "recording", "verdict": None, "files": None})
    move_and_link(run.folder, tmp_path / "bigger")
    assert finish_seal(run)
    assert run.manifest().verdict == "PASS"


def test_a_run_behind_a_link_is_evaluated_anew_where_its_chain_is(linked: Path) -> None:
    wanted = jobs_for(linked.parent, [(linked.name, "W1", "0" * 64, "FAIL")], None)
    assert [job.folder for job in wanted.jobs] == [str(linked.parent.resolve() / linked.name)]
    say_pass(linked.resolve())
    assert alterations(RunRecord(Path(wanted.jobs[0].folder)))
