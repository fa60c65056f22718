"""Looking at runs decides nothing, whatever comes and goes meanwhile; `conclude` does, and can be tried again."""

from __future__ import annotations

import hashlib
import os
import shutil
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import here
from run_copies import desert

from station.records.ring.ring import W_PID, W_READ, W_WRITTEN, create
from station.records.ring.writer import RingWriter
from station.records.run_record import RunRecord
from station.records.samples.scan_record import RECORD_BYTES, unpack

LOOKS = 100
COMES_AND_GOES = ("recipe.yaml", "bench.yaml", "samples.bin", "program.json", "scan-report.json")
WAITING = 50


@pytest.fixture
def deserted(golden_run: Any, tmp_path: Path) -> RunRecord:
    """A run whose supervisor died when all was on disk, beside one that was concluded."""
    data = golden_run.copy(tmp_path / "runs").parent
    run = RunRecord(data / f"{golden_run.record.name}-deserted")
    shutil.copytree(golden_run.record, run.folder)
    run.write_json("run.json", run.read_json("run.json") | {"id": run.id})
    report = {"state": "finished", "written": run.records(), "lost": 0, "realtime": {"details": {}}}
    desert(run, ring=tmp_path / "gone", report=report)
    return run


@pytest.fixture
def waiting(deserted: RunRecord, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RunRecord:
    """The same with its last records in the ring alone."""
    monkeypatch.setattr("station.records.ring.ring.SHARED_MEMORY", tmp_path)
    content, written = deserted.samples.read_bytes(), deserted.records()
    ring = create(tmp_path, 4 * WAITING, run=deserted.folder)
    writer = RingWriter(ring)
    writer.sequence = writer._words[W_WRITTEN] = writer._words[W_READ] = written - WAITING
    for number in range(written - WAITING, written):
        assert writer.append(*_header(content, number), *unpack(content[number * RECORD_BYTES :])[1:])
    writer._words[W_PID] = 0
    writer.close()
    deserted.samples.write_bytes(content[: (written - WAITING) * RECORD_BYTES])
    deserted.update(ring=str(ring))
    return deserted


def _header(content: bytes, number: int) -> tuple[int, int, int]:
    return unpack(content[number * RECORD_BYTES :])[0], 0, 0


def everything(data: Path) -> dict[str, str]:
    """Return every file of the runs and their chain with its content; the store is a copy, made by whoever looks."""
    files = (path for path in sorted(data.rglob("*")) if path.is_file() and not path.name.startswith("store.sqlite3"))
    return {str(path.relative_to(data)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def looks(run: RunRecord, out: Path) -> list[Callable[[], Any]]:
    data = ("--data", str(run.folder.parent))
    return [
        lambda: here("list", *data, "--json"),
        lambda: here("show", run.id, *data),
        lambda: here("analyze", run.id, *data, "--json"),
        lambda: here("export", run.id, *data, "--out", str(out)),
        lambda: here("replay", run.id, *data, "--json"),
        lambda: here("report", run.id, *data),
        lambda: here("capability", "--metric", "lost_motion", *data),
        lambda: here("units", "--metric", "lost_motion", *data),
    ]


def test_looking_a_hundred_times_while_files_come_and_go_changes_no_byte(deserted: RunRecord, tmp_path: Path) -> None:
    before, ended = everything(deserted.folder.parent), threading.Event()
    aside = tmp_path / "aside"
    aside.mkdir()
    moved = 0

    def come_and_go() -> None:
        nonlocal moved
        while not ended.is_set():
            for name in COMES_AND_GOES:
                (deserted.folder / name).rename(aside / name)
                ended.wait(0.01)
                (aside / name).rename(deserted.folder / name)
                moved += 1

    mover = threading.Thread(target=come_and_go)
    mover.start()
    try:
        kinds = looks(deserted, tmp_path / "out.parquet")
        for number in range(LOOKS):
            # every second one is the list: it is what a line looks at, and what decided for every run
            assert (kinds[0] if number % 2 else kinds[number // 2 % len(kinds)])().exit_code in (0, 1, 2, 3, 4)
    finally:
        ended.set()
        mover.join()
    assert moved >= LOOKS // 10, "hardly anything came and went"
    assert everything(deserted.folder.parent) == before
    assert here("conclude", deserted.id, "--data", str(deserted.folder.parent)).exit_code == 0
    assert deserted.manifest().state == "complete"


def test_a_run_that_was_left_is_shown_as_what_it_is_with_its_samples_and_its_ring(waiting: RunRecord) -> None:
    data, on_disk = str(waiting.folder.parent), waiting.records()
    before = everything(waiting.folder.parent)
    ring = Path(waiting.manifest().ring)
    shown = here("show", waiting.id, "--data", data, "--json").json
    assert (shown["state"], shown["verdict"]) == ("not concluded", "NOT DECIDABLE")
    assert (shown["records"], shown["waiting"]) == (on_disk, WAITING)
    assert f"lostmotion conclude {waiting.id}" in shown["reasons"][0]
    listed = here("list", "--data", data)
    assert f"not evaluated yet: 1. 'lostmotion conclude --all --data {data}'" in listed.out
    assert here("report", waiting.id, "--data", data).exit_code == 2
    assert everything(waiting.folder.parent) == before
    assert ring.exists()
    ran = here("conclude", "--all", "--data", data, "--json")
    assert ran.exit_code == 0
    (row,) = ran.json["runs"]
    assert (row["run"], row["outcome"], row["records_brought"]) == (waiting.id, "concluded", WAITING)
    assert not ring.exists()
    assert waiting.records() == on_disk + WAITING


@pytest.mark.parametrize("name", ["recipe.yaml", "bench.yaml", "samples.bin", "program.json"])
def test_what_is_not_there_now_decides_nothing_and_conclude_is_tried_again(
    waiting: RunRecord, name: str, tmp_path: Path
) -> None:
    words = ("conclude", waiting.id, "--data", str(waiting.folder.parent))
    (waiting.folder / name).rename(tmp_path / name)
    refused = here(*words)
    assert refused.exit_code == 1
    assert f"{name}: cannot be read: No such file or directory" in refused.out
    assert waiting.manifest().state == "recording"
    assert not waiting.has(name)
    (tmp_path / name).rename(waiting.folder / name)
    assert here(*words).exit_code == 0
    assert waiting.manifest().state == "complete"
    assert waiting.read_json("result.json")["timing"]["scans"] == waiting.records()


@pytest.mark.parametrize("number", [24, 13, 5])
def test_a_file_that_cannot_be_opened_now_decides_nothing(
    deserted: RunRecord, number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    honest = os.open

    def refused(path: Any, *words: Any, **how: Any) -> int:
        if os.fspath(path).endswith("bench.yaml"):
            raise OSError(number, "refused")
        return honest(path, *words, **how)

    with monkeypatch.context() as patched:
        patched.setattr(os, "open", refused)
        assert here("conclude", deserted.id, "--data", str(deserted.folder.parent)).exit_code == 1
    assert deserted.manifest().state == "recording"
    assert here("conclude", deserted.id, "--data", str(deserted.folder.parent)).exit_code == 0
    assert deserted.manifest().state == "complete"


def test_a_recipe_that_is_put_right_gives_its_run_the_result_after_all(waiting: RunRecord) -> None:
    words = ("conclude", waiting.id, "--data", str(waiting.folder.parent), "--json")
    whole = (waiting.folder / "recipe.yaml").read_bytes()
    (waiting.folder / "recipe.yaml").write_bytes(b"junk {")
    (row,) = here(*words).json["runs"]
    assert (row["outcome"], row["state"], row["verdict"]) == ("interrupted", "interrupted", None)
    assert "junk" in row["error"] or "recipe.yaml" in row["error"]
    (waiting.folder / "recipe.yaml").write_bytes(whole)
    assert here("conclude", "--all", "--data", str(waiting.folder.parent), "--json").json["runs"] == []
    (row,) = here(*words).json["runs"]
    assert (row["outcome"], row["state"]) == ("concluded", "complete")
    assert waiting.read_json("result.json")["timing"]["scans"] == waiting.records()


def test_conclude_wants_a_run_or_all() -> None:
    for words in ((), ("last", "--all")):
        assert here("conclude", *words).exit_code == 2


def test_a_run_that_starts_concludes_those_of_its_own_bench_and_says_so(deserted: RunRecord) -> None:
    data = str(deserted.folder.parent)
    recipe = str(deserted.folder / "recipe.yaml")
    ran = here("run", recipe, "--serial", "N", "--virtual-time", "--no-report", "--data", data)
    assert f"run {deserted.id} was evaluated afterwards, because its supervisor process had ended: complete" in ran.err
    assert deserted.manifest().state == "complete"


def test_a_run_that_starts_leaves_those_of_another_bench(deserted: RunRecord) -> None:
    deserted.update(bench=replace(deserted.manifest().bench, name="another"))
    recipe = str(deserted.folder / "recipe.yaml")
    ran = here("run", recipe, "--serial", "N", "--virtual-time", "--no-report", "--data", str(deserted.folder.parent))
    assert deserted.id not in ran.err
    assert deserted.manifest().state == "recording"
