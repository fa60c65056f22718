"""Processes that are started ahead: their order comes once, whole, and makes them what they would have been without."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from lostmotion_command import ROOT

from station.run.ahead import Ahead

LONGEST_S = 60.0
WAITS = """
import json, os, sys
from pathlib import Path

def prepare(*words):
    Path(words[0]).write_text(str(os.getpid()))
    def run():
        print(json.dumps({"argv": sys.argv, "pid": os.getpid(), "stdin": sys.stdin.read(), "tty": sys.stdout.isatty()}))
        sys.stderr.write("told\\n")
        return 3
    return run
"""


@pytest.fixture
def ahead(tmp_path: Path) -> Ahead:
    (tmp_path / "waits.py").write_text(WAITS)
    found = Ahead("waits", str(tmp_path / "ready"), env=os.environ | {"PYTHONPATH": f"{tmp_path}:{ROOT}"})
    assert found.wait_until_ready(LONGEST_S)
    assert (tmp_path / "ready").read_text() == str(found.process.pid)
    return found


def begun(ahead: Ahead, folder: Path) -> subprocess.Popen[bytes] | None:
    (folder / "in").write_text("what stands there")
    with (folder / "in").open() as given, (folder / "out").open("w") as out, (folder / "err").open("w") as err:
        return ahead.begin(["run", "a b"], stdin=given.fileno(), stdout=out.fileno(), stderr=err.fileno())


def test_an_order_brings_the_command_line_and_the_handles(ahead: Ahead, tmp_path: Path) -> None:
    process = begun(ahead, tmp_path)
    assert process is not None
    assert process.wait(LONGEST_S) == 3
    told = json.loads((tmp_path / "out").read_text())
    assert told == {
        "argv": ["waits", "run", "a b"], "pid": process.pid, "stdin": "what stands there", "tty": False,
    }  # fmt: skip
    assert (tmp_path / "err").read_text() == "told\n"
    assert begun(ahead, tmp_path) is None, "it comes once"


def test_an_order_may_come_before_anything_is_loaded(tmp_path: Path) -> None:
    (tmp_path / "waits.py").write_text(WAITS)
    found = Ahead("waits", str(tmp_path / "ready"), env=os.environ | {"PYTHONPATH": f"{tmp_path}:{ROOT}"})
    process = begun(found, tmp_path)
    assert process is not None
    assert process.wait(LONGEST_S) == 3
    assert json.loads((tmp_path / "out").read_text())["argv"] == ["waits", "run", "a b"]


def test_who_is_gone_takes_no_order(ahead: Ahead, tmp_path: Path) -> None:
    ahead.process.kill()
    ahead.process.wait()
    assert begun(ahead, tmp_path) is None
    ahead.end()


def test_without_an_order_it_ends_with_the_one_who_started_it(tmp_path: Path) -> None:
    (tmp_path / "waits.py").write_text(WAITS)
    starter = (
        "import os, sys\nfrom station.run.ahead import Ahead\n"
        f"found = Ahead('waits', {str(tmp_path / 'ready')!r})\n"
        f"assert found.wait_until_ready({LONGEST_S})\nprint('ready', flush=True)\nos.kill(os.getpid(), 9)\n"
    )
    # What waits holds this pipe too: its end is the end of both.
    ended = subprocess.run(
        [sys.executable, "-c", starter], env=os.environ | {"PYTHONPATH": f"{tmp_path}:{ROOT}"}, cwd=ROOT,
        capture_output=True, timeout=LONGEST_S, check=False,
    )  # fmt: skip
    assert (ended.returncode, ended.stdout, ended.stderr) == (-9, b"ready\n", b"")


def test_one_that_is_ended_leaves_nothing(ahead: Ahead) -> None:
    ahead.end()
    assert ahead.process.returncode is not None
    ahead.end()
