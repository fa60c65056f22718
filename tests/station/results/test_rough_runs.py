"""Runs of few points at a third of the load: friction that waves as the shaft turns is no bend of a torque channel."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from virtual_benches import Runs, runs_by

from analysis.evaluation.pipeline import analyse
from analysis.loop.method import MetricWanted
from analysis.trace.trace import Trace
from station.bench.figures import figures_of
from station.bench.request import Job
from station.results.evaluation import method_of

GOLDEN = Path(__file__).parents[2] / "proofs" / "golden" / "golden.yaml"
ROUGH = {
    "period: 4 ms": "period: 20 ms",
    "  sample_age: 20 ms": "  sample_age: 40 ms",
    "  drive_age: 40 ms": "  drive_age: 50 ms",
    "torque_rate: 300 N·m/s": "torque_rate: 75 N·m/s",
}
UNITS = (9, 11, 16, 20, 26, 37)
"""Sound ones that were refused when the scatter of the points counted as if each were one of its own."""

BENT = 0.05


@pytest.fixture(scope="module")
def rough(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    """Runs of some units in virtual time, each with sensors of its own."""
    return runs_by(GOLDEN, ROUGH, {seed: f"P1:{seed}" for seed in UNITS}, tmp_path_factory.mktemp("rough"))


def bend_of(job: Job, trace: Trace) -> tuple[float | None, bool | None]:
    """Figure of the check [%], and whether it passed."""
    wanted = [MetricWanted("torque_ratio_slope")]
    result = analyse(trace, method_of(job.recipe, job.bench), wanted, figures=figures_of(job.bench))
    (found,) = [one for one in result.checks if one.id == "torque_bend"]
    return found.figure, found.passed


@pytest.mark.parametrize("seed", UNITS)
def test_a_sound_rough_run_has_no_bend(rough: Runs, seed: int) -> None:
    """Its bend scatters by 0.9 % from unit to unit, and independent residuals say 0.4 %: 24 of 120 were refused."""
    job, runs = rough
    figure, passed = bend_of(job, runs[seed])
    assert passed, f"{figure} %"


@pytest.mark.parametrize("bent", [BENT, -BENT - 0.01])
@pytest.mark.parametrize("seed", UNITS)
def test_a_bent_channel_is_seen_in_it(rough: Runs, seed: int, bent: float) -> None:
    """Friction at a small load bends by 1.1 % itself, the way a positive bend does: so the other way it takes more."""
    job, runs = rough
    torque = runs[seed].torque_out_nm
    assert torque is not None
    share = np.abs(torque) / np.abs(torque).max()
    figure, passed = bend_of(job, replace(runs[seed], torque_out_nm=torque * (1.0 + bent * (share - 1.0))))
    assert passed is False, f"{figure} %"
