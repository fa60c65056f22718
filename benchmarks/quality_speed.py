"""How long the quality figures take with many runs: `python -m benchmarks.quality_speed`.

The rows of the store are multiplied from those of real runs; what is asked here reads no folder. Beside the time stands
that of the processor: on a computer that does other things they differ, and the latter is the program's own.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

from sqlalchemy import text

from analysis.line.run_rules import RULE_SETS
from benchmarks.search_speed import make_folder, times_ms
from station.quality.figures import capability_of, causes_of, chart_of, trend_of, yield_of
from station.store.quality.lot import Lot, Production, production
from station.store.quality.trial import Rule, flips
from station.store.quality.values import characteristic
from station.store.view import opened

ALLOWED_MS = 1000.0
"""Longest time of the processor for one figure."""

METRIC = "lost_motion"
LOT = Lot(recipe="small")

FIGURES: dict[str, Callable[[Production], object]] = {
    "yield": lambda look: yield_of(look, LOT),
    "yield by month": lambda look: yield_of(look, LOT, "month"),
    "Pareto": lambda look: causes_of(look, LOT),
    "capability of five metrics": lambda look: capability_of(look, LOT),
    "control chart": lambda look: chart_of(look, LOT, METRIC, RULE_SETS["western-electric"]),
    "trend by month": lambda look: trend_of(look, LOT, METRIC, "month"),
    "trend by shift": lambda look: trend_of(look, LOT, METRIC, "shift"),
    "limits on trial": lambda look: flips(look, LOT, characteristic(look, LOT, METRIC), Rule(None, 0.51, 0.5)),
}
"""What is asked: counts and trends of all runs, values of the newest 2000 first attempts."""

MULTIPLIED = (
    """INSERT INTO metrics SELECT m.chain, r.run, m.position, m.side, m.main, m.metric, m.definition, m.unit, m.branch,
       m.estimator, m.band, m.torque_nm, m.choices, m.cycles, m.value + (abs(random()) % 1000) * 1e-4 - 0.05,
       m.uncertainty, m.coverage_factor, m.limit_min, m.limit_max,
       CASE WHEN m.position = 0 THEN r.verdict ELSE 'PASS' END
       FROM runs r JOIN metrics m ON m.chain = r.chain AND m.run = :sample
       WHERE NOT EXISTS (SELECT 1 FROM metrics o WHERE o.chain = r.chain AND o.run = r.run)""",
    """INSERT INTO checks SELECT c.chain, r.run, c.id, c.figure, c."limit", c.unit,
       CASE WHEN c.id = 'drift' AND r.verdict = 'NOT DECIDABLE' THEN 0 ELSE 1 END, c.text
       FROM runs r JOIN checks c ON c.chain = r.chain AND c.run = :sample
       WHERE NOT EXISTS (SELECT 1 FROM checks o WHERE o.chain = r.chain AND o.run = r.run)""",
    """INSERT INTO alarms SELECT r.chain, r.run, 0, 'torque_over_limit', 1, 0.1, 'ramp_pos', 'unload', 1, ''
       FROM runs r WHERE r.verdict = 'NOT DECIDABLE'""",
)
"""Statements that give every run the metrics and checks of one, with values that scatter."""

UNDECIDED = """UPDATE runs SET verdict = 'NOT DECIDABLE', objection = 'measurement invalid: drift'
               WHERE verdict = 'PASS' AND attempt = 1 AND CAST(substr(run, 12, 2) AS INTEGER) % 30 = 0"""


def make_store(data: Path, count: int) -> None:
    """Make the folder, its store, and rows of metrics, checks and alarms for every run."""
    make_folder(data, count)
    database = opened(data)
    with database.writing() as connection:
        sample = connection.execute(text("SELECT max(run) FROM metrics")).scalar()
        connection.execute(text(UNDECIDED))
        for statement in MULTIPLIED:
            connection.execute(text(statement), {"sample": sample} if ":sample" in statement else {})
    database.close()


def _asked(data: Path, figure: Callable[[Production], object]) -> object:
    """Return a figure as a page gets it: with the store looked at anew."""
    with production(data, most_s=0.1) as look:
        return figure(look)


def main() -> None:
    """Make the store, measure every figure, and say whether all stay within the allowed time."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=200_000)
    parser.add_argument("--tries", type=int, default=5)
    parser.add_argument("--folder", type=Path, help="keep the folder there, and use it again")
    asked = parser.parse_args()
    place = asked.folder or Path(tempfile.mkdtemp(prefix="lostmotion-quality-"))
    os.environ["LOSTMOTION_STATE"] = str(place / "state")
    data = place / f"runs-{asked.runs}"
    if not data.exists():
        make_store(data, asked.runs)
    sizes = ", ".join(f"{one.name} {one.stat().st_size / 1e6:.0f} MB" for one in data.iterdir() if one.is_file())
    print(f"{asked.runs} runs: {sizes}")
    print(f"{'':40} {'median':>8} {'p95':>8} {'processor p95':>14} ms")
    slow = []
    for name, figure in FIGURES.items():
        call = partial(_asked, data, figure)
        call()
        median, p95, work = times_ms(call, asked.tries)
        print(f"{name:40} {median:8.0f} {p95:8.0f} {work:14.0f}")
        slow += [name] if work > ALLOWED_MS else []
    if asked.folder is None:
        shutil.rmtree(place)
    if slow:
        sys.exit(f"more than {ALLOWED_MS:g} ms: {', '.join(slow)}")


if __name__ == "__main__":
    main()
