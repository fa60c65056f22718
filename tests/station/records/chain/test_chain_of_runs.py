"""A chain that grows: attempts, what was removed before, processes that are killed or that write at once."""

from __future__ import annotations

import os
import shutil
import signal
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from chain_folders import folder, lines, write
from lostmotion_command import here
from station_samples import SETUP
from stored_runs import metric, store_run

from station.errors import RecordError
from station.records.chain.blocks import LARGEST_LINES
from station.records.chain.chain_file import CHAIN, CREATED_MANIFEST, Chain
from station.records.chain.entries import REMOVED, entry_of
from station.records.chain.old_index import INDEX
from station.records.chain.walk import walk
from station.records.chain.writing import writing_to
from station.records.data_folder import Store
from station.records.process_birth import process_birth
from station.records.run_record import RunRecord
from station.records.seal import CONCLUDED, finish_seal, seal
from station.records.verify import verify_folder
from station.run.run_list import row
from station.store.stored_runs import runs_named
from station.store.view import look_at


def test_a_run_is_an_attempt_although_it_was_deleted(data: Path) -> None:
    for run in Store(data).of_serial("A"):
        shutil.rmtree(run.folder)
    again = store_run(data, "A", [metric(0.4)])
    assert again.manifest().attempt == 3
    missing = [problem.text for problem in verify_folder(data).problems if problem.kind == "missing"]
    assert len(missing) == 2
    assert "attempt 1 of unit A, FAIL" in missing[0]


def test_what_was_cut_off_stays_named_when_the_next_run_follows(data: Path) -> None:
    shutil.rmtree(folder(data, -1))
    write(data, lines(data)[:-2])
    store = Store(data)
    store.create("D", SETUP, {})
    assert "entries 8 to 9" in store.warnings[0]
    assert [problem.kind for problem in verify_folder(data).problems] == ["lost_entries"]
    assert [entry.counter for entry in map(entry_of, (line[:-1] for line in lines(data))) if entry][-2:] == [10, 11]


def test_a_chain_that_follows_a_removed_one_says_so(data: Path) -> None:
    shutil.rmtree(data)
    store = Store(data)
    store.create("A", SETUP, {})
    assert "9 entries" in store.warnings[0]
    assert "replaced" in {problem.kind for problem in verify_folder(data).problems}


@pytest.mark.usefixtures("place")
def test_a_lock_that_is_a_link_is_not_followed(tmp_path: Path) -> None:
    data = tmp_path / "runs"
    data.mkdir()
    (tmp_path / "precious").write_text("x")
    (data / ".lock").symlink_to(tmp_path / "precious")
    with pytest.raises(RecordError):
        Store(data).create("A", SETUP, {})


def killed(*_: Any) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


FILES = {"recipe.yaml": b"r\n", "bench.yaml": b"b\n", "profiles/drive.yaml": b"p\n"}


@pytest.mark.parametrize("step", range(1, 50))
def test_a_run_whose_process_is_killed_while_it_is_created_is_there_or_not(data: Path, step: int) -> None:
    """At each call that changes the disk; the next run finds it whole, and counts it when the chain does."""
    before = {run.id for run in Store(data).runs()}
    pid = os.fork()
    if pid == 0:
        left = step
        for name in ("mkdir", "fsync", "replace", "write"):
            honest = getattr(os, name)

            def call(*args: Any, honest: Callable[..., Any] = honest, **kwargs: Any) -> Any:
                nonlocal left
                left -= 1
                return killed() if left == 0 else honest(*args, **kwargs)

            setattr(os, name, call)
        Store(data).create("A", SETUP, FILES)
        os._exit(0)
    os.waitpid(pid, 0)
    for run in (one for one in Store(data).runs() if one.id not in before):  # it can be concluded, so it has its files
        assert {name for name in (*FILES, "samples.bin", "samples.json") if not run.has(name)} == set()
    assert {problem.kind for problem in verify_folder(data).problems} == set()
    counted = len([entry for entry in walk(Chain(data)).created.values() if entry.fields["serial"] == "A"])
    again = Store(data).create("A", SETUP, FILES)
    assert again.manifest().attempt == counted + 1
    assert {problem.kind for problem in verify_folder(data).problems} == set()
    assert not list(data.glob(f"*/{CREATED_MANIFEST}")) or counted == 2


@pytest.mark.usefixtures("place")
def test_runs_of_several_processes_at_once_make_one_chain(tmp_path: Path) -> None:
    data = tmp_path / "runs"
    pids = []
    for number in range(4):
        pid = os.fork()
        if pid == 0:
            for _ in range(4):
                store_run(data, f"S{number % 2}", [metric(0.4)])
            os._exit(0)
        pids.append(pid)
    assert {os.waitpid(pid, 0)[1] for pid in pids} == {0}
    found = verify_folder(data)
    assert found.problems == []
    assert sorted(run.manifest().attempt for run in Store(data).of_serial("S0")) == list(range(1, 9))


@pytest.mark.parametrize("altered", [False, True])
def test_a_unit_that_is_measured_while_a_folder_is_verified_is_no_problem(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, altered: bool
) -> None:
    """A run begins, another one is concluded, and another one is altered, after the chain was read."""
    store_run(tmp_path, "S1", [metric(0.4)])
    old, unsealed = next(tmp_path.glob("*-S1")), []
    with monkeypatch.context() as later:
        later.setattr("stored_runs.seal", lambda run, **how: unsealed.append((run, how)))
        store_run(tmp_path, "S2", [metric(0.4)])
    happens = [
        lambda: store_run(tmp_path, "S3", [metric(0.4)]),
        lambda: [seal(run, **how) for run, how in unsealed],
        lambda: Store(tmp_path).create("S4", SETUP, FILES),
    ]
    if altered:
        (old / "result.json").write_bytes(b"{}")

    def walk_and_go_on(chain: Chain, **how: Any) -> Any:
        found = walk(chain, **how)
        if happens:
            happens.pop(0)()
        return found

    monkeypatch.setattr("station.records.verify.walk", walk_and_go_on)
    found = verify_folder(tmp_path)
    assert not happens
    assert {(one.kind, one.run) for one in found.problems} == ({("altered", old.name)} if altered else set())
    assert (found.runs, found.concluded) == (4, 3)


@pytest.mark.parametrize("command", [("list",), ("show", "A"), ("verify",), ("store", "rebuild"), ("backup", "b.tar")])
def test_a_chain_beyond_all_bounds_is_named_and_not_read(
    data: Path, monkeypatch: pytest.MonkeyPatch, command: tuple[str, ...]
) -> None:
    monkeypatch.chdir(data.parent)  # where a backup would be
    os.truncate(data / CHAIN, LARGEST_LINES + 1)  # takes no room on the disk
    ran = here(*command, "--data", str(data))
    assert ran.exit_code == 2
    assert f"{CHAIN}: this file is too large" in ran.err
    with pytest.raises(RecordError, match="too large"):
        Store(data).create("D", SETUP, {})


@pytest.mark.parametrize("name", [CHAIN, INDEX])
def test_a_seal_is_not_finished_by_lines_beyond_all_bounds_and_they_are_not_read(data: Path, name: str) -> None:
    run = Store(data).create("D", SETUP, {})
    run.write_json(CONCLUDED, run.read_json("run.json"))
    (data / name).touch()
    os.truncate(data / name, LARGEST_LINES + 1)
    tracemalloc.start()
    try:
        with pytest.raises(RecordError, match=f"{name}: this file is too large"):
            finish_seal(run)
        assert tracemalloc.get_traced_memory()[1] < 16 << 20
    finally:
        tracemalloc.stop()
    assert run.has(CONCLUDED)


def test_a_run_that_was_begun_has_room_for_its_conclusion(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run, other = Store(data).create("D", SETUP, {}), Store(data).create("F", SETUP, {})
    monkeypatch.setattr("station.records.chain.writing.LARGEST_LINES", (data / CHAIN).stat().st_size + 1000)
    monkeypatch.setattr("station.records.chain.writing.ROOM_TO_CONCLUDE", 1000)
    with pytest.raises(RecordError, match="too large"):
        Store(data).create("E", SETUP, {})
    with pytest.raises(RecordError, match="too large"), writing_to(data) as chain:
        chain.append(REMOVED, run=run.id, serial="D", sha256="0", rule="r", person="p", trace="")
    seal(run, state="complete", verdict="PASS")
    assert [one.id for one in Store(data).runs()][-2] == run.id
    monkeypatch.setattr("station.records.chain.writing.LARGEST_LINES", (data / CHAIN).stat().st_size + 9)
    with pytest.raises(RecordError, match="too large"):  # or nobody could read the file any more
        seal(other, state="complete", verdict="PASS")


@pytest.mark.parametrize("ended", [True, False])
def test_a_sealed_run_json_that_waits_for_its_name_is_no_problem(data: Path, *, ended: bool) -> None:
    run = RunRecord(folder(data, 1))
    before = run.read_json("run.json")
    (run.folder / "run.json").rename(run.folder / CONCLUDED)
    desk = {"pid": os.getpid(), "birth": "gone" if ended else process_birth(os.getpid())}
    run.write_json("run.json", before | {"state": "recording", "verdict": None, "files": None, "desk": desk})
    for _ in range(2):
        with look_at(data) as view, view.database.reading() as connection:
            (found,) = runs_named(connection, view.chain, [run.id]).values()
        assert (view.problems, verify_folder(data).problems) == ([], [])
        assert ("lostmotion conclude" in found.altered) is ended
    assert row(run).verdict is None
    (run.folder / CONCLUDED).unlink()
    with look_at(data) as view:
        assert [(one.kind, one.run) for one in view.problems] == [("altered", run.id)]
