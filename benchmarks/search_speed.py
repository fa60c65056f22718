"""How long the search of the results page takes with many runs: `python -m benchmarks.search_speed`.

The newest runs have folders, sealed and signed as a bench does it; of the older ones there are the rows in the store
and lines in the chain as long as real ones, which is what a search can meet of them. So the search is measured as it is
in a folder of that many runs, without a folder of that many runs being made. Beside the time stands that of the
processor: on a computer that does other things they differ, and the latter is the program's own.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from sqlalchemy import insert, select, update

from benchmarks.many_runs import EVERY, FIRST, UNITS_MEASURED_TWICE, make_runs
from station.records.chain.chain_file import Chain
from station.store.run_search import search
from station.store.stored_runs import Wanted
from station.store.tables import PROJECTIONS, RUNS
from station.store.view import bring_up, opened

REAL = 500
"""Newest runs, which have folders."""

ALLOWED_MS = 300.0
AT_A_TIME = 5000
MODELS = ("RV-40E-121", "RV-80E-101", "RV-20E-105")
OPERATORS = ("A. Tester", "B. Tester", "C. Tester", "D. Tester")

SEARCHES: dict[str, tuple[Wanted, int]] = {
    "nothing asked": (Wanted(), 0),
    "deep in the list": (Wanted(), 100_000),
    "serial number begins with U00001": (Wanted(begins="U00001"), 0),
    "no such serial number": (Wanted(begins="X"), 0),
    "one unit": (Wanted(serial="U000100"), 0),
    "model": (Wanted(model="RV-80E-101"), 0),
    "recipe": (Wanted(recipe="small"), 0),
    "FAIL": (Wanted(verdict="FAIL"), 0),
    "operator": (Wanted(operator="B. Tester"), 0),
    "a week": (Wanted(since="2024-06-03T00:00:00.000+00:00", until="2024-06-10T00:00:00.000+00:00"), 0),
    "FAIL of a model, an operator, a week": (
        Wanted(model="RV-80E-101", verdict="FAIL", operator="B. Tester", since="2024-06-03T00:00:00.000+00:00",
               until="2024-06-10T00:00:00.000+00:00"), 0),
    "good master part of a model": (Wanted(model="RV-80E-101", verdict="PASS", master="PASS"), 0),
}  # fmt: skip
"""What is asked, and from which run on."""


def older_rows(sample: dict[str, Any], count: int) -> Iterator[dict[str, Any]]:
    """Yield rows of runs from before the real ones, after the pattern of these."""
    for number in range(count):
        again = number % UNITS_MEASURED_TWICE == UNITS_MEASURED_TWICE - 1
        serial, moment = f"U{number - again:06}", FIRST + number * EVERY
        failed = (number + 1) % UNITS_MEASURED_TWICE == UNITS_MEASURED_TWICE - 1
        started = moment.isoformat(timespec="milliseconds")
        yield sample | {
            "run": f"{moment:%Y%m%dT%H%M%S}.000Z-{serial}", "serial": serial, "attempt": 1 + again,
            "started": started, "ended": started, "verdict": "FAIL" if failed else "PASS",
            "model": MODELS[number % len(MODELS)], "operator": OPERATORS[number % len(OPERATORS)],
        }  # fmt: skip


def make_folder(data: Path, count: int) -> None:
    """Make the folder with its store and its chain."""
    make_runs(data, REAL, first=count - REAL)
    while bring_up(data, 60.0):
        pass
    chain, database = Chain(data), opened(data)
    lines = chain.content.splitlines(keepends=True)
    long = (lines[1] + lines[2]) * (count - REAL)
    content = lines[0] + long + b"".join(lines[1:])
    with database.writing() as connection:
        sample = dict(connection.execute(select(RUNS).where(RUNS.c.chain == chain.id).limit(1)).mappings().one())
        rows: list[dict[str, Any]] = []
        for row in older_rows(sample, count - REAL):
            rows.append(row)
            if len(rows) == AT_A_TIME:
                connection.execute(insert(RUNS), rows)
                rows = []
        if rows:
            connection.execute(insert(RUNS), rows)
        chain.path.write_bytes(content)
        there = {"offset": len(content), "prefix_sha256": hashlib.sha256(content).hexdigest()}
        seen = Chain(data).seen_now()
        connection.execute(update(PROJECTIONS).where(PROJECTIONS.c.chain == chain.id).values(seen=seen, **there))
    database.close()


def times_ms(call: Callable[[], object], tries: int) -> tuple[float, float, float]:
    """Return how long a call takes: median, 95th percentile, and that of the processor's time, in milliseconds."""
    walls, work = [], []
    for _ in range(tries):
        started, before = time.perf_counter(), time.process_time()
        call()
        walls.append(1e3 * (time.perf_counter() - started))
        work.append(1e3 * (time.process_time() - before))
    if tries == 1:
        return walls[0], walls[0], work[0]
    return statistics.median(walls), statistics.quantiles(walls, n=20)[-1], statistics.quantiles(work, n=20)[-1]


def main() -> None:
    """Make the folder, measure every search, and say whether all stay within the allowed time."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=200_000)
    parser.add_argument("--tries", type=int, default=20)
    parser.add_argument("--folder", type=Path, help="keep the folder there, and use it again")
    asked = parser.parse_args()
    place = asked.folder or Path(tempfile.mkdtemp(prefix="lostmotion-search-"))
    os.environ["LOSTMOTION_STATE"] = str(place / "state")
    data = place / f"runs-{asked.runs}"
    if not data.exists():
        make_folder(data, asked.runs)
    sizes = ", ".join(f"{one.name} {one.stat().st_size / 1e6:.0f} MB" for one in data.iterdir() if one.is_file())
    print(f"{asked.runs} runs: {sizes}")
    print(f"{'':40} {'median':>8} {'p95':>8} {'processor p95':>14} ms   runs found")
    slow = []
    for name, (wanted, first) in SEARCHES.items():
        total = search(data, wanted, first=first, count=50).total
        median, p95, work = times_ms(partial(search, data, wanted, first=first, count=50), asked.tries)
        print(f"{name:40} {median:8.0f} {p95:8.0f} {work:14.0f}      {total}")
        slow += [name] if work > ALLOWED_MS else []
    number = sum(1 for one in data.iterdir() if one.is_dir()) - REAL
    make_runs(data, 1, first=asked.runs + number)
    median, p95, work = times_ms(partial(search, data, Wanted(), count=50), 1)
    print(f"{'the first one after a run was sealed':40} {median:8.0f} {p95:8.0f} {work:14.0f}")
    if asked.folder is None:
        shutil.rmtree(place)
    if slow:
        sys.exit(f"more than {ALLOWED_MS:g} ms: {', '.join(slow)}")


if __name__ == "__main__":
    main()
