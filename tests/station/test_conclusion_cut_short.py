"""A conclusion that is killed, or refused by the disk, at each of its steps: the next look at the run concludes it."""

from __future__ import annotations

import os
import shutil
import signal
from collections.abc import Callable
from errno import ENOSPC
from pathlib import Path
from typing import Any

import pytest
from run_copies import desert

import station.record.seal
from station.commands.show import row, stored_result
from station.errors import RecordError
from station.record.run_index import INDEX, index_lines
from station.record.run_record import RunRecord
from station.record.seal import CONCLUDED, alterations, finish_seal
from station.record.store import Store
from station.run.recovery import recover, recover_all

STEPS = ("fsync", "replace", "write", "ftruncate")
"""What a conclusion does to the disk for good, by its name in `os`."""

MOST_STEPS = 60
ITS_OWN = ("ended", "files", "desk", "trouble")
"""Entries of run.json that differ from one conclusion to the next."""


@pytest.fixture
def deserted(golden_run: Any, tmp_path: Path) -> Callable[[str], RunRecord]:
    """Return a run, in a data folder of its own, whose desk was lost when its last record was on disk."""

    def make(name: str) -> RunRecord:
        folder = tmp_path / name / golden_run.record.name
        shutil.copytree(golden_run.record, folder)
        run = RunRecord(folder)
        report = {"state": "finished", "written": run.records(), "lost": 0, "realtime": {"details": {}}}
        desert(run, ring=folder / "gone", report=report)
        return run

    return make


def left(run: RunRecord) -> dict[str, Any]:
    """Return what a concluded run says, without what is its folder's own."""
    manifest = {key: value for key, value in run.manifest().items() if key not in ITS_OWN}
    return {"run": manifest, "result": stored_result(run) | {"record": ""}, "row": row(run)}


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
    deserted: Callable[[str], RunRecord], end: Callable[[], None], *, once: bool
) -> None:
    whole = deserted("whole")
    recover(whole)
    expected, files = left(whole), {path.name for path in whole.folder.iterdir()}
    assert expected["row"]["state"] == "complete"
    for step in range(1, MOST_STEPS):
        run = deserted(f"{step}")
        reached = ended_at(step, run, end, once=once)
        recover_all(Store(run.folder.parent))
        assert alterations(run) == (), step
        assert left(run) == expected, step
        assert len(index_lines(run.folder.parent / INDEX, run.id) or []) == 1, step
        assert {path.name for path in run.folder.iterdir()} == files, step
        if not reached:
            assert step > 12, "too few steps were seen"
            return
    raise AssertionError("the conclusion does not come to its end")


def sealed_up_to_the_line(run: RunRecord) -> None:
    """Kill a conclusion between its line in the index and its run.json."""
    pid = os.fork()
    if pid == 0:
        try:
            station.record.seal._put_in_place = lambda _run: killed()
            recover(run)
        finally:
            os._exit(1)
    assert os.WIFSIGNALED(os.waitpid(pid, 0)[1])
    assert run.manifest()["state"] == "recording"
    assert len(index_lines(run.folder.parent / INDEX, run.id) or []) == 1


def forged(run: RunRecord) -> None:
    text = (run.folder / CONCLUDED).read_text(encoding="utf-8")
    (run.folder / CONCLUDED).write_text(text.replace("NOT DECIDABLE", "PASS"), encoding="utf-8")


def better_result(run: RunRecord) -> None:
    text = (run.folder / "result.json").read_text(encoding="utf-8")
    (run.folder / "result.json").write_text(text.replace("NOT DECIDABLE", "PASS"), encoding="utf-8")


@pytest.mark.parametrize(("alter", "file"), [(forged, INDEX), (better_result, "result.json")])
def test_what_is_altered_between_the_line_and_the_manifest_shows(
    deserted: Callable[[str], RunRecord], alter: Callable[[RunRecord], None], file: str
) -> None:
    run = deserted("altered")
    sealed_up_to_the_line(run)
    alter(run)
    recover_all(Store(run.folder.parent))
    assert any(one.startswith(file) for one in alterations(run))
    assert stored_result(run)["verdict"] == "NOT DECIDABLE"
    assert not run.has(CONCLUDED)


def test_a_manifest_that_no_line_vouches_for_is_not_believed(deserted: Callable[[str], RunRecord]) -> None:
    run, other = deserted("forged"), deserted("honest")
    recover(other)
    manifest = other.manifest() | {"verdict": "PASS"}
    run.write_json(CONCLUDED, manifest)
    assert not finish_seal(run)
    assert not run.has(CONCLUDED)
    run.write_json(CONCLUDED, manifest)
    recover(run)
    assert left(run) == left(other)
    assert alterations(run) == ()


def test_an_index_that_cannot_be_read_is_no_reason_to_conclude_again(deserted: Callable[[str], RunRecord]) -> None:
    run = deserted("unread")
    sealed_up_to_the_line(run)
    index = run.folder.parent / INDEX
    index.rename(index.with_suffix(".away"))
    index.mkdir()  # opens, and reads as an error
    recover_all(Store(run.folder.parent))
    assert run.manifest()["state"] == "recording"
    index.rmdir()
    index.with_suffix(".away").rename(index)
    recover_all(Store(run.folder.parent))
    assert alterations(run) == ()
    assert run.manifest()["state"] == "complete"


def test_a_line_that_did_not_fit_is_taken_back_and_one_that_was_torn_tears_no_other(
    deserted: Callable[[str], RunRecord], monkeypatch: pytest.MonkeyPatch
) -> None:
    run = deserted("torn")
    index, honest = run.folder.parent / INDEX, os.write
    index.write_bytes(b'{"run": "of another"}\n')
    with monkeypatch.context() as patched:
        patched.setattr(os, "write", lambda handle, data: honest(handle, data[: len(data) // 2]))
        with pytest.raises(RecordError, match="No space left on device"):
            recover(run)
    assert index.read_bytes() == b'{"run": "of another"}\n'
    index.write_bytes(b'{"run": "of another"}\n{"run": "torn by a power fail')
    recover(run)
    assert alterations(run) == ()
    assert run.manifest()["state"] == "complete"
