"""A command that starts warm: the interpreter and its modules are there already, everything after that is the command.

Loading the supervisor's modules takes seconds of processor time, in which no kill can hit anything: the run has not
begun. A drill of hundreds of kills forks them instead. The child is a process of its own in a session of its own, as
the shell starts it, and runs the same entry.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import traceback
from pathlib import Path

ROOT = Path(__file__).parents[3]
COMMAND = (sys.executable, "-m", "station")
LOOK_EVERY_S = 0.005
PROGRAM_FAILED = 70


class Started:
    """A command that has been started: its process id, its end, and what it wrote to standard error."""

    def __init__(self, pid: int, errors: Path) -> None:
        self.pid, self._errors, self._code = pid, errors, None

    def poll(self) -> int | None:
        """Return the exit code, negative for a signal; None while it runs."""
        if self._code is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            self._code = os.waitstatus_to_exitcode(status) if pid else None
        return self._code

    def wait(self, most_s: float) -> int:
        """Wait for its end."""
        end = time.monotonic() + most_s
        while (code := self.poll()) is None:
            assert time.monotonic() < end, f"in {most_s:.0f} s the command did not end"
            time.sleep(LOOK_EVERY_S)
        return code

    def end(self) -> None:
        """Kill it with everything in its session, if it still runs."""
        if self.poll() is None:
            os.killpg(self.pid, signal.SIGKILL)
            self.wait(LOOK_EVERY_S * 1000)

    @property
    def errors(self) -> str:
        """What it wrote to standard error."""
        return self._errors.read_text(encoding="utf-8")


def cold(args: tuple[str, ...], errors: Path) -> Started:
    """Start `lostmotion ARGS` as a shell does."""
    with errors.open("wb") as file:
        process = subprocess.Popen(
            [*COMMAND, *args], cwd=ROOT, stdout=subprocess.DEVNULL, stderr=file, start_new_session=True
        )
    process.returncode = 0  # from here on `Started` collects it
    return Started(process.pid, errors)


def warm(args: tuple[str, ...], errors: Path) -> Started:
    """Start `lostmotion ARGS` in a fork of this process; call `load` first."""
    sys.stdout.flush()
    pid = os.fork()
    if pid == 0:
        try:
            os.setsid()
            os.chdir(ROOT)
            with errors.open("wb") as file, Path(os.devnull).open("r+b") as nothing:
                for handle, target in ((0, nothing), (1, nothing), (2, file)):
                    os.dup2(target.fileno(), handle)
            _run(args)
        except BaseException:  # noqa: BLE001 - a child never returns into the drill
            traceback.print_exc()
        finally:
            os._exit(PROGRAM_FAILED)
    return Started(pid, errors)


def _run(args: tuple[str, ...]) -> None:
    from station.cli import main  # noqa: PLC0415

    sys.argv = ["lostmotion", *args]
    sys.stdin, sys.stdout, sys.stderr = (os.fdopen(os.dup(n), mode) for n, mode in ((0, "r"), (1, "w"), (2, "w")))
    try:
        main()
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def load() -> None:
    """Load what the commands of a drill load when they run, once for all of them."""
    from station.bench import assemble_virtual  # noqa: F401, PLC0415
    from station.cli.measure import resume as command_resume  # noqa: F401, PLC0415
    from station.cli.measure import run as command_run  # noqa: F401, PLC0415
    from station.run import supervisor  # noqa: F401, PLC0415
    from station.run.way_back import recover as recovery  # noqa: F401, PLC0415
