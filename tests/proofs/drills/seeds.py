"""Seeded runs in virtual time, each made in two processes: their bytes must be the same, and they must replay.

`python tests/proofs/drills/seeds.py [COUNT] [FIRST]` makes them (`make seeds SEEDS=1000`). A seed draws the unit, the
noise of its sensors, and what happens: nothing, a stop, a quick stop, or a fault at a random moment, in half of those
with the recovery. The two processes have nothing in common but the seed: not the order of their hashes, not the memory.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import random
import sys
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[3]
if __name__ in ("__main__", "__mp_main__"):
    sys.path.insert(0, str(ROOT))

from controller.controller import Controller  # noqa: E402 - after the path of a script run by hand
from definitions.faults import FAULT_BY_NUMBER  # noqa: E402
from definitions.image import State  # noqa: E402
from faultlab.rows import ROWS, STATES  # noqa: E402
from faultlab.run import Bench  # noqa: E402
from station.bench.assemble_virtual import virtual_config  # noqa: E402
from station.bench.request import Job, load_job  # noqa: E402
from station.bench.virtual_unit import VirtualUnit  # noqa: E402
from station.records.samples.scan_record import pack  # noqa: E402
from station.results.replay import replay  # noqa: E402
from virtual_bench.faults.scenario import Fault, Header, Operator, Scenario, When  # noqa: E402
from virtual_bench.physics.units import UNITS  # noqa: E402

RECIPE = ROOT / "tests" / "proofs" / "drills" / "seeds.yaml"
MODEL = "RV-40E-121"
DRAWN = tuple(row for row in ROWS if row.states)
"""Faults that virtual time can show; the others are done to processes and over wires."""

LATEST_SCANS = 600
"""Scans after the entry into a state within which something happens to it."""

TAIL_SCANS = 1200
"""Scans that are run on after the end: time for the operator to acknowledge and to reset."""

LONGEST_SCANS = 60_000


@dataclass(frozen=True)
class Made:
    """One run of a seed: what was drawn, how it ended, the SHA-256 of its records, and what the replay said."""

    seed: int
    drawn: str
    sha256: str
    scans: int
    states: frozenset[str]
    end: str
    cause: str
    replayed: bool
    wrong: str


@cache
def job() -> Job:
    """Return the recipe of the seeded runs on the shipped virtual bench."""
    return load_job(str(RECIPE), None)


def draw(seed: int) -> tuple[str, str, Scenario]:
    """Return unit and scenario of a seed, and in words what happens."""
    dice = random.Random(seed)  # noqa: S311 - what a seed draws must be drawn again
    names = [name for name, unit in UNITS.items() if unit.model == MODEL]
    unit = f"{'P1' if dice.random() < 0.5 else dice.choice(names)}:{seed}"
    moment = When(state=dice.choice(STATES), after_scans=dice.randrange(LATEST_SCANS))
    kind = dice.choice(("nothing", "stop", "quick_stop", "fault", "fault", "fault"))
    faults: tuple[Fault, ...] = ()
    operator: tuple[Operator, ...] = ()
    words = kind
    if kind == "fault":
        row = dice.choice(DRAWN)
        for_ms = row.for_ms or dice.choice((None, float(dice.randrange(20, 2000))))
        faults = (Fault(target=row.target, verb=row.verb, value=row.value, when=moment, for_ms=for_ms),)
        words = row.name
    elif kind != "nothing":
        operator = (Operator(command=kind, when=moment),)
    words += "" if kind == "nothing" else f" in {moment.state} after {moment.after_scans} scans"
    if dice.random() < 0.5:
        at = dice.randrange(1, LATEST_SCANS)
        way_back = (("acknowledge", at), ("reset", at + dice.randrange(1, 200)))
        operator += tuple(Operator(command=c, when=When(state="fault", after_scans=n)) for c, n in way_back)
        words += ", recovery after a fault"
    return unit, words, Scenario(scenario=Header(name=f"seed {seed}"), faults=faults, operator=operator)


def make(seed: int, *, replayed: bool) -> Made:
    """Run a seed in virtual time, and replay it when asked."""
    work = job()
    unit, words, scenario = draw(seed)
    bench = Bench(work.program, virtual_config(work.bench, work.profile_paths, VirtualUnit(unit, seed)), scenario)
    tail = 0
    while tail < TAIL_SCANS and len(bench.run.scans) < LONGEST_SCANS:
        bench.go()
        tail = tail + 1 if bench.controller.finished else 0
    run = bench.run
    rows = zip(run.scans, run.images, run.orders, strict=True)
    content = b"".join(pack((n, scan, 0, 0), image, orders) for n, (scan, image, orders) in enumerate(rows))
    first = next((orders.fault for orders in run.orders if orders.fault), 0)
    wrong = "" if bench.controller.finished else "does not end"
    if replayed:
        found = replay(content, Controller(work.program))
        if not found.same or found.identical != len(run.scans):
            shown = [] if found.difference is None else found.difference.lines(work.recipe.sampling.period_ns)
            wrong = "\n".join([found.damage or "does not replay", *shown])
    return Made(
        seed=seed,
        drawn=f"{unit}: {words}",
        sha256=hashlib.sha256(content).hexdigest(),
        scans=len(run.scans),
        states=frozenset(State(orders.state).name.lower() for orders in run.orders),
        end=bench.state,
        cause=FAULT_BY_NUMBER[first].id if first else "",
        replayed=replayed,
        wrong=wrong,
    )


def made_of(asked: tuple[int, bool]) -> Made:
    """Make a seed in a process of the pool; `asked` is the seed, and whether to replay it."""
    seed, replayed = asked
    return make(seed, replayed=replayed)


def both(seeds: range) -> Iterator[tuple[Made, Made]]:
    """Make every seed in each of two processes; one of them replays the even seeds, the other the odd ones."""
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, fresh) as one, ProcessPoolExecutor(1, fresh) as other:
        mine = one.map(made_of, [(seed, seed % 2 == 0) for seed in seeds])
        theirs = other.map(made_of, [(seed, seed % 2 == 1) for seed in seeds])
        try:
            yield from zip(mine, theirs, strict=True)
        finally:  # a seed that fails to be made is told at once, and not after all the others
            for pool in (one, other):
                pool.shutdown(wait=False, cancel_futures=True)


def problems(one: Made, other: Made) -> list[str]:
    """Return what must not be with the two runs of a seed."""
    found = [made.wrong for made in (one, other) if made.wrong]
    if one.sha256 != other.sha256:
        found.append(f"the two records differ: {one.sha256} ({one.scans} scans), {other.sha256} ({other.scans} scans)")
    if one.replayed == other.replayed:
        found.append("was not replayed exactly once")
    return found


def say(text: str, end: str = "\n") -> None:
    """Print at once: the runs take minutes."""
    sys.stdout.write(text + end)
    sys.stdout.flush()


def main() -> int:
    """Make as many seeds as asked, one line of progress and a summary; 1 when any of them failed."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    started = time.monotonic()
    failed, scans = 0, 0
    ends, causes, states, digests = Counter[str](), Counter[str](), Counter[str](), set[str]()
    line_end = "\r" if sys.stdout.isatty() else "\n"
    for done, (one, other) in enumerate(both(range(first, first + count)), start=1):
        wrong = problems(one, other)
        failed += bool(wrong)
        for text in wrong:
            say(f"seed {one.seed} ({one.drawn}): {text}")
        scans += one.scans
        ends[one.end] += 1
        causes[one.cause or "none"] += 1
        states.update(one.states)
        digests.add(one.sha256)
        if done % max(count // 20, 1) == 0:
            seconds = time.monotonic() - started
            say(f"{done} of {count} seeds, {failed} failed, {scans} scans, {seconds:.0f} s", line_end)
    seconds = time.monotonic() - started
    missing = [state.name.lower() for state in State if state.name.lower() not in states]
    say(f"{count} seeds from {first}, {scans} scans of 1 ms each made twice and replayed once in {seconds:.0f} s")
    say(f"  the same bytes twice and an identical replay: {count - failed}; failed: {failed}")
    say(f"  different records: {len(digests)}")
    say(f"  ended in: {', '.join(f'{name} {n}' for name, n in ends.most_common())}")
    say(f"  first cause: {', '.join(f'{name} {n}' for name, n in causes.most_common())}")
    say(f"  states visited: {', '.join(f'{name} {n}' for name, n in states.most_common())}")
    if missing:
        say(f"  never visited: {', '.join(missing)}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
