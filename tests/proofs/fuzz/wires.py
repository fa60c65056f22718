"""Bent CAN frames and Modbus replies into a controller. `python tests/proofs/fuzz/wires.py [FRAMES] [REPLIES] [SEED]`.

Each run starts somewhere in the middle of an honest one, is attacked for a while, and then left alone: whatever the
wires said, nothing may raise, no order may leave its limits, and the run goes on or ends in a fault that has settled.
"""

from __future__ import annotations

import copy
import dataclasses
import logging
import random
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

HERE = Path(__file__).parent
if __name__ == "__main__":
    sys.path[:0] = [str(HERE), str(HERE.parents[2])]

from bent_frames import CAN_HARMLESS, CAN_WAYS, FrameBender  # noqa: E402 - after the path of a script run by hand
from bent_replies import MODBUS_HARMLESS, MODBUS_WAYS, ReplyBender  # noqa: E402
from wire_rig import Snapshot, WireRig  # noqa: E402

from definitions.faults import FAULT_BY_NUMBER  # noqa: E402
from definitions.image import Command, State  # noqa: E402
from faultlab.run import Bench  # noqa: E402
from station.bench.assemble_virtual import choose_unit, virtual_config  # noqa: E402
from station.bench.request import Job, load_job  # noqa: E402
from station.bench.virtual_unit import FIXED_SEED  # noqa: E402

RECIPES: dict[str, tuple[str, ...]] = {
    "rv-40e-121-faults": ("home", "lock", "calibrate", "ramp_pos", "reverse", "ramp_neg", "unload", "release"),
    "static-50nm": ("ramp_pos", "reverse", "ramp_neg"),
}
"""Ramps by torque and ramps by speed, and the states in which an attack begins."""

INTO_STATE_SCANS = {"home": (2, 60), "lock": (5, 600), "release": (2, 60), "unload": (5, 200), "reverse": (2, 40)}
OTHER_STATES_SCANS = (10, 400)
COPIES = 3
"""Moments inside each state."""

AFTERWARDS_SCANS = 100
COMMANDS = (Command.STOP, Command.QUICK_STOP, Command.ACKNOWLEDGE, Command.RESET, Command.START, 77, 255)


class Attack:
    """How a run is attacked: which ways, how often."""

    def __init__(self, chance: random.Random) -> None:
        self.kind = chance.choice(("harmless", "frames", "replies", "wild"))
        self.scans = chance.randint(20, 400)
        every = tuple(CAN_WAYS)
        some = tuple(chance.sample(every, chance.randint(1, 4)))
        self.can_ways, self.per_scan = {
            "harmless": (CAN_HARMLESS, chance.uniform(5.0, 30.0)),
            "frames": ((*some, *CAN_HARMLESS * chance.choice((0, 1, 20))), 10.0 ** chance.uniform(-1.0, 1.3)),
            "replies": (CAN_HARMLESS, 4.0),
            "wild": ((*every, *CAN_HARMLESS * chance.choice((0, 1, 20))), 10.0 ** chance.uniform(-1.0, 1.3)),
        }[self.kind]
        few = tuple(chance.sample(tuple(MODBUS_WAYS), chance.randint(1, 3)))
        self.modbus_ways, self.share = {
            "harmless": (MODBUS_HARMLESS, 1.0),
            "frames": (MODBUS_HARMLESS, 0.2),
            "replies": ((*few, *MODBUS_HARMLESS * chance.choice((0, 5, 50))), 10.0 ** chance.uniform(-1.0, 0.0)),
            "wild": ((*MODBUS_WAYS, *MODBUS_HARMLESS * chance.choice((0, 5, 50))), 10.0 ** chance.uniform(-1.0, 0.0)),
        }[self.kind]
        self.in_fault_scans = chance.choice((5, 50, 400))
        self.operator = chance.random() < 0.3
        self.rtu = chance.random() < 0.3
        if (
            self.rtu and self.kind == "harmless"
        ):  # a reply that comes twice is spoilt where no number tells it from the next
            self.modbus_ways = tuple(way for way in MODBUS_HARMLESS if way != "again")


@dataclass
class Told:
    """What all runs together have shown."""

    runs: int = 0
    scans: int = 0
    frames: int = 0
    replies: int = 0
    states: Counter[str] = field(default_factory=Counter)
    ends: Counter[str] = field(default_factory=Counter)
    faults: Counter[str] = field(default_factory=Counter)
    ways: Counter[str] = field(default_factory=Counter)
    seconds: float = 0.0


@cache
def job(recipe: str) -> Job:
    return load_job(recipe, None)


@cache
def snapshots(recipe: str, most: int = COPIES) -> tuple[Snapshot, ...]:
    """Moments of one honest run."""
    the_job = job(recipe)
    unit = choose_unit(None, the_job.recipe, FIXED_SEED)
    bench = Bench(the_job.program, virtual_config(the_job.bench, the_job.profile_paths, unit), None)
    found = []
    for state in RECIPES[recipe]:
        while bench.state != state:
            orders = bench.go()
        first, last = INTO_STATE_SCANS.get(state, OTHER_STATES_SCANS)
        for at in range(most):
            for _ in range(first if not at else (last - first) // max(most - 1, 1)):
                if bench.state == state:
                    orders = bench.go()
            plant, controller = copy.deepcopy((bench.bench, bench.controller))
            found.append(Snapshot(state, plant, controller, bench._scan, bench.run.images[-1], orders))
        bench.run = type(bench.run)(bench.run.period_s)  # what has been recorded so far is not needed
    return tuple(found)


def attack(recipe: str, number: int, seed: int, told: Told, most: int = COPIES) -> None:
    """One run; its place in the honest run, its attack and every byte follow from `seed` and `number`."""
    chance = random.Random(f"{seed}.{number}")
    chosen = chance.choice(snapshots(recipe, most))
    plant, controller = copy.deepcopy((chosen.plant, chosen.controller))
    plan = Attack(chance)
    node = job(recipe).bench.drive.node_id
    frames = FrameBender(chance, node, plan.can_ways, plan.per_scan)
    replies = ReplyBender(chance, plan.modbus_ways, plan.share)
    moment = dataclasses.replace(chosen, plant=plant, controller=controller)
    rig = WireRig(job(recipe), moment, frames, replies, rtu=plan.rtu)
    try:
        _run(rig, plan, chance, frames, replies)
    finally:
        rig.close()
    told.runs += 1
    told.frames += frames.bent.total()
    told.replies += replies.bent.total()
    told.ways.update(frames.bent)
    told.ways.update(replies.bent)
    told.states.update(rig.watch.states)
    told.scans += sum(rig.watch.states.values())
    orders = rig.orders
    told.ends["fault" if orders.state == State.FAULT else "goes on"] += 1
    if orders.fault:
        told.faults[FAULT_BY_NUMBER[orders.fault].id] += 1


def _run(rig: WireRig, plan: Attack, chance: random.Random, frames: FrameBender, replies: ReplyBender) -> None:
    in_fault = 0
    for _ in range(plan.scans):
        in_fault += rig.state == State.FAULT
        if in_fault > plan.in_fault_scans:
            break
        if plan.operator and chance.random() < 0.05:
            rig.order(chance.choice(COMMANDS))
        rig.step(missed=chance.choice((0,) * 200 + (1, 3, 50)) if plan.kind == "wild" else 0)
    if plan.kind == "harmless" and not plan.operator:
        assert rig.state != State.FAULT, f"a run ended by frames that are not for it: fault {rig.orders.fault}"
    frames.on = replies.on = False
    program = rig.controller.program
    longest = program.enable_scans + program.unload_limit_scans + program.settle_scans
    left = AFTERWARDS_SCANS
    while left and not rig.controller.finished:
        rig.step()
        left -= 1
        if not left and rig.state == State.FAULT:
            longest -= AFTERWARDS_SCANS
            assert longest > 0, f"the reaction to fault {rig.orders.fault} does not end"
            left = AFTERWARDS_SCANS


def campaign(frames: int, replies: int, seed: int, most: int = COPIES) -> Iterator[Told]:
    """Attack until so many frames and replies were bent; yields the sum after every run."""
    told = Told()
    recipes = tuple(RECIPES)
    number = 0
    begin = time.perf_counter()
    while told.frames < frames or told.replies < replies:
        recipe = recipes[number % 4 == 3]
        try:
            attack(recipe, number, seed, told, most)
        except Exception as error:
            error.add_note(f"recipe {recipe}, run {number}, seed {seed}")
            raise
        number += 1
        told.seconds = time.perf_counter() - begin
        yield told


def main() -> int:
    """Attack and say what came of it; 1 when something raised or an order left its limits."""
    frames = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    replies = int(sys.argv[2]) if len(sys.argv) > 2 else 100_000
    seed = int(sys.argv[3]) if len(sys.argv) > 3 else random.SystemRandom().randrange(10**6)
    say = sys.stdout.write
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL + 1)  # as `ModbusLine.open` does
    say(f"{frames} CAN frames, {replies} Modbus replies, seed {seed}\n")
    for recipe in RECIPES:
        snapshots(recipe)
    shown, told = 0.0, Told()
    for told in campaign(frames, replies, seed):
        if told.seconds - shown > 10.0:
            shown = told.seconds
            say(f"  {told.frames} frames, {told.replies} replies, {told.runs} runs, {shown:.0f} s\n")
            sys.stdout.flush()
    rate = f"{told.frames / told.seconds:.0f} frames/s, {told.replies / told.seconds:.0f} replies/s"
    say(f"{told.frames} bent frames and {told.replies} bent replies in {told.runs} runs, {told.scans} scans, {rate}\n")
    say("nothing raised, no order beyond its limits, every fault settled\n")
    for name, counts in (
        ("runs", told.ends),
        ("scans in state", told.states),
        ("first fault", told.faults),
        ("bent", told.ways),
    ):
        say(f"{name}: {', '.join(f'{key} {count}' for key, count in counts.most_common())}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
