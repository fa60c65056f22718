"""Walks through all that the controller can do against a bench that may do anything: breadth first, no repetition."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple
from unittest import mock

import small_bench
from bench_model import READY
from mutants import Mutant
from safety_rules import (
    AGREEMENT_STATES,
    CONDITIONS,
    ESTABLISHED,
    RULES,
    BrokenRuleError,
    Monitor,
    check_step,
    require,
)
from small_bench import (
    LEFT_CHOICES,
    START,
    WOUND_UP,
    ZERO_NM,
    BenchState,
    Choice,
    Devices,
    Shown,
    advance,
    choices,
    look,
)
from snapshots import Freezer, Snapshot

from controller.aftermath import FaultReaction, Release
from controller.controller import Controller
from controller.debounce import debounce_scans
from controller.faults import FAULT_BY_ID
from controller.held_lock import HeldLock, Left
from controller.image import Command, DriveState, Image, Orders, Reaction, State
from controller.interlocks import INTERLOCKS, Measured, Watch
from controller.program import Program
from controller.states import Sequence
from controller.unloading import Unloading

S = State
ENDS = (S.IDLE, S.COMPLETE, S.STOPPED, S.FAULT)
WATCHED_ALARMS = sum(1 << FAULT_BY_ID[row.fault].number for row in INTERLOCKS if S.FAULT in row.live_in)
"""What can come up in a fault as another cause. Any other alarm stays in a fault what it was when the fault began."""

AGREEMENT_NM = 3.5
LONGEST_RUN = 400
SETTLED_AFTER = 12
WAYS_BACK: tuple[tuple[str, ...], ...] = (
    # commands by what the bench shows: 0 in order, 1 torque stays in the unit, 3 emergency stop, 4 brake link lost
    ("0.RESET",),
    ("1.RESET",),
    ("0.ACKNOWLEDGE", "0.RESET"),
    ("1.ACKNOWLEDGE", "1.RESET"),
    ("3.ACKNOWLEDGE", "3.RESET"),
    ("4.ACKNOWLEDGE", "4.RESET"),
    ("1.ACKNOWLEDGE", "4.NONE", "0.RESET"),
)
STUBBORN = (
    "0.NONE",
    "1.NONE",
    "2.NONE",
    "drive lags",
    "mode lags",
    "brake lags",
    "no homing",
    "samples late",
    "left: samples late",
)


class Node(NamedTuple):
    """One state of everything: controller, devices, and what the rules remember."""

    controller: Snapshot
    bench: BenchState
    monitor: Monitor


@dataclass
class Explored:
    """What a walk has seen."""

    states: int = 0
    choices: int = 0
    steps: int = 0
    places: int = 0
    probes: int = 0
    longest_scans: int = 0
    complete: bool = False
    visited: set[State] = field(default_factory=set)
    probed: dict[str, set[State]] = field(default_factory=dict)


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


class Explorer:
    """Breadth-first search over one program; `left`: over the way back on a bench that was left wound up."""

    def __init__(self, *, by_speed: bool = False, loading_input: bool = True, left: bool = False) -> None:
        taken_up = Left(FAULT_BY_ID["operator_quick_stop"].number, 0.0, ZERO_NM) if left else None
        self.left = left
        program = small_bench.small_program(by_speed=by_speed, loading_input=loading_input)
        self.controller = Controller(program, left=taken_up)
        self.conditions = {name: shown_on(program, condition.shown) for name, condition in CONDITIONS.items()}
        self.freezer = Freezer(self.controller, WATCHED_ALARMS)
        self.choices = (*choices(), *LEFT_CHOICES) if left else choices()
        self.by_name = {choice.name: choice for choice in self.choices}
        self.stubborn = [choice for choice in self.choices if choice.name in STUBBORN]
        self.found = Explored()
        self._places: set[Any] = set()
        self._ids: dict[Any, int] = {}
        self._edges: list[tuple[int, ...]] = []
        self._running: list[bool] = []
        self._came_from: list[tuple[int, str]] = []

    def step(self, node: Node, choice: Choice, devices: Devices | None = None) -> tuple[Node, Image, Orders]:
        """One scan from a node, with what the devices do in it if that is known; raises `BrokenRuleError`."""
        self.freezer.put_back(node.controller)
        devices = devices or advance(node.bench, choice)
        counter = self.controller._last_counter % 3 + 1
        image = look(devices, choice.command, counter, choice.shown)
        orders = self._decide(image)
        monitor = check_step(node.bench, node.monitor, image, orders)
        bench = BenchState(devices.drive, devices.mode, devices.torque_out_nm, devices.brake_on, orders)
        return Node(self.freezer.take(), bench, monitor), image, orders

    def _decide(self, image: Image) -> Orders:
        controller = self.controller
        try:
            return controller.step(image, controller._last_scan + 1 + image.missed_periods)
        except Exception as error:
            raise BrokenRuleError(RULES[0], f"{type(error).__name__}: {error}") from error

    def key(self, node: Node) -> tuple[Any, ...]:
        """What makes two nodes the same."""
        bench, monitor = node.bench, node.monitor
        seen = (bench.drive, bench.mode, bench.torque_out_nm, bench.brake_on, bench.orders.state)
        return (seen, monitor._replace(alarms=monitor.alarms & WATCHED_ALARMS), self.freezer.key(node.controller))

    def first(self) -> Node:
        """The bench switched on."""
        return Node(self.freezer.take(), WOUND_UP if self.left else START, Monitor(left=self.left))

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

    def explore(self, most_states: int = 1_000_000) -> Explored:
        """Visit every state that can be reached, or as many as allowed; `BrokenRuleError` at the first breach."""
        found = self.found
        _check_trips()
        queue: deque[tuple[int, Node]] = deque()
        _check_agreement(self.controller.program)
        nominal = self.nominal()
        for number, node in enumerate(nominal):
            self._take_in(node, queue, (number - 1, "nominal"))
        for node in () if self.left else nominal[::3]:
            self._ways_back(node)
        while queue and len(self._ids) < most_states:
            number, node = queue.popleft()
            self._edges[number] = self._expand(number, node, queue)
        found.complete = not queue
        found.states, found.places = len(self._ids), len(self._places)
        found.longest_scans = self._longest_way()
        return found

    def _expand(self, number: int, node: Node, queue: deque[tuple[int, Node]]) -> tuple[int, ...]:
        """Let everything happen that may happen in one scan.

        Choices that leave the devices alike and show the controller the same image, such as a drive that lags where it
        has nothing to do, are one and the same step: the controller sees nothing else.
        """
        following: dict[tuple[Devices, int, Shown], int] = {}
        for choice in self.choices:
            devices = advance(node.bench, choice)
            same = devices, choice.command, choice.shown
            if same not in following:
                following[same] = self._follow(number, node, choice, devices, queue)
        self.found.choices += len(self.choices)
        self.found.steps += len(following)
        return tuple(following.values())

    def _follow(self, number: int, node: Node, choice: Choice, devices: Devices, queue: deque[tuple[int, Node]]) -> int:
        try:
            return self._take_in(self.step(node, choice, devices)[0], queue, (number, choice.name))
        except BrokenRuleError as error:
            error.add_note("timeline: " + ", ".join(self._way_to(number, choice.name)))
            raise

    def _way_to(self, number: int, last: str) -> list[str]:
        """Names of the choices that lead from the start to a breach."""
        names = [last]
        while number >= 0:
            number, name = self._came_from[number]
            names.append(name)
        return names[::-1]

    def _take_in(self, node: Node, queue: deque[tuple[int, Node]], came_from: tuple[int, str]) -> int:
        key = self.key(node)
        number = self._ids.get(key)
        if number is not None:
            return number
        number = self._ids[key] = len(self._edges)
        state = State(node.bench.orders.state)
        self._edges.append(())
        self._came_from.append(came_from)
        self._running.append(state not in ENDS)
        self.found.visited.add(state)
        queue.append((number, node))
        orders, bench = node.bench.orders, node.bench
        place = (state, orders.phase, orders.segment, orders.drive_command, bench.drive, bench.brake_on)
        if place not in self._places:
            self._places.add(place)
            self._probe(node, state)
            self._persist(node)
        return number

    def _ways_back(self, node: Node) -> None:
        """A fault with torque left in the unit, and operators who do not do what they should."""
        for way in WAYS_BACK:
            at = self.step(node, self.by_name["drive drops, torque stays"])[0]
            for _ in range(SETTLED_AFTER):
                at = self.step(at, self.by_name["1.NONE"])[0]
            for name in way:
                at = self.step(at, self.by_name[name])[0]
            for _ in range(SETTLED_AFTER):
                at = self.step(at, self.by_name[way[-1].replace("RESET", "NONE")])[0]
            self.found.steps += 2 * SETTLED_AFTER + len(way) + 1

    def _persist(self, node: Node) -> None:
        """Let one device misbehave in the same way for ever: the run, or the reaction to its fault, still ends."""
        for choice in self.stubborn:
            at, seen = node, set()
            for _ in range(LONGEST_RUN):
                self.found.steps += 1
                at = self.step(at, choice)[0]
                key = self.key(at)
                state = at.bench.orders.state
                settled = at.bench.orders.phase == FaultReaction.SETTLED  # there a way back waits for a person
                if state in (S.IDLE, S.COMPLETE, S.STOPPED) or (state == S.FAULT and settled):
                    break
                require(11, f"{choice.name} for ever, in {State(state).name}", holds=key not in seen)
                seen.add(key)

    def _probe(self, node: Node, state: State) -> None:
        """Put on every condition that must be seen here, and look for its reaction in time."""
        for name, condition in CONDITIONS.items():
            established = node.bench.orders.phase in ESTABLISHED.get(state, ())
            if state not in condition.states and not (established and state in condition.established_in):
                continue
            self.found.probes += 1
            self.found.probed.setdefault(name, set()).add(state)
            self._probe_one(node, name)

    def _probe_one(self, node: Node, name: str) -> None:
        condition, nominal = CONDITIONS[name], Choice(name, shown=self.conditions[name])
        began = State(node.bench.orders.state)
        strongest, asked_for = Reaction.NONE, (*condition.states, *condition.established_in)
        for _ in range(condition.within_scans):
            node, _, orders = self.step(node, nominal)
            if orders.state in (S.FAULT, *asked_for):
                strongest = max(strongest, Reaction(orders.reaction))
            if orders.state not in asked_for:
                break  # the run has gone on to where the condition means nothing
        stays = orders.state in asked_for or orders.state == S.FAULT
        holds = strongest >= condition.reaction or not stays
        require(10, f"{name} in {began.name}: reaction {strongest.name} in {condition.within_scans} scans", holds=holds)

    def _longest_way(self) -> int:
        """Scans that a run can last at most; `BrokenRuleError` when it can go round for ever."""
        order: list[int] = []
        incoming = [0] * len(self._edges)
        for number, following in enumerate(self._edges):
            if self._running[number]:
                for after in set(following):
                    incoming[after] += self._running[after]
        ready = [n for n, running in enumerate(self._running) if running and not incoming[n]]
        length = [0] * len(self._edges)
        while ready:
            number = ready.pop()
            order.append(number)
            for after in set(self._edges[number]):
                if self._running[after]:
                    length[after] = max(length[after], length[number] + 1)
                    incoming[after] -= 1
                    if not incoming[after]:
                        ready.append(after)
        require(11, "a run can go round for ever", holds=len(order) == sum(self._running))
        return max(length)


def shown_on(program: Program, shown: dict[str, float]) -> Shown:
    """How a condition shows on the side that a program loads; `CONDITIONS` is written for a loaded input."""
    other = {} if program.loading_input else {"angle_in_rad": "angle_out_rad", "angle_out_rad": "angle_in_rad"}
    return tuple((other.get(name, name), value) for name, value in shown.items())


def _check_trips() -> None:
    for state in State:
        if state == S.FAULT:
            continue
        sequence = Sequence()
        sequence.state = state
        try:
            sequence.fire("trip")
        except Exception as error:
            raise BrokenRuleError(RULES[12], f"{state.name}: {error}") from error
        require(12, f"{state.name} -> {sequence.state.name}", holds=sequence.state == S.FAULT)


def _check_agreement(program: Program) -> None:
    """The one interlock that a small ramp is too short for: the two torque channels contradict each other."""
    program = replace(program, limits=replace(program.limits, torque_agreement_nm=AGREEMENT_NM))
    for state in AGREEMENT_STATES:
        watch, measured = Watch(program), Measured()
        measured.agreement_live, measured.torque_out_nm = True, 2.0 * program.limits.torque_agreement_nm
        measured.torque_out_nm = min(measured.torque_out_nm, program.limits.torque_out_trip_nm)
        for _ in range(debounce_scans(FAULT_BY_ID["torque_channels_disagree"], program)):
            watch.look(READY, measured, state)
        strongest = watch.look(READY, measured, state)
        require(10, f"torque_channels_disagree in {state.name}: {strongest}", holds=strongest >= Reaction.QUICK_STOP)


NEIGHBOURHOODS: tuple[tuple[dict[str, bool], int], ...] = (({}, 600), ({"by_speed": True}, 300))
NEAR_THE_WAY_BACK: tuple[tuple[dict[str, bool], int], ...] = (({"left": True}, 3000),)
"""Walks that look for mutants, and how many states of each."""


def check_mutant(mutant: Mutant) -> bool:
    """Return whether the check notices a mutant, by the undisturbed runs and what branches off near them."""
    for walk, states in NEAR_THE_WAY_BACK if mutant.on_the_way_back else NEIGHBOURHOODS:
        try:
            with coarse_time(), mutant.applied():
                Explorer(**walk).explore(states)
        except BrokenRuleError:
            return True
    return False
