"""When faults start and end, and which of them have been seen to act; what they do is for whoever asks.

The virtual bench's injector and the gateway on a cable's wires both build on it. `unseen()` names the faults that never
had an effect, so that none does nothing silently.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from virtual_bench.faults.scenario import Fault, Scenario, When
from virtual_bench.faults.vocabulary import BY_STATION

LOST = -1
"""Fate of a frame that never arrives; others are delays in ns."""


@dataclass(frozen=True)
class Acted:
    """Report of a fault that has acted."""

    fault: Fault
    at_s: float


def _by_station(fault: Fault) -> bool:
    return (fault.target, fault.verb) in BY_STATION


def moment_of(when: When) -> str:
    """Say a moment in the words of the scenario file."""
    return ", ".join(f"{name} {value}" for name, value in when.model_dump(exclude_defaults=True).items())


def without_effect(fault: Fault) -> str:
    """Begin the sentence about a fault that has had no effect."""
    return f"the fault {fault.target} {fault.verb} had no effect: "


def never_due(fault: Fault) -> str:
    """Say that the moment of a fault did not come."""
    return f"the fault {fault.target} {fault.verb} had no effect: its trigger ({moment_of(fault.when)}) was not reached"


def never_met(fault: Fault) -> str:
    """Say that nothing went a fault's way."""
    return f"the fault {fault.target} {fault.verb} had no effect: it was injected, but nothing changed"


class FaultSchedule:
    """Starts each fault at its moment and notes when its effect was first seen."""

    def __init__(self, scenario: Scenario | None, report: Callable[[Acted], None] | None = None) -> None:
        self.acted: list[Acted] = []
        self.active: dict[tuple[str, str], Fault] = {}
        self.targets: frozenset[str] = frozenset()
        """What the active faults act on: who is asked about anything else, in every scan, need not look further."""
        self.since_ns: dict[tuple[str, str], int] = {}
        self.dice = random.Random(1)  # noqa: S311 - the same frames are lost in every run
        self.now_ns = 0
        self._waiting = [] if scenario is None else [fault for fault in scenario.faults if not _by_station(fault)]
        self._started: list[Fault] = []  # until something is different because of them
        self._ends_ns: dict[tuple[str, str], int] = {}
        self._kept: dict[tuple[str, str], float] = {}
        self.armed = bool(self._waiting)
        """Whether there is or was any fault; while there is none, `step` need not be called."""
        self._report = report
        self._controller: tuple[str, int, int] | None = None  # state, scan of its entry, scan now

    def inject(self, faults: Iterable[Fault]) -> None:
        """Add faults to those that wait for their moment."""
        self._waiting += faults
        self.armed = True

    def withdraw(self, target: str, verb: str) -> bool:
        """End a fault at the next step; False when it is not active."""
        active = (target, verb) in self.active
        if active:
            self._ends_ns[target, verb] = self.now_ns
        return active

    def tell(self, state: str, scan: int, entered: int | None = None) -> None:
        """Say what state the controller is in after a scan; moments that are keyed by it need this.

        Without `entered` the state was entered in the scan in which it was first told.
        """
        before = self._controller
        if entered is None:
            entered = before[1] if before is not None and before[0] == state else scan
        self._controller = (state, entered, scan)

    def step(self, now_ns: int) -> None:
        """Start the faults that are due and end those whose time is over."""
        self.now_ns = now_ns
        if self._started:
            self._look()
        if self._ends_ns:
            for key in [key for key, end_ns in self._ends_ns.items() if now_ns >= end_ns]:
                del self._ends_ns[key]
                ended = self.active.pop(key)
                self.targets = frozenset(target for target, _ in self.active)
                self._end(ended, now_ns)
        if not self._waiting:
            return
        torque_nm = self._torque_nm()
        for fault in [fault for fault in self._waiting if self._is_due(fault.when, torque_nm, now_ns * 1e-9)]:
            self._waiting.remove(fault)
            key = (fault.target, fault.verb)
            self.active[key] = fault
            self.targets |= {fault.target}
            self.since_ns[key] = now_ns
            if fault.for_ms is not None:
                self._ends_ns[key] = now_ns + round(fault.for_ms * 1e6)
            if self._start(fault, now_ns):
                self._note(fault)
            else:
                self._started.append(fault)

    def _is_due(self, when: When, torque_nm: float, time_s: float) -> bool:
        if when.torque_out_above_nm is not None:
            return torque_nm > when.torque_out_above_nm
        if when.time_s is not None:
            return time_s >= when.time_s
        if self._controller is None:
            return False
        state, entered, scan = self._controller
        if when.scan is not None:
            return scan + 1 >= when.scan
        return state == when.state and scan + 1 - entered >= when.after_scans

    # --- what a bench adds

    def _look(self) -> None:
        """Look for effects that nobody else would see; asked in every step while a fault waits to be seen."""

    def _torque_nm(self) -> float:
        """Return the magnitude of the torque in the reducer; 0 for one who cannot see it."""
        return 0.0

    def _start(self, fault: Fault, now_ns: int) -> bool:
        """Start a fault and return whether that alone is its effect."""
        del fault, now_ns
        return False

    def _end(self, fault: Fault, now_ns: int) -> None:
        """Take back what a fault did when it started."""
        del now_ns
        self._kept.pop((fault.target, fault.verb), None)

    # --- who has seen what

    def seen(self, target: str) -> None:
        """Note that something on `target` was different because of its fault; called by whoever changed it."""
        if self._started:
            for fault in [fault for fault in self._started if fault.target == target]:
                self._started.remove(fault)
                self._note(fault)

    def unseen(self) -> list[Fault]:
        """Return the faults that have had no effect: not due, or never on the way of anything."""
        return [*self._waiting, *self._started]

    def why_unseen(self) -> list[str]:
        """Say of each fault that has had no effect why it has not, one sentence each."""
        return [*map(never_due, self._waiting), *map(never_met, self._started)]

    def _note(self, fault: Fault) -> None:
        acted = Acted(fault, self.now_ns * 1e-9)
        self.acted.append(acted)
        if self._report is not None:
            self._report(acted)

    # --- asked by those who change something

    def value(self, target: str, verb: str) -> float | None:
        """Return the value of an active fault (0 for one that takes none), None while it is not active."""
        fault = self.active.get((target, verb))
        return None if fault is None else fault.value or 0.0

    def count_down(self, key: tuple[str, str], times: float) -> bool:
        """Tell whether a fault that acts so many times has one left, and take it."""
        left = self._kept.get(key, times)
        self._kept[key] = left - 1
        return left > 0
