"""Walks through the whole space of the small programs and prints what is proven; with `mutants`, that it can fail."""

from __future__ import annotations

import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parents[1] / "controller"), str(HERE.parents[2])]

from exploration import Explored, Explorer, check_mutant, coarse_time  # noqa: E402
from mutants import ALL, NOT_ASKED_FOR, SEEN_OTHERWISE  # noqa: E402
from safety_rules import CONDITIONS, RULES, BrokenRuleError  # noqa: E402

WORKERS = 2


WALKS: dict[str, dict[str, bool]] = {
    "input loading, ramps by speed": {"by_speed": True},
    "input loading, ramps by torque": {},
    "output loading, ramps by torque": {"loading_input": False},
    "the recovery of a bench left wound up": {"left": True},
    "a jog": {"jog": True},
}
"""The largest first, so that two processes end together."""


class Walked(NamedTuple):
    """What a walk has found, or the rule that is broken and how to get there; and the time it took its process."""

    found: Explored | None
    broken: str
    cpu_s: float


def explore(name: str) -> Walked:
    """Explore everything that one walk can reach."""
    begin = time.process_time()
    found, broken = None, ""
    try:
        with coarse_time():
            found = Explorer(**WALKS[name]).explore()
    except BrokenRuleError as error:
        broken = "\n".join([str(error), *getattr(error, "__notes__", [])])
    return Walked(found, broken, time.process_time() - begin)


def survives(at: tuple[str, int]) -> str:
    """Name of a mutant that nobody noticed, or nothing."""
    mutant = ALL[at[0]]()[at[1]]
    return "" if check_mutant(mutant) else mutant.name


def walk_all(pool: ProcessPoolExecutor) -> bool:
    """Print what was explored and proven; whether every walk is complete and no rule broken."""
    proven = True
    for name, (found, broken, cpu_s) in zip(WALKS, pool.map(explore, WALKS), strict=True):
        if found is None:
            print(f"{name}: BROKEN RULE: {broken}")
            proven = False
            continue
        proven = proven and found.complete
        print(
            f"{name}: {found.states} states, {found.choices} choices that come to {found.steps} steps, "
            f"{found.places} places, {found.probes} probes, {found.compared} pairs compared, "
            f"longest run {found.longest_scans} scans, "
            f"{'COMPLETE' if found.complete else 'NOT COMPLETE'}, {cpu_s:.1f} s of CPU"
        )
    if proven:
        print("proven in all of them:")
        print("\n".join(f"  - {rule}" for rule in RULES))
        print(f"conditions seen in time, in every state that asks for them: {len(CONDITIONS)}")
    return proven


def mutate_all(pool: ProcessPoolExecutor) -> bool:
    """Print how many mutants are noticed; whether all are."""
    jobs = [(group, number) for group, make in ALL.items() for number in range(len(make()))]
    found = list(zip(jobs, pool.map(survives, jobs, chunksize=4), strict=True))
    for group in ALL:
        alive = [name for (in_group, _), name in found if in_group == group]
        print(f"mutants of {group}: {len(alive)}, noticed {alive.count('')}")
    survived = [name for _, name in found if name]
    print(f"survived: {', '.join(survived) or 'none'}")
    print(f"rows without a mutant, for another stands in for them: {len(SEEN_OTHERWISE)}")
    print("\n".join(f"  - {fault} in {state.name}: {why}" for (fault, state), why in SEEN_OTHERWISE.items()))
    print(f"rows without a mutant, for no rule asks for them: {len(NOT_ASKED_FOR)}")
    print("\n".join(f"  - {fault} in {state.name}: {why}" for (fault, state), why in NOT_ASKED_FOR.items()))
    return not survived


def main() -> int:
    """0 when everything is proven (`mutants`: when every mutant is noticed), 1 otherwise, 2 for a wrong argument."""
    if sys.argv[1:] not in ([], ["mutants"]):
        print(f"no such argument: {sys.argv[1:]}; either none, for the walks, or: mutants")
        return 2
    begin = time.perf_counter()
    with ProcessPoolExecutor(WORKERS) as pool:
        good = mutate_all(pool) if sys.argv[1:] else walk_all(pool)
    print(f"{time.perf_counter() - begin:.1f} s")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
