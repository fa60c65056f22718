"""Identification on loops of reference units with sensor noise: what comes back, and what is refused."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from reference_unit import ARC, RATIO, ReferenceUnit, bench_trace, quantised

from analysis.models.identify import Identified, identify, torque_on_branches
from analysis.models.maxwell_slip import identify_maxwell_slip
from analysis.models.reducer_model import ReducerModel
from analysis.models.samples import LoopSamples, loop_samples, loop_shape
from analysis.models.table import MODELS
from analysis.trace.errors import AnalysisError
from analysis.trace.runs import commanded_runs

PEAK_NM = 453.0
NAMES = {
    "stiffness_nm_per_arcmin": "k_inf",
    "soft_zone_arcmin": "b",
    "soft_zone_nm": "t0",
    "gap_arcmin": "j",
    "gap_torque_nm": "t_j",
    "friction_nm": "f_c",
    "presliding_nm_per_arcmin": "sigma",
}


def noisy(
    unit: ReferenceUnit, peak: float = PEAK_NM, noise: float = 0.2, seed: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """One loop at 60 N·m/s and 1 kHz: wind-up [arcmin] by a 20 bit encoder at the input, output torque with noise."""
    phi, rising, falling = unit.branches(peak)
    up = np.arange(-peak, peak, 0.06)
    torque = np.concatenate([up, up[::-1]])
    angle = np.concatenate([np.interp(up, rising, phi), np.interp(up[::-1], falling, phi)])
    measured = quantised(angle * ARC * RATIO, 20) / ARC / RATIO
    return measured, torque + np.random.default_rng(seed).normal(0.0, noise, torque.size)


@cache
def reference_loop(peak: float = PEAK_NM, most_points: int = 4000) -> LoopSamples:
    return loop_samples(*noisy(ReferenceUnit(), peak), most_points=most_points)


@cache
def small_loop_model() -> Identified:
    return identify(reference_loop(100.0, 1500), "gap_dahl")


def test_gap_dahl_finds_the_reference_unit() -> None:
    found = identify(reference_loop(), "gap_dahl")
    unit = ReferenceUnit()
    assert found.residual_pct < 0.3
    assert found.values["friction_nm"] == pytest.approx(unit.f_c, rel=0.01)
    assert found.values["stiffness_nm_per_arcmin"] == pytest.approx(unit.k_inf, rel=0.01)
    assert found.values["presliding_nm_per_arcmin"] == pytest.approx(unit.sigma, rel=0.02)
    assert found.values["gap_arcmin"] == pytest.approx(unit.j, rel=0.02)
    assert not found.refused
    assert not found.at_bound
    # the residual is the noise of the torque: nothing of the loop is left
    assert found.residual_pct == pytest.approx(100 * 0.2 / PEAK_NM, rel=0.05)


@pytest.mark.parametrize("seed", range(4))
def test_uncertainties_cover_other_units(seed: int) -> None:
    scale = np.random.default_rng(seed).uniform(0.8, 1.2, 7)
    p1 = ReferenceUnit()
    unit = replace(p1, **{field: getattr(p1, field) * s for field, s in zip(NAMES.values(), scale, strict=True)})
    found = identify(loop_samples(*noisy(unit, seed=seed)), "gap_dahl")
    for name, field in NAMES.items():
        assert abs(found.values[name] - getattr(unit, field)) < 5.0 * found.u[name], name
    assert found.residual_pct < 0.06


def test_a_worn_unit() -> None:
    unit = replace(ReferenceUnit(), j=0.8, f_c=60.0)
    found = identify(loop_samples(*noisy(unit)), "gap_dahl")
    assert found.values["gap_arcmin"] == pytest.approx(0.8, rel=0.01)
    assert found.values["friction_nm"] == pytest.approx(60.0, rel=0.01)


def test_from_a_whole_bench_run() -> None:
    unit = ReferenceUnit()
    trace = bench_trace(unit, PEAK_NM, cycles=2)
    windup = (trace.angle_in_rad / RATIO - trace.angle_out_rad) / ARC
    found = identify(loop_samples(windup, trace.torque_out_nm, commanded_runs(trace)), "gap_dahl")
    assert found.values["friction_nm"] == pytest.approx(unit.f_c, rel=0.01)
    assert found.values["stiffness_nm_per_arcmin"] == pytest.approx(unit.k_inf, rel=0.01)
    assert found.residual_pct < 0.3


def crept(at_turns: tuple[float, float], noise: float = 0.2, together: int = 1) -> LoopSamples:
    """The reference loop whose friction crept while the torque was held: at a turn, a share of it is left.

    together: samples over which the noise hangs together.
    """
    loop = loop_samples(*noisy(ReferenceUnit(), noise=0.0), most_points=2000)
    unit = ReferenceUnit()
    values = {name: getattr(unit, field) for name, field in NAMES.items()} | {"angle_offset_arcmin": 0.0}
    torque = torque_on_branches(MODELS["gap_dahl"], values, at_turns, loop)
    white = np.random.default_rng(7).normal(0.0, noise, torque.size + together)
    return replace(loop, torque_nm=torque + np.convolve(white, np.full(together, together**-0.5), "valid")[1:])


def test_friction_that_crept_at_the_turns_is_found() -> None:
    found = identify(crept((0.7, 0.5)), "gap_dahl")
    unit = ReferenceUnit()
    assert found.friction_at_turns == pytest.approx((0.7, 0.5), abs=0.03)
    assert found.values["friction_nm"] == pytest.approx(unit.f_c, rel=0.002)
    assert found.values["presliding_nm_per_arcmin"] == pytest.approx(unit.sigma, rel=0.02)
    assert found.residual_pct == pytest.approx(100 * 0.2 / PEAK_NM, rel=0.05)


def test_residuals_that_hang_together_make_the_uncertainty_larger() -> None:
    alone = identify(crept((1.0, 1.0), noise=0.5), "gap_dahl")
    found = identify(crept((1.0, 1.0), noise=0.5, together=50), "gap_dahl")
    assert found.residual_pct == pytest.approx(alone.residual_pct, rel=0.3)
    assert found.u["stiffness_nm_per_arcmin"] > 2.0 * alone.u["stiffness_nm_per_arcmin"]
    unit = ReferenceUnit()
    for name, field in NAMES.items():
        assert abs(found.values[name] - getattr(unit, field)) < 3.0 * found.u[name], name


def test_steps_of_an_encoder_are_no_turns() -> None:
    unit = ReferenceUnit()
    angle, torque = noisy(unit)
    # the output creeps with the lock and its encoder sees it in steps of 23 bits: the wind-up is a saw
    output = torque / 1e4
    saw = angle + output - quantised(output * ARC, 23) / ARC
    assert (np.diff(saw[: saw.size // 2]) < 0.0).sum() > 20
    loop = loop_samples(saw, torque)
    for branch in loop.branches:
        assert (
            loop.direction[branch] * np.diff(loop.angle_arcmin[branch], prepend=loop.angle_arcmin[branch.start]) >= 0
        ).all()
    found = identify(loop, "gap_dahl")
    assert found.values["friction_nm"] == pytest.approx(unit.f_c, rel=0.01)
    assert found.values["stiffness_nm_per_arcmin"] == pytest.approx(unit.k_inf, rel=0.01)
    assert found.residual_pct < 0.3


def test_a_small_loop_does_not_tell_the_stiffness_at_high_torque() -> None:
    found = small_loop_model()
    named = {frozenset((refusal.parameter, refusal.other)) for refusal in found.refused}
    assert frozenset(("soft_zone_arcmin", "stiffness_nm_per_arcmin")) in named
    assert all(abs(refusal.correlation) > 0.95 for refusal in found.refused)
    assert "cannot be separated from" in found.refused[0].reason
    # known from elsewhere, the rest can be told
    unit = ReferenceUnit()
    known = {"stiffness_nm_per_arcmin": unit.k_inf, "soft_zone_nm": unit.t0}
    fixed = identify(reference_loop(100.0, 1500), "gap_dahl", fixed=known)
    assert not fixed.refused
    assert fixed.values["soft_zone_arcmin"] == pytest.approx(unit.b, rel=0.01)
    assert fixed.u["stiffness_nm_per_arcmin"] == 0.0


def test_a_parameter_without_influence_is_refused() -> None:
    # without a gap, the torque that closes it moves nothing
    known = {"gap_arcmin": 1e-6}
    unit = replace(ReferenceUnit(), j=0.0)
    found = identify(loop_samples(*noisy(unit)), "gap_dahl", fixed=known)
    gap = found.u["gap_torque_nm"]
    assert not gap < found.values["gap_torque_nm"] or "gap_torque_nm" in {
        refusal.parameter for refusal in found.refused
    }


def test_cubic_cannot_make_a_loop() -> None:
    found = identify(reference_loop(), "cubic")
    half_height = loop_shape(reference_loop()).half_height_nm
    assert found.residual_pct > 0.9 * 100 * half_height / PEAK_NM
    model = ReducerModel("cubic", found.values)
    there = np.linspace(-4.0, 4.0, 50)
    assert model.play(there)[0] == pytest.approx(model.play(there[::-1])[0][::-1])
    assert "cannot make a loop" in MODELS["cubic"].text


def test_bouc_wen_makes_the_loop_but_not_the_gap() -> None:
    found = identify(reference_loop(), "bouc_wen")
    assert found.values["friction_nm"] == pytest.approx(ReferenceUnit().f_c, rel=0.01)
    assert found.residual_pct < 2.0
    # the reference unit has Dahl's loop: the shape ends at its bound
    assert "shape" in found.at_bound


def test_bouc_wen_finds_its_own_loop() -> None:
    values = {
        "linear_nm_per_arcmin": 60.0, "cubic_nm_per_arcmin3": 1.0, "angle_offset_arcmin": 0.1, "friction_nm": 30.0,
        "yield_arcmin": 0.2, "exponent": 1.6, "shape": 0.7,
    }  # fmt: skip
    angle = 4.0 * np.sin(np.linspace(-np.pi / 2, 3 * np.pi / 2, 3000))
    model = ReducerModel("bouc_wen", values)
    _, state = model.play(angle)
    torque, _ = model.play(angle, state)
    noise = np.random.default_rng(2).normal(0.0, 0.1, torque.size)
    found = identify(loop_samples(angle, torque + noise), "bouc_wen")
    for name, value in values.items():
        assert found.values[name] == pytest.approx(value, abs=5 * found.u[name]), name
    assert found.residual_pct < 0.1


def test_maxwell_slip_reproduces_the_loop_with_springs_that_are_not_negative() -> None:
    found = identify_maxwell_slip(reference_loop())
    assert found.residual_pct < 0.3
    assert all(found.values[name] > 0.0 for name in found.free)
    assert np.abs(found.correlation - np.eye(len(found.free))).max() <= 0.95


def test_maxwell_slip_merges_what_cannot_be_told_apart() -> None:
    found = identify_maxwell_slip(reference_loop(), slips=80, springs=40)
    assert found.refused
    assert np.abs(found.correlation - np.eye(len(found.free))).max() <= 0.95


@pytest.mark.parametrize(
    ("angle", "torque", "said"),
    [
        (np.zeros(3), np.zeros(4), "3 angles and 4 torques"),
        (np.zeros(100), np.full(100, np.nan), "row 1: found angle 0 and torque nan"),
        (np.zeros(5), np.zeros(5), "found 5 samples"),
        (np.linspace(0, 1, 100), np.linspace(0, 1, 100), "never reverses"),
        (np.zeros(100), np.concatenate([np.linspace(-1, 1, 50), np.linspace(1, -1, 50)]), "does not change"),
    ],
)
def test_what_is_no_loop_is_said(angle: np.ndarray, torque: np.ndarray, said: str) -> None:
    with pytest.raises(AnalysisError, match=said):
        loop_samples(angle, torque)


@pytest.mark.parametrize(
    ("model", "fixed", "said"),
    [
        ("gap_dal", {}, "did you mean gap_dahl"),
        ("gap_dahl", {"friction": 3.0}, "unknown parameters: friction"),
        ("gap_dahl", {"friction_nm": -3.0}, "friction_nm: found -3.0; allowed: 1e-06"),
        ("cubic", dict.fromkeys(MODELS["cubic"].parameters, 1.0), "leave at least one free"),
    ],
)
def test_wrong_questions_are_said(model: str, fixed: dict[str, float], said: str) -> None:
    with pytest.raises(AnalysisError, match=said):
        identify(reference_loop(), model, fixed)


def test_a_grid_without_elements_is_refused() -> None:
    with pytest.raises(AnalysisError, match="one of each or more"):
        identify_maxwell_slip(reference_loop(), slips=0)
