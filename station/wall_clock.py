"""The one place where the station reads the computer's wall clock: times of day in records, logs and names of runs.

Nothing else in the station, the drivers of a real bench, the analysis or the controller looks at it (a test holds them
to it; only the check of a recipe, before a run, asks what day it is): a run is timed by the monotonic clock, which
nobody can set. `WALL_CLOCK.step` makes it jump for this process,
as `machine.clock step` of a scenario asks for; the computer's own clock is not touched.
"""

from __future__ import annotations

import time
from datetime import UTC, datetime, timedelta

SEEN_FROM_S = 0.5
"""Smallest jump that is told: a clock that is steered by 500 ppm at most does not come so far in a quarter hour."""

SLACK = timedelta(minutes=2)
"""By which what was written last may be in the future: two computers, or a clock that was just set."""


class WallClock:
    """Time of day, in UTC."""

    def __init__(self) -> None:
        self._jumped = timedelta(0)

    def now(self) -> datetime:
        """Return the time of day."""
        return datetime.now(UTC) + self._jumped

    def step(self, seconds: float) -> None:
        """Let it jump, for this process."""
        self._jumped += timedelta(seconds=seconds)


WALL_CLOCK = WallClock()


def now_text() -> str:
    """Return the time in UTC, to the millisecond, as it stands in records."""
    return WALL_CLOCK.now().isoformat(timespec="milliseconds")


class JumpWatch:
    """Finds out whether the wall clock was set while something went on, by the monotonic clock."""

    def __init__(self) -> None:
        self._before = self._ahead_s()
        self._most_s = 0.0

    @staticmethod
    def _ahead_s() -> float:
        return WALL_CLOCK.now().timestamp() - time.monotonic()

    def look(self) -> None:
        """Look at the clock: one that is put back before the end was set all the same."""
        self._most_s = max(self._most_s, self._ahead_s() - self._before, key=abs)

    def jumped_s(self) -> float:
        """Return the most by which it was seen set since then [s]; 0 where that is too little to tell."""
        self.look()
        return round(self._most_s, 3) if abs(self._most_s) >= SEEN_FROM_S else 0.0
