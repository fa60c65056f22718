"""Runs in virtual time that several test files look at: made once, by whichever worker needs one first."""

from __future__ import annotations

import fcntl
import json
import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from lostmotion_command import ROOT, Ran, here

os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
"""Before numpy is loaded: on small matrices a second thread only waits, and doubles the processor time of the fits."""


@dataclass(frozen=True)
class Stored:
    """A run that is there to be copied and never to be written to: its data folder, and what the command printed."""

    data: Path
    ran: Ran

    @property
    def record(self) -> Path:
        return self.ran.record

    def copy(self, folder: Path) -> Path:
        """Copy the data folder with its index; return the record in the copy."""
        return Path(shutil.copytree(self.data, folder)) / self.record.name


@pytest.fixture(scope="session")
def stored_once(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Stored]:
    """Run `lostmotion run ARGS` in virtual time into a folder of that name, unless another worker has done so."""
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base

    def make(name: str, *args: str) -> Stored:
        data, said = shared / f"{name}-runs", shared / f"{name}.json"
        with (shared / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not said.exists():
                ran = here("run", *args, "--virtual-time", "--json", "--data", str(data))
                said.write_text(json.dumps([ran.exit_code, ran.out, ran.err]), encoding="utf-8")
        return Stored(data, Ran(*json.loads(said.read_text(encoding="utf-8"))))

    return make


@pytest.fixture(scope="session")
def quick_run(stored_once: Callable[..., Stored]) -> Stored:
    """The shipped quick recipe with a good unit: PASS."""
    stored = stored_once("quick", "rv-40e-121-quick", "--serial", "SN 1", "--operator", "A. Tester")
    assert stored.ran.exit_code == 0, stored.ran
    return stored


@pytest.fixture(scope="session")
def shipped_run(stored_once: Callable[..., Stored], quick_run: Stored) -> Callable[[str], Stored]:
    """Run a shipped recipe, by its name, with the unit and the bench that it is for."""
    made = {"rv-40e-121-quick": quick_run}

    def run(name: str) -> Stored:
        return made.get(name) or stored_once(f"shipped-{name}", name, "--serial", "SN 1", "--no-report")

    return run


@pytest.fixture(scope="session")
def worn_run(stored_once: Callable[..., Stored]) -> Stored:
    """The shipped quick recipe with a worn unit: FAIL."""
    recipe = ROOT / "recipes" / "rv-40e-121-quick.yaml"
    return stored_once("worn", str(recipe), "--unit", "worn", "--serial", "W1")


@pytest.fixture(scope="session")
def golden_run(stored_once: Callable[..., Stored]) -> Stored:
    """The short recipe of the golden runs: nothing to decide by."""
    return stored_once("golden", str(ROOT / "tests" / "golden" / "golden.yaml"), "--serial", "R")
