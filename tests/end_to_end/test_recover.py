"""The way back over real wires: a virtual bench that runs on by itself, a run torn off under torque, `recover`."""

from __future__ import annotations

import json
import os
import pty
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from controller.image import DriveCommand, State
from station.record.check import read_table

pytestmark = pytest.mark.wires
ROOT = Path(__file__).parents[2]
COMMAND = (sys.executable, "-m", "station")
RATED_NM = 412.0
ATTEMPTS = 3
ENABLING = {int(DriveCommand.SWITCH_ON), int(DriveCommand.ENABLE_OPERATION), int(DriveCommand.START_HOMING)}


def bench_apart(folder: Path) -> Path:
    """A bench file whose virtual bench is started by hand, on ports that are free now."""
    text = (
        (ROOT / "recipes" / "benches" / "virtual.yaml")
        .read_text(encoding="utf-8")
        .replace("name: virtual\n", "name: apart\n")
    )
    text = re.sub(r"  embedded: true.*\n", "", text)
    sockets = [socket.socket() for _ in range(4)]
    for number, item in zip((29536, 1502, 1503, 1504), sockets, strict=True):
        item.bind(("127.0.0.1", 0))
        text = text.replace(f"port: {number}\n", f"port: {item.getsockname()[1]}\n")
    for item in sockets:
        item.close()
    path = folder / "apart.yaml"
    path.write_text(text, encoding="utf-8")
    return path


class Apart:
    """A virtual bench that runs on by itself; `path` is its bench file."""

    def __init__(self, folder: Path) -> None:
        self.path = bench_apart(folder)
        self.start()

    def start(self) -> None:
        command = [*COMMAND, "virtual-bench", "--bench", str(self.path)]
        self.process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        assert json.loads(self.process.stdout.readline())["ready"]

    def stop(self) -> None:
        self.process.terminate()
        self.process.wait(10)
        self.process.stdout.close()


@pytest.fixture
def apart(tmp_path: Path) -> Iterator[Apart]:
    bench = Apart(tmp_path)
    yield bench
    bench.stop()


def recipe(folder: Path) -> Path:
    """The golden run's recipe at 1 ms, to a higher torque; the lock may open below 1 % of rated torque."""
    text = (ROOT / "tests" / "golden" / "golden.yaml").read_text(encoding="utf-8")
    for old, new in (
        ("period: 4 ms", "period: 1 ms"),
        ("max_torque: 3 %", "max_torque: 1 %"),
        ("  - calibrate: {peak_torque: 30 %, torque_rate: 300 N·m/s, dwell: 40 ms}\n", ""),
        ("metrics:\n  - {id: torque_ratio_slope}", "metrics:\n  - {id: windup}"),
        ("output_torque: reaction\n", "output_torque: reaction\n  reference_torque: 60 %\n"),
        ("peak_torque: 30 %, torque_rate: 300", "peak_torque: 80 %, torque_rate: 120"),
        ("torque_out_alarm: 36 %", "torque_out_alarm: 110 %"),
        ("torque_out_trip: 40 %", "torque_out_trip: 120 %"),
    ):
        assert old in text
        text = text.replace(old, new)
    path = folder / "recipe.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def newest(data: Path) -> Path:
    return max(data.glob("*/run.json")).parent


def torn_off(bench: Apart, folder: Path) -> Path:
    """Kill desk and scan above 200 N·m; the drive stops itself, and friction keeps the rest behind the lock."""
    args = ("run", str(recipe(folder)), "--bench", str(bench.path), "--serial", "W")
    for attempt in range(ATTEMPTS):
        data = folder / f"runs-{attempt}"
        command = [*COMMAND, *args, "--data", str(data)]
        desk = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        while desk.poll() is None:
            time.sleep(0.02)
            files = list(data.glob("*/samples.bin"))
            table = read_table(files[0]) if files else ()
            if len(table) and table[-1]["image"]["torque_out_nm"] > 200.0:
                scan = json.loads((newest(data) / "scan-report.json").read_bytes())["pid"]
                os.kill(scan, signal.SIGKILL)
                os.kill(desk.pid, signal.SIGKILL)
                desk.wait()
                return data
        bench.stop()  # a machine that stood still tripped the run before it came so far
        bench.start()
    pytest.fail(f"no run of {ATTEMPTS} came to 200 N·m")


def says_no(bench: Apart, data: Path) -> None:
    """A person who is asked and says no: everything stays as it is."""
    master, terminal = pty.openpty()
    process = subprocess.Popen(
        [*COMMAND, "recover", "--bench", str(bench.path), "--data", str(data)],
        cwd=ROOT, stdin=terminal, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    os.write(master, b"n\n")
    said, _ = process.communicate(timeout=60)
    os.close(master)
    os.close(terminal)
    assert process.returncode == 4, said
    assert "left as it is" in said
    assert "NOT RELEASED" in said
    table = read_table(newest(data / "recoveries") / "samples.bin")
    assert table["orders"]["state"][-1] == State.FAULT
    assert table["image"]["brake_on"][-1] == 1
    assert not set(table["orders"]["drive_command"]) & ENABLING


def test_recover_releases_a_unit_that_was_left_wound_up(apart, tmp_path):
    data = torn_off(apart, tmp_path)
    again = subprocess.run(
        [*COMMAND, "run", str(recipe(tmp_path)), "--serial", "X", "--json", "--bench", str(apart.path), "--data", data],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert again.returncode == 4
    refused = json.loads(again.stdout)
    assert refused["alarms"][0]["id"] == "brake_stays_closed"
    assert refused["left"]["lock"] == "closed", "another run leaves the lock as it found it"
    assert abs(refused["left"]["torque_nm"]) > 0.01 * RATED_NM

    says_no(apart, data)

    done = subprocess.run(
        [*COMMAND, "recover", "--bench", str(apart.path), "--data", str(data), "--yes", "--json"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "Traceback" not in done.stderr, done.stderr
    report = json.loads(done.stdout)
    assert (done.returncode, report["released"]) == (0, True), done.stderr
    for words in ("Torque at the output", "Lock                  closed", "Check:", "bringing the torque to zero"):
        assert words in done.stderr
    table = read_table(Path(report["record"]) / "samples.bin")
    assert table["orders"]["state"][-1] == State.STOPPED
    torque_nm = table["image"]["torque_out_nm"] - table["orders"]["torque_out_tare_nm"]
    assert abs(torque_nm[-1]) < 0.02 * RATED_NM
    opened = int(np.argmax(table["image"]["brake_on"] & (table["orders"]["brake_on"] == 0)))
    assert table["orders"]["state"][opened] == State.RELEASE
    assert abs(torque_nm[opened]) < 0.02 * RATED_NM
    assert table["image"]["brake_on"][-1] == 0
    replayed = subprocess.run([*COMMAND, "replay", report["record"]], cwd=ROOT, capture_output=True, check=False)
    assert replayed.returncode == 0, replayed.stdout

    nothing = subprocess.run([*COMMAND, "recover", "--bench", str(apart.path), "--data", str(data), "--yes"],
                             cwd=ROOT, capture_output=True, text=True, check=False)  # fmt: skip
    assert nothing.returncode == 0
    assert "nothing to take back" in nothing.stdout
