"""The lock of a data folder: for its owner or its group alone, and waited for with an end."""

from __future__ import annotations

import fcntl
import os
import stat
from pathlib import Path

import pytest
from chain_folders import lines
from station_samples import SETUP

from station.errors import RecordError
from station.records.chain import folder_lock
from station.records.chain.folder_lock import LOCK, held
from station.records.data_folder import Store
from station.records.run_record import RunRecord
from station.records.seal import is_sealed, seal
from station.records.verify import verify_folder


def rights(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


@pytest.fixture
def held_by_another(data: Path, monkeypatch: pytest.MonkeyPatch) -> int:
    """The handle of somebody who holds the lock and never lets go; one try is made to get it."""
    monkeypatch.setattr(folder_lock, "LONGEST_WAIT_S", 0.0)
    handle = os.open(data / LOCK, os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)
    return handle


@pytest.mark.parametrize(("folder", "lock"), [(0o755, 0o600), (0o700, 0o600), (0o775, 0o660), (0o2770, 0o660)])
@pytest.mark.parametrize("there", [None, 0o644, 0o666])
def test_the_lock_is_for_who_may_write_to_the_folder(tmp_path: Path, folder: int, lock: int, there: int | None) -> None:
    tmp_path.chmod(folder)
    if there is not None:
        (tmp_path / LOCK).touch()
        (tmp_path / LOCK).chmod(there)
    with held(tmp_path):
        assert rights(tmp_path / LOCK) == lock


def test_the_lock_of_another_user_keeps_its_rights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / LOCK).touch()
    (tmp_path / LOCK).chmod(0o664)
    monkeypatch.setattr(os, "geteuid", lambda: (tmp_path / LOCK).stat().st_uid + 1)
    with held(tmp_path):
        assert rights(tmp_path / LOCK) == 0o664


def test_a_run_is_not_begun_while_somebody_keeps_the_lock(data: Path, held_by_another: int) -> None:
    before, whole = sorted(data.iterdir()), lines(data)
    with pytest.raises(RecordError, match=r"\.lock: another process keeps this file locked.*fuser"):
        Store(data).create("D", SETUP, {})
    assert (sorted(data.iterdir()), lines(data)) == (before, whole)
    os.close(held_by_another)
    Store(data).create("D", SETUP, {})
    assert verify_folder(data).problems == []


def test_a_run_that_cannot_be_sealed_has_no_verdict_and_is_sealed_later(
    data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = RunRecord(Store(data).create("D", SETUP, {}).folder)
    monkeypatch.setattr(folder_lock, "LONGEST_WAIT_S", 0.0)
    handle = os.open(data / LOCK, os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)
    whole = lines(data)
    with pytest.raises(RecordError, match="lostmotion conclude"):
        seal(run, state="stopped", verdict="NOT DECIDABLE")
    assert not is_sealed(run.manifest())
    assert (run.manifest().verdict, lines(data)) == (None, whole)
    os.close(handle)
    seal(run, state="stopped", verdict="NOT DECIDABLE")
    assert is_sealed(run.manifest())
    assert len(lines(data)) == len(whole) + 1
