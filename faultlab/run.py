"""One run in virtual time with faults in it: what happened, scan by scan, and when each fault acted."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, field

from controller.context import Event
from controller.controller import Controller
from definitions.image import Command, Image, Orders, State
from definitions.program import Program
from station.bench.assemble_virtual import virtual_config
from station.bench.request import Job
from station.bench.virtual_unit import VirtualUnit
from station.run.faults.companion import AFTER_END_SCANS, COMMANDS
from station.scan.scan_loop import START_AT
from virtual_bench.config import BenchConfig
from virtual_bench.faults.injector import FaultInjector
from virtual_bench.faults.scenario import Scenario, When
from virtual_bench.in_process import VirtualTimeBench

LONGEST_RUN_S = 300.0


@dataclass(frozen=True)
class Kept:
    """What the record of a run says afterwards: state, verdict, and what is wrong with its samples."""

    state: str
    verdict: str | None
    problems: tuple[str, ...]


@dataclass
class FaultRun:
    """A finished run: one entry per scan in `scans`, `images` and `orders`, and the faults with their first scan."""

    period_s: float
    scans: list[int] = field(default_factory=list)
    images: list[Image] = field(default_factory=list)
    orders: list[Orders] = field(default_factory=list)
    torque_nm: list[float] = field(default_factory=list)  # in the reducer itself, whatever the sensors say
    events: list[Event] = field(default_factory=list)
    acted: list[tuple[str, int]] = field(default_factory=list)  # "target verb" and the place in `scans`
    unseen: list[str] = field(default_factory=list)  # a sentence for each fault that has had no effect
    finished: bool = False
    refused: str = ""  # why the bench was not opened: nothing has moved
    kept: Kept | None = None  # over wires

    @property
    def states(self) -> list[str]:
        """States in the order in which they were visited."""
        visited: list[str] = []
        for orders in self.orders:
            name = State(orders.state).name.lower()
            if not visited or visited[-1] != name:
                visited.append(name)
        return visited

    def alarms(self) -> list[Event]:
        """Alarms in the order of their scans."""
        return [event for event in self.events if event.kind == "alarm"]

    def place(self, scan: int) -> int:
        """Return where a scan stands in the lists."""
        return self.scans.index(scan)

    def waited(self, first: int, last: int) -> int:
        """Return the scans between two places, the missed ones among them."""
        return self.scans[last] - self.scans[first]


class Bench:
    """A bench in virtual time with its controller; `go` steps both. Used by scenarios, the matrix and plant's tests."""

    def __init__(self, program: Program, config: BenchConfig, scenario: Scenario | None) -> None:
        period_ns = round(program.period_s * 1e9)
        self.bench = VirtualTimeBench(config, period_ns, scenario)
        self.controller = Controller(program)
        self.run = FaultRun(period_ns * 1e-9)
        self._operator = list(scenario.operator) if scenario is not None else []
        self._scan = -1
        self._entered = 0
        self._command = Command.NONE
        self._acted = 0

    @property
    def faults(self) -> FaultInjector:
        """What injects."""
        return self.bench.faults

    @property
    def state(self) -> str:
        """State of the controller."""
        return self.controller.state.name.lower()

    def order(self, command: Command) -> None:
        """Give a command to the next scan."""
        self._command = command

    def go(self) -> Orders:
        """Run one scan."""
        missed = self.bench.faults.take_missed()
        self._scan += 1 + missed
        run, before = self.run, self.controller.state
        image = self.bench.read(self._scan, missed, self._next_command())
        orders = self.controller.step(image, self._scan)
        run.images.append(image._replace())  # the bench writes its answers into it
        self.bench.write(orders, self._scan)
        if self.controller.state != before:
            self._entered = self._scan
        self.bench.faults.tell(self.state, self._scan)
        run.scans.append(self._scan)
        run.orders.append(orders)
        run.torque_nm.append(self.bench.plant.reducer_torque_nm)
        run.events += self.controller.events
        self.controller.events.clear()
        for acted in self.bench.faults.acted[self._acted :]:
            self._acted += 1
            run.acted.append((f"{acted.fault.target} {acted.fault.verb}", len(run.scans) - 1))
        return orders

    def silence(self) -> None:
        """Let one period pass without a controller: nothing is sent, the orders of the last scan are kept."""
        self._scan += 1
        run = self.run
        run.scans.append(self._scan)
        run.images.append(self.bench.read(self._scan, 0, 0)._replace())
        run.orders.append(run.orders[-1])
        run.torque_nm.append(self.bench.plant.reducer_torque_nm)

    def until(self, condition: Callable[[Orders], bool]) -> bool:
        """Run until a condition holds; False when the run ended or lasted too long before that."""
        most = round(LONGEST_RUN_S / self.run.period_s)
        for _ in range(most):
            if condition(self.go()):
                return True
            if self.controller.finished:
                return False
        return False

    def finish(self) -> FaultRun:
        """Run to the end, and a little further."""
        most = round(LONGEST_RUN_S / self.run.period_s)
        for _ in range(most):
            self.go()
            if self.controller.finished and not self._operator_can_act():
                break
        self.run.finished = self.controller.finished
        for _ in range(AFTER_END_SCANS):
            self.go()
        self.run.unseen = self.bench.faults.why_unseen()
        return self.run

    def _operator_can_act(self) -> bool:
        """Tell whether a moment of the operator can still come in a run that has ended: no other state will."""
        return any(item.when.scan is not None or item.when.state == self.state for item in self._operator)

    def branch(self, scenario: Scenario) -> Bench:
        """Return a copy that goes on from here with the faults of a scenario; its record begins anew."""
        run, self.run = self.run, FaultRun(self.run.period_s)
        twin = copy.deepcopy(self)
        self.run = run
        twin.faults.inject(scenario.faults)
        return twin

    def _next_command(self) -> int:
        command, self._command = self._command, Command.NONE
        if self._scan == START_AT:
            return Command.START
        for item in self._operator:
            if self._is_due(item.when):
                self._operator.remove(item)
                return COMMANDS[item.command]
        return command

    def _is_due(self, when: When) -> bool:
        if when.scan is not None:
            return self._scan >= when.scan
        return self.state == when.state and self._scan - self._entered >= when.after_scans


def run_scenario(job: Job, unit: VirtualUnit, scenario: Scenario) -> FaultRun:
    """Run a scenario in virtual time."""
    return Bench(job.program, virtual_config(job.bench, job.profile_paths, unit), scenario).finish()
