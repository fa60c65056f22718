"""A process that is started ahead: it has loaded its module, and waits to be told what to do.

To start an interpreter and to load what a run needs takes seconds of processor time in which a person at the bench
waits for nothing that they could see. So whoever knows that a run will come starts the process before: `Ahead` on this
side, `main` on the other, a socket between them. The order is what would have stood on the command line, with the
handles that the process would have been started with. It comes once. A process without an order does nothing and ends
with the one who started it; one that has its order does not know any more how it was started.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path

from station.own_program import loading, own_module

LONGEST_ORDER = 1 << 17
MOST_HANDLES = 8
PROGRAM_FAILED = 70


class Ahead:
    """A process that has loaded a module, or is about to, and waits for its order."""

    def __init__(
        self, module: str, *words: str, env: Mapping[str, str] | None = None, own_session: bool = True
    ) -> None:
        """Start it; words: what the module's `prepare` gets. OSError where that fails.

        own_session: what is typed at the terminal is not for it. Else Ctrl-C is, from when it has its order.
        """
        self._orders, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        command = own_module("station.run.ahead", str(theirs.fileno()), module, *words)
        with theirs:
            self.process: subprocess.Popen[bytes] = subprocess.Popen(  # noqa: S603 - our own program
                command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, pass_fds=(theirs.fileno(),),
                start_new_session=own_session, env=env,
            )  # fmt: skip

    def begin(
        self, words: Sequence[str | Path], *, stdin: int, stdout: int, stderr: int, keep: Sequence[int] = ()
    ) -> subprocess.Popen[bytes] | None:
        """Have it run its module with these words on its command line; None where it is gone, or was told before.

        stdin, stdout, stderr: handles of this process that become those of it. keep: further ones that it holds open.
        """
        if self.process.poll() is not None:
            return None
        try:
            order = json.dumps([str(word) for word in words]).encode()
            socket.send_fds(self._orders, [order], [stdin, stdout, stderr, *keep])
        except OSError:
            return None
        self._orders.close()
        return self.process

    def wait_until_ready(self, most_s: float) -> bool:
        """Wait until it has loaded everything; False where that took longer, or it is gone. For one without its order.

        An order may come before: it waits in the socket.
        """
        self._orders.settimeout(most_s)
        try:
            self._orders.recv(1)  # it says nothing: it is ready when it has closed its side
        except OSError:
            return False
        else:
            return self.process.poll() is None
        finally:
            self._orders.settimeout(None)

    def end(self) -> None:
        """End it where it has no order: it holds nothing yet, and what it has started ends with it."""
        if self._orders.fileno() < 0:
            return
        self._orders.close()
        self.process.terminate()
        self.process.wait()


def main() -> int:
    """Load the module that is named, have it prepare, wait for the order, and do it; 0 where none comes.

    The module's `prepare` returns what is to be done with the order, which then stands on the command line.
    """
    handle, name, *words = sys.argv[1:]
    interrupted = signal.signal(signal.SIGINT, signal.SIG_IGN)
    with socket.socket(fileno=int(handle)) as orders:
        with loading():
            run: Callable[[], int] = import_module(name).prepare(*words)
        # Nothing is sent back: what nobody reads before the order comes would cost the order.
        orders.shutdown(socket.SHUT_WR)
        order, handles, _, _ = socket.recv_fds(orders, LONGEST_ORDER, MOST_HANDLES)
    if not order:
        return 0
    for target, given in enumerate(handles[:3]):
        os.dup2(given, target)
        os.close(given)
    # What was made of the handles before is of another kind of file: with buffer, place and line ends of its own.
    sys.stdin, sys.stdout, sys.stderr = (
        os.fdopen(target, mode, buffering=1 if os.isatty(target) or target == 2 else -1, closefd=False)
        for target, mode in enumerate(("r", "w", "w"))
    )
    sys.argv = [name, *json.loads(order)]
    signal.signal(signal.SIGINT, interrupted)
    try:
        return run()
    except Exception:  # noqa: BLE001 - its exit code must not be one of a verdict
        traceback.print_exc()
        return PROGRAM_FAILED


if __name__ == "__main__":
    sys.exit(main())
