"""A pipe in place of a file of a record: it is named as damaged, nobody waits for it, and other runs work."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import Ran, here
from run_copies import copy_of, desert
from station_samples import SETUP

from station.atomic_file import (
    LARGEST_DOCUMENT,
    LARGEST_SMALL_FILE,
    Appender,
    append_line,
    open_handle,
    read_file,
    read_from_disk,
    reserve,
    write_atomic,
)
from station.errors import RecordError
from station.own_place import PLACE, own_folder
from station.records.archive_note import NOTE
from station.records.chain.chain_file import CHAIN
from station.records.chain.keys import FOLDER_KEYS, KEYS, PRIVATE, keys_in, own_key, own_public_key
from station.records.chain.old_index import INDEX
from station.records.data_folder import Store
from station.records.revisions.history import HISTORY
from station.records.run_lock import LOCK, RunLock
from station.records.run_record import RunRecord

HANGS_AFTER_S = 60


@pytest.fixture(autouse=True)
def _nobody_waits() -> Iterator[None]:
    """End a test that waits for a pipe: nobody will ever write to it."""

    def waited(*_: object) -> None:
        raise AssertionError("waited for a pipe")

    before = signal.signal(signal.SIGALRM, waited)
    signal.alarm(HANGS_AFTER_S)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def pipe_at(path: Path) -> Path:
    path.unlink(missing_ok=True)
    os.mkfifo(path)
    return path


def command(run: RunRecord, *words: str) -> Ran:
    return here(*words, "--data", str(run.folder.parent))


@pytest.fixture
def sealed(quick_run: Any, tmp_path: Path) -> RunRecord:
    return RunRecord(quick_run.copy(tmp_path / "data"))


@pytest.fixture
def deserted(quick_run: Any, tmp_path: Path) -> RunRecord:
    run = copy_of(quick_run.record, tmp_path / "data")
    desert(run, ring=tmp_path / "gone", report={"state": "finished", "written": run.records(), "lost": 0})
    return run


@pytest.mark.parametrize("name", ["recipe.yaml", "bench.yaml", "events.jsonl", "samples.parquet", "result.json"])
def test_in_a_concluded_run_it_is_an_alteration_and_ends_every_command_soon(
    sealed: RunRecord, name: str, tmp_path: Path
) -> None:
    out = str(tmp_path / "x.parquet")
    pipe_at(sealed.folder / name)
    shown = command(sealed, "show", "last")
    assert shown.exit_code == 3, shown
    assert f"{name}: is missing or cannot be read" in shown.out
    named = [(word, "last") for word in ("report", "replay", "analyze")]
    for words in (*named, ("export", "last", "--out", out), ("list",)):
        told = command(sealed, *words)
        assert told.exit_code != 70, told
        assert "PASS" not in told.out or "altered" in told.out, told


@pytest.mark.parametrize("name", ["samples.bin", "recipe.yaml", "bench.yaml", "program.json", "samples.json", LOCK])
def test_in_a_run_that_is_not_concluded_it_decides_nothing(deserted: RunRecord, name: str) -> None:
    pipe_at(deserted.folder / name)
    assert command(deserted, "list").exit_code == 0
    assert command(deserted, "show", "last").exit_code in (0, 2)
    told = command(deserted, "conclude", "--all")
    assert told.exit_code == 1, told
    assert f"could not be concluded: {deserted.folder / name}: " in told.out
    assert deserted.manifest().state == "recording"


def test_the_next_run_on_the_bench_does_not_wait_for_it(deserted: RunRecord, quarter: Callable[[str], str]) -> None:
    pipe_at(deserted.samples)
    told = command(deserted, "run", quarter("rv-40e-121-quick"), "--serial", "N", "--virtual-time", "--no-report")
    assert told.exit_code == 0, told
    assert f"run {deserted.id} cannot be evaluated now: {deserted.samples}: cannot be read" in told.out + told.err


@pytest.mark.parametrize("how", ["pipe", "large"])
def test_a_private_key_that_is_none_by_its_file_is_not_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    monkeypatch.setenv(PLACE, str(tmp_path))
    path = own_folder(KEYS) / PRIVATE
    if how == "pipe":
        os.mkfifo(path, 0o600)
    else:
        path.touch(0o600)
        os.truncate(path, LARGEST_SMALL_FILE + 1)
    with pytest.raises(RecordError, match=f"{PRIVATE}: cannot be read: {'.*a pipe' if how == 'pipe' else '.*larger'}"):
        own_key()
    assert own_public_key() is None


def test_a_list_of_keys_and_a_file_have_a_bound_of_what_is_read(tmp_path: Path) -> None:
    path = tmp_path / FOLDER_KEYS
    path.write_text(f"ed25519:{'0' * 64}\n", encoding="utf-8")
    assert keys_in(path)
    os.truncate(path, LARGEST_SMALL_FILE + 1)
    assert keys_in(path) == []
    os.truncate(path, LARGEST_DOCUMENT + 1)
    with pytest.raises(RecordError, match="larger than 256 MB"):
        read_file(path)


def test_an_index_that_is_a_pipe_begins_no_chain(tmp_path: Path) -> None:
    pipe_at(tmp_path / INDEX)
    with pytest.raises(RecordError, match=f"{INDEX}: cannot be read"):
        Store(tmp_path).create("U", SETUP, {})
    assert not (tmp_path / CHAIN).exists()


@pytest.mark.parametrize("how", ["folder", "pipe", "link loop"])
@pytest.mark.parametrize(("name", "kind"), [(HISTORY, "recipes"), (NOTE, "archive")])
def test_one_file_beside_the_runs_ends_no_look_at_them(sealed: RunRecord, name: str, kind: str, how: str) -> None:
    path = sealed.folder.parent / name
    if how == "link loop":
        path.symlink_to(name)
    else:
        (os.mkfifo if how == "pipe" else os.mkdir)(path)
    told = command(sealed, "verify", "--json")
    assert told.exit_code == 1, told
    assert kind in [one["kind"] for one in told.json["problems"]]
    rebuilt, listed = command(sealed, "store", "rebuild"), command(sealed, "list")
    assert (f"WARNING  {path}: cannot be read" in rebuilt.err) is (kind == "archive"), rebuilt
    assert (rebuilt.exit_code, listed.exit_code, "PASS" in listed.out) == (0, 0, True), listed


def test_keys_that_are_a_pipe_keep_a_run_from_its_start(sealed: RunRecord) -> None:
    path = pipe_at(sealed.folder.parent / FOLDER_KEYS)
    with pytest.raises(RecordError, match=f"{path}: cannot be written: .*a pipe"):
        Store(path.parent).create("U", SETUP, {})


def test_a_lock_that_is_a_pipe_has_no_owner(tmp_path: Path) -> None:
    pipe_at(tmp_path / LOCK)
    lock = RunLock(tmp_path)
    assert not lock.taken()
    with pytest.raises(RecordError, match="a pipe"):
        lock.take()


def test_no_file_is_read_from_or_written_to_a_pipe(tmp_path: Path) -> None:
    path = pipe_at(tmp_path / "x")
    pipe_at(tmp_path / ".y.part")
    for deed in (
        lambda: read_from_disk(path),
        lambda: append_line(path, b"x"),
        lambda: Appender(path),
        lambda: write_atomic(tmp_path / "y", b"x"),
    ):
        with pytest.raises(RecordError, match="cannot be"):
            deed()
    pipe_at(tmp_path / ".y.part")
    with pytest.raises(RecordError, match="cannot be written"):
        reserve(tmp_path / "y", 10)
    with pytest.raises(OSError, match="a pipe"):
        open_handle(path, os.O_RDONLY)
