"""Memory and processor time of a server and of the browser that shows its page, by /proc and by Chromium itself."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

MIB = 1 << 20
TICKS = os.sysconf("SC_CLK_TCK")


class Memory(NamedTuple):
    """What is held, in MiB, and what the page counts: DOM nodes and listeners of events.

    heap: of JavaScript, what is used of it and what it holds from the system.
    """

    server_mib: float
    renderer_mib: float
    browser_mib: float
    heap_mib: float
    heap_held_mib: float
    nodes: int
    listeners: int


def held_mib(pid: int) -> float:
    """Return the memory that a process has filled, of what is shared its share (PSS) [MiB]; 0 for one that is gone.

    Pages of files are left out: how many of them are counted hangs on who else has the same programs open.
    """
    with suppress(OSError):
        rows = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()[1:])
        return sum(int(rows[name].split()[0]) for name in ("Pss_Anon", "Pss_Shmem")) / 1024
    return 0.0


def descendants(pid: int) -> set[int]:
    """Return the processes below one, itself among them."""
    found, new = {pid}, {pid}
    while new:
        children: set[int] = set()
        for one in new:
            for file in Path(f"/proc/{one}/task").glob("*/children"):
                with suppress(OSError):
                    children |= {int(word) for word in file.read_text().split()}
        new = children - found
        found |= new
    return found


def used_s(pid: int) -> float:
    """Return the processor time of a process itself [s]; 0 for one that is gone."""
    with suppress(OSError):
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        return sum(int(one) for one in fields[11:13]) / TICKS
    return 0.0


def processes_of(browser: Any) -> dict[int, str]:
    """Return what Chromium says of its processes: which kind each is, by its id."""
    session = browser.new_browser_cdp_session()
    try:
        told = session.send("SystemInfo.getProcessInfo")["processInfo"]
    finally:
        session.detach()
    return {one["id"]: one["type"] for one in told}


def memory_of(server: int, browser: Any, page: Any) -> Memory:
    """Return what server and browser hold, after the page has thrown away what it does not need."""
    session = page.context.new_cdp_session(page)
    try:
        for _ in range(2):
            session.send("HeapProfiler.collectGarbage")
        session.send("Performance.enable")
        told = {one["name"]: one["value"] for one in session.send("Performance.getMetrics")["metrics"]}
    finally:
        session.detach()
    held = {(pid, kind): held_mib(pid) for pid, kind in processes_of(browser).items()}
    renderer = max(mib for (_, kind), mib in held.items() if kind == "renderer")
    return Memory(
        held_mib(server),
        renderer,
        sum(held.values()),
        told["JSHeapUsedSize"] / MIB,
        told["JSHeapTotalSize"] / MIB,
        int(told["Nodes"]),
        int(told["JSEventListeners"]),
    )
