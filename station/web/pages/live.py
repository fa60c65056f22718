"""One look at the bench for all pages that show it, and a loop on the screen that grows by what is new.

Twenty pages that each look for themselves cost the server twenty looks, and the last of them shows what is old. A page
that is sent the whole loop again with every look is sent megabytes a second towards the end of a run.
"""

from __future__ import annotations

import asyncio
import json
import time

from nicegui import ui

from station.web.running import Now, Running

LOOK_EVERY_S = 0.08
"""The newest point is at most this old, and what it takes to read, send and draw it."""


class Looks:
    """Looks at the bench that every open page waits for; none is made while no page is open."""

    def __init__(self, running: Running) -> None:
        self._running = running
        self._look: asyncio.Task[Now] | None = None
        self._at_s = 0.0

    async def next(self) -> Now:
        """Return what the bench does at the next look, to all who wait for it at once."""
        if self._look is None or self._look.done():
            self._look = asyncio.create_task(self._next())
        return await asyncio.shield(self._look)  # a page that is left must not end the look of the others

    async def _next(self) -> Now:
        now_s = time.monotonic()
        self._at_s = max(self._at_s + LOOK_EVERY_S, now_s)
        await asyncio.sleep(self._at_s - now_s)
        return await asyncio.to_thread(self._running.now)


class GrowingLoop:
    """The loop on one page: the page keeps its points, and is told those that have come."""

    def __init__(self, chart: ui.echart) -> None:
        """Begin with an empty loop on a chart; the page has the script `live.js`."""
        self._chart = chart
        self._run, self._told = "", 0

    def show(self, now: Now) -> None:
        """Tell the page the points that it has not; all of them where they are of another run."""
        first = self._told if now.run == self._run and len(now.loop) >= self._told else 0
        if first == len(now.loop) and self._told == first:
            self._run = now.run
            return
        points = json.dumps(now.loop[first:], separators=(",", ":"))
        self._chart.client.run_javascript(f"showLoop({self._chart.id}, {first}, {points})")
        self._run, self._told = now.run, len(now.loop)
