"""A run folder that cannot be read, for want of rights or by a failing disk: it is named, and all others work."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from ended_runs import bench_of, ended
from lostmotion_command import here
from station_samples import SETUP

from station.errors import RecordError
from station.records.attempts import earlier_attempts
from station.records.certificate_code import code_of
from station.records.chain.chain_file import CHAIN, Chain
from station.records.chain.old_index import INDEX
from station.records.data_folder import Store
from station.records.run_folders import is_run
from station.records.run_record import RunRecord
from station.run.way_back.last_run import last_run_of, why_not_free

KeepBack = Callable[[Path], None]
ASKED = ("stat", "lstat", "open", "listdir", "scandir", "replace", "truncate")


@pytest.fixture(params=["EACCES", "EIO", "ESTALE"])
def keep_back(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> KeepBack:
    """Let the system refuse whatever is asked of a folder; root would be refused nothing by its rights."""
    number = int(getattr(errno, request.param))

    def kept(folder: Path) -> None:
        def refusing(real: Callable[..., Any]) -> Callable[..., Any]:
            def call(path: Any = ".", *args: Any, **named: Any) -> Any:
                below = not isinstance(path, int) and f"/{os.fsdecode(path)}/".partition(f"/{folder.name}/")[1:]
                itself = below and below[0] and not below[1].strip("/")
                # Of a folder without rights everybody may know that it is there.
                if below and below[0] and not (itself and number == errno.EACCES and real is asked["stat"]):
                    raise OSError(number, os.strerror(number), os.fsdecode(path))
                return real(path, *args, **named)

            return call

        asked = {name: getattr(os, name) for name in ASKED}
        for name, real in asked.items():
            monkeypatch.setattr(os, name, refusing(real))

    return kept


@pytest.fixture
def data(quick_run: Any, tmp_path: Path) -> Path:
    """A data folder with a unit that passed."""
    return Path(quick_run.copy(tmp_path / "data")).parent


@pytest.fixture
def deserted(data: Path) -> RunRecord:
    """A run that was begun last, and that no process owns."""
    run = Store(data).create("D1", SETUP, {"recipe.yaml": b"x", "bench.yaml": b"x"})
    run.update(desk={"pid": 1, "birth": "gone"})
    return run


def test_what_looks_names_it_and_shows_all_others(data: Path, deserted: RunRecord, keep_back: KeepBack) -> None:
    keep_back(deserted.folder)
    listed = here("list", "--data", str(data), "--json")
    assert listed.exit_code == 0, listed
    states = {row["run"]: row["state"] for row in listed.json}
    assert states.pop(deserted.id) == "damaged"
    assert list(states.values()) == ["complete"]
    assert "missing" not in listed.err
    shown = here("show", "SN 1", "--data", str(data), "--json")
    assert (shown.exit_code, shown.json["verdict"]) == (0, "PASS")
    checked = here("verify", "--quick", "--data", str(data), "--json")
    assert checked.exit_code == 1, checked
    assert [(one["kind"], one["run"]) for one in checked.json["problems"] if one["run"]] == [("damaged", deserted.id)]


@pytest.mark.parametrize("command", ["show", "report", "resume", "conclude", "replay", "export", "analyze"])
def test_who_asks_for_it_is_told_which_file_cannot_be_read(
    data: Path, deserted: RunRecord, keep_back: KeepBack, command: str
) -> None:
    keep_back(deserted.folder)
    told = here(command, deserted.id, "--data", str(data))
    assert told.exit_code in (1, 2), told
    assert f"{deserted.id}/run.json: cannot be read" in told.out + told.err


def test_others_are_measured_exported_concluded_and_put_into_the_store(
    data: Path, deserted: RunRecord, keep_back: KeepBack, quarter: Callable[[str], str], tmp_path: Path
) -> None:
    recipe = quarter("rv-40e-121-quick")
    keep_back(deserted.folder)
    for words in (
        ("export", "SN 1", "--out", str(tmp_path / "x.parquet")),
        ("report", "SN 1", "--out", str(tmp_path)),
        ("store", "rebuild"),
    ):
        told = here(*words, "--data", str(data))
        assert told.exit_code == 0, told
    concluded = here("conclude", "--all", "--data", str(data))
    assert concluded.exit_code == 1, concluded
    assert f"run {deserted.id} could not be concluded" in concluded.out
    ran = here("run", recipe, "--serial", "NEW", "--virtual-time", "--no-report", "--data", str(data))
    assert ran.exit_code == 0, ran


def test_a_backup_without_it_would_be_none(
    data: Path, deserted: RunRecord, keep_back: KeepBack, tmp_path: Path
) -> None:
    keep_back(deserted.folder)
    told = here("backup", str(tmp_path / "b.tar"), "--data", str(data))
    assert told.exit_code == 2, told
    assert deserted.id in told.err
    assert not (tmp_path / "b.tar").exists()


def test_a_bench_whose_last_run_cannot_be_read_is_not_free(
    data: Path, deserted: RunRecord, keep_back: KeepBack
) -> None:
    job = SimpleNamespace(
        bench=SimpleNamespace(bench=SimpleNamespace(name="b", embedded=True)), bench_source=SimpleNamespace(sha256="0")
    )
    keep_back(deserted.folder)
    last = last_run_of(data, job)
    assert last is not None
    assert last.id == deserted.id
    assert "cannot be read" in why_not_free(data, last, "Recover it.")


def test_it_counts_as_an_attempt(tmp_path: Path, keep_back: KeepBack) -> None:
    """Also in a folder whose chain does not know it."""
    store = Store(tmp_path)
    known = ended(tmp_path, "U", "FAIL", setup=bench_of("b"))
    keep_back(tmp_path / known)
    assert [one.verdict for one in earlier_attempts(tmp_path, store.named_by("U"), "U")] == ["FAIL"]
    (tmp_path / CHAIN).unlink()
    assert [run.id for run in store.named_by("U")] == [known]
    assert store._next_attempt("U", store._names(), Chain(tmp_path)) == 2


def test_the_next_run_begins_behind_one_whose_start_was_cut_short(tmp_path: Path, keep_back: KeepBack) -> None:
    first = Store(tmp_path).create("U", SETUP, {})
    keep_back(first.folder)
    second = Store(tmp_path).create("V", SETUP, {})
    assert second.has("run.json")
    assert [run.id for run in Store(tmp_path).runs()] == [first.id, second.id]


def test_a_folder_that_is_not_named_as_a_run_is_none(tmp_path: Path, keep_back: KeepBack) -> None:
    folder = tmp_path / "lost+found"
    folder.mkdir()
    keep_back(folder)
    assert not is_run(folder)
    assert Store(tmp_path).runs() == []


def test_an_index_that_cannot_be_read_begins_no_chain(tmp_path: Path, keep_back: KeepBack) -> None:
    (tmp_path / INDEX).write_bytes(b"x")
    keep_back(tmp_path / INDEX)
    with pytest.raises(RecordError, match=f"{INDEX}: cannot be read"):
        Store(tmp_path).create("U", SETUP, {})
    assert not Chain(tmp_path).there


def test_a_huge_file_in_place_of_a_document_is_damaged_and_stops_nobody(data: Path, deserted: RunRecord) -> None:
    os.truncate(deserted.folder / "run.json", 1 << 40)  # a hole: it takes no room, and no memory could hold it
    states = {row["run"]: row["state"] for row in here("list", "--data", str(data), "--json").json}
    assert states.pop(deserted.id) == "damaged"
    assert list(states.values()) == ["complete"]
    checked = here("verify", "--data", str(data), "--json")
    assert [(one["kind"], one["run"]) for one in checked.json["problems"] if one["run"]] == [("damaged", deserted.id)]
    for kept in (deserted.manifest, lambda: deserted.read_json("run.json"), lambda: code_of(deserted)):
        with pytest.raises(RecordError, match=r"run\.json: cannot be read: this file is larger than 256 MB"):
            kept()
