"""How long the search of the results page takes with many runs: `python -m benchmarks.search_speed [--postgresql]`.

See `benchmarks.plant_store` for what is there and what is measured.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

from benchmarks.plant_store import Question, measure
from station.store.run_search import Page, search
from station.store.stored_runs import Wanted
from station.web.bench.changes import since_it_worked
from station.web.pages.run import beside

ALLOWED_MS = 300.0
DEEP = 100_000
SINCE, UNTIL = "2024-06-03T00:00:00.000+00:00", "2024-06-10T00:00:00.000+00:00"

SEARCHES: dict[str, tuple[Wanted, int]] = {
    "nothing asked": (Wanted(), 0),
    "deep in the list": (Wanted(), DEEP),
    "serial number begins with U00001": (Wanted(begins="U00001"), 0),
    "no such serial number": (Wanted(begins="X"), 0),
    "one unit": (Wanted(serial="U000100"), 0),
    "model": (Wanted(model="RV-80E-101"), 0),
    "recipe": (Wanted(recipe="small"), 0),
    "FAIL": (Wanted(verdict="FAIL"), 0),
    "operator": (Wanted(operator="B. Tester"), 0),
    "a week": (Wanted(since=SINCE, until=UNTIL), 0),
    "FAIL of a model, an operator, a week": (
        Wanted(model="RV-80E-101", verdict="FAIL", operator="B. Tester", since=SINCE, until=UNTIL), 0),
    "good master part of a model": (Wanted(model="RV-80E-101", verdict="PASS", master="PASS"), 0),
}  # fmt: skip
"""What is asked, and from which run on."""


def page_of(wanted: Wanted, first: int, data: Path) -> Page:
    """Return a page of the table of runs."""
    return search(data, wanted, first=first, count=50)


QUESTIONS = {name: Question(partial(page_of, *asked), ALLOWED_MS) for name, asked in SEARCHES.items()}
QUESTIONS["beside a run: its unit, good master parts"] = Question(
    lambda data: beside(data, "", "U000100", "RV-40E-121"), ALLOWED_MS
)
QUESTIONS["since the bench worked"] = Question(since_it_worked, ALLOWED_MS)

if __name__ == "__main__":
    measure(__doc__, QUESTIONS, tries=20)
