"""Results by OPC UA to two clients through kills. `python tests/proofs/drills/opcua_drill.py [RUNS] [AWAY] [SEED]`.

asyncua's client and one of node-opcua, which share no code, keep every result of 100 runs. 20 of them are sealed while
both clients and the server are down. Before and after, one of the three is killed with SIGKILL while results come. At
the end each client has each result once. A result that was not acknowledged before a kill comes again: the client knows
it by its id, and the drill counts it.
"""

from __future__ import annotations

import asyncio
import os
import random
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from multiprocessing import get_context
from pathlib import Path
from typing import Any

TESTS = Path(__file__).parents[2]
sys.path[:0] = [str(TESTS.parent), str(TESTS), str(TESTS / "station"), str(TESTS / "station" / "web")]

from opcua_support import Plant, keep_results, kept_by, know_types  # noqa: E402 - after the path of a script run by hand

from station.own_place import PLACE  # noqa: E402 - as above

BATCH = 20
"""After so many runs something is killed; then both clients come to have all before the next."""

LONGEST_S = 600.0


class Keeper:
    """A client that is started again whenever it has ended and results are still to come."""

    def __init__(self, name: str, kept: Path, start: Callable[[], Any]) -> None:
        self.name, self.kept, self._start = name, kept, start
        self.process: Any = None
        self.kills = self.starts = 0

    def stay(self) -> None:
        """Start it where it does not run."""
        if self.process is None or not _runs(self.process):
            self.process, self.starts = self._start(), self.starts + 1

    def has(self, count: int) -> bool:
        """Say whether it has so many results."""
        return len(kept_by(self.kept)) >= count

    def kill(self) -> None:
        """Kill it, whatever it does."""
        if self.process is not None and _runs(self.process):
            self.process.kill()
            (self.process.join if hasattr(self.process, "join") else self.process.wait)()
            self.kills += 1
        self.process = None


def _runs(process: Any) -> bool:
    return process.is_alive() if hasattr(process, "is_alive") else process.poll() is None


def _keep_quietly(plant: Plant, kept: Path, until: int) -> None:
    with kept.with_name(f"{kept.name}.err").open("a") as told:
        os.dup2(told.fileno(), 2)  # a server that was killed is told of by a traceback
        asyncio.run(keep_results(plant, kept, until))


async def _learn(plant: Plant) -> None:
    """Have the structures of the server in this process, and so in each that is forked."""
    async with plant.session("the admin") as client:
        await know_types(client)


class Drill:
    """The server, its two clients, and what was sealed for them."""

    def __init__(self, folder: Path, runs: int, seed: int) -> None:
        os.environ[PLACE] = str(folder / "place")
        self.runs, self._drawn = runs, random.Random(seed)  # noqa: S311 - moments of kills
        self.plant, self.sealed, self.server_kills = Plant(folder / "data"), list[str](), 0
        self.plant.set_up()
        self.plant.start()
        asyncio.run(_learn(self.plant))
        python, node = folder / "asyncua.jsonl", folder / "node.jsonl"

        def of_asyncua() -> Any:
            process = get_context("fork").Process(target=_keep_quietly, args=(self.plant, python, runs), daemon=True)
            process.start()
            return process

        self.keepers = [
            Keeper("asyncua", python, of_asyncua),
            Keeper("node-opcua", node, lambda: self.plant.node(node, runs, quiet=True)),
        ]

    def seal(self) -> None:
        """Seal a run, some time after the one before."""
        number = len(self.sealed)
        self.sealed += self.plant.seal(f"SN-{number}", failed="too large" if number % 5 == 0 else None)
        time.sleep(self._drawn.uniform(0.0, 0.3))

    def kill_server(self) -> None:
        """Kill the server."""
        self.plant.kill(signal.SIGKILL)
        self.server_kills += 1

    def all_away(self, count: int) -> None:
        """Seal runs while everybody is down."""
        for keeper in self.keepers:
            keeper.kill()
        self.kill_server()
        for _ in range(count):
            self.seal()
        self.plant.start()

    def kill_one(self) -> None:
        """Kill a client or the server, which is started again."""
        victim = self._drawn.choice([None, *self.keepers])
        if victim is not None:
            victim.kill()
        else:
            self.kill_server()
            self.plant.start()

    def run(self, away: int) -> None:
        """Seal all runs, and wait until both clients have them."""
        apart = (self.runs - away) // 2
        while len(self.sealed) < self.runs:
            self.come_up()
            until = apart if len(self.sealed) < apart else self.runs
            for _ in range(min(BATCH, until - len(self.sealed))):
                self.seal()
            if len(self.sealed) == apart:
                self.all_away(away)
            elif len(self.sealed) < self.runs:
                self.kill_one()
        self.come_up()
        time.sleep(1.0)  # the last acknowledgements
        self.plant.kill()

    def come_up(self) -> None:
        """Wait until both clients have all that was sealed; start each that has ended, if more is to come for it."""
        end_s = time.monotonic() + LONGEST_S
        there = False
        while not there and time.monotonic() < end_s:
            for keeper in self.keepers:
                if not keeper.has(self.runs):
                    keeper.stay()
            there = all(keeper.has(len(self.sealed)) for keeper in self.keepers)
            time.sleep(0.05)

    def tell(self) -> int:
        """Print what each client has; return how many results are missing or there twice."""
        problems = 0
        for keeper in self.keepers:
            kept = [one["id"] for one in kept_by(keeper.kept)]
            missing, twice = len(set(self.sealed) - set(kept)), len(kept) - len(set(kept))
            again = len(kept_by(keeper.kept.with_name(f"{keeper.kept.name}.again")))
            problems += missing + twice
            print(
                f"{keeper.name:12} {len(set(kept))} of {self.runs} results, {missing} missing, {twice} twice; {again} "
                f"repeats on the wire, known by their id; started {keeper.starts} times, killed {keeper.kills} times"
            )
            keeper.kill()
        return problems


def drill(folder: Path, runs: int, away: int, seed: int) -> int:
    """Run it in a folder; return the number of problems."""
    began_s, one = time.monotonic(), Drill(folder, runs, seed)
    one.run(away)
    problems = one.tell()
    took_s = time.monotonic() - began_s
    kills = f"server killed {one.server_kills} times"
    print(f"{away} results sealed while all were down; {kills}; seed {seed}; {took_s:.0f} s")
    return problems


if __name__ == "__main__":
    asked = [int(word) for word in sys.argv[1:]]
    count, apart, first = [*asked, *(100, 20, 1)[len(asked) :]]
    with tempfile.TemporaryDirectory(prefix="opcua-drill-") as place:
        sys.exit(1 if drill(Path(place), count, apart, first) else 0)
