"""Coverage where errors that nobody declared are as large as the checks of a run leave open, by units of all types.

Each unit is measured with a gain of the output torque and a hysteresis of its sensor, each drawn evenly within what
`ratio_agreement` and `torque_bend` leave open in a sound run of its type. One evaluation with `left_open: budget` shows
both: what is told alone has the same rows without those errors.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from analysis.evaluation.pipeline import analyse
from analysis.uncertainty.budget import Budget
from analysis.uncertainty.left_open import OPEN_SOURCES
from benchmarks.simulated.kinds import KINDS, Kind
from benchmarks.simulated.loop_generator import Bench, Defect, course_of, figures_of, measured, method_of
from benchmarks.simulated.truth import truth
from benchmarks.simulated.types_of_units import wanted_of

SEED = 60
METRICS = (
    "backlash_width_3pct", "backlash_width_zero", "lost_motion", "stiffness_50_100 load", "stiffness_lsq",
    "spring_constant", "hysteresis_energy", "windup",
)  # fmt: skip

DRAWN = {"ratio_agreement": "open_torque_out_gain", "torque_bend": "open_hysteresis"}
"""Checks whose errors are drawn, and the row of the budget that each is."""

OPEN = {source.id for sources in OPEN_SOURCES.values() for source in sources}
ROWS: dict[str, Callable[[str], bool]] = {
    "told": lambda name: name not in OPEN,
    "drawn": lambda name: name not in OPEN or name in DRAWN.values(),
    "budget": lambda _: True,
}
"""Rows of a budget that count: without what is left open, with the errors that are drawn, and with all of it."""


class Share(NamedTuple):
    """Share of the values of a metric whose error is within U, and median of U, by `ROWS`."""

    covered: dict[str, float]
    expanded: dict[str, float]


def expanded_of(budget: Budget, counts: Callable[[str], bool]) -> float:
    """Return U of some of the rows of a budget."""
    return budget.coverage.factor * float(
        np.sqrt(sum(row.contribution**2 for row in budget.rows if counts(row.quantity)))
    )


def sizes_of(unit: Kind, bench: Bench) -> dict[str, float]:
    """Return what a sound run of a unit leaves open, of the errors that are drawn."""
    trace = measured(unit, course_of(unit, bench), bench, np.random.default_rng(SEED))
    checks = analyse(trace, method_of(unit, bench), [wanted_of(METRICS[0])], figures=figures_of(unit)).checks
    return {one.id: one.left_open.figure for one in checks if one.id in DRAWN and one.left_open is not None}


def study(units: int, metrics: Sequence[str] = METRICS, kinds: Sequence[str] = tuple(KINDS)) -> dict[str, Share]:
    """Measure so many units, of each type in turn; return what is covered of each metric."""
    bench, asked = Bench(), [wanted_of(name) for name in metrics]
    sizes = {kind: sizes_of(KINDS[kind], bench) for kind in kinds}
    errors: dict[str, list[float]] = defaultdict(list)
    expanded: dict[str, list[tuple[float, ...]]] = defaultdict(list)
    for number in range(units):
        random = np.random.default_rng([SEED, number])
        kind = kinds[number % len(kinds)]
        unit, size = KINDS[kind].varied(random), sizes[kind]
        gain, hysteresis_nm = (size[check] * random.uniform(-1.0, 1.0) for check in DRAWN)
        defect = Defect(out_gain=1.0 + gain / 100.0, hysteresis_nm=hysteresis_nm)
        trace = measured(unit, course_of(unit, bench), bench, random, defect)
        result = analyse(trace, method_of(unit, bench, left_open="budget"), asked, figures=figures_of(unit))
        for name, one in zip(metrics, result.metrics, strict=True):
            for side in one.sides:
                exact = truth(unit, name, -1 if side.side == "-" else 1, bench.peak * unit.rated_nm)
                # Over the true value, for the types differ by their size.
                errors[name].append(np.inf if side.value is None else abs(side.value - exact) / abs(exact))
                rows = [0.0 for _ in ROWS] if side.budget is None else [
                    expanded_of(side.budget, counts) / abs(exact) for counts in ROWS.values()
                ]  # fmt: skip
                expanded[name].append(tuple(rows))
    found = {}
    for name in metrics:
        each = np.array(expanded[name])
        within = np.array(errors[name])[:, None] <= each
        found[name] = Share(
            dict(zip(ROWS, within.mean(axis=0).tolist(), strict=True)),
            dict(zip(ROWS, np.median(each, axis=0).tolist(), strict=True)),
        )
    return found


def table(units: int) -> str:
    """Return the study as Markdown: a row per metric."""
    lines = [
        "| metric | covered, `told` | with the two errors | `budget` | U of value, `told` | with the two | `budget` |",
        f"|{' --- |' * 7}",
    ]
    for name, share in study(units).items():
        covered = " | ".join(f"{one:.1%}" for one in share.covered.values())
        lines.append(f"| `{name}` | {covered} | {' | '.join(f'{one:.2%}' for one in share.expanded.values())} |")
    return "\n".join(lines) + f"\n\n{units} units of six types.\n"
