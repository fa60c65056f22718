"""What runs beside the supervisor in a run with faults over wires.

It tells the bench where the controller is, plays the operator of the scenario, and does to the station's own processes
what a machine in trouble would do to them (`machine_faults`); the bench's log names that too, because it outlives them
all. It looks at records that were written, twice 20 ms after they were made at most:
moments that wait for a state come up to that much late. When a fault acted is known all the same, from whoever
injected it, on the monotonic clock.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import NamedTuple

from definitions.image import Command, State
from station.records.samples.scan_record import RECORD_BYTES, unpack
from station.run.faults.machine_faults import DEEDS, deed_of
from virtual_bench.faults.scenario import Fault, Operator, Scenario, When

AFTER_END_SCANS = 300
"""Scans that are run on after the end, so that what would clear by itself is seen to do so."""

COMMANDS = {command.name.lower(): command for command in Command}


def after_end_scans(scenario: Scenario) -> int:
    """Return for how many scans a run goes on after its end: longer while the operator has something to do then."""
    late = [item.when.after_scans for item in scenario.operator if item.when.state is not None]
    return AFTER_END_SCANS + max(late, default=0)


class Reach(NamedTuple):
    """What a companion may do: the scan process's id, commands into its mailbox, lines for the virtual bench."""

    scan_pid: int
    order: Callable[[Command], None]
    tell: Callable[[bytes], None] | None


class Companion:
    """Follows one run of a scenario."""

    def __init__(self, scenario: Scenario, *, judged: bool) -> None:
        """Follow a scenario; one that is not judged only has its faults injected."""
        self.after_end_scans = after_end_scans(scenario) if judged else 0
        self._waiting: list[Operator] = list(scenario.operator) if judged else []
        self._faults = [fault for fault in scenario.faults if deed_of(fault) is not None]
        self._ends_ns: dict[Fault, int] = {}
        self._reach: Reach | None = None
        self._state = ""
        self._entered = 0
        self._scan = -1

    def begin(self, reach: Reach) -> None:
        """Take what can be reached, once both processes are there."""
        self._reach = reach

    def look(self, data: bytes) -> None:
        """Take the records since the last look."""
        for start in range(0, len(data), RECORD_BYTES):
            scan, _, orders = unpack(memoryview(data)[start : start + RECORD_BYTES])
            state = State(orders.state).name.lower()
            if state != self._state:
                self._state, self._entered = state, scan
            self._scan = scan
        if self._reach is not None and self._scan >= 0:
            self._act(self._reach)

    def tick(self) -> None:
        """Take back what has lasted long enough; called at every look of the supervisor, with records or without."""
        now_ns = time.monotonic_ns()
        for fault in [fault for fault, end_ns in self._ends_ns.items() if now_ns >= end_ns]:
            del self._ends_ns[fault]
            DEEDS[fault.target, fault.verb].end(fault.value or 0.0)

    def _act(self, reach: Reach) -> None:
        if reach.tell is not None:
            line = {"state": self._state, "scan": self._scan, "entered": self._entered}
            reach.tell(json.dumps(line).encode() + b"\n")
        due = next((item for item in self._waiting if self.is_due(item.when)), None)
        if due is not None:
            self._waiting.remove(due)
            reach.order(COMMANDS[due.command])

        for fault in [fault for fault in self._faults if self.is_due(fault.when)]:
            self._faults.remove(fault)
            now_ns = time.monotonic_ns()
            if reach.tell is not None:  # before it is done: the supervisor may not live to tell
                done = {"acted": f"{fault.target} {fault.verb}", "value": fault.value, "clock_ns": now_ns}
                reach.tell(json.dumps(done).encode() + b"\n")
            if fault.for_ms is not None:
                self._ends_ns[fault] = now_ns + round(fault.for_ms * 1e6)
            DEEDS[fault.target, fault.verb].begin(reach.scan_pid, fault.value or 0.0)

    def is_due(self, when: When) -> bool:
        """Tell whether a moment that the controller's state or scan gives has come."""
        if when.scan is not None:
            return self._scan >= when.scan
        return self._state == when.state and self._scan - self._entered >= when.after_scans
