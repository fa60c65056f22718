"""Time of a virtual bench: by the wall clock, or led by a scan; and everything that becomes due in it.

Whoever lets something happen later asks here (`after`) and nowhere else, so that delays, heartbeats and silences are of
the bench's time, whichever clock that is.
"""

from __future__ import annotations

import asyncio
import heapq
import time
from collections.abc import Callable
from contextlib import suppress

STANDSTILL_NS = 10_000_000  # the computer held the process up: a drive's own timers would have gone on hearing frames
LARGEST_LAG_NS = 500_000_000  # after a longer stop of the process the plant does not make up for the time

Do = Callable[[], None]


class BenchTime:
    """`let_pass` is called with every piece of time [ns]; `excuse` with those in which nobody could be heard."""

    def __init__(self, let_pass: Callable[[int], None], excuse: Callable[[int], None] | None = None) -> None:
        self.now_ns = 0
        """Time since the bench was started, as it has passed here."""
        self.led = False
        """Whether a scan leads: then nothing moves by itself."""
        self._let_pass = let_pass
        self._excuse = excuse
        self._wall_ns = time.monotonic_ns()
        self._due: list[tuple[int, int, Do]] = []
        self._asked = 0

    def advance(self) -> int:
        """Bring the bench to the present, unless a scan leads; return how long the process stood still [ns], or 0."""
        if self.led:
            return 0
        now_ns = time.monotonic_ns()
        elapsed_ns = now_ns - self._wall_ns
        self._wall_ns = now_ns
        stood_ns = elapsed_ns if elapsed_ns > LARGEST_LAG_NS else 0
        elapsed_ns = min(elapsed_ns, LARGEST_LAG_NS)
        if elapsed_ns > STANDSTILL_NS and self._excuse is not None:
            # what arrived meanwhile waits in the sockets and is read after this
            self._excuse(elapsed_ns)
        self.let_pass(elapsed_ns)
        return stood_ns

    def let_pass(self, duration_ns: int) -> None:
        """Let time pass; what becomes due in it is done by `do_due`."""
        self.now_ns += duration_ns
        self._let_pass(duration_ns)

    def after(self, delay_s: float, do: Do) -> None:
        """Have something done later."""
        self._asked += 1
        heapq.heappush(self._due, (self.now_ns + round(delay_s * 1e9), self._asked, do))
        with suppress(RuntimeError):  # nobody serves yet: the first tick looks
            asyncio.get_running_loop().call_later(delay_s, self._wake)

    def _wake(self) -> None:
        if not self.led:
            self.advance()
            self.do_due()

    def do_due(self) -> None:
        """Do everything that is due by now, in order."""
        while self._due and self._due[0][0] <= self.now_ns:
            heapq.heappop(self._due)[2]()

    def lead(self) -> None:
        """Let a scan lead: the wall clock says nothing any more."""
        self.led = True

    def release(self) -> None:
        """Go on by the wall clock, from now."""
        self.led = False
        self._wall_ns = time.monotonic_ns()
