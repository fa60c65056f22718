"""Kills scan and supervisor of many runs. `python tests/proofs/drills/kill_drill.py [COUNT] [SEED] [STANDS]`.

Several stands kill at the same time. The scan and the virtual bench of a run take a good third of a core each, with
priority; what the other stand does meanwhile (opening its bench, evaluating, replaying) has none. A run that the
machine tripped all the same is counted apart, and only where its record proves that it was the machine.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[3])]

from station.run.children import ONE_THREAD  # noqa: E402 - after the path of a script run by hand

os.environ.update(ONE_THREAD)  # before numpy: a fork copies one thread only

from kills import LASTS_S, kill  # noqa: E402
from patient import patient_bench, short_recipe, wrong_verdict  # noqa: E402
from warm_supervisor import COMMAND, ROOT, cold, load, warm  # noqa: E402

STANDS = 2
TRIPPED_AT_MOST = 0.25
"""Share of runs that the machine may trip: beyond it the drill has not seen what it is there for."""

COLD_ONE_IN = 10
"""One command in so many starts as a shell starts it, interpreter and all."""


class Drawn(NamedTuple):
    """One kill: its number, who dies, when, whether a new supervisor takes over, whether its commands start cold."""

    number: int
    who: str
    since: str
    after_s: float
    resume: bool
    cold: bool


class Left(NamedTuple):
    """What one kill left."""

    drawn: Drawn
    written: int
    state: str
    problems: list[str]
    machine: str


def draw(count: int, seed: int) -> list[Drawn]:
    """Draw when to kill: one in ten while the bench is opened, one in ten while the run is concluded."""
    chance = random.Random(seed)  # noqa: S311 - moments, not secrets
    drawn = []
    for number in range(count):
        for who in ("scan", "desk"):
            since = chance.choices(("opening", "run", "ending"), (1, 8, 1))[0]
            after_s = chance.uniform(0.0, LASTS_S[since])
            resume = who == "desk" and number % 2 == 1
            drawn.append(Drawn(number + 1, who, since, after_s, resume, number % COLD_ONE_IN == 0))
    return drawn


def carry_out(drawn: Drawn) -> Left:
    """Kill once, in a folder of its own, which is kept where something went wrong."""
    folder = tempfile.mkdtemp(prefix="lostmotion-kill-")
    start = cold if drawn.cold else warm
    try:
        found = kill(drawn.who, drawn.after_s, Path(folder), resume=drawn.resume, since=drawn.since, start=start)
        left = Left(drawn, found.written, found.state, found.problems(), found.machine)
    except AssertionError as error:
        left = Left(drawn, 0, "nothing", [str(error)], "")
    if left.problems:
        left.problems.append(f"kept in {folder}")
    else:
        shutil.rmtree(folder)
    return left


def undisturbed() -> str:
    """Make a run that nothing happens to; return its verdict and reasons unless it is PASS."""
    with tempfile.TemporaryDirectory(prefix="lostmotion-kill-") as folder:
        words = [str(short_recipe(Path(folder))), "--bench", str(patient_bench(Path(folder)))]
        command = [*COMMAND, "run", *words, "--serial", "K", "--json", "--data", folder]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        result = json.loads(done.stdout)
    return wrong_verdict(result)


def _line(left: Left) -> str:
    drawn = left.drawn
    told = "; ".join(left.problems) or f"{left.written} records, none lost, replay identical, {left.state}"
    if left.machine:
        told += f" (the machine tripped the run: {left.machine})"
    return f"{drawn.number:4} {drawn.who:4} {drawn.since:7} + {drawn.after_s:6.3f} s: {told}\n"


def main() -> int:
    """Kill scan and supervisor in turn at random moments and count what went wrong."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else random.SystemRandom().randrange(10**6)
    stands = int(sys.argv[3]) if len(sys.argv) > 3 else min(STANDS, os.cpu_count() or 1)
    sys.stdout.write(f"{count} kills of each, seed {seed}, {stands} at a time\n")
    sys.stdout.flush()
    load()
    if verdict := undisturbed():
        sys.stdout.write(f"the run that nothing happens to must pass: {verdict}\n")
        return 1
    started = time.monotonic()
    ended: list[Left] = []
    with ProcessPoolExecutor(stands, mp_context=get_context("fork")) as pool:
        for left in pool.map(carry_out, draw(count, seed)):
            ended.append(left)
            sys.stdout.write(_line(left))
            sys.stdout.flush()
    took_s = time.monotonic() - started
    states = Counter(f"{left.drawn.who} {left.state}" for left in ended)
    bad, tripped = sum(bool(left.problems) for left in ended), sum(bool(left.machine) for left in ended)
    records = sum(left.written for left in ended)
    sys.stdout.write(f"{', '.join(f'{name} {times}' for name, times in sorted(states.items()))}\n")
    sys.stdout.write(f"{tripped} of {len(ended)} runs were tripped by the machine, as their records prove\n")
    sys.stdout.write(f"{len(ended)} kills, {records} records, {bad} with problems, {took_s:.0f} s in all\n")
    if tripped > TRIPPED_AT_MOST * len(ended):
        sys.stdout.write(f"too many runs were tripped: repeat on a quieter machine, at most {TRIPPED_AT_MOST:.0%}\n")
        return 1
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
