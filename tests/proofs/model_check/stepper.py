"""One scan of the controller against the small bench, from any state back and forth."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, NamedTuple
from unittest import mock

import small_bench
from safety_rules import RULES, BrokenRuleError, require
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
    jog_choices,
    look,
)
from snapshots import Freezer, Snapshot
from step_check import WATCHED_ALARMS, Monitor, check_step

from controller.aftermath import FaultReaction, Release
from controller.controller import Controller
from controller.held_lock import HeldLock, Left
from controller.unloading import Unloading
from definitions.faults import FAULT_BY_ID
from definitions.image import Command, DriveState, Image, Orders, State

S = State
LONGEST_RUN = 400

COMPARE_EVERY = 500
"""Of states that are taken for one that is known, one in so many is held against it, see `Stepper._compare`."""

COMPARED_SCANS = 4

ONLY_SAID: dict[str, int] = {
    "segment": 0, "fault": 0, "alarms": 0, "reference_torque_nm": 0, "controlled_torque_nm": 0
}  # fmt: skip
"""What orders say for the record only; the alarms that act, and the segment where it acts, are in the keys."""

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
    """One state of everything: controller, devices, and what the rules remember.

    `number` is that of the controller's state: two that behave alike have the same.
    """

    controller: Snapshot
    number: int
    bench: BenchState
    monitor: Monitor


class Happening(NamedTuple):
    """What may happen in one scan to a bench: what its devices become, and what the controller is shown."""

    name: str
    devices: Devices
    command: int
    shown: Shown
    image: Image
    number: int
    """Of all that tells: the same for the same devices, command and show."""


def _bench(devices: Devices, orders: Orders) -> BenchState:
    return BenchState(devices.drive, devices.mode, devices.torque_out_nm, devices.brake_on, orders)


class Stepper:
    """The controller with one small program; `left`: with the recovery on a bench that was left wound up.

    jog: with a jog in place of a run.
    """

    def __init__(
        self, *, by_speed: bool = False, loading_input: bool = True, left: bool = False, jog: bool = False
    ) -> None:
        taken_up = Left(FAULT_BY_ID["operator_quick_stop"].number, 0.0, ZERO_NM) if left else None
        self.left, self.jog = left, jog
        self.program = small_bench.small_program(by_speed=by_speed, loading_input=loading_input, jog=jog)
        self.choices = (*choices(), *(LEFT_CHOICES if left else jog_choices() if jog else ()))
        self.by_name = {choice.name: choice for choice in self.choices}
        self.compared = self._found_again = 0
        self._controller = Controller(self.program, left=taken_up)
        self._freezer = Freezer(self._controller, WATCHED_ALARMS)
        self._numbers: dict[Hashable, int] = {}
        self._snapshots: list[Snapshot] = []
        self._shows: dict[Hashable, int] = {}
        self._happenings: dict[Hashable, tuple[Happening, ...]] = {}
        self._decided: dict[tuple[int, int], tuple[int, BenchState]] = {}

    def step(self, node: Node, choice: Choice) -> tuple[Node, Image, Orders]:
        """One scan from a node; raises `BrokenRuleError`."""
        what = self.happening(node.bench, choice)
        image, orders = self._run(node.controller, what)
        monitor = check_step(node.bench, node.monitor, image, orders)
        after, bench = self._freezer.take(), _bench(what.devices, orders)
        return Node(after, self._number(bench), bench, monitor), image, orders

    def onward(self, node: Node, ahead: Iterable[Choice]) -> Iterator[BenchState]:
        """Scan after scan from a node, to which nothing returns; what the bench is after each.

        The controller goes on by itself, and is neither kept nor compared: nobody else may ask it meanwhile. Raises
        `BrokenRuleError`.
        """
        self._freezer.put_back(node.controller)
        bench, monitor = node.bench, node.monitor
        for choice in ahead:
            what = self.happening(bench, choice)
            image, orders = self._scan(what)
            monitor = check_step(bench, monitor, image, orders)
            bench = _bench(what.devices, orders)
            yield bench

    def follow(self, node: Node, what: Happening) -> Node:
        """One scan from a node, as `step`; but a controller that has been seen to decide the same is not asked again.

        The rules are held against every step all the same: they see bench and past, which differ.
        """
        which = node.number, what.number
        known = self._decided.get(which)
        if known is None:
            _, orders = self._run(node.controller, what)
            bench = _bench(what.devices, orders)
            known = self._decided[which] = self._number(bench), bench
        number, bench = known
        monitor = check_step(node.bench, node.monitor, what.image, bench.orders)
        return Node(self._snapshots[number], number, bench, monitor)

    def happenings(self, bench: BenchState) -> tuple[Happening, ...]:
        """Everything that may happen in the next scan, by the first choice that leads to it.

        Choices that leave the devices alike and show the controller the same image, such as a drive that lags where it
        has nothing to do, are one and the same step: the controller sees nothing else.
        """
        orders = bench.orders
        which = (
            bench[:-1], orders.drive_command, orders.drive_mode, orders.brake_on,
            orders.drive_target_torque_nm, orders.drive_target_velocity_rad_s,
        )  # fmt: skip
        found = self._happenings.get(which)
        if found is None:
            every = [self.happening(bench, choice) for choice in self.choices]
            first = {what.number: what for what in reversed(every)}
            found = self._happenings[which] = tuple(what for what in every if first[what.number] is what)
        return found

    def happening(self, bench: BenchState, choice: Choice) -> Happening:
        """What a choice comes to."""
        devices = advance(bench, choice)
        same = devices, choice.command, choice.shown
        number = self._shows.setdefault(same, len(self._shows))
        return Happening(choice.name, *same, look(devices, choice.command, 1, choice.shown), number)

    def _run(self, snapshot: Snapshot, what: Happening) -> tuple[Image, Orders]:
        """Let a controller decide on what it is shown."""
        self._freezer.put_back(snapshot)
        return self._scan(what)

    def _scan(self, what: Happening) -> tuple[Image, Orders]:
        """Let the controller as it is decide on what it is shown."""
        self._controller.events.clear()
        counter = self._controller._context.last_counter % 3 + 1
        image = look(what.devices, what.command, counter, what.shown)
        latched, was = self._controller._watch.latched, self._controller.state
        orders = self._decide(image)
        if was == orders.state == S.FAULT:
            new = orders.alarms & ~latched & ~WATCHED_ALARMS
            require(9, f"alarms {new:#x} come up in a fault, where none watches for them", holds=not new)
        return image, orders

    def _number(self, bench: BenchState) -> int:
        """Number of the state in which the controller is now, on this bench."""
        key = self._freezer.key()
        number = self._numbers.get(key)
        if number is None:
            number = self._numbers[key] = len(self._snapshots)
            self._snapshots.append(self._freezer.take())
        else:
            self._found_again += 1
            if self._found_again % COMPARE_EVERY == 0:
                self._compare(number, bench)
        return number

    def _compare(self, number: int, bench: BenchState) -> None:
        """Let two controllers that are taken for the same decide: what a key leaves out must not act."""
        one, other = self._freezer.take(), self._snapshots[number]
        happenings = self.happenings(bench)
        what = happenings[self.compared % len(happenings)]
        found = [self._orders_after(snapshot, bench, what) for snapshot in (one, other)]
        assert found[0] == found[1], f"{what.name} tells two states apart that have one key: {found}"
        self.compared += 1

    def _orders_after(self, snapshot: Snapshot, bench: BenchState, what: Happening) -> list[Orders]:
        """What a controller orders after something has happened, and in the undisturbed scans after that."""
        found = []
        for _ in range(COMPARED_SCANS):
            _, orders = self._run(snapshot, what)
            found.append(orders._replace(**ONLY_SAID))
            snapshot, bench = self._freezer.take(), _bench(what.devices, orders)
            what = self.happening(bench, self.by_name["0.NONE"])
        return found

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
        return (seen, monitor, node.number)

    def first(self) -> Node:
        """The bench switched on."""
        bench = WOUND_UP if self.left else START
        after = self._freezer.take()
        return Node(after, self._number(bench), bench, Monitor(left=self.left))

    def nominal(self) -> list[Node]:
        """The nodes of an undisturbed run, from idle to complete; with `left`, of the recovery until it is stopped.

        With `jog`, of one movement in each direction, until it is stopped.
        """
        if self.jog:
            return self._nominal_jog()
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

    def _nominal_jog(self) -> list[Node]:
        node, nodes = self.first(), []
        for name in NOMINAL_JOG:
            nodes.append(node)
            node, _, orders = self.step(node, self.by_name[name])
        turned = {one.bench.orders.drive_target_velocity_rad_s for one in nodes}
        require(11, f"the undisturbed jog does not turn: {turned}", holds=turned >= {1.0, -1.0})
        require(11, "the undisturbed jog does not end", holds=orders.state == S.STOPPED)
        return [*nodes, node]


def _movement(key: str) -> list[str]:
    """Key, then the enabling device, and both let go once the shaft turns."""
    return [*[f"0.{key}"] * 4, *[f"device.{key}"] * 7, *["0.NONE"] * 6]


NOMINAL_JOG = ("0.START", "0.NONE", *_movement("JOG_POSITIVE"), *_movement("JOG_NEGATIVE"), *["0.STOP"] * 3)
