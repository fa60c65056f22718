"""Who asks a run to stop from outside: Ctrl-C, a service manager, and a terminal that is closed.

Asked once, the torque is brought to zero before the lock opens; asked again, it is a quick stop.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from definitions.image import Command

ASKS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

STOP_WORDS = {
    Command.STOP: "stopping: the torque is brought to zero first (Ctrl-C again: quick stop)",
    Command.QUICK_STOP: "quick stop",
}
"""What is said when a stop is passed on."""


@contextmanager
def listening(handler: Callable[..., None]) -> Iterator[None]:
    """Let `handler(number, frame)` hear them meanwhile; a hang-up that is ignored (nohup) stays ignored."""
    heard = [number for number in ASKS if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, handler) for number in heard}
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)


class Stopping:
    """Counts how often a run was asked to stop: the first time is a stop, every further one a quick stop."""

    def __init__(self) -> None:
        self.asked = 0
        self._taken = 0

    def hear(self, *_: object) -> None:
        """Count one more who asks: the handler for `listening`."""
        self.asked += 1

    def take_command(self) -> Command:
        """Return the command of the oldest asking that was not taken yet; `Command.NONE` when all were."""
        if self.asked <= self._taken:
            return Command.NONE
        self._taken += 1
        return Command.STOP if self._taken == 1 else Command.QUICK_STOP
