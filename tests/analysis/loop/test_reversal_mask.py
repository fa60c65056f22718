"""The stretch after a turn that no fit sees: without a step, no longer than shown, and branches never masked."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from analysis.evaluation.pipeline import analyse
from analysis.loop.branches import Branch
from analysis.loop.loop import Loop
from analysis.loop.method import Method, MetricWanted
from analysis.trace.units import FloatArray
from benchmarks.simulated.kinds import KINDS
from benchmarks.simulated.loop_generator import Bench, course_of, figures_of, measured, method_of
from benchmarks.simulated.truth import truth

PEAK_NM, STIFFNESS = 453.2, 100.0
METHOD = Method(121.0, 412.0)


def leaving(steeper: float, friction_nm: float) -> Loop:
    """A parallelogram: a branch leaves its turn so many times as stiff as it goes on, until friction has reversed."""
    torque = np.linspace(-PEAK_NM, PEAK_NM, 4001)
    turned = 2.0 * friction_nm / (1.0 - 1.0 / steeper)

    def windup(depth: FloatArray) -> FloatArray:
        return np.where(depth < turned, depth / steeper, depth - 2.0 * friction_nm) / STIFFNESS

    return Loop(Branch(torque, windup(PEAK_NM + torque)), Branch(torque, (2.0 * (PEAK_NM - friction_nm)) / STIFFNESS
                - windup(PEAK_NM - torque)), METHOD)  # fmt: skip


def with_friction(at_turn_nm: float, in_the_middle_nm: float) -> Loop:
    """A loop whose friction is another one in the middle of its angle than next to the turns."""
    angle = np.linspace(-4.0, 4.0, 4001)
    dome = np.clip(3.0 - np.abs(angle), 0.0, 1.0)
    friction = at_turn_nm + (in_the_middle_nm - at_turn_nm) * dome
    forward, backward = STIFFNESS * angle + friction, STIFFNESS * angle - friction
    low, high = backward[0], forward[-1]
    rising = Branch(np.append(low, forward), np.append(angle[0] - 1e-6, angle))
    return Loop(rising, Branch(np.append(backward, high), np.append(angle, angle[-1] + 1e-6)), METHOD)


def test_mask_grows_without_a_step() -> None:
    """From nothing, where a branch leaves its turn as it arrived, to all of the friction where it leaves it steeply."""
    masked = [leaving(steeper, 20.0).exclusion_nm for steeper in np.linspace(1.02, 6.0, 500)]
    for end in zip(*masked, strict=True):
        assert end[0] == 0.0
        assert end[-1] == pytest.approx(2.25 * 20.0, rel=0.01)
        assert max(later - sooner for sooner, later in pairwise(end)) < 0.02 * end[-1]
        assert min(later - sooner for sooner, later in pairwise(end)) > -0.02 * end[-1]


def test_mask_is_no_longer_than_the_loop_shows() -> None:
    """Friction of 40 N·m in the middle says nothing of 10 N·m at the turn: 90 N·m were masked, where 23 do."""
    loop = with_friction(10.0, 40.0)
    assert loop.friction_nm == pytest.approx(40.0, rel=0.02)
    for masked in loop.exclusion_nm:
        assert 20.0 < masked < 24.0


def test_what_is_read_off_the_branches_is_as_measured() -> None:
    loop = leaving(1e3, 20.0)
    for torque in (452.0, 430.0, 412.0, 0.0, -412.0, -452.0):
        at = np.array([torque])
        assert loop.rising_at(torque) == loop.forward.at(at)[0]
        assert loop.falling_at(torque) == loop.backward.at(at)[0]


def test_mean_stiffness_of_a_soft_unit_does_not_jump_with_its_friction() -> None:
    """Friction of 25 % of the load read 11.80 ± 0.01 N·m/arcmin, where 12.74 is true: it was read off a fit."""
    wanted = [MetricWanted("stiffness_50_100", branch="mean")]
    bench = Bench(cycles=2)
    for most in (0.25, 0.28, 0.3):
        unit = replace(KINDS["strain-wave"], threshold=(0.02, most))
        trace = measured(unit, course_of(unit, bench), bench, np.random.default_rng(1))
        (found,) = analyse(trace, method_of(unit, bench), wanted, figures=figures_of(unit)).metrics
        for side in found.sides:
            exact = truth(unit, "stiffness_50_100 mean", -1 if side.side == "-" else 1, bench.peak * unit.rated_nm)
            assert abs(side.value - exact) < 2.0 * side.uncertainty
            assert abs(side.value - exact) < 0.003 * exact
