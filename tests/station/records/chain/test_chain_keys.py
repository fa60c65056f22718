"""Whose key signs a chain, who believes it, and who may read the private one."""

from __future__ import annotations

import shutil
import stat
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from chain_folders import a_key, another_computer
from lostmotion_command import here
from run_copies import alone
from stored_runs import metric, store_run

from station.errors import RecordError
from station.own_place import PLACE
from station.records.chain.keys import FOLDER_KEYS, KEYS, PRIVATE, own_key, trust
from station.records.data_folder import Store
from station.records.seal import alterations
from station.records.verify import verify_folder
from station.run.run_list import row


@pytest.mark.parametrize("moved", [True, False])
def test_a_folder_is_verified_on_another_computer_by_its_public_key(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, moved: bool
) -> None:
    key = own_key().public
    away = tmp_path / "away"
    (shutil.move if moved else shutil.copytree)(str(data), str(away))
    assert verify_folder(away).problems == [], "on its own computer a moved folder is the same"
    another_computer(monkeypatch, tmp_path)
    known = verify_folder(away, (key,))
    assert (known.problems, known.trust.warning) == ([], "")
    unknown = verify_folder(away)
    assert unknown.problems == []
    assert key in unknown.trust.warning
    other = a_key().public
    assert [problem.kind for problem in verify_folder(away, (other,)).problems][:1] == ["unknown_key"]
    (away / FOLDER_KEYS).unlink()
    assert {row(run).verdict for run in Store(away).runs()} == {None}
    trust(key)
    assert [row(run).verdict for run in Store(away).runs()] == ["FAIL", "PASS", "PASS", "PASS"]


def test_two_computers_write_into_one_folder(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    another_computer(monkeypatch, tmp_path)
    theirs = store_run(data, "A", [metric(0.4)])
    second = own_key().public
    assert theirs.manifest().attempt == 3
    assert verify_folder(data).problems == [], "it has pinned the first key when it first wrote there"
    monkeypatch.setenv(PLACE, str(tmp_path / "place"))
    assert [problem.kind for problem in verify_folder(data, ()).problems if problem.run == ""] == ["unknown_key"]
    assert row(theirs).verdict is None
    trust(second)
    assert verify_folder(data).problems == []
    assert row(theirs).verdict == "PASS"


def test_the_key_of_the_bench_file_is_the_one_that_must_have_signed(data: Path) -> None:
    run = store_run(data, "D", [metric(0.1)])
    assert alterations(run) == ()
    bench = run.manifest().bench
    own = alone(run)
    own.update(bench=replace(bench, public_key=a_key().public))
    assert any("bench file" in one for one in alterations(store_run(data, "E", [], key=a_key().public)))


@pytest.mark.usefixtures("place")
def test_a_run_on_a_bench_file_of_another_key_is_refused(tmp_path: Path) -> None:
    shipped = Path(__file__).parents[4] / "recipes" / "benches" / "virtual.yaml"
    text = shipped.read_text(encoding="utf-8").replace("  revision: 1\n", "  revision: 1\n  public_key: KEY\n", 1)
    bench = tmp_path / "bench.yaml"
    for key, code in ((a_key().public, 2), ("ed25519:12", 2)):
        bench.write_text(text.replace("KEY", key), encoding="utf-8")
        ran = here("run", "rv-40e-121-quick", "--virtual-time", "--bench", str(bench), "--data", str(tmp_path / "d"))
        assert ran.exit_code == code
        assert "public_key" in ran.err
        assert not (tmp_path / "d").exists()


def test_the_private_key_is_the_services_alone(place: Path) -> None:
    own_key()
    path = place / KEYS / PRIVATE
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(place.stat().st_mode) == 0o700
    path.chmod(0o644)
    with pytest.raises(RecordError, match="chmod 600"):
        own_key()
    path.chmod(0o600)
    path.write_text("no key")
    with pytest.raises(RecordError, match="is not a private key"):
        own_key()


@pytest.mark.usefixtures("place")
def test_processes_that_start_at_once_make_one_key() -> None:
    with ThreadPoolExecutor(8) as pool:
        assert len({key.public for key in pool.map(lambda _: own_key(), range(8))}) == 1


def test_a_key_that_is_none_is_refused(data: Path) -> None:
    ran = here("verify", "--data", str(data), "--key", "x")
    assert ran.exit_code == 2
    assert "64 hexadecimal" in ran.err


@pytest.mark.usefixtures("place")
def test_the_key_command_prints_and_trusts() -> None:
    other = a_key().public
    ran = here("key", "--trust", other, "--json")
    assert ran.json["public_key"] == own_key().public
    assert ran.json["trusted"] == [other]
    assert own_key().public in here("key").out


def test_a_run_that_files_share_is_of_the_key_of_the_tests_whoever_asks_first(
    stored_once: Callable[..., Any], quarter: Callable[[str], str], tmp_path: Path
) -> None:
    with pytest.MonkeyPatch.context() as other:
        other.setenv("LOSTMOTION_STATE", str(tmp_path))
        shared = stored_once("shared-key", quarter("rv-40e-121-quick"), "--serial", "K", "--no-report")
    assert own_key().public in (shared.data / "chain.jsonl").read_text(encoding="utf-8")
