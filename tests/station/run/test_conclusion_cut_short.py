"""A conclusion that is killed, or refused by the disk, at each of its steps: the next look at the run concludes it."""

from __future__ import annotations

import os
import shutil
import signal
from collections.abc import Callable
from dataclasses import replace
from errno import ENOSPC
from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import here
from run_copies import desert, from_before
from run_samples import as_recorded, recorded
from station_samples import SETUP
from stored_runs import metric, store_run

import station.records.seal
import station.run.conclusion
from analysis.trace.trace import Trace
from station.errors import RecordError
from station.records.chain.chain_file import CHAIN, CREATED_MANIFEST, Chain
from station.records.chain.walk import walk
from station.records.data_folder import Store
from station.records.run_record import MANIFEST, PACKED, SAMPLES, RunRecord
from station.records.seal import CONCLUDED, alterations, finish_seal
from station.reports.stored_result import stored_result
from station.results.export_origin import fingerprint_of
from station.run.run_list import row
from station.run.way_back.recover import recover

STEPS = ("fsync", "replace", "write", "ftruncate", "unlink")
"""What a conclusion does to the disk for good, by its name in `os`."""

MOST_STEPS = 60
ITS_OWN = ("ended", "files", "desk", "trouble", "samples", "chain")
"""Entries of run.json that differ from one conclusion to the next; samples stay raw where the disk refuses others."""


@pytest.fixture(scope="module")
def unpacked(golden_run: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with its samples as they were recorded, to be copied."""
    folder = tmp_path_factory.mktemp("unpacked") / golden_run.record.name
    as_recorded(RunRecord(shutil.copytree(golden_run.record, folder)))
    return folder


@pytest.fixture
def deserted(unpacked: Path, tmp_path: Path) -> Callable[[str], RunRecord]:
    """Return a run, in a data folder of its own, whose supervisor was lost when its last record was on disk."""

    def make(name: str) -> RunRecord:
        folder = tmp_path / name / unpacked.name
        shutil.copytree(unpacked, folder)
        run = RunRecord(folder)
        report = {"state": "finished", "written": run.records(), "lost": 0, "realtime": {"details": {}}}
        desert(from_before(run), ring=folder / "gone", report=report)
        return run

    return make


def evaluate_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the analysis of the same samples be done once: what a conclusion does to the disk is tried, step by step."""
    found: dict[str, Any] = {}
    honest = station.run.conclusion.evaluate_trace

    def evaluate(trace: Trace, *how: Any) -> Any:
        samples = fingerprint_of(trace)
        if samples not in found:
            found[samples] = honest(trace, *how)
        return found[samples]

    monkeypatch.setattr(station.run.conclusion, "evaluate_trace", evaluate)


def conclude_all(data: Path) -> None:
    """Conclude every run of a data folder, as a person does."""
    here("conclude", "--all", "--data", str(data))


def file_names(run: RunRecord) -> set[str]:
    """Return the files of a run; its samples are in one file, whichever."""
    names = [path.name for path in run.folder.iterdir()]
    return {"samples" if name in (SAMPLES, PACKED) else name for name in names} | {str(len(names))}


def left(run: RunRecord) -> dict[str, Any]:
    """Return what a concluded run says, without what is its folder's own."""
    manifest = {key: value for key, value in run.read_json("run.json").items() if key not in ITS_OWN}
    return {"run": manifest, "result": replace(stored_result(run), record=""), "row": row(run)}


def ended_at(step: int, run: RunRecord, end: Callable[[], None], *, once: bool) -> bool:
    """Conclude a run in a child of this process, with `end` called at the step, and at those behind it unless `once`.

    Returns whether it came so far.
    """
    pid = os.fork()
    if pid == 0:
        count = 0

        def counted(name: str) -> Callable[..., Any]:
            honest = getattr(os, name)

            def call(*args: Any, **kwargs: Any) -> Any:
                nonlocal count
                count += 1
                if count == step or (count > step and not once):
                    end()
                return honest(*args, **kwargs)

            return call

        try:
            for name in STEPS:
                setattr(os, name, counted(name))
            recover(run)
        finally:
            os._exit(count < step)
    _, status = os.waitpid(pid, 0)
    return os.WIFSIGNALED(status) or os.WEXITSTATUS(status) == 0


def sealed_entries(run: RunRecord) -> int:
    found = walk(Chain(run.folder.parent))
    assert found.problems == []
    return len(found.sealed.get(run.id, []))


def killed() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def refused() -> None:
    raise OSError(ENOSPC, "No space left on device")


@pytest.mark.parametrize(
    ("end", "once"),
    [(killed, True), (refused, False), (refused, True)],
    ids=["killed", "disk full", "disk full for a moment"],
)
def test_a_conclusion_that_is_cut_short_anywhere_is_made_good_once(
    deserted: Callable[[str], RunRecord], monkeypatch: pytest.MonkeyPatch, end: Callable[[], None], *, once: bool
) -> None:
    evaluate_once(monkeypatch)
    whole = deserted("whole")
    recover(whole)
    expected, files, samples = left(whole), file_names(whole), recorded(whole.folder)
    assert whole.has(PACKED)
    assert expected["row"].state == "complete"
    for step in range(1, MOST_STEPS):
        run = deserted(f"{step}")
        reached = ended_at(step, run, end, once=once)
        conclude_all(run.folder.parent)
        assert alterations(run) == (), step
        assert left(run) == expected, step
        assert sealed_entries(run) == 1, step
        assert file_names(run) == files, step
        assert recorded(run.folder) == samples, step
        if not reached:
            assert step > 12, "too few steps were seen"
            return
    raise AssertionError("the conclusion does not come to its end")


def sealed_up_to_the_line(run: RunRecord) -> None:
    """Kill a conclusion between its line in the chain and its run.json."""
    pid = os.fork()
    if pid == 0:
        try:
            station.records.seal._put_in_place = lambda _run: killed()
            recover(run)
        finally:
            os._exit(1)
    assert os.WIFSIGNALED(os.waitpid(pid, 0)[1])
    assert run.manifest().state == "recording"
    assert sealed_entries(run) == 1


def forged(run: RunRecord) -> None:
    text = (run.folder / CONCLUDED).read_text(encoding="utf-8")
    (run.folder / CONCLUDED).write_text(text.replace("NOT DECIDABLE", "PASS"), encoding="utf-8")


def better_result(run: RunRecord) -> None:
    text = (run.folder / "result.json").read_text(encoding="utf-8")
    (run.folder / "result.json").write_text(text.replace("NOT DECIDABLE", "PASS"), encoding="utf-8")


@pytest.mark.parametrize(("alter", "file"), [(forged, "run.json"), (better_result, "result.json")])
def test_what_is_altered_between_the_line_and_the_manifest_shows(
    deserted: Callable[[str], RunRecord], alter: Callable[[RunRecord], None], file: str
) -> None:
    run = deserted("altered")
    sealed_up_to_the_line(run)
    alter(run)
    conclude_all(run.folder.parent)
    assert any(one.startswith(file) for one in alterations(run))
    assert stored_result(run).verdict == "NOT DECIDABLE"
    assert not run.has(CONCLUDED)


@pytest.mark.parametrize("asked", ["SN-1", "--all"])
def test_a_run_that_was_killed_behind_its_first_line_is_named_to_who_concludes(tmp_path: Path, asked: str) -> None:
    run = Store(tmp_path).create("SN-1", SETUP, {})
    run.update(desk={"pid": 999_999, "birth": "gone"})
    (run.folder / MANIFEST).rename(run.folder / CREATED_MANIFEST)
    ran = here("conclude", asked, "--data", str(tmp_path), "--json")
    assert [one["run"] for one in ran.json["runs"]] == [run.id]
    assert run.has(MANIFEST)


@pytest.mark.parametrize("asked", ["SN-1", "last", "Z-SN-"])
@pytest.mark.parametrize("earlier", [True, False])
def test_a_run_that_was_killed_behind_its_first_line_is_named_to_who_looks(
    tmp_path: Path, asked: str, *, earlier: bool
) -> None:
    store = Store(tmp_path)
    others = [store.create("SN-1", SETUP, {})] if earlier else []
    run = store.create("SN-1", SETUP, {})
    (run.folder / MANIFEST).rename(run.folder / CREATED_MANIFEST)
    ran = here("show", asked, "--data", str(tmp_path))
    assert ran.exit_code == 2
    assert f"lostmotion conclude {run.id}" in ran.err
    assert [store.find(one.id).id for one in others] == [one.id for one in others]
    (tmp_path / CHAIN).unlink()
    assert f"lostmotion conclude {run.id}" not in here("show", asked, "--data", str(tmp_path)).err


@pytest.mark.parametrize("command", ["show", "conclude"])
@pytest.mark.parametrize("asked", ["SN-1", "last", "Z-SN-"])
@pytest.mark.parametrize("left", [True, False])
def test_a_concluded_run_whose_manifest_is_gone_is_not_one_that_was_only_begun(
    tmp_path: Path, command: str, asked: str, *, left: bool
) -> None:
    store_run(tmp_path, "SN-1", [metric(0.4)])
    run = store_run(tmp_path, "SN-1", [metric(2.0)], failed="lost_motion")
    (run.folder / MANIFEST).rename(run.folder / (CREATED_MANIFEST if left else "aside"))
    ran = here(command, asked, "--data", str(tmp_path))
    assert ran.exit_code == 2
    assert f"{run.id}: attempt 2 of unit SN-1, FAIL" in ran.err
    assert f"lostmotion conclude {run.id}" not in ran.err


def test_in_a_folder_that_is_not_there_nothing_is_concluded(tmp_path: Path) -> None:
    assert here("conclude", "--all", "--data", str(tmp_path / "nowhere")).exit_code == 2


def test_a_manifest_that_no_line_vouches_for_is_not_believed(deserted: Callable[[str], RunRecord]) -> None:
    run, other = deserted("forged"), deserted("honest")
    recover(other)
    manifest = other.read_json("run.json") | {"verdict": "PASS"}
    run.write_json(CONCLUDED, manifest)
    assert not finish_seal(run)
    assert not run.has(CONCLUDED)
    run.write_json(CONCLUDED, manifest)
    recover(run)
    assert left(run) == left(other)
    assert alterations(run) == ()


def test_a_chain_that_cannot_be_read_is_no_reason_to_conclude_again(deserted: Callable[[str], RunRecord]) -> None:
    run = deserted("unread")
    sealed_up_to_the_line(run)
    chain = run.folder.parent / CHAIN
    chain.rename(chain.with_suffix(".away"))
    chain.mkdir()  # opens, and reads as an error
    conclude_all(run.folder.parent)
    assert run.manifest().state == "recording"
    chain.rmdir()
    chain.with_suffix(".away").rename(chain)
    conclude_all(run.folder.parent)
    assert alterations(run) == ()
    assert run.manifest().state == "complete"


def test_a_line_that_did_not_fit_is_taken_back_and_one_that_was_torn_tears_no_other(
    deserted: Callable[[str], RunRecord], monkeypatch: pytest.MonkeyPatch
) -> None:
    run = deserted("torn")
    chain, honest = run.folder.parent / CHAIN, os.write
    Store(run.folder.parent).create("another", SETUP, {})
    whole = chain.read_bytes()
    with monkeypatch.context() as patched:
        patched.setattr(os, "write", lambda handle, data: honest(handle, data[: len(data) // 2]))
        with pytest.raises(RecordError, match="No space left on device"):
            recover(run)
    assert chain.read_bytes() == whole
    chain.write_bytes(whole + b'{"kind":"created","counter":3,"run":"torn by a power fail')
    recover(run)
    assert sealed_entries(run) == 1
    assert alterations(run) == ()
    assert run.manifest().state == "complete"
