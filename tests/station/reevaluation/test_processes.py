"""Processes that evaluate: forks of one that has loaded everything, with the environment of their parent."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from station.reevaluation.processes import begin, forks
from station.results.evaluation import LOADED_AHEAD

LONGEST_S = 60.0


def loaded() -> set[str]:
    return set(sys.modules)


def in_a_fork(call: Callable[[], Any], nice: int = 0) -> Any:
    with ProcessPoolExecutor(1, forks(), begin, (dict(os.environ), nice)) as pool:
        return pool.submit(call).result(LONGEST_S)


def test_what_evaluates_is_loaded_before_anybody_asks() -> None:
    assert set(LOADED_AHEAD) <= in_a_fork(loaded)


def test_each_has_the_environment_of_its_parent_as_it_is_then(monkeypatch: pytest.MonkeyPatch) -> None:
    for value in ("first", "second"):
        monkeypatch.setenv("LOSTMOTION_TEST", value)
        assert in_a_fork(partial(os.getenv, "LOSTMOTION_TEST")) == value
    monkeypatch.delenv("LOSTMOTION_TEST")
    assert in_a_fork(partial(os.getenv, "LOSTMOTION_TEST")) is None


def test_it_gives_way_by_so_many_steps() -> None:
    here = os.getpriority(os.PRIO_PROCESS, 0)
    assert in_a_fork(partial(os.getpriority, os.PRIO_PROCESS, 0), nice=2) == min(here + 2, 19)


ASKS = """
import os, sys, time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from station.reevaluation.processes import end_with_parent, forks
if __name__ == "__main__":
    pool = ProcessPoolExecutor(1, forks(), end_with_parent)
    print(pool.submit(os.getpid).result(), flush=True)
    pool.submit(time.sleep, 600)
    time.sleep(600)
"""


def test_it_ends_when_the_process_that_asked_for_it_is_killed(tmp_path: Path) -> None:
    program = tmp_path / "asks.py"
    program.write_text(ASKS, encoding="utf-8")
    path = os.pathsep.join(filter(None, sys.path))
    with subprocess.Popen(
        [sys.executable, str(program)], stdout=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": path}
    ) as parent:
        assert parent.stdout is not None
        fork = int(parent.stdout.readline())
        os.kill(fork, 0)
        parent.send_signal(signal.SIGKILL)
    until = time.monotonic() + LONGEST_S
    with suppress(ProcessLookupError):
        while time.monotonic() < until:
            os.kill(fork, 0)
            time.sleep(0.05)
        pytest.fail("it has outlived the process that asked for it")
