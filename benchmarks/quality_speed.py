"""How long the quality figures take with many runs: `python -m benchmarks.quality_speed [--postgresql]`.

What is asked here reads no folder of a run; see `benchmarks.plant_store` for what is there and what is measured.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from analysis.line.run_rules import RULE_SETS
from analysis.trace.errors import AnalysisError
from benchmarks.plant_store import Question, measure
from station.quality.figures import capability_of, causes_of, chart_of, trend_of, yield_of
from station.store.quality.guard_bands import GuardBands
from station.store.quality.lot import Lot, Production, production
from station.store.quality.trial import Rule, flips
from station.store.quality.values import characteristic

ALLOWED_MS = 1000.0

METRIC = "lost_motion"
LOT = Lot(recipe="small")


def trend(look: Production, by: str) -> object:
    """Return a trend, or what the page says where all runs are of one group and nothing is to be compared."""
    try:
        return trend_of(look, LOT, METRIC, by)
    except AnalysisError as error:
        return str(error)


FIGURES: dict[str, Callable[[Production], object]] = {
    "yield": lambda look: yield_of(look, LOT),
    "yield by month": lambda look: yield_of(look, LOT, "month"),
    "runs that are not believed": lambda look: look.disbelieved(LOT),
    "Pareto": lambda look: causes_of(look, LOT),
    "capability of all metrics": lambda look: capability_of(look, LOT),
    "control chart": lambda look: chart_of(look, LOT, METRIC, RULE_SETS["western-electric"]),
    "trend by month": lambda look: trend(look, "month"),
    "trend by shift": lambda look: trend(look, "shift"),
    "limits on trial": lambda look: flips(
        look, LOT, characteristic(look, LOT, METRIC), Rule(None, 0.51, 0.5), judged=GuardBands.of_all(None)
    ),
}
"""What is asked: counts and trends of all runs, values of the newest 2000 first attempts."""


def on_a_page(figure: Callable[[Production], object], data: Path) -> object:
    """Return a figure as a page gets it: with the store looked at anew."""
    with production(data, most_s=0.1) as look:
        return figure(look)


QUESTIONS = {name: Question(partial(on_a_page, figure), ALLOWED_MS) for name, figure in FIGURES.items()}

if __name__ == "__main__":
    measure(__doc__, QUESTIONS, tries=5)
