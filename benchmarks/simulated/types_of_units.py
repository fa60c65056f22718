"""Coverage by type of unit: units of `kinds`, each measured once, against the closed form of their loop."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence

import numpy as np

from analysis.evaluation.pipeline import Curves, analyse
from analysis.loop.method import MetricWanted
from benchmarks.simulated.coverage import CoverageRow, coverage_row
from benchmarks.simulated.kinds import KINDS
from benchmarks.simulated.loop_generator import Bench, course_of, figures_of, measured, method_of
from benchmarks.simulated.truth import TRUTH, truth

SEED = 30
Values = list[tuple[float, float, float]]


def wanted_of(name: str) -> MetricWanted:
    """Return what is asked for by a name of `TRUTH`: the id of a metric, and a branch where it has one."""
    metric, _, branch = name.partition(" ")
    return MetricWanted(metric, branch=branch or None)


ASKED: Mapping[str, MetricWanted] = {name: wanted_of(name) for name in TRUTH}


ABOUT_ZERO = "asymmetry_at_rated"
"""Its value is a magnitude, and zero for a unit with equal sides: errors of either sign make it larger, so it
is held against the truth with the sign that the measured loops give it."""


def softer_side(curves: Curves, torque_nm: float) -> float:
    """Return the sign of the side that winds up more to ± a torque [N·m], by the mean of all measured cycles."""
    found = [
        branch.value_at(torque_nm) + branch.value_at(-torque_nm) - 2.0 * branch.value_at(0.0)
        for branch in (*curves.forward, *curves.backward)
    ]
    return -1.0 if sum(found) < 0.0 else 1.0


def rows_by_type(units: int, only: Sequence[str] = ()) -> tuple[dict[str, list[CoverageRow]], dict[str, int]]:
    """Measure so many units, of each type in turn; return the rows of each type, and checks that failed, by id.

    only: metrics, by their names in `TRUTH`; all when empty. Every other unit rests at its turns.
    """
    asked = [ASKED[name] for name in only or ASKED]
    found: dict[str, list[Values]] = {kind: [[] for _ in asked] for kind in KINDS}
    shown: list[str] = []
    refused: dict[str, int] = defaultdict(int)
    for number in range(units):
        random = np.random.default_rng([SEED, number])
        kind = list(KINDS)[number % len(KINDS)]
        unit, bench = KINDS[kind].varied(random), Bench(dwell_s=0.5 * (number // len(KINDS) % 2))
        peak = bench.peak * unit.rated_nm
        trace = measured(unit, course_of(unit, bench), bench, random)
        result = analyse(trace, method_of(unit, bench), asked, figures=figures_of(unit))
        shown = [one.definition.unit for one in result.metrics]
        for check in result.checks:
            if check.passed is False:
                refused[check.id] += 1
        for values, name, one in zip(found[kind], only or ASKED, result.metrics, strict=True):
            for side in one.sides:
                exact = truth(unit, name, -1 if side.side == "-" else 1, peak)
                if side.value is None or side.uncertainty is None:
                    values.append((np.nan, np.nan, np.nan))
                else:
                    turn = softer_side(result.curves, unit.rated_nm) if name == ABOUT_ZERO else 1.0
                    values.append((exact, turn * side.value - exact, side.uncertainty))
    counts = {kind: len(range(place, units, len(KINDS))) for place, kind in enumerate(KINDS)}
    rows = {
        kind: [
            coverage_row(one, unit, values, counts[kind])
            for one, unit, values in zip(asked, shown, found[kind], strict=True)
        ]
        for kind in KINDS
        if counts[kind]
    }
    return rows, dict(refused)


def cell(row: CoverageRow) -> str:
    """Coverage, bias over U, and 2·s / U of one metric and type."""
    return f"{row.covered:.1%}; {row.bias / row.expanded:+.2f}; {2.0 * row.deviation / row.expanded:.2f}"


def table(units: int) -> str:
    """Return the study as Markdown: a row per metric, a column per type."""
    rows, refused = rows_by_type(units)
    head = f"| metric | {' | '.join(rows)} |\n|{' --- |' * (len(rows) + 1)}\n"
    lines = []
    for number, name in enumerate(ASKED):
        lines.append(f"| `{name}` | {' | '.join(cell(of[number]) for of in rows.values())} |")
    every = [row for of in rows.values() for row in of]
    worst = max(row.bias_over_u for row in every)
    said = ", ".join(f"`{check}` {count}" for check, count in refused.items()) or "none"
    return (
        f"{head}" + "\n".join(lines) + f"\n\n{units} units, {min(row.units for row in every)} or more of each type. "
        f"Largest bias: {worst:.2f} U. Coverage: {min(row.covered for row in every):.1%} to "
        f"{max(row.covered for row in every):.1%}. Checks that refused a sound measurement: {said}.\n"
    )
