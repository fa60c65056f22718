"""When the next scan is due: absolute deadlines in integer nanoseconds.

By the wall clock whole periods are skipped and counted. A scan that comes late is not followed by a burst of short
ones: the grid of deadlines stays where it is, and periods that have passed completely are reported to the controller as
missed.

Before a bench that waits (`drivers.pace`) nothing can be missed: the bench has waited too. The period is stretched, the
grid of deadlines moves on by as much, and what the wall clock would have called missed is counted apart.
"""

from __future__ import annotations

import time
from typing import NamedTuple, Protocol

from station.documents.scan_report import Pace

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


def _wait_until(deadline_ns: int, now_ns: int, spin_ns: int) -> int:
    """Sleep, and spin for the last `spin_ns`; return the time, which is never before the deadline."""
    pause_ns = deadline_ns - spin_ns - now_ns
    if pause_ns > 0:
        time.sleep(pause_ns * 1e-9)
    now_ns = time.monotonic_ns()
    while now_ns < deadline_ns:
        # Reached in the spin tail, and when a sleep returns a few hundred nanoseconds early.
        now_ns = time.monotonic_ns()
    return now_ns


class Schedule(Protocol):
    """What the loop needs of a schedule."""

    @property
    def started_ns(self) -> int:
        """Monotonic time from which deadlines count."""

    @property
    def missed(self) -> int:
        """Periods missed before the scan that was waited for."""

    @property
    def lateness_ns(self) -> int:
        """How long after its deadline that scan began."""

    def start(self) -> None:
        """Lay the grid of deadlines."""

    def wait(self) -> int:
        """Wait for the next scan and return the time of waking."""


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
        now = _wait_until(deadline, now, self._spin_ns)
        self.lateness_ns = now - deadline
        return now


class WaitingBench(Protocol):
    """What the schedule needs of a bench that waits for the scan."""

    @property
    def in_step(self) -> bool:
        """Whether it waits, and has answered in time."""

    def wait(self) -> int:
        """Wait, bounded, until it has let the period pass; return the periods that we have missed."""


class BenchSchedule:
    """Keeps deadlines and waits for the bench: a period that comes late is stretched, and none is missed.

    Args:
        period_ns: scan period.
        bench: what is waited for. One that does not answer in time is not waited for until it does again.
        spin_ns: as in `RealTimeSchedule`.
        fast: do not wait for deadlines, only for the bench; deadlines count again while it does not answer.

    """

    __slots__ = (
        "_bench",
        "_fast",
        "_spin_ns",
        "deadline_ns",
        "lateness_ns",
        "longest_ns",
        "missed",
        "period_ns",
        "started_ns",
        "stretched",
        "stretched_ns",
        "would_have_missed",
    )

    def __init__(self, period_ns: int, bench: WaitingBench, spin_ns: int = 0, *, fast: bool = False) -> None:
        self.period_ns = period_ns
        self._bench = bench
        self._spin_ns = spin_ns
        self._fast = fast
        self.deadline_ns = self.started_ns = 0
        self.missed = 0
        self.lateness_ns = 0
        self.stretched = 0
        """Periods that ended a whole period late or more."""
        self.stretched_ns = 0
        self.longest_ns = 0
        self.would_have_missed = 0
        """Whole periods that this computer let pass, without those in which it waited for the bench."""

    def start(self) -> None:
        """Lay the grid of deadlines."""
        self.deadline_ns = self.started_ns = time.monotonic_ns()

    def wait(self) -> int:
        """Wait for the next deadline and for the bench; return the time from which the scan works."""
        if self._fast and self._bench.in_step:
            self.missed = self._bench.wait()
            self.deadline_ns = now = time.monotonic_ns()
            return now
        deadline = self.deadline_ns + self.period_ns
        now = _wait_until(deadline, time.monotonic_ns(), self._spin_ns)
        self.would_have_missed += (now - deadline) // self.period_ns
        self.missed = self._bench.wait()
        now = time.monotonic_ns()
        self.lateness_ns = late_ns = now - deadline
        if late_ns < self.period_ns:
            self.deadline_ns = deadline
        else:
            self.deadline_ns = now
            self.stretched += 1
            self.stretched_ns += late_ns
            self.longest_ns = max(self.longest_ns, late_ns)
        return now

    def pace(self) -> Pace:
        """Return what was counted, for the proof of timing."""
        return Pace(
            fast=self._fast,
            stretched=self.stretched,
            stretched_s=round(self.stretched_ns * 1e-9, 6),
            longest_s=round(self.longest_ns * 1e-9, 6),
            would_have_missed=self.would_have_missed,
        )
