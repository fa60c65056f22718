"""What the scan process asks of the machine, each thing optional, each answered with granted or refused and why.

The figures behind the choices: sleeping is late by 50 µs of timer slack unless the slack is set to 1 ns; a collection
of a large heap takes tens of milliseconds unless the heap is frozen; the first touch of a page costs up to 2 ms.
"""

from __future__ import annotations

import ctypes
import gc
import mmap
import os
import resource
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from station.documents.scan_report import Realtime

FIFO_PRIORITY = 80
"""Above the kernel's threaded interrupts (50), below its watchdogs (99)."""

PREFAULT_BYTES = 8 * 1024 * 1024
"""Heap that is touched before the scan starts."""

TIMER_SLACK_NS = 1
PR_SET_TIMERSLACK = 29
ISOLATED_CORES = Path("/sys/devices/system/cpu/isolated")
MCL_CURRENT, MCL_FUTURE = 1, 2

CAP_IPC_LOCK, CAP_SYS_NICE = 14, 23
"""Bits of Linux capabilities; a container takes them from root as well."""


def has_capability(bit: int, status: Path = Path("/proc/self/status")) -> bool:
    """Whether this process has a Linux capability in force, by its bit."""
    try:
        rows = status.read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return False
    masks = [row.split()[1] for row in rows if row.startswith("CapEff:")]
    return bool(masks) and bool(int(masks[0], 16) >> bit & 1)


class Grant(NamedTuple):
    """Answer of the machine to one request."""

    name: str
    granted: bool
    detail: str


def request_fifo(priority: int = FIFO_PRIORITY) -> Grant:
    """Ask for the first-in-first-out scheduling class, so that no ordinary process delays the scan."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (PermissionError, OSError, AttributeError) as error:
        return Grant("fifo", granted=False, detail=f"{error}; needs CAP_SYS_NICE or an rtprio limit of {priority}")
    return Grant("fifo", granted=True, detail=f"SCHED_FIFO priority {priority}")


def request_mlock() -> Grant:
    """Ask that no page of this process is ever paged out."""
    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    unlimited = has_capability(CAP_IPC_LOCK) or limit == resource.RLIM_INFINITY
    # With a limit in force, MCL_FUTURE would turn a later allocation into a MemoryError in the middle of a run.
    flags = MCL_CURRENT | MCL_FUTURE if unlimited else MCL_CURRENT
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(flags) != 0:
        reason = os.strerror(ctypes.get_errno())
        return Grant("mlock", granted=False, detail=f"{reason}; needs CAP_IPC_LOCK or a larger memlock limit")
    return Grant("mlock", granted=True, detail="current and future pages" if unlimited else "current pages")


def request_affinity(isolated: Path = ISOLATED_CORES) -> Grant:
    """Ask for a core that the kernel keeps free of other work, where there is one."""
    try:
        cores = isolated.read_text(encoding="ascii").strip()
    except OSError:
        cores = ""
    if not cores:
        return Grant("affinity", granted=False, detail="no core is isolated; boot with isolcpus=N to keep one free")
    core = int(cores.replace("-", ",").split(",")[0])
    try:
        os.sched_setaffinity(0, {core})
    except OSError as error:
        return Grant("affinity", granted=False, detail=f"core {core}: {error.strerror}")
    return Grant("affinity", granted=True, detail=f"core {core} of the isolated cores {cores}")


def request_timer_slack(slack_ns: int = TIMER_SLACK_NS) -> Grant:
    """Ask the kernel to wake this process when it said, instead of up to 50 µs later."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(PR_SET_TIMERSLACK, ctypes.c_ulong(slack_ns), 0, 0, 0) != 0:
        return Grant("timer_slack", granted=False, detail=os.strerror(ctypes.get_errno()))
    return Grant("timer_slack", granted=True, detail=f"{slack_ns} ns")


def request_frozen_gc() -> Grant:
    """Collect once, put what is left out of the collector's sight, and switch the collector off."""
    gc.collect()
    gc.freeze()
    gc.disable()
    return Grant("gc_off", granted=True, detail=f"{gc.get_freeze_count()} objects frozen, collector off")


def request_prefault(size: int = PREFAULT_BYTES) -> Grant:
    """Touch `size` bytes of heap, so that the scan's small allocations meet pages that are already there."""
    block = bytearray(size)
    for offset in range(0, size, mmap.PAGESIZE):
        block[offset] = 1
    return Grant("prefault", granted=True, detail=f"{size // 1024} KiB of heap touched")


REQUESTS: tuple[Callable[[], Grant], ...] = (
    request_affinity,
    request_timer_slack,
    request_prefault,
    request_mlock,
    request_frozen_gc,
    request_fifo,
)
"""In this order: the heap is touched before it is locked, and FIFO comes last so that nothing slow runs under it."""


def request_all() -> tuple[Grant, ...]:
    """Ask for everything; a refusal is reported, never an error."""
    return tuple(request() for request in REQUESTS)


def is_granted(grants: tuple[Grant, ...], name: str) -> bool:
    """Whether a request was granted."""
    return any(grant.name == name and grant.granted for grant in grants)


def spin_tail(wanted_ns: int, grants: tuple[Grant, ...]) -> tuple[int, Grant]:
    """Return how long to spin before each deadline [ns], and the answer; without FIFO spinning only makes it later."""
    if not wanted_ns:
        why = "not requested: the bench waits for the scan, or there is no processor to spare"
        return 0, Grant("spin_tail", granted=False, detail=why)
    if not is_granted(grants, "fifo"):
        return 0, Grant("spin_tail", granted=False, detail="of use under SCHED_FIFO only, which was refused")
    return wanted_ns, Grant("spin_tail", granted=True, detail=f"the last {wanted_ns // 1000} µs before each deadline")


def answers(grants: tuple[Grant, ...]) -> Realtime:
    """Return for the timing proof what was granted, and the details of each answer."""
    granted = {grant.name: grant.granted for grant in grants}
    return Realtime(
        affinity=granted.get("affinity"),
        timer_slack=granted.get("timer_slack"),
        prefault=granted.get("prefault"),
        mlock=granted.get("mlock"),
        gc_off=granted.get("gc_off"),
        fifo=granted.get("fifo"),
        spin_tail=granted.get("spin_tail"),
        details={grant.name: grant.detail for grant in grants},
    )


@contextmanager
def quiet_collector() -> Iterator[None]:
    """Run a virtual-time run without the collector, and leave it as it was found."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
