"""Whether this computer's clock is behind what the chain of a data folder has seen: it was set back, or was wrong then.

What has its day, as a calibration has, is judged by the later of both times. One clock that was wrong once, by years
perhaps, must not end every run for ever: somebody says once that the clock is right now. The chain keeps that in the
line of the run, with the reason, and of the entries before it none counts as later any more.
"""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from station.records.chain.chain_file import CHAIN
from station.records.chain.lookup import latest_after
from station.wall_clock import SLACK, WALL_CLOCK

SAY_SO = "--clock-is-right REASON"


class ClockBehind(NamedTuple):
    """A clock that is behind: what it says, the entry that is later, its run ('' for none), and its time."""

    now: datetime
    counter: int
    run: str
    at: datetime

    @property
    def found(self) -> str:
        """Both times, and which entry is later."""
        of_run = f", run {self.run}" if self.run else ""
        return (
            f"the computer's clock says {self.now:%Y-%m-%d %H:%M} UTC, which is before entry {self.counter} of "
            f"{CHAIN} ({self.at:%Y-%m-%d %H:%M} UTC{of_run})"
        )

    @property
    def note(self) -> str:
        """What a run says of it."""
        return f"{self.found}: it was set back, or was wrong then. Set it; if it is right now, run once with {SAY_SO}"

    def right(self, reason: str) -> str:
        """Return what a run says of it that was begun with the word that the clock is right."""
        return f"{self.found}; it is right now, was said at the start: {reason}"


def clock_behind(data: Path) -> ClockBehind | None:
    """Return by what the clock is behind; None where it is not, by more than the slack.

    Raises:
        RecordError: the chain is there and cannot be read.

    """
    now = WALL_CLOCK.now()
    entry = latest_after(data, now + SLACK)
    if entry is None:
        return None
    return ClockBehind(now, entry.counter, str(entry.fields.get("run", "")), entry.at)
