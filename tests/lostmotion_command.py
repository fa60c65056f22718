"""The command as tests call it: as a process of its own, as a person does, or here, where everything is loaded already.

What a command does is the same in both; starting an interpreter with everything that it loads takes a second or two.
"""

from __future__ import annotations

import io
import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

ROOT = Path(__file__).parents[1]
COMMAND = (sys.executable, "-m", "station")

SEED = "1"
"""Of the noise on the virtual bench in every run that does not name its own: a test is the same test every time."""

ON_A_CABLE = "example-socketcan"
RUNS = (("run",), ("faults", "run"))


@contextmanager
def served(bench: Path) -> Iterator[dict[str, Any]]:
    """Serve the virtual bench of a file as a process of its own, at free ports; what it says when it is ready."""
    ports = ("--can", "127.0.0.1:0", "--modbus", "127.0.0.1:0")
    command = [*COMMAND, "virtual-bench", "--bench", str(bench), "--seed", SEED, *ports]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        assert process.stdout is not None
        yield json.loads(process.stdout.readline())
        process.terminate()


def seeded(args: tuple[str, ...]) -> tuple[str, ...]:
    """Return the arguments of a command, of one that runs on the virtual bench with the seed of its noise."""
    runs = any(args[: len(words)] == words for words in RUNS)
    if not runs or "--seed" in args or ON_A_CABLE in args or _on_a_cable(args):
        return args
    return (*args, "--seed", SEED)


def _on_a_cable(args: tuple[str, ...]) -> bool:
    """Whether these arguments name the file of a bench that is not embedded: a seed is refused there."""
    named = Path(args[args.index("--bench") + 1]) if "--bench" in args else None
    return named is not None and named.is_file() and "embedded: true" not in named.read_text(encoding="utf-8")


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


def here(*args: str, cwd: Path = ROOT) -> Ran:
    """Run `lostmotion ARGS` to its end in this process, from a folder."""
    from station import cli  # noqa: PLC0415 - most tests need no command

    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8", newline="") for _ in range(2))
    before, argv = Path.cwd(), ["lostmotion", *seeded(args)]
    os.chdir(cwd)
    try:
        with (
            redirect_stdout(out),
            redirect_stderr(err),
            mock.patch.object(sys, "argv", argv),
            mock.patch.dict(os.environ),  # a command is the whole process otherwise, and may change it
        ):
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


def forked(*args: str) -> Ran:
    """Run `lostmotion ARGS` to its end in a fork of this process, where everything is loaded already."""
    return Running(args).finish(most_s=None)


@cache
def _load() -> None:
    """Load here what every fork would load anew: two seconds of processor time each."""
    from station.cli.measure import standby  # noqa: PLC0415 - most tests need no command

    standby.load()


class Running:
    """A command that is under way in a fork of this process, where everything is loaded, with the data that it writes.

    It is a process in a session of its own, as a shell starts it.
    """

    def __init__(self, args: tuple[str, ...], data: Path = ROOT) -> None:
        _load()
        self.data = data
        self._said = tempfile.TemporaryFile("w+", encoding="utf-8")  # noqa: SIM115 - open until it has ended
        self._ended = False
        self.pid = os.fork()
        if self.pid == 0:
            try:
                os.setsid()
                ran = here(*args)
                json.dump([ran.exit_code, ran.out, ran.err], self._said)
                self._said.flush()
            finally:
                os._exit(0)
        self._process = os.pidfd_open(self.pid)

    def ended(self, most_s: float | None = 0.0) -> bool:
        """Tell whether it has ended, once it has or so much time has passed; None waits for its end."""
        if not self._ended and select.select([self._process], [], [], most_s)[0]:
            os.waitpid(self.pid, 0)
            os.close(self._process)
            self._ended = True
        return self._ended

    def wait_for(self, condition: Callable[[], bool], most_s: float = 40.0) -> None:
        end = time.monotonic() + most_s
        while not condition():
            assert time.monotonic() < end, "the moment did not come"
            assert not self.ended(0.02), self.finish()

    def interrupt(self) -> None:
        """Ctrl-C as a terminal sends it: to the whole foreground group."""
        os.killpg(self.pid, signal.SIGINT)

    def finish(self, most_s: float | None = 60.0) -> Ran:
        assert self.ended(most_s), f"the command did not end in {most_s} s"
        self._said.seek(0)
        with self._said:
            return Ran(*json.load(self._said))

    def kill(self) -> None:
        """Kill it, if it still runs; nothing else is told of it."""
        if not self.ended():
            os.kill(self.pid, signal.SIGKILL)
            self.ended(None)

    def end(self) -> None:
        """Kill it with everything that it started, if it still runs."""
        if not self.ended():
            with suppress(ProcessLookupError):  # a fork that has not come to its own session yet
                os.killpg(self.pid, signal.SIGKILL)
            self.kill()
