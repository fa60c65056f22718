"""Which clock a run over wires is made by: a virtual bench waits, unless somebody or the faults say otherwise."""

from __future__ import annotations

from typing import TYPE_CHECKING

from station.bench.request import Job
from station.records.clocks import BY_WALL_CLOCK, SCAN, Pacing
from virtual_bench.faults.vocabulary import BY_STATION

if TYPE_CHECKING:
    from virtual_bench.faults.scenario import Scenario


def pacing_of(job: Job, scenario: Scenario | None = None, *, wall_clock: bool = False, fast: bool = False) -> Pacing:
    """Return the clock of a run over wires.

    A virtual bench waits for the scan; real hardware never does. Faults of the machine itself (a process that is
    stopped or killed, a full disk) are about real time, so they are run by the wall clock.
    """
    of_machine = scenario is not None and any((fault.target, fault.verb) in BY_STATION for fault in scenario.faults)
    waits = job.bench.bench.embedded or job.bench.pace is not None
    return BY_WALL_CLOCK if wall_clock or of_machine or not waits else Pacing(SCAN, fast=fast)
