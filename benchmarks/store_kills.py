"""Kills between seal and store: `python -m benchmarks.store_kills 50`. Nothing may be lost, nor stand twice.

Runs are sealed; the process that puts them into the store is killed at a random moment; again and again, and nobody
looks in between. In the end the store is held against the chain, and against one that is made anew.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.many_runs import make_runs
from benchmarks.store_size import own_server
from station.records.chain.chain_file import Chain
from station.store.outbox import rebuild
from station.store.table_counts import all_rows
from station.store.view import bring_up, look_at, opened

RUNS_EACH = 30


def put_in(data: Path, killed_after_s: float | None) -> bool:
    """Bring the store up in a child, which is killed after a time; return whether it was killed before its end."""
    pid = os.fork()
    if pid == 0:
        try:
            bring_up(data, 60.0)
        finally:
            os._exit(0)
    if killed_after_s is not None:
        time.sleep(killed_after_s)
        os.kill(pid, signal.SIGKILL)
    return os.WIFSIGNALED(os.waitpid(pid, 0)[1])


def main() -> None:
    """Kill as often as asked for, and compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kills", type=int, nargs="?", default=50)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--postgresql", action="store_true")
    asked = parser.parse_args()
    place = Path(tempfile.mkdtemp(prefix="lostmotion-kills-"))
    os.environ["LOSTMOTION_STATE"] = str(place / "state")
    if asked.postgresql:
        os.environ["LOSTMOTION_STORE"] = own_server(place / "postgresql")
    data, dice = place / "runs", random.Random(asked.seed)  # noqa: S311 - moments, not secrets
    make_runs(data, RUNS_EACH)
    started = time.monotonic()
    put_in(data, None)
    takes_s, killed, made, tries = time.monotonic() - started, 0, RUNS_EACH, 0
    while killed < asked.kills:
        make_runs(data, RUNS_EACH, made)
        made += RUNS_EACH
        killed += put_in(data, dice.uniform(0.0, 2.0 * takes_s))
        tries += 1
    with look_at(data) as view:
        rows, problems = all_rows(view.database, view.chain), view.problems
    database = opened(data)
    rebuild(database, Chain(data))
    anew = all_rows(database, Chain(data))
    database.close()
    print(f"{killed} kills in {tries} tries, each of up to {takes_s:.2f} s; {made} runs sealed")
    print(
        f"in the store: {len(rows['runs'])} runs, {len(rows['metrics'])} rows of metrics; equal to a new store: ",
        end="",
    )
    print(rows == anew)
    shutil.rmtree(place, ignore_errors=True)
    if rows != anew or problems or len(rows["runs"]) != made:
        sys.exit("NOT THE SAME")


if __name__ == "__main__":
    main()
