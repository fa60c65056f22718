"""Whether the machine itself stood still while a test ran: the longest time that it held up a process of top priority.

Tests over wires keep real time. Where the computer gives them none for longer than a device may be silent, they fail
for nothing that they test; a process of higher priority than any of a test's was held up as well then, and says so.
`python tests/machine_watch.py` watches until its input ends and prints the longest hold-up in seconds.
"""

from __future__ import annotations

import os
import select
import subprocess
import sys
import time
from types import TracebackType
from typing import Self

PRIORITY = 90
"""FIFO priority of the watch, above that of scan and virtual bench: what holds it up is not one of them."""

SLEEP_S = 1e-3
HELD_UP_S = 5e-3
"""A sleep that ends so much later is the machine's doing: on a quiet one the longest is half of it."""


class MachineWatch:
    """A context in which the machine is watched; afterwards `longest_s` is the longest hold-up, 0 if not permitted."""

    def __init__(self) -> None:
        """Prepare."""
        self.longest_s = 0.0

    @property
    def held_up(self) -> bool:
        """Whether the machine stood still, as far as can be known."""
        return self.longest_s >= HELD_UP_S

    def __enter__(self) -> Self:
        """Begin."""
        command = [sys.executable, "-I", __file__]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """End."""
        said, _ = self._process.communicate()
        self.longest_s = float(said or 0.0)


def main() -> None:
    """Watch until the input ends."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except PermissionError:
        return
    longest_s, before = 0.0, time.monotonic()
    while not select.select([sys.stdin], [], [], SLEEP_S)[0]:
        now = time.monotonic()
        longest_s, before = max(longest_s, now - before - SLEEP_S), now
    sys.stdout.write(f"{longest_s:.6f}")


if __name__ == "__main__":
    main()
