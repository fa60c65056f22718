from __future__ import annotations

import json
import os
import stat
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.config import CanConfig
from recipes import load_bench
from station.bench.assemble import can_config
from station.bench.bench_lock import BenchBusyError, alone_on, lock_path
from station.own_place import PLACE

ROOT = Path(__file__).parents[3]


NAME = "bench 1"


def _can() -> CanConfig:
    return can_config(load_bench("example-socketcan"))


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PLACE, str(tmp_path / "own"))


def test_a_bench_has_one_controller_at_a_time() -> None:
    can = _can()
    with (
        alone_on(NAME, can),
        pytest.raises(BenchBusyError, match=f"in use by process {os.getpid()}"),
        alone_on(NAME, can),
    ):
        pass
    with alone_on(NAME, can):
        pass


def test_other_wires_are_another_bench() -> None:
    can = _can()
    other = replace(can, port=can.port + 1)
    assert lock_path(can) != lock_path(other)
    with alone_on(NAME, can), alone_on(NAME, other):
        pass


def test_no_other_user_can_hold_the_lock() -> None:
    can = _can()
    with alone_on(NAME, can):
        path = lock_path(can)
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700


def test_a_place_that_others_may_enter_is_refused() -> None:
    can = _can()
    with alone_on(NAME, can):
        pass
    lock_path(can).parent.chmod(0o755)
    with pytest.raises(BenchBusyError, match="mode 0755; allowed is 0700"), alone_on(NAME, can):
        pass


def test_a_link_in_place_of_the_lock_is_followed_by_nobody(tmp_path: Path) -> None:
    can, target = _can(), tmp_path / "target"
    target.write_text("as it was")
    lock_path(can).symlink_to(target)
    with pytest.raises(BenchBusyError, match="cannot be opened"), alone_on(NAME, can):
        pass
    assert target.read_text() == "as it was"


@pytest.mark.wires
def test_a_second_run_on_a_bench_is_refused(tmp_path: Path) -> None:
    with alone_on(NAME, _can()):
        words = ["run", "rv-40e-121-quick", "--serial", "SN1", "--bench", "example-socketcan", "--json"]
        words += ["--data", str(tmp_path)]
        done = subprocess.run(
            [sys.executable, "-m", "station", *words], cwd=ROOT, text=True, capture_output=True, check=False
        )
    assert done.returncode == 4, done.stderr
    result = json.loads(done.stdout)
    assert result["verdict"] == "NOT DECIDABLE"
    assert f"in use by process {os.getpid()}" in " ".join(result["reasons"])
