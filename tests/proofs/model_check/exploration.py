"""Walks through all that the controller can do against a bench that may do anything: breadth first, no repetition."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Any

from graph import Graph
from mutants import Mutant
from probes import Probes, check_agreement, check_trips
from safety_rules import BrokenRuleError, waits_for_hands
from stepper import Happening, Node, Stepper, coarse_time

from definitions.image import State

S = State
ENDS = (S.IDLE, S.COMPLETE, S.STOPPED, S.FAULT)


@dataclass
class Explored:
    """What a walk has seen."""

    states: int = 0
    choices: int = 0
    steps: int = 0
    places: int = 0
    probes: int = 0
    compared: int = 0
    longest_scans: int = 0
    complete: bool = False
    visited: set[State] = field(default_factory=set)
    probed: dict[str, set[State]] = field(default_factory=dict)


class Explorer:
    """Breadth-first search over one program; options as those of `Stepper`.

    `only`: a fault, of which alone the conditions are put on, and nothing else is tried off the walk.
    """

    def __init__(self, *, only: str = "", **options: bool) -> None:
        self.stepper = Stepper(**options)
        self.only = only
        self.probes = Probes(self.stepper, only)
        self.graph = Graph()
        self.found = Explored()
        self._queue: deque[tuple[int, Node]] = deque()
        self._places: set[Any] = set()

    def explore(self, most_states: int = 1_000_000) -> Explored:
        """Visit every state that can be reached, or as many as allowed; `BrokenRuleError` at the first breach."""
        check_trips()
        check_agreement(self.stepper.program)
        nominal = self.stepper.nominal()
        for number, node in enumerate(nominal):
            self._take_in(node, (number - 1, "nominal"))
        for node in () if self.stepper.left or self.stepper.jog or self.only else nominal[::3]:
            self.probes.ways_back(node)
        while self._queue and len(self.graph) < most_states:
            self._expand(*self._queue.popleft())
        found, probes = self.found, self.probes
        found.complete = not self._queue
        found.states, found.places = len(self.graph), len(self._places)
        found.steps += probes.steps
        found.probes, found.probed = probes.count, probes.states
        found.compared = self.stepper.compared
        found.longest_scans = self.graph.longest_way()
        return found

    def _expand(self, number: int, node: Node) -> None:
        """Let everything happen that may happen in one scan."""
        happenings = self.stepper.happenings(node.bench)
        self.graph.follow(number, tuple([self._follow(number, node, what) for what in happenings]))
        self.found.choices += len(self.stepper.choices)
        self.found.steps += len(happenings)

    def _follow(self, number: int, node: Node, what: Happening) -> int:
        try:
            return self._take_in(self.stepper.follow(node, what), (number, what.name))
        except BrokenRuleError as error:
            error.add_note("timeline: " + ", ".join(self.graph.way_to(number, what.name)))
            raise

    def _take_in(self, node: Node, came_from: tuple[int, str]) -> int:
        key = self.stepper.key(node)
        number = self.graph.number(key)
        if number is not None:
            return number
        orders, bench = node.bench.orders, node.bench
        state = orders.state
        number = self.graph.add(key, came_from, running=state not in ENDS and not waits_for_hands(orders))
        self.found.visited.add(state)
        self._queue.append((number, node))
        place = (state, orders.phase, orders.segment, orders.drive_command, bench.drive, bench.brake_on)
        if place not in self._places:
            self._places.add(place)
            self.probes.conditions(node, state)
            if not self.only:
                self.probes.persist(node)
        return number


NEIGHBOURHOODS: tuple[tuple[dict[str, bool], int], ...] = (({}, 600), ({"by_speed": True}, 300))
NEAR_A_JOG: tuple[tuple[dict[str, bool], int], ...] = (({"jog": True}, 1500),)
NEAR_THE_WAY_BACK: tuple[tuple[dict[str, bool], int], ...] = (({"left": True}, 3000),)
"""Walks that look for mutants, and how many states of each."""


def check_mutant(mutant: Mutant) -> bool:
    """Return whether the check notices a mutant, by the undisturbed runs and what branches off near them.

    A row of a fault is most likely missed where that fault is due: a walk that asks for nothing else is a part of the
    whole one, and goes first.
    """
    walks = NEAR_THE_WAY_BACK if mutant.on_the_way_back else NEAR_A_JOG if mutant.of_a_jog else NEIGHBOURHOODS
    for only in (mutant.fault, "") if mutant.fault else ("",):
        for walk, states in walks:
            try:
                with coarse_time(), mutant.applied():
                    Explorer(only=only, **walk).explore(states)
            except BrokenRuleError:
                return True
    return False
