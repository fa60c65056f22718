"""What the budget says of a delay between torque and angle, against a run whose torques are moved in time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.evaluation.metric_result import MetricResult
from analysis.evaluation.pipeline import analyse
from analysis.loop.method import MetricWanted
from analysis.trace.trace import Trace
from benchmarks.virtual_bench_study import Both, run
from station.bench.assemble_virtual import choose_unit, virtual_config
from station.bench.figures import figures_of
from station.bench.request import Job, load_job
from station.results.evaluation import method_of

GOLDEN = Path(__file__).parents[2] / "proofs" / "golden" / "golden.yaml"
METRICS = ("backlash_width_3pct", "backlash_width_zero", "lost_motion", "hysteresis_energy")
LATE_S = 3.5e-3


@pytest.fixture(scope="module")
def both() -> tuple[Job, Both]:
    """A run at 300 N·m/s: its drive accelerates, runs through the gap, and ripples."""
    job = load_job(str(GOLDEN), None)
    return job, run(job, virtual_config(job.bench, job.profile_paths, choose_unit("P1:1", job.recipe, 1)))


@pytest.fixture(scope="module")
def quick(both: tuple[Job, Both]) -> tuple[Job, Trace]:
    """What was there in that run: no sensor's error hides what a delay does."""
    job, traces = both
    return job, traces.true


def evaluated(job: Job, trace: Trace, late_s: float) -> list[MetricResult]:
    """Evaluate the run with its torques so much later."""
    late = {
        name: np.interp(trace.t_s - late_s, trace.t_s, getattr(trace, name))
        for name in ("torque_in_nm", "torque_out_nm")
    }
    wanted = [MetricWanted(name) for name in METRICS]
    return list(
        analyse(replace(trace, **late), method_of(job.recipe, job.bench), wanted, figures=figures_of(job.bench)).metrics
    )


def test_the_budget_knows_what_a_delay_does(quick: tuple[Job, Trace]) -> None:
    """By the mean rate of the torque it was 5.7 arcmin/s of backlash, where the run itself says 10.8."""
    now, late, early = (evaluated(*quick, late_s) for late_s in (0.0, LATE_S, -LATE_S))
    for name, *results in zip(METRICS, now, late, early, strict=True):
        for side, after, before in zip(*(one.sides for one in results), strict=True):
            assert side.budget is not None
            (row,) = [one for one in side.budget.rows if one.quantity == "skew"]
            assert row.sensitivity == pytest.approx((after.value - before.value) / (2.0 * LATE_S), rel=0.15), name


def test_what_the_sensors_show_is_within_u_of_what_was_there(both: tuple[Job, Both]) -> None:
    """The truth of a run is its own: another takes another way where friction reverses."""
    job, traces = both
    wanted = [MetricWanted(name) for name in METRICS]
    method = method_of(job.recipe, job.bench)
    seen = analyse(traces.seen, method, wanted, figures=figures_of(job.bench)).metrics
    for shown, exact in zip(seen, analyse(traces.true, method, wanted).metrics, strict=True):
        for side, true in zip(shown.sides, exact.sides, strict=True):
            assert side.value is not None
            assert true.value is not None
            assert side.uncertainty is not None
            assert 0.0 < abs(side.value - true.value) <= side.uncertainty, (shown.wanted.id, side.side)
