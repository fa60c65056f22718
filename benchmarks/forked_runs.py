"""`python -m benchmarks.forked_runs DATA`: a station whose runs are forks of one loaded process, for thousands of them.

To load what a run needs takes seconds of processor time, in which the page and the server do nothing. Here a process
loads it once and forks for each unit: a run in virtual time that takes a second, and one of every N by its own
processes and sockets, as fast as the bench allows. Server, page, record and verdict are those of `lostmotion serve`.
"""

from __future__ import annotations

import argparse
import json
import os
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType

FORKS = "--forks"
REAP_EVERY_S = 1.0
LOOK_EVERY_SCANS = 400
PAUSE_S = 0.002
"""A run of 3 600 scans leaves its records ten times as it goes, so that its loop comes to the page in some parts."""

REHEARSED = "rv-40e-121-quick"
FAILED = 70


class Forked:
    """A run that was forked: as much of a `subprocess.Popen` as the server asks for."""

    def __init__(self, pid: int) -> None:
        self.pid, self._handle = pid, os.pidfd_open(pid)
        self._over = False

    def poll(self) -> int | None:
        """Return 0 when it has ended, None before: nobody asks how."""
        if not self._over:
            look = select.poll()
            look.register(self._handle, select.POLLIN)
            self._over = bool(look.poll(0))
        return 0 if self._over else None

    def __del__(self) -> None:
        os.close(self._handle)


class ForkedRuns:
    """Takes the place of `station.run.next_run.NextRun`: what waits is a process that forks."""

    one_in = 20
    """One run of so many is by its own processes and sockets."""

    def __init__(self) -> None:
        self._orders: socket.socket | None = None
        self._count = 0

    def get_ready(self, *_likely: str) -> None:
        """Start what forks, once: it stays ready for any unit."""
        if self._orders is None:
            self._orders, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            with theirs:
                command = [sys.executable, "-m", "benchmarks.forked_runs", FORKS, str(theirs.fileno())]
                self._process = subprocess.Popen(command, pass_fds=(theirs.fileno(),))  # noqa: S603
            self._orders.recv(1)  # it has loaded all

    def start(self, options: Sequence[str], *, stdout: int, stderr: int) -> Forked:
        """Fork for a run with these options."""
        self.get_ready()
        assert self._orders is not None  # noqa: S101 - it is ready
        self._count += 1
        how = ("--pace", "fast") if self._count % self.one_in == 0 else ("--virtual-time",)
        order = json.dumps(["run", *options, *how]).encode()
        with Path(os.devnull).open("rb") as nothing:
            socket.send_fds(self._orders, [order], [nothing.fileno(), stdout, stderr])
            return Forked(int(self._orders.recv(64)))

    def close(self) -> None:
        """End what forks."""
        if self._orders is not None:
            self._orders.close()
            self._process.wait()


def fork_for_orders(handle: int) -> None:
    """Load what a run needs, and fork for each order until the server is gone."""
    import station.run.virtual_run  # noqa: PLC0415
    from station.cli.measure import standby  # noqa: PLC0415

    standby.load()
    _rehearse()
    _draw_on_the_way(station.run.virtual_run)
    for one in (signal.SIGINT, signal.SIGTERM):
        signal.signal(one, signal.SIG_IGN)  # it ends when the server does
    with socket.socket(fileno=handle) as orders:
        orders.send(b".")
        while True:
            while not select.select([orders], [], [], REAP_EVERY_S)[0]:
                _reap()
            order, handles, _, _ = socket.recv_fds(orders, 1 << 17, 3)
            if not order:
                return
            if (pid := os.fork()) == 0:
                orders.close()
                _be_run(json.loads(order), handles)
            for one in handles:
                os.close(one)
            orders.send(str(pid).encode())
            _reap()


def _rehearse() -> None:
    """Measure a unit in a folder of its own: what is worked out for the first run, no later one works out again."""
    from station.cli import main  # noqa: PLC0415

    with TemporaryDirectory(prefix="lostmotion-rehearsal-") as folder, Path(os.devnull).open("w") as nowhere:
        sys.argv = ["lostmotion", "run", REHEARSED, "--serial", "first", "--data", folder, "--virtual-time"]
        with redirect_stdout(nowhere), redirect_stderr(nowhere), suppress(SystemExit):
            main()


def _draw_on_the_way(virtual_run: ModuleType) -> None:
    """Have a run in virtual time leave its records as it goes, as long as one by the wall clock would be short.

    Its loop is to grow on the page: else it would be over before anybody looks.
    """
    last = virtual_run.VirtualRecorder.last

    def paused(recorder: object) -> object:
        found = last(recorder)
        time.sleep(PAUSE_S)
        return found

    virtual_run.VirtualRecorder.last = paused
    virtual_run.LOOK_EVERY = LOOK_EVERY_SCANS


def _reap() -> None:
    try:
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass
    except ChildProcessError:
        return


def _be_run(words: list[str], handles: list[int]) -> None:
    """Become the run, in a session of its own, as the server starts it."""
    code = FAILED
    try:
        os.setsid()
        for one in (signal.SIGINT, signal.SIGTERM):
            signal.signal(one, signal.default_int_handler if one == signal.SIGINT else signal.SIG_DFL)
        for target, given in enumerate(handles):
            os.dup2(given, target)
            os.close(given)
        sys.stdin, sys.stdout, sys.stderr = (
            os.fdopen(target, mode, closefd=False) for target, mode in enumerate(("r", "w", "w"))
        )
        sys.argv = ["lostmotion", *words]
        from station.cli import main  # noqa: PLC0415

        try:
            main()
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else FAILED
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(code)  # a child never returns to the one that forks


def main() -> None:
    """Serve a data folder with forked runs, or be what forks."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path, nargs="?")
    parser.add_argument("--port", type=int, default=0)
    parser.add_argument("--wires-one-in", type=int, default=ForkedRuns.one_in)
    parser.add_argument(FORKS, type=int, metavar="HANDLE", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.forks is not None:
        fork_for_orders(asked.forks)
        return
    from station.web import running  # noqa: PLC0415
    from station.web.server import Served, serve  # noqa: PLC0415

    ForkedRuns.one_in = asked.wires_one_in
    running.NextRun = ForkedRuns  # type: ignore[misc, assignment]
    serve(Served(asked.data, "127.0.0.1", asked.port))


if __name__ == "__main__":
    main()
