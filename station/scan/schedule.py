"""When the next scan is due: absolute deadlines in integer nanoseconds; whole periods are skipped and counted.

A scan that comes late is not followed by a burst of short ones: the grid of deadlines stays where it is, and periods
that have passed completely are reported to the controller as missed.
"""

from __future__ import annotations

import time
from typing import NamedTuple

SPIN_TAIL_NS = 100_000
"""How long before the deadline sleeping ends and spinning begins, where spinning is allowed."""


class Due(NamedTuple):
    """The next deadline, and how many whole periods before it were skipped."""

    deadline_ns: int
    missed: int


def next_due(now_ns: int, deadline_ns: int, period_ns: int) -> Due:
    """Return the deadline after `deadline_ns` that is not yet a whole period in the past at `now_ns`."""
    following = deadline_ns + period_ns
    if now_ns < following + period_ns:
        return Due(following, 0)
    missed = (now_ns - following) // period_ns
    return Due(following + missed * period_ns, missed)


class RealTimeSchedule:
    """Waits for deadlines on the monotonic clock.

    Args:
        period_ns: scan period.
        spin_ns: tail before each deadline that is spun instead of slept; only of use under SCHED_FIFO, else 0.

    """

    __slots__ = ("_spin_ns", "deadline_ns", "lateness_ns", "missed", "period_ns", "started_ns")

    def __init__(self, period_ns: int, spin_ns: int = 0) -> None:
        self.period_ns = period_ns
        self._spin_ns = spin_ns
        self.deadline_ns = 0
        self.started_ns = 0
        self.missed = 0
        self.lateness_ns = 0

    def start(self) -> None:
        """Lay the grid of deadlines: scan n is due n + 1 periods after `started_ns`, which is now."""
        self.deadline_ns = self.started_ns = time.monotonic_ns()

    def wait(self) -> int:
        """Wait for the next deadline and return the time of waking; `missed` and `lateness_ns` then describe it."""
        now = time.monotonic_ns()
        deadline, self.missed = next_due(now, self.deadline_ns, self.period_ns)
        self.deadline_ns = deadline
        pause = deadline - self._spin_ns - now
        if pause > 0:
            time.sleep(pause * 1e-9)
        now = time.monotonic_ns()
        while now < deadline:
            # Reached in the spin tail, and when a sleep returns a few hundred nanoseconds early.
            now = time.monotonic_ns()
        self.lateness_ns = now - deadline
        return now
