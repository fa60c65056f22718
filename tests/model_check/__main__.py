"""`make model-check`: the whole space of the small programs, and with `--mutants` every mutant; prints the figures."""

from __future__ import annotations

import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent / "controller"), str(HERE.parents[1])]

from exploration import Explored, Explorer, check_mutant, coarse_time  # noqa: E402
from mutants import ALL  # noqa: E402
from safety_rules import RULES, BrokenRuleError  # noqa: E402

WORKERS = 2


WALKS: dict[str, dict[str, bool]] = {
    "ramps by torque": {"by_speed": False},
    "ramps by speed": {"by_speed": True},
    "the way back": {"left": True},
}
MOST_STATES = {"the way back": 6000}
"""The way back is checked near its start only, so that all of it takes less than a minute."""


def explore(name: str) -> Explored:
    """Explore everything that one walk can reach."""
    with coarse_time():
        return Explorer(**WALKS[name]).explore(most_states=MOST_STATES.get(name, 1_000_000))


def survives(at: tuple[str, int]) -> str:
    """Name of a mutant that nobody noticed, or nothing."""
    mutant = ALL[at[0]]()[at[1]]
    return "" if check_mutant(mutant) else mutant.name


def main() -> int:
    """Print what was explored and proven; 1 when a rule is broken or a mutant survives."""
    begin = time.perf_counter()
    with ProcessPoolExecutor(WORKERS) as pool:
        try:
            walks = dict(zip(WALKS, pool.map(explore, WALKS), strict=True))
        except BrokenRuleError as error:
            print(f"BROKEN RULE: {error}")
            print("\n".join(getattr(error, "__notes__", [])))
            return 1
        for name, found in walks.items():
            print(
                f"{name}: {found.states} states, {found.steps} steps, {found.places} places, {found.probes} probes, "
                f"longest run {found.longest_scans} scans, {'complete' if found.complete else 'NOT COMPLETE'}, "
                f"{found.seconds:.1f} s"
            )
        print("proven in all of them:")
        print("\n".join(f"  - {rule}" for rule in RULES))
        print(f"{time.perf_counter() - begin:.1f} s")
        if "--mutants" not in sys.argv:
            return 0
        jobs = [(group, number) for group, make in ALL.items() for number in range(len(make()))]
        alive = [name for name in pool.map(survives, jobs, chunksize=8) if name]
        for group, make in ALL.items():
            print(f"mutants of {group}: {len(make())}")
        print(f"survived: {', '.join(alive) or 'none'}")
        print(f"{time.perf_counter() - begin:.1f} s")
        return 1 if alive else 0


if __name__ == "__main__":
    sys.exit(main())
