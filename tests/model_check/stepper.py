"""One scan of the controller against the small bench, from any state back and forth."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, NamedTuple
from unittest import mock

import small_bench
from safety_rules import RULES, BrokenRuleError
from small_bench import LEFT_CHOICES, START, WOUND_UP, ZERO_NM, BenchState, Choice, Devices, advance, choices, look
from snapshots import Freezer, Snapshot
from step_check import Monitor, check_step

from controller.aftermath import FaultReaction, Release
from controller.controller import Controller
from controller.faults import FAULT_BY_ID
from controller.held_lock import HeldLock, Left
from controller.image import Command, DriveState, Image, Orders, State
from controller.interlocks import INTERLOCKS
from controller.unloading import Unloading

S = State
WATCHED_ALARMS = sum(1 << FAULT_BY_ID[row.fault].number for row in INTERLOCKS if S.FAULT in row.live_in)
"""What can come up in a fault as another cause. Any other alarm stays in a fault what it was when the fault began."""

LONGEST_RUN = 400

COARSE: tuple[tuple[type, str, int], ...] = (
    (Release, "PROVE_SCANS", 2),
    (Unloading, "RELAX_SCANS", 1),
    (Unloading, "STUCK_SCANS", 1),
    (HeldLock, "HOLD_SCANS", 2),
)


@contextmanager
def coarse_time() -> Iterator[None]:
    """Proofs of a few scans instead of fifty, so that the space stays small; the code that counts them is the same."""
    with ExitStack() as shortened:
        for thing, name, scans in COARSE:
            shortened.enter_context(mock.patch.object(thing, name, scans))
        yield


class Node(NamedTuple):
    """One state of everything: controller, devices, and what the rules remember."""

    controller: Snapshot
    bench: BenchState
    monitor: Monitor


class Stepper:
    """The controller with one small program; `left`: with the way back on a bench that was left wound up."""

    def __init__(self, *, by_speed: bool = False, loading_input: bool = True, left: bool = False) -> None:
        taken_up = Left(FAULT_BY_ID["operator_quick_stop"].number, 0.0, ZERO_NM) if left else None
        self.left = left
        self.program = small_bench.small_program(by_speed=by_speed, loading_input=loading_input)
        self.choices = (*choices(), *LEFT_CHOICES) if left else choices()
        self.by_name = {choice.name: choice for choice in self.choices}
        self._controller = Controller(self.program, left=taken_up)
        self._freezer = Freezer(self._controller, WATCHED_ALARMS)

    def step(self, node: Node, choice: Choice, devices: Devices | None = None) -> tuple[Node, Image, Orders]:
        """One scan from a node, with what the devices do in it if that is known; raises `BrokenRuleError`."""
        self._freezer.put_back(node.controller)
        devices = devices or advance(node.bench, choice)
        counter = self._controller._last_counter % 3 + 1
        image = look(devices, choice.command, counter, choice.shown)
        orders = self._decide(image)
        monitor = check_step(node.bench, node.monitor, image, orders)
        bench = BenchState(devices.drive, devices.mode, devices.torque_out_nm, devices.brake_on, orders)
        return Node(self._freezer.take(), bench, monitor), image, orders

    def _decide(self, image: Image) -> Orders:
        controller = self._controller
        try:
            return controller.step(image, controller._last_scan + 1 + image.missed_periods)
        except Exception as error:
            raise BrokenRuleError(RULES[0], f"{type(error).__name__}: {error}") from error

    def key(self, node: Node) -> tuple[Any, ...]:
        """What makes two nodes the same."""
        bench, monitor = node.bench, node.monitor
        seen = (bench.drive, bench.mode, bench.torque_out_nm, bench.brake_on, bench.orders.state)
        return (seen, monitor._replace(alarms=monitor.alarms & WATCHED_ALARMS), self._freezer.key(node.controller))

    def first(self) -> Node:
        """The bench switched on."""
        return Node(self._freezer.take(), WOUND_UP if self.left else START, Monitor(left=self.left))

    def nominal(self) -> list[Node]:
        """The nodes of an undisturbed run, from idle to complete; with `left`, of the way back until it is stopped."""
        node, nodes, orders = self.first(), [], None
        for _ in range(LONGEST_RUN):
            nodes.append(node)
            command = Command.NONE if orders else Command.START
            if self.left and orders and orders.phase == FaultReaction.SETTLED and orders.state == S.FAULT:
                command = Command.RESET if node.monitor.acknowledged else Command.ACKNOWLEDGE
            # a unit that was left wound up stays so until the drive unwinds it
            held = self.left and node.bench.drive != DriveState.OPERATION_ENABLED
            node, _, orders = self.step(node, self.by_name[f"{int(held)}.{command.name}"])
            if orders.state == (S.STOPPED if self.left else S.COMPLETE):
                return [*nodes, node]
        raise BrokenRuleError(RULES[11], "the undisturbed run does not end")
