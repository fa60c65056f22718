"""Runs the command as a person does: another process, real sockets on loopback, records in a folder of the test."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
COMMAND = (sys.executable, "-m", "station")


@dataclass(frozen=True)
class Ran:
    """What a command left: exit code, what it printed, its JSON object when it printed one."""

    exit_code: int
    out: str
    err: str

    @property
    def json(self) -> dict[str, Any]:
        return json.loads(self.out)

    @property
    def record(self) -> Path:
        return Path(self.json["record"])

    def log(self, name: str) -> list[dict[str, Any]]:
        return [json.loads(line) for line in (self.record / name).read_text(encoding="utf-8").splitlines()]


class Running:
    """A command that is under way, with the run folder that it writes."""

    def __init__(self, args: tuple[str, ...], data: Path) -> None:
        self.data = data
        self.process = subprocess.Popen(
            [*COMMAND, *args],
            cwd=ROOT,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )

    def wait_for(self, condition: Callable[[], bool], most_s: float = 40.0) -> None:
        end = time.monotonic() + most_s
        while not condition():
            assert time.monotonic() < end, "the moment did not come"
            assert self.process.poll() is None, self.process.communicate()
            time.sleep(0.05)

    def interrupt(self) -> None:
        """Ctrl-C as a terminal sends it: to the whole foreground group."""
        os.killpg(self.process.pid, signal.SIGINT)

    def finish(self, most_s: float = 60.0) -> Ran:
        out, err = self.process.communicate(timeout=most_s)
        return Ran(self.process.returncode, out, err)


@pytest.fixture
def lostmotion(tmp_path: Path) -> Callable[..., Ran]:
    """Run `lostmotion ARGS` to its end; `run` and `list` store below the test's folder."""

    def run(*args: str, most_s: float = 150.0) -> Ran:
        data = ("--data", str(tmp_path)) if args[0] in ("run", "list", "show") else ()
        done = subprocess.run(
            [*COMMAND, *args, *data], cwd=ROOT, text=True, capture_output=True, timeout=most_s, check=False
        )
        assert "Traceback" not in done.stderr, done.stderr
        return Ran(done.returncode, done.stdout, done.stderr)

    return run


@pytest.fixture(scope="session")
def golden_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of the short recipe of the golden runs in virtual time, made once; not to be written to."""
    data = tmp_path_factory.mktemp("golden")
    args = ("run", str(ROOT / "tests" / "golden" / "golden.yaml"), "--virtual-time", "--json", "--serial", "R")
    done = subprocess.run(
        [*COMMAND, *args, "--data", str(data)], cwd=ROOT, text=True, capture_output=True, timeout=150.0, check=False
    )
    return Path(json.loads(done.stdout)["record"])


@pytest.fixture
def stored(golden_run: Path, tmp_path: Path) -> Path:
    """A copy of that run, with its index, in a folder of the test's own."""
    return Path(shutil.copytree(golden_run.parent, tmp_path / "runs")) / golden_run.name


@pytest.fixture
def start(tmp_path: Path) -> Callable[..., Running]:
    """Start `lostmotion run ARGS` and go on."""
    started: list[Running] = []

    def begin(*args: str) -> Running:
        started.append(Running((*args, "--data", str(tmp_path)), tmp_path))
        return started[-1]

    yield begin
    for item in started:
        if item.process.poll() is None:
            os.killpg(item.process.pid, signal.SIGKILL)
            item.process.wait()


@pytest.fixture
def short_recipe(tmp_path: Path) -> str:
    """One cycle to 60 % of rated torque without calibration: about 18 s of bench time."""
    text = (ROOT / "recipes" / "rv-40e-121-quick.yaml").read_text(encoding="utf-8")
    for old, new in (
        ("  - calibrate: {peak_torque: 110 %, torque_rate: 120 N·m/s, dwell: 100 ms}\n", ""),
        ("count: 1, peak_torque: 110 %, torque_rate: 120", "count: 1, peak_torque: 60 %, torque_rate: 150"),
        ("  - {id: torque_ratio_slope}\n  - {id: torque_ratio_offset, min: -25 N·m}\n", ""),
        ("output_torque: reaction\n", "output_torque: reaction\n  reference_torque: 60 %\n"),
        ("name: rv-40e-121-quick", "name: short"),
    ):
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "short.yaml"
    path.write_text(text, encoding="utf-8")
    return str(path)
