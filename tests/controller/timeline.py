"""Runs a controller against the bench model and keeps what it did, scan by scan."""

from __future__ import annotations

import copy
from collections.abc import Callable

from bench_model import BenchModel

from controller.context import Event
from controller.controller import Controller
from definitions.image import Command, Image, Orders, State
from definitions.program import Program


class Timeline:
    """A run in the making: `until` a condition, `go` some scans, with changes to the bench in between."""

    def __init__(self, program: Program, *, start: bool = True) -> None:
        self.bench = BenchModel(program)
        self.controller = Controller(program)
        self.scan = 0
        self.images: list[Image] = []
        self.orders: list[Orders] = []
        self.events: list[Event] = []
        if start:
            self.bench.command = Command.START

    def branch(self) -> Timeline:
        """Return a run that goes on from here by itself, so that many tests need not go the same way there."""
        other = copy.copy(self)
        kept = {id(self.controller.program): self.controller.program}
        other.bench, other.controller = copy.deepcopy((self.bench, self.controller), kept)
        other.images, other.orders, other.events = list(self.images), list(self.orders), list(self.events)
        return other

    def go(self, scans: int = 1) -> Orders:
        for _ in range(scans):
            image = self.bench.read()
            orders = self.controller.step(image, self.scan)
            self.bench.write(orders)
            self.scan += 1 + image.missed_periods
            self.images.append(image)
            self.orders.append(orders)
            self.events += self.controller.events
            self.controller.events.clear()
        return self.orders[-1]

    def until(self, condition: Callable[[Orders], bool], most: int = 40_000) -> Orders:
        for _ in range(most):
            if condition(self.go()):
                return self.orders[-1]
        message = f"condition not met in {most} scans; state {self.controller.state.name}"
        raise AssertionError(message)

    def until_state(self, state: State) -> Orders:
        return self.until(lambda orders: orders.state == state)

    def until_finished(self) -> Orders:
        return self.until(lambda _: self.controller.finished)

    def command(self, command: Command) -> Orders:
        self.bench.command = command
        return self.go()

    def states(self) -> list[State]:
        """States in the order in which they were visited."""
        visited = [State(self.orders[0].state)]
        for orders in self.orders:
            if orders.state != visited[-1]:
                visited.append(State(orders.state))
        return visited

    def alarms(self) -> list[str]:
        return [event.text for event in self.events if event.kind == "alarm"]
