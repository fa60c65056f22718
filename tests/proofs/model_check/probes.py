"""What is tried from every new place: each dangerous condition, devices that misbehave for ever, wrong ways back."""

from __future__ import annotations

from dataclasses import replace
from itertools import repeat

from bench_model import READY
from safety_rules import AGREEMENT_STATES, CONDITIONS, ESTABLISHED, RULES, BrokenRuleError, require, waits_for_hands
from small_bench import PRESSED, Choice, Shown
from stepper import LONGEST_RUN, Node, Stepper

from controller.aftermath import FaultReaction
from controller.conditions import Measured
from controller.debounce import debounce_scans
from controller.interlocks import Watch
from controller.states import Sequence
from definitions.faults import FAULT_BY_ID
from definitions.image import Command, Reaction, State
from definitions.program import Program

S = State
AGREEMENT_NM = 3.5
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
HELD = {1: Command.JOG_POSITIVE, -1: Command.JOG_NEGATIVE}
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
    "device.NONE",
    "device.JOG_POSITIVE",
    "held, drive lags",
    "held, mode lags",
    "held, shaft turns on",
    "shaft turns on",
)


class Probes:
    """What is tried from a node, off the walk, and how often; `BrokenRuleError` where a rule does not hold.

    `only`: the fault whose conditions are put on; every one when empty.
    """

    def __init__(self, stepper: Stepper, only: str = "") -> None:
        self.steps = 0
        self.count = 0
        self.states: dict[str, set[State]] = {}
        """Where each condition was put on."""
        self._stepper = stepper
        self._stubborn = [choice for choice in stepper.choices if choice.name in STUBBORN]
        self._asked = {name: one for name, one in CONDITIONS.items() if only in ("", name.split(" ")[0])}
        self._shown = {name: shown_on(stepper.program, one.shown) for name, one in self._asked.items()}

    def ways_back(self, node: Node) -> None:
        """A fault with torque left in the unit, and operators who do not do what they should."""
        for way in WAYS_BACK:
            after = way[-1].replace("RESET", "NONE")
            names = ("drive drops, torque stays", *["1.NONE"] * SETTLED_AFTER, *way, *[after] * SETTLED_AFTER)
            self.steps += sum(1 for _ in self._stepper.onward(node, [self._stepper.by_name[name] for name in names]))

    def persist(self, node: Node) -> None:
        """Let one device misbehave in the same way for ever: the run, or the reaction to its fault, still ends."""
        for choice in self._stubborn:
            at, seen = node, set()
            for _ in range(LONGEST_RUN):
                self.steps += 1
                at = self._stepper.follow(at, self._stepper.happening(at.bench, choice))
                key = self._stepper.key(at)
                state = at.bench.orders.state
                settled = at.bench.orders.phase == FaultReaction.SETTLED  # there a recovery waits for a person
                over = state in (S.IDLE, S.COMPLETE, S.STOPPED) or waits_for_hands(at.bench.orders)
                if over or (state == S.FAULT and settled):
                    break
                require(11, f"{choice.name} for ever, in {State(state).name}", holds=key not in seen)
                seen.add(key)

    def conditions(self, node: Node, state: State) -> None:
        """Put on every condition that must be seen here, and look for its reaction in time."""
        for name, condition in self._asked.items():
            established = node.bench.orders.phase in ESTABLISHED.get(state, ())
            if state not in condition.states and not (established and state in condition.established_in):
                continue
            if node.monitor.way_back and not condition.on_the_way_back:
                continue
            self.count += 1
            self.states.setdefault(name, set()).add(state)
            self._probe_one(node, name)

    def _probe_one(self, node: Node, name: str) -> None:
        condition, nominal = CONDITIONS[name], Choice(name, shown=self._shown[name])
        if node.bench.orders.state == S.JOG and not waits_for_hands(node.bench.orders):
            held = HELD[node.monitor.token_way]
            nominal = Choice(name, command=held, shown=(*PRESSED, *nominal.shown))
        began = State(node.bench.orders.state)
        strongest, asked_for = Reaction.NONE, (*condition.states, *condition.established_in)
        for bench in self._stepper.onward(node, repeat(nominal, condition.within_scans)):
            orders = bench.orders
            if orders.state in (S.FAULT, *asked_for):
                strongest = max(strongest, Reaction(orders.reaction))
            if orders.state not in asked_for:
                break  # the run has gone on to where the condition means nothing
        stays = orders.state in asked_for or orders.state == S.FAULT
        holds = strongest >= condition.reaction or not stays
        require(10, f"{name} in {began.name}: reaction {strongest.name} in {condition.within_scans} scans", holds=holds)


def shown_on(program: Program, shown: dict[str, float]) -> Shown:
    """How a condition shows on the side that a program loads; `CONDITIONS` is written for a loaded input."""
    other = {} if program.loading_input else {"angle_in_rad": "angle_out_rad", "angle_out_rad": "angle_in_rad"}
    return tuple((other.get(name, name), value) for name, value in shown.items())


def check_trips() -> None:
    sequence = Sequence()
    for state in State:
        if state == S.FAULT:
            continue
        sequence.state = state
        try:
            sequence.fire("trip")
        except Exception as error:
            raise BrokenRuleError(RULES[12], f"{state.name}: {error}") from error
        require(12, f"{state.name} -> {sequence.state.name}", holds=sequence.state == S.FAULT)


def check_agreement(program: Program) -> None:
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
