"""U of what is read off the branches holds for units of which neither bench nor analysis knows, and none is refused."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from analysis.evaluation.pipeline import analyse
from analysis.loop.method import MetricWanted
from benchmarks.simulated.loop_generator import KINDS, Bench, course_of, figures_of, measured, method_of, truth

WANTED = (
    MetricWanted("backlash_width_3pct", max=6.0),
    MetricWanted("lost_motion"),
    MetricWanted("stiffness_50_100", branch="load"),
    MetricWanted("stiffness_lsq"),
    MetricWanted("hysteresis_energy"),
)
UNITS = 48


def test_uncertainty_holds_and_no_good_unit_is_refused() -> None:
    within: dict[str, list[bool]] = defaultdict(list)
    for seed in range(UNITS):
        random = np.random.default_rng(seed)
        unit = list(KINDS.values())[seed % len(KINDS)].varied(random)
        bench = Bench(dwell_s=0.5 * (seed // len(KINDS) % 2))
        trace = measured(unit, course_of(unit, bench), bench, random)
        result = analyse(trace, method_of(unit, bench), WANTED, figures=figures_of(unit))
        assert [check.id for check in result.checks if check.passed is False] == []
        for wanted, found in zip(WANTED, result.metrics, strict=True):
            name = f"{wanted.id} {wanted.branch}" if wanted.branch else wanted.id
            for side in found.sides:
                exact = truth(unit, name, -1 if side.side == "-" else 1, bench.peak * unit.rated_nm)
                within[name].append(abs(side.value - exact) <= side.uncertainty)
    assert {name: np.mean(hits) > 0.88 for name, hits in within.items()} == dict.fromkeys(within, True)
