"""The command as tests call it: as a process of its own, as a person does, or here, where everything is loaded already.

What a command does is the same in both; starting an interpreter with everything that it loads takes a second or two.
"""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

ROOT = Path(__file__).parents[1]
COMMAND = (sys.executable, "-m", "station")


@dataclass(frozen=True)
class Ran:
    """What a command left: exit code, what it printed, its JSON object when it printed one."""

    exit_code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out)

    @property
    def record(self) -> Path:
        return Path(self.json["record"])


def apart(*args: str, most_s: float = 150.0) -> Ran:
    """Run `lostmotion ARGS` to its end in a process of its own."""
    done = subprocess.run([*COMMAND, *args], cwd=ROOT, text=True, capture_output=True, timeout=most_s, check=False)
    assert "Traceback" not in done.stderr, done.stderr
    return Ran(done.returncode, done.stdout, done.stderr)


def here(*args: str) -> Ran:
    """Run `lostmotion ARGS` to its end in this process."""
    from station import cli  # noqa: PLC0415 - most tests need no command

    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8", newline="") for _ in range(2))
    before, argv = Path.cwd(), ["lostmotion", *args]
    os.chdir(ROOT)
    try:
        with redirect_stdout(out), redirect_stderr(err), mock.patch.object(sys, "argv", argv):
            try:
                cli.main()
                code = 0
            except SystemExit as end:
                code = end.code if isinstance(end.code, int) else int(end.code is not None)
    finally:
        os.chdir(before)
    said = []
    for stream in (out, err):
        stream.flush()
        said.append(stream.buffer.getvalue().decode("utf-8"))  # type: ignore[attr-defined]
    assert "the program failed" not in said[1], said[1]
    return Ran(code, *said)


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
            time.sleep(0.02)

    def interrupt(self) -> None:
        """Ctrl-C as a terminal sends it: to the whole foreground group."""
        os.killpg(self.process.pid, signal.SIGINT)

    def finish(self, most_s: float = 60.0) -> Ran:
        out, err = self.process.communicate(timeout=most_s)
        return Ran(self.process.returncode, out, err)

    def end(self) -> None:
        """Kill it with everything that it started, if it still runs."""
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()
