"""What one scan costs in system calls: counted by strace on the running scan, not at objects of ours."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from lostmotion_command import ROOT

pytestmark = [
    pytest.mark.wires,
    pytest.mark.skipif(shutil.which("strace") is None, reason="strace is not installed: system calls are not counted"),
]
SLEEP = re.compile(r"^clock_nanosleep\(")
MOST = 7
"""Sleep, one look at CAN and one send, and four for Modbus: a reply and a request each of two devices."""

PERIOD_US = 10_000
"""Brake and remote I/O are asked as often: a scan has as much to do as it ever has."""

OF_MODBUS = ("read(", "write(")


def cycles(trace: Path) -> list[list[str]]:
    """The system calls from one sleep to the next; a sleep that a signal cut in two counts once."""
    found: list[list[str]] = []
    for line in trace.read_text(encoding="utf-8", errors="replace").splitlines():
        if SLEEP.match(line) and not (found and len(found[-1]) == 1):
            found.append([])
        if found and not line.startswith("---"):
            found[-1].append(line)
    return found


ENOUGH = 100
SECONDS = (3, 12, 48)
"""A scan that is late does not sleep, and two of them are no single cycle: a busy machine is looked at for longer."""


def counted_cycles(folder: Path, seconds: int, sends: re.Pattern[str]) -> list[list[str]]:
    """The system calls of each single cycle of a scan that `timing` ran for so long, without those of its ends."""
    command = [sys.executable, "-m", "station", "timing", "--seconds", str(seconds), "--period-us", str(PERIOD_US)]
    subprocess.run(
        [str(shutil.which("strace")), "-ff", "-qq", "-o", str(folder / "trace"), *command],
        cwd=ROOT,
        capture_output=True,
        check=False,
        timeout=120 + seconds,
    )
    (scan,) = [path for path in folder.glob("trace.*") if sends.search(path.read_text(errors="replace"))]
    return [cycle for cycle in cycles(scan) if sum("sendto" in call for call in cycle) == 1][100:-10]


def test_a_scan_makes_seven_system_calls_at_most(tmp_path):
    sends = re.compile(r'sendto\(\d+, "< send 205')
    for seconds in SECONDS:
        folder = tmp_path / str(seconds)
        folder.mkdir()
        counted = counted_cycles(folder, seconds, sends)
        if len(counted) > ENOUGH:
            break
    assert len(counted) > ENOUGH
    worst = max(counted, key=len)
    assert len(worst) <= MOST, "\n".join(worst)
    for cycle in counted:
        of_the_bus = [call for call in cycle if not call.startswith(OF_MODBUS)]
        (sent,) = [call for call in of_the_bus if "sendto" in call]
        assert sends.match(sent), "SYNC goes out with the set-points"
        assert sum("recvfrom" in call for call in of_the_bus) == 1, "one look at the bus"
        assert len(of_the_bus) == 3, of_the_bus
