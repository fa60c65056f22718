from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import station.bench.bench_lock
from recipes import load_bench
from station.bench.bench_lock import BenchBusyError, alone_on, lock_path

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(station.bench.bench_lock, "SHARED_MEMORY", tmp_path)


def test_a_bench_has_one_controller_at_a_time() -> None:
    bench = load_bench("example-socketcan")
    with alone_on(bench), pytest.raises(BenchBusyError, match=f"in use by process {os.getpid()}"), alone_on(bench):
        pass
    with alone_on(bench):
        pass


def test_other_wires_are_another_bench() -> None:
    bench = load_bench("example-socketcan")
    other = bench.model_copy(update={"can": bench.can.model_copy(update={"port": bench.can.port + 1})})
    assert lock_path(bench) != lock_path(other)
    with alone_on(bench), alone_on(other):
        pass


@pytest.mark.wires
def test_a_second_run_on_a_bench_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()  # the run looks in the real place
    with alone_on(load_bench("example-socketcan")):
        words = ["run", "rv-40e-121-quick", "--serial", "SN1", "--bench", "example-socketcan", "--json"]
        words += ["--data", str(tmp_path)]
        done = subprocess.run(
            [sys.executable, "-m", "station", *words], cwd=ROOT, text=True, capture_output=True, check=False
        )
    assert done.returncode == 4, done.stderr
    result = json.loads(done.stdout)
    assert result["verdict"] == "NOT DECIDABLE"
    assert f"in use by process {os.getpid()}" in " ".join(result["reasons"])
