"""What the station does to its own processes in a run with faults: one row per fault of `BY_STATION`.

Each is done by the supervisor, to the real thing: SIGKILL and SIGSTOP to processes, a limit of the kernel on the size
of files (`RLIMIT_FSIZE`: every write fails, with EFBIG where a full disk has ENOSPC), a jump of the one wall clock that
the supervisor reads. `proof` tells from what is left of the run whether the fault has acted.
"""

from __future__ import annotations

import os
import resource
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from station.wall_clock import WALL_CLOCK
from virtual_bench.faults.scenario import Fault

CLOCK_TOLERANCE_S = 0.3
STOPPED_SHARE = 0.8
"""Share of a stop that must have been missed: it may begin and end within periods, and waking takes its time."""


@dataclass(frozen=True)
class Traces:
    """What is left of a run that tells of its machine's faults."""

    scan_died: bool = False
    """The scan process ended without saying so."""
    supervisor_killed: bool = False
    disk_refused: bool = False
    """The supervisor stopped the run because the disk did not take its records."""
    clock_jumped_s: float = 0.0
    missed: int = 0
    """Periods that the scan has missed."""
    period_ms: float = 1.0


class Deed(NamedTuple):
    """What is done to the scan process of an id by a fault's value, how it is taken back, and what proves it."""

    begin: Callable[[int, float], None]
    end: Callable[[float], None]
    proof: Callable[[Traces, float], bool]


def _not_taken_back(_value: float) -> None:
    """Leave it: the fault is done once."""


def _stop(scan_pid: int, ms: float) -> None:
    os.kill(scan_pid, signal.SIGSTOP)
    time.sleep(ms * 1e-3)
    os.kill(scan_pid, signal.SIGCONT)


def _kill_scan(scan_pid: int, _value: float) -> None:
    os.kill(scan_pid, signal.SIGKILL)


def _kill_supervisor(_scan_pid: int, _value: float) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def _fill_disk(_scan_pid: int, _value: float) -> None:
    _, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, most))  # Python ignores the signal SIGXFSZ: the write fails instead


def free_disk(_value: float = 0.0) -> None:
    """Let this process write files again."""
    _, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))


def _held_up(traces: Traces, ms: float) -> bool:
    """Tell whether so many periods were missed as the stop lasted, or nearly: any machine misses one now and then."""
    return traces.scan_died or traces.missed >= max(1.0, STOPPED_SHARE * ms / traces.period_ms)


def _jumped(traces: Traces, step_s: float) -> bool:
    return traces.clock_jumped_s != 0.0 and abs(traces.clock_jumped_s - step_s) < CLOCK_TOLERANCE_S


DEEDS: dict[tuple[str, str], Deed] = {
    ("process.scan", "stop"): Deed(_stop, _not_taken_back, _held_up),
    ("process.scan", "kill"): Deed(_kill_scan, _not_taken_back, lambda traces, _: traces.scan_died),
    ("process.desk", "kill"): Deed(_kill_supervisor, _not_taken_back, lambda traces, _: traces.supervisor_killed),
    ("machine.disk", "full"): Deed(_fill_disk, free_disk, lambda traces, _: traces.disk_refused),
    ("machine.clock", "step"): Deed(lambda _, step_s: WALL_CLOCK.step(step_s), lambda s: WALL_CLOCK.step(-s), _jumped),
}
"""By target and verb; the keys are those of `BY_STATION`."""


def deed_of(fault: Fault) -> Deed | None:
    """Return what the station does for a fault; None for one that is the bench's."""
    return DEEDS.get((fault.target, fault.verb))
