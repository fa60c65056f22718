"""One look at the bench for all pages that show it, and a loop on the screen that grows by what is new.

Twenty pages that each look for themselves cost the server twenty looks, and the last of them shows what is old. A page
that is sent the whole loop again with every look is sent megabytes a second towards the end of a run. The loop of a run
that this server has not seen is read from its record, once for all pages.
"""

from __future__ import annotations

import asyncio
import json
import time
from concurrent.futures import CancelledError
from contextlib import suppress
from typing import TYPE_CHECKING

from nicegui import ui

from station.errors import StationError
from station.records.run_record import RunRecord
from station.web.running import ENDED, Now
from station.web.station import Station

if TYPE_CHECKING:
    from station.reports.loop_curves import LoopCurves

Points = tuple[tuple[float | None, float | None], ...]
"""Torque [N·m] and wind-up [arcmin] as they are drawn, one after another; None where the line is lifted."""

LIFTED = (None, None)

LOOK_EVERY_S = 0.08
"""The newest point is at most this old, and what it takes to read, send and draw it."""


READ_AGAIN_S = (2.0, 10.0, 60.0)
"""After how long a loop is read again that could not be read: the evaluating process was busy, or had ended."""


class Looks:
    """Looks at the bench that every open page waits for; none is made while no page is open."""

    def __init__(self, station: Station) -> None:
        self._station = station
        self._look: asyncio.Task[tuple[Now, Points]] | None = None
        self._at_s = 0.0
        self._stored: asyncio.Task[Points | None] | None = None
        self._stored_of = ""
        """The run whose loop is read from its record, or was."""
        self._pauses: list[float] = []
        """What is left of `READ_AGAIN_S` for it."""

    async def next(self) -> tuple[Now, Points]:
        """Return what the bench does at the next look, with its loop, to all who wait for it at once."""
        if self._look is None or self._look.done():
            self._look = asyncio.create_task(self._next())
        return await asyncio.shield(self._look)  # a page that is left must not end the look of the others

    async def _next(self) -> tuple[Now, Points]:
        now_s = time.monotonic()
        self._at_s = max(self._at_s + LOOK_EVERY_S, now_s)
        await asyncio.sleep(self._at_s - now_s)
        now = await asyncio.to_thread(self._station.running.now)
        return now, now.loop or self._loop_of_record(now)

    def _loop_of_record(self, now: Now) -> Points:
        """Return the loop of a run that has ended unseen; nothing until it was read, and where it cannot be."""
        if now.stage != ENDED or now.result is None or now.altered:
            return ()
        if now.run != self._stored_of:
            self._stored_of, self._pauses = now.run, list(READ_AGAIN_S)
            self._stored = asyncio.create_task(self._read_after(0.0, now.run))
        found = self._stored.result() if self._stored is not None and self._stored.done() else ()
        if found is None and self._pauses:
            self._stored = asyncio.create_task(self._read_after(self._pauses.pop(0), now.run))
        return found or ()

    async def _read_after(self, pause_s: float, run: str) -> Points | None:
        await asyncio.sleep(pause_s)
        return await asyncio.to_thread(self._read, run)

    def _read(self, run: str) -> Points | None:
        """Read the loop of a run, which takes seconds; None where it cannot be read now."""
        # Whoever opens the run is told what is wrong with its record; here it is not drawn.
        with suppress(StationError, OSError, RuntimeError, CancelledError):
            return drawn_points(self._station.evaluations.loop(RunRecord(self._station.data / run)))
        return None


def drawn_points(curves: LoopCurves) -> Points:
    """Return the lines of a stored loop as one, lifted between two of them."""
    lines = [tuple(zip(line.torque_nm, line.values, strict=True)) for line in curves.loop]
    return tuple(point for line in lines for point in (*line, LIFTED))[:-1]


class GrowingLoop:
    """The loop on one page: the page keeps its points, and is told those that have come."""

    def __init__(self, chart: ui.echart) -> None:
        """Begin with an empty loop on a chart; the page has the script `live.js`."""
        self._chart = chart
        self._run, self._told = "", 0

    def show(self, run: str, loop: Points) -> None:
        """Tell the page the points of a run that it has not; all of them where they are of another one."""
        first = self._told if run == self._run and len(loop) >= self._told else 0
        if first == len(loop) and self._told == first:
            self._run = run
            return
        points = json.dumps(loop[first:], separators=(",", ":"))
        self._chart.client.run_javascript(f"showLoop({self._chart.id}, {first}, {points})")
        self._run, self._told = run, len(loop)
