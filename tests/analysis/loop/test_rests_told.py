"""Where a ramp is told to have rested: wherever it did, and not where a sound unit goes over zero torque by itself."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from reference_unit import ReferenceUnit

from analysis.loop.interruptions import interruptions_of
from analysis.loop.samples import BranchSamples
from analysis.trace.runs import Run

PEAK_NM, RATE_NM_S, PERIOD_S = 453.2, 120.0, 1e-3
SOUND, WORN = ReferenceUnit(), ReferenceUnit(j=0.35, f_c=26.0)
CROSSINGS: dict[str, tuple[tuple[float, float], ...]] = {
    "even": (),
    "slows": ((0.028, 0.8),),
    "slows long": ((0.07, 1.8),),
    "runs ahead": ((0.012, 6.0), (0.06, 0.6)),
    "goes back": ((0.012, 8.0), (0.028, -5.0)),
    "rests after a surge": ((0.05, 25.0), (0.15, 0.4)),
    "rests long after a surge": ((0.08, 50.0), (0.33, 0.4)),
    "waits too long": ((0.02, 8.0), (0.38, 0.1)),
}
"""What the torque does from zero on, before the ramp goes on: parts of so many seconds and N·m."""

OWN = ("slows", "slows long", "runs ahead")
"""What units of the virtual bench do by themselves, where a ramp by torque takes them over zero at 120 N·m/s."""


def rising(
    crossing: str = "even", at_nm: float = 0.0, *, rest: tuple[float, float] | None = None,
    unit: ReferenceUnit = SOUND, noise_nm: float = 0.2, direction: int = 1, rate_nm_s: float = RATE_NM_S,
) -> tuple[BranchSamples, slice]:  # fmt: skip
    """Return one branch, and the rows of its rest; at_nm: where it crosses; rest: at a share of the peak, seconds."""
    parts = CROSSINGS[crossing]
    seconds, nm = np.cumsum([((at_nm + PEAK_NM) / rate_nm_s, at_nm + PEAK_NM), *parts], axis=0).T
    left_s = (2.0 * PEAK_NM - nm[-1]) / rate_nm_s
    knots_s = np.concatenate(([0.0], seconds, [seconds[-1] + left_s]))
    knots_nm = np.concatenate(([0.0], nm, [2.0 * PEAK_NM])) - PEAK_NM
    torque = np.interp(np.arange(0.0, knots_s[-1], PERIOD_S), knots_s, knots_nm)
    share, rest_s = rest or (0.0, 0.0)
    begins, rows = int(np.argmax(torque >= share * PEAK_NM)), round(rest_s / PERIOD_S)
    torque = np.insert(torque, begins, np.full(rows, torque[begins]))
    phi, along, _ = unit.branches(PEAK_NM)
    windup = np.interp(torque, along, phi)
    torque = torque + noise_nm * np.random.default_rng(1).standard_normal(torque.size)
    run = Run("measure", direction, 1, (slice(0, torque.size),))
    time = np.arange(torque.size) * PERIOD_S
    branch = BranchSamples(run, 1, direction * torque, direction * windup, time, "")
    return branch, slice(begins, begins + rows)


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("noise_nm", [0.0, 0.2])
@pytest.mark.parametrize("crossing", OWN)
@pytest.mark.parametrize("unit", [SOUND, WORN], ids=["sound", "worn"])
def test_a_unit_that_goes_over_zero_by_itself_is_not_interrupted(
    unit: ReferenceUnit, crossing: str, noise_nm: float, direction: int
) -> None:
    """On its way through the play the torque runs ahead, or falls behind, and then the ramp goes on as before."""
    assert interruptions_of([rising(crossing, unit=unit, noise_nm=noise_nm, direction=direction)[0]]) == ()


LEVELS = (
    -0.85,
    -0.6,
    -0.3,
    -0.05,
    -0.02,
    -0.01,
    -0.005,
    0.0,
    0.002,
    0.004,
    0.006,
    0.01,
    0.013,
    0.02,
    0.05,
    0.3,
    0.6,
    0.95,
)


@pytest.mark.parametrize("noise_nm", [0.0, 0.2])
@pytest.mark.parametrize("rest_s", [0.08, 0.2, 1.0, 5.0, 20.0])
@pytest.mark.parametrize("unit", [SOUND, WORN], ids=["sound", "worn"])
def test_a_rest_is_told_wherever_it_is(unit: ReferenceUnit, rest_s: float, noise_nm: float) -> None:
    """Before, in and after the play too, whatever the torque does there, and if it takes most of the time."""
    missed = []
    for crossing, level in product(("even", *OWN), LEVELS):
        branch, rest = rising(crossing, rest=(level, rest_s), unit=unit, noise_nm=noise_nm)
        found = [one.rows for one in interruptions_of([branch])]
        if not any(rows.start <= rest.start and rest.stop <= rows.stop for rows in found):
            missed.append((crossing, level))
    assert missed == []


@pytest.mark.parametrize("crossing", OWN)
@pytest.mark.parametrize("at_nm", [-300.0, -30.0, 30.0, 300.0])
def test_away_from_zero_no_unit_does_that_by_itself(crossing: str, at_nm: float) -> None:
    assert len(interruptions_of([rising(crossing, at_nm)[0]])) == 1


def test_a_torque_that_goes_back_is_told_at_zero_too() -> None:
    """It lost no time: it had run ahead. But the unit has gone through a small loop."""
    assert len(interruptions_of([rising("goes back")[0]])) == 1


@pytest.mark.parametrize(("crossing", "at_nm"), [("rests after a surge", -25.0), ("rests long after a surge", -50.0)])
def test_what_ran_ahead_before_the_play_excuses_no_rest(crossing: str, at_nm: float) -> None:
    """The ramp has lost no time by what it was before: but the unit has rested."""
    assert len(interruptions_of([rising(crossing, at_nm)[0]])) == 1


def test_what_ran_ahead_through_the_play_excuses_no_long_rest() -> None:
    """On a slow ramp it would make up for half a second: the torque law needs less to come back to it."""
    assert len(interruptions_of([rising("waits too long", rate_nm_s=20.0)[0]])) == 1


def test_a_wind_up_that_goes_back_at_zero_is_told() -> None:
    """No unit does that while its torque rises; the torque alone is as a unit's own."""
    branch, _ = rising("slows long")
    middle = int(np.argmax(branch.torque_nm >= 1.0))
    slipped = branch.windup_arcmin - 0.04 * np.clip((np.arange(branch.torque_nm.size) - middle) / 40.0, 0.0, 1.0)
    assert len(interruptions_of([replace(branch, windup_arcmin=slipped)])) == 1
