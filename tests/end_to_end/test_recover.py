"""The recovery over real wires: a virtual bench that runs on by itself, a run torn off under torque, `recover`."""

from __future__ import annotations

import json
import os
import pty
import signal
import socket
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from lostmotion_command import COMMAND, ROOT, Running, here
from patient import ONE_RAMP, Changes, patient_bench, short_recipe
from run_samples import records_of

from definitions.image import DriveCommand, State

pytestmark = pytest.mark.wires
RATED_NM = 412.0
HELD: Changes = {
    "sequence": [
        *ONE_RAMP["sequence"][:2],
        {"torque_cycles": {"count": 1, "peak_torque": "80 %", "torque_rate": "250 N·m/s", "dwell": "30 s"}},
        *ONE_RAMP["sequence"][3:],
    ]
}
"""The bench keeps real time here: however late a busy computer looks, the torque is still there to be torn off."""
ENABLING = {int(DriveCommand.SWITCH_ON), int(DriveCommand.ENABLE_OPERATION), int(DriveCommand.START_HOMING)}


def bench_apart(folder: Path) -> Path:
    """A bench file whose virtual bench is started by hand, on ports that are free now."""
    sockets = [socket.socket() for _ in range(4)]
    ports = {}
    for part, item in zip(("can", "amplifier", "brake", "remote_io"), sockets, strict=True):
        item.bind(("127.0.0.1", 0))
        ports[part] = {"port": item.getsockname()[1]}
    for item in sockets:
        item.close()
    return patient_bench(folder, {"bench": {"name": "apart", "embedded": False}}, ports)


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
def stands_apart(tmp_path: Path) -> Iterator[Apart]:
    bench = Apart(tmp_path)
    yield bench
    bench.stop()


def newest(data: Path) -> Path:
    return max(data.glob("*/run.json")).parent


def torn_off(start: Callable[..., Running], words: tuple[str, ...], data: Path) -> None:
    """Kill supervisor and scan above 200 N·m; the drive stops itself, and friction keeps the rest behind the lock."""
    supervisor = start("run", *words, "--serial", "W", data=data)

    def loaded() -> bool:
        begun = list(data.glob("*/run.json"))  # comes after all other files of a run
        table = records_of(begun[0].parent) if begun else ()
        return len(table) > 0 and table[-1]["image"]["torque_out_nm"] > 200.0

    supervisor.wait_for(loaded)
    scan = json.loads((newest(data) / "scan-report.json").read_bytes())["pid"]
    os.kill(scan, signal.SIGKILL)
    supervisor.kill()


def cancelled(start: Callable[..., Running], words: tuple[str, ...], data: Path) -> None:
    """A start that a person takes back at once: it says nothing of the unit that the bench holds."""
    before = set(data.glob("*/scan-spec.json"))
    supervisor = start("run", *words, "--serial", "Y", data=data)
    # from here on the supervisor hears a Ctrl-C; before, it ends by it as if it were killed
    supervisor.wait_for(lambda: set(data.glob("*/scan-spec.json")) > before)
    supervisor.interrupt()
    supervisor.finish()
    result = json.loads((newest(data) / "result.json").read_bytes())
    assert result["state"] in ("stopped", "fault")
    assert "lock opened" not in " ".join(result["reasons"])


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
    table = records_of(newest(data / "recoveries"))
    assert table["orders"]["state"][-1] == State.FAULT
    assert table["image"]["brake_on"][-1] == 1
    assert not set(table["orders"]["drive_command"]) & ENABLING


def test_recover_releases_a_unit_that_was_left_wound_up(start, stands_apart, tmp_path):
    data, bench = tmp_path / "runs", ("--bench", str(stands_apart.path))
    words = (str(short_recipe(tmp_path, ONE_RAMP, HELD)), *bench, "--no-report")
    torn_off(start, words, data)
    again = here("run", *words, "--serial", "X", "--json", "--data", str(data))
    assert again.exit_code == 4
    refused = again.json
    assert refused["alarms"][0]["id"] == "brake_stays_closed"
    assert refused["left"]["lock"] == "closed", "another run leaves the lock as it found it"
    assert abs(refused["left"]["torque_nm"]) > 0.01 * RATED_NM

    cancelled(start, words, data)
    says_no(stands_apart, data)

    done = here("recover", *bench, "--data", str(data), "--yes", "--json")
    report = done.json
    assert (done.exit_code, report["released"]) == (0, True), done.err
    for said in ("Torque at the output", "Lock                  closed", "Check:", "bringing the torque to zero"):
        assert said in done.err
    left = json.loads((Path(report["record"]) / "run.json").read_bytes())["left"]
    assert left["zeroes_of"] == min(one.parent.name for one in data.glob("*/run.json")), "no later run took them"
    table = records_of(Path(report["record"]))
    assert table["orders"]["state"][-1] == State.STOPPED
    assert table["orders"]["torque_out_tare_nm"][-1] == left["torque_out_tare_nm"] != 0.0
    torque_nm = table["image"]["torque_out_nm"] - table["orders"]["torque_out_tare_nm"]
    assert abs(torque_nm[-1]) < 0.02 * RATED_NM
    opened = int(np.argmax(table["image"]["brake_on"] & (table["orders"]["brake_on"] == 0)))
    assert table["orders"]["state"][opened] == State.RELEASE
    assert abs(torque_nm[opened]) < 0.02 * RATED_NM
    assert table["image"]["brake_on"][-1] == 0
    assert here("replay", report["record"]).exit_code == 0

    nothing = here("recover", *bench, "--data", str(data), "--yes")
    assert nothing.exit_code == 0
    assert "Nothing to recover" in nothing.out

    cancelled(start, words, data)
    nothing = here("recover", *bench, "--data", str(data), "--yes")
    assert (nothing.exit_code, "Nothing to recover" in nothing.out) == (0, True), "as the recovery left it"
