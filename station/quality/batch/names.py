"""What the metrics of a batch are called: by their short titles, and by more where two would have one name."""

from __future__ import annotations

import functools
import itertools
from collections import Counter
from collections.abc import Callable, Sequence

from definitions.metrics import METRICS
from station.reports.result_text import minus
from station.store.quality.values import Characteristic

_DIFFER: tuple[tuple[str, str], ...] = (
    ("branch", "branch {}"), ("torque_nm", "at {} N·m"), ("band", "band {}"), ("estimator", "by {}"), ("unit", "in {}"),
    ("definition", "defined as {}"),
)  # fmt: skip
"""What tells metrics of one title and choices apart, the most usual first, and the words for it."""


def names_of(there: Sequence[Characteristic]) -> dict[Characteristic, str]:
    """Return the name of each characteristic of a batch, without its side; no two have the same.

    A name has no more than it needs: the short title with the choices, the whole title where another metric has the
    same short one, and then what differs among those that are still called alike.
    """
    found = {one: _words(_title(one).partition(" (")[0], one.choices) for one in there}
    found = _longer(found, lambda one, _: _words(_title(one), one.choices), "metric")
    for field, words in _DIFFER:
        found = _longer(found, functools.partial(_with, field, words), field)
    number = itertools.count(1)
    return _longer(found, lambda _, name: f"{name} ({next(number)})")


def column_of(name: str, side: str) -> str:
    """Return how a column of values of a side is called; name: of the characteristic."""
    return name if side == "both" else f"{name} side {minus(side)}"


def _title(one: Characteristic) -> str:
    row = METRICS.get(one.metric)
    return one.metric if row is None else row.title


def _with(field: str, words: str, one: Characteristic, name: str) -> str:
    return f"{name} {words.format(getattr(one, field))}"


def _words(*parts: str) -> str:
    return " ".join(part for part in parts if part)


def _longer(
    names: dict[Characteristic, str], longer: Callable[[Characteristic, str], str], field: str | None = None
) -> dict[Characteristic, str]:
    """Return names of which those that stand twice are longer; field: only where those of one name differ in it."""
    times = Counter(names.values())
    values = {name: {getattr(one, field) for one in names if names[one] == name} for name in times} if field else {}
    return {
        one: longer(one, name) if times[name] > 1 and (field is None or len(values[name]) > 1) else name
        for one, name in names.items()
    }
