"""Validity gates: each one fails for what it is there for, and passes a good run; a failed one decides nothing."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from reference_unit import ARC, RATIO, ReferenceUnit, bench_trace, exact_trace, timed_trace
from scipy.signal import lfilter

from analysis import (
    GATES,
    AnalysisError,
    Evidence,
    FixtureCurve,
    Method,
    MetricWanted,
    Quadrants,
    Result,
    RunFacts,
    SensorFigures,
    TorqueFigures,
    TorqueLine,
    Trace,
    Verdict,
    analyse,
    gate_reasons,
    judge_gates,
)
from analysis.cycle_gates import COMPARED
from recipes.recipe_schema import Validity
from recipes.section import option_name

P1 = ReferenceUnit()
METHOD = Method(
    ratio=RATIO, rated_torque_nm=412, fixture_stiffness_nm_per_arcmin=1e4, catalogue_stiffness_nm_per_arcmin=100.0
)
WANTED = [MetricWanted("backlash_width_3pct", max=1.0)]
LAGS = {"torque_out_nm": 0.001, "torque_in_nm": 0.001, "angle_in_rad": 0.001, "angle_out_rad": 0.001}
FACTS = RunFacts(periods=100_000, missed=3, missed_allowed=0.001, oldest_sample_scans=2, sample_age_allowed_scans=10)
DRIVE_COUNT_NM = 0.004
"""A thousandth of the motor's rated torque: what 0x6077 of a drive counts in."""

RUN = bench_trace(P1, 453.2, cycles=3)
GOOD = dataclasses.replace(
    RUN,
    temperature_c=np.linspace(22.0, 23.0, RUN.samples),
    drive_torque_nm=np.round(RUN.torque_in_nm / DRIVE_COUNT_NM) * DRIVE_COUNT_NM,
)
KNOWN = dataclasses.replace(METHOD, lags_s=LAGS)

FIGURES = SensorFigures(torque_in=TorqueFigures(5.0), torque_out=TorqueFigures(1000.0))
"""Noise is declared: no two cycles are alike."""

Bad = Callable[[], dict[str, Any]]
"""What `judged` is given instead of the good run."""


def judged(
    trace: Trace = GOOD, method: Method = KNOWN, facts: RunFacts | None = FACTS, invalid: tuple[str, ...] = ()
) -> Result:
    return analyse(trace, method, WANTED, invalid=invalid, facts=facts, figures=FIGURES)


def facts(**changes: Any) -> dict[str, Any]:
    return {"facts": dataclasses.replace(FACTS, **changes)}


def changed(**channels: Any) -> dict[str, Any]:
    return {"trace": dataclasses.replace(GOOD, **channels)}


def steps_in_angle() -> dict[str, Any]:
    """The lock slips in the middle of the first cycle, and stays where it went to."""
    first = [index for index, info in GOOD.segments.items() if info.role == "measure" and info.cycle == 1]
    late = GOOD.segment > first[0]
    return changed(angle_in_rad=GOOD.angle_in_rad + late * 0.5 * ARC * RATIO)


def one_cycle_off() -> dict[str, Any]:
    """The second cycle finds another angle, and the third the old one."""
    second = [index for index, info in GOOD.segments.items() if info.role == "measure" and info.cycle == 2]
    return changed(angle_in_rad=GOOD.angle_in_rad + np.isin(GOOD.segment, second) * 0.5 * ARC * RATIO)


def copied_cycle(after: int = 1) -> dict[str, Any]:
    """The second cycle is the first one once more, from a sample on."""
    cycles = [[key for key, info in GOOD.segments.items() if info.role == "measure" and info.cycle == number]
              for number in (1, 2)]  # fmt: skip
    channels = {name: getattr(GOOD, name).copy() for name in COMPARED}
    for source, target in zip(*cycles, strict=True):
        here, there = (np.flatnonzero(GOOD.segment == key) for key in (source, target))
        size = min(here.size, there.size)
        for values in channels.values():
            values[there[after:size]] = values[here[after:size]]
    return changed(**channels)


def uneven_ramp() -> dict[str, Any]:
    """Every second stretch of the way is run ten times as slowly."""
    step = np.where((np.arange(GOOD.samples) // 700) % 2, 1e-3, 1e-2)
    return changed(t_s=np.cumsum(step))


def sparse() -> dict[str, Any]:
    exact = exact_trace(P1, 480.0, points=101)
    return {"trace": exact, "facts": None}


def back_and_forth() -> dict[str, Any]:
    """Within the first falling branch the torque rises by 60 N·m and falls again."""
    (first, *_) = [index for index, info in GOOD.segments.items() if info.role == "measure"]
    inside = np.flatnonzero(GOOD.segment == first)
    bump = 60.0 * np.exp(-np.square((np.arange(GOOD.samples) - inside.mean()) / 300.0))
    return changed(torque_out_nm=GOOD.torque_out_nm + bump)


def slipped() -> dict[str, Any]:
    """The lock slips in the middle of the cycles and both shafts stay there: the wind-up shows nothing."""
    last = [index for index, info in GOOD.segments.items() if info.role == "measure"][2:]
    slip = np.isin(GOOD.segment, last) * 0.5 * ARC
    return changed(angle_in_rad=GOOD.angle_in_rad + slip * RATIO, angle_out_rad=GOOD.angle_out_rad + slip)


def both_torques(gain: float = 1.0, lag_s: float = 0.0) -> dict[str, Any]:
    """Both torque channels have the same gain, or come late by the same filter: nothing between them shows it."""
    late = {name: gain * filtered(getattr(GOOD, name), lag_s) for name in ("torque_in_nm", "torque_out_nm")}
    return changed(**late)


def filtered(values: np.ndarray, lag_s: float) -> np.ndarray:
    """What a filter of the first order lets through, sample after sample."""
    share = GOOD.t_s[1] / (lag_s + GOOD.t_s[1])
    return lfilter([share], [1.0, share - 1.0], values)


def loaded_alone(method: Method) -> dict[str, Any]:
    return {"trace": dataclasses.replace(GOOD, angle_out_rad=None), "method": method}


def wrong_ratio(ratio: float, **limits: float) -> dict[str, Any]:
    """Evaluate the run of a unit of 121 by another ratio, its wind-up with it."""
    return loaded_alone(dataclasses.replace(KNOWN, ratio=ratio, gate_limits=limits))


def nearly_one_curve() -> dict[str, Any]:
    """The falling branches are made of a tenth of themselves and nine tenths of the rising ones."""
    angle, rising = GOOD.angle_in_rad.copy(), {}
    for index, info in GOOD.segments.items():
        if info.role == "measure" and info.direction > 0:
            rising[info.cycle] = GOOD.segment == index
    for index, info in GOOD.segments.items():
        if info.role == "measure" and info.direction < 0:
            here, there = GOOD.segment == index, rising[info.cycle]
            order = np.argsort(GOOD.torque_out_nm[there])
            other = np.interp(
                GOOD.torque_out_nm[here], GOOD.torque_out_nm[there][order], GOOD.angle_in_rad[there][order]
            )
            angle[here] = 0.1 * angle[here] + 0.9 * other
    return changed(angle_in_rad=angle)


BAD: dict[str, Bad] = {
    "record": lambda: {"invalid": ("200 records were lost",)},
    "missed_periods": lambda: facts(missed=400),
    "sample_age": lambda: facts(oldest_sample_scans=11),
    "torque_in_saturated": lambda: facts(torque_in_saturated=1),
    "torque_out_saturated": lambda: facts(torque_out_saturated=7),
    "not_ready": lambda: facts(not_ready=2),
    "clipping": lambda: changed(torque_out_nm=np.clip(GOOD.torque_out_nm, -430.0, 430.0)),
    "wrong_way": lambda: changed(angle_in_rad=-GOOD.angle_in_rad, angle_out_rad=-GOOD.angle_out_rad),
    "loop_closure": steps_in_angle,
    "drift": lambda: changed(angle_in_rad=GOOD.angle_in_rad + 1.0 / 60 * GOOD.t_s * ARC * RATIO),
    "repeat": one_cycle_off,
    "copied_cycles": copied_cycle,
    "lag": lambda: {"method": dataclasses.replace(KNOWN, lags_s=LAGS | {"torque_out_nm": 0.2})},
    "ramp_rate": uneven_ramp,
    "points_per_bin": sparse,
    "monotone_loading": back_and_forth,
    "torque_agreement": lambda: changed(torque_in_nm=-GOOD.torque_in_nm),
    "efficiency_low": lambda: wrong_ratio(141.0, efficiency_low=70.0),
    "efficiency_high": lambda: wrong_ratio(105.0, efficiency_high=86.0),
    "ratio_agreement": lambda: wrong_ratio(141.0),
    "temperature_change": lambda: changed(temperature_c=np.linspace(20.0, 26.0, GOOD.samples)),
    "temperature_low": lambda: changed(temperature_c=np.full(GOOD.samples, 4.0)),
    "temperature_high": lambda: changed(temperature_c=np.full(GOOD.samples, 55.0)),
    "locked_angle": lambda: {
        "trace": dataclasses.replace(GOOD, angle_out_rad=None),
        "method": dataclasses.replace(KNOWN, fixture_stiffness_nm_per_arcmin=None),
    },
    "locked_motion": slipped,
    "fixture_share": lambda: loaded_alone(dataclasses.replace(KNOWN, fixture_stiffness_nm_per_arcmin=300.0)),
    "stiffness_agreement": lambda: changed(
        angle_in_rad=GOOD.angle_in_rad / 60.0, angle_out_rad=GOOD.angle_out_rad / 60.0
    ),
    "loss": nearly_one_curve,
    "torque_lines": lambda: changed(torque_in_nm=GOOD.torque_in_nm + 0.1 * np.sin(3.0 * GOOD.torque_in_nm)),
    "drive_torque_agreement": lambda: both_torques(gain=1.25),
    "drive_torque_gap": lambda: both_torques(lag_s=0.4),
    "locked_compliance": lambda: changed(angle_out_rad=-GOOD.angle_out_rad),
}
"""What makes each gate fail."""

GOOD_RUN = judged()


def of(result: Result, gate: str):
    (found,) = [one for one in result.gates if one.id == gate]
    return found


def test_every_gate_has_something_that_makes_it_fail() -> None:
    assert set(BAD) == set(GATES)
    assert [gate.id for gate in GOOD_RUN.gates] == list(GATES)


@pytest.mark.parametrize("gate", GATES)
def test_a_good_run_passes(gate: str) -> None:
    found = of(GOOD_RUN, gate)
    assert found.passed is True, found
    assert found.figure is not None
    assert f"{found.limit:.3g}" in found.text
    assert (GOOD_RUN.verdict, GOOD_RUN.reasons) == (Verdict.PASS, ())


@pytest.mark.parametrize("gate", GATES)
def test_a_failed_gate_decides_nothing_and_says_why(gate: str) -> None:
    result = judged(**BAD[gate]())
    found = of(result, gate)
    assert found.passed is False, found
    assert result.verdict is Verdict.NOT_DECIDABLE
    assert result.metrics[0].verdict is Verdict.NOT_DECIDABLE
    if gate == "record":
        assert result.reasons[0] == "measurement invalid: 200 records were lost"
        return
    (reason,) = [text for text in result.reasons if text.startswith(f"measurement invalid: {gate}: ")]
    assert found.text in reason
    assert GATES[gate].action in reason
    assert f"{found.figure:.3g}" in reason
    assert f"{found.limit:.3g}" in reason


@pytest.mark.parametrize("gate", GATES)
def test_what_could_not_be_evaluated_is_not_applicable(gate: str) -> None:
    (found,) = [one for one in judge_gates(Evidence(None)) if one.id == gate]
    if gate == "record":
        assert found.passed is True
    else:
        assert (found.passed, found.figure) == (None, None)
        assert "not applicable" in found.text


def test_facts_of_a_run_that_could_not_be_evaluated_still_speak() -> None:
    gates = judge_gates(Evidence(None, dataclasses.replace(FACTS, missed=400, not_ready=3), ("lost",)))
    reasons = gate_reasons(gates, ("lost",))
    assert reasons[0] == "measurement invalid: lost"
    assert any("400 of 100000 scan periods were missed (0.400%)" in reason for reason in reasons)
    assert any("not ready: 3 samples" in reason for reason in reasons)
    assert len(reasons) == 3


def test_gates_that_do_not_apply_say_why_and_decide_nothing() -> None:
    result = analyse(exact_trace(P1, 480.0), METHOD, WANTED)
    assert result.verdict is Verdict.PASS
    why = {one.id: one.text for one in result.gates if one.passed is None}
    assert set(why) == {
        "missed_periods", "sample_age", "torque_in_saturated", "torque_out_saturated", "not_ready", "drift", "repeat",
        "copied_cycles", "lag", "ramp_rate", "torque_agreement", "efficiency_low", "efficiency_high", "ratio_agreement",
        "temperature_change", "temperature_low", "temperature_high", "locked_motion", "torque_lines",
        "drive_torque_agreement", "drive_torque_gap", "locked_compliance",
    }  # fmt: skip
    assert "one cycle" in why["drift"]
    assert "no time" in why["ramp_rate"]
    assert "one torque channel" in why["torque_agreement"]
    assert "not measured: one torque channel alone" in why["ratio_agreement"]


def without(role: str) -> Trace:
    """The good run without the segments of a role."""
    kept = np.isin(GOOD.segment, [index for index, info in GOOD.segments.items() if info.role != role])
    names = ("t_s", "torque_in_nm", "torque_out_nm", "angle_in_rad", "angle_out_rad", "temperature_c", "segment",
             "drive_torque_nm")  # fmt: skip
    return dataclasses.replace(GOOD, **{name: getattr(GOOD, name)[kept] for name in names})


def test_a_wrong_ratio_is_seen_by_the_torques() -> None:
    """A recipe with 141 instead of 121 makes the backlash read 14 % small, and nothing else shows it."""
    wrong = judged(method=dataclasses.replace(KNOWN, ratio=141.0))
    assert wrong.metrics[0].headline.value < 0.85
    assert wrong.verdict is Verdict.NOT_DECIDABLE
    (reason,) = [one for one in wrong.reasons if "measurement invalid" in one]
    assert "the lines of the calibration show a ratio of 121" in reason
    assert "where the recipe has 141" in reason


@pytest.mark.parametrize(("role", "where"), [("calibrate", "measured cycles"), ("unload", "calibration")])
def test_the_ratio_is_seen_with_and_without_a_calibration(role: str, where: str) -> None:
    right, wrong = (judged(without(role), dataclasses.replace(KNOWN, ratio=ratio)) for ratio in (RATIO, 141.0))
    assert of(right, "ratio_agreement").figure < 1.0
    assert of(right, "efficiency_low").figure == pytest.approx(100.0 * 94.689 / RATIO, abs=0.5)
    assert right.verdict is Verdict.PASS
    assert f"the lines of the {where} show a ratio of 121" in of(wrong, "ratio_agreement").text


def test_stored_lines_of_another_ratio_are_seen() -> None:
    """With one torque sensor the lines that convert its torque are all that knows the ratio."""
    lines = [TorqueLine(sign * c, m) for sign in (1, -1) for c, m in ((-13.9, 94.7), (24.8, 168.0))]
    stored = dataclasses.replace(KNOWN, output_torque="calibrated", quadrants=Quadrants(*lines), ratio=141.0)
    found = of(judged(dataclasses.replace(without("calibrate"), torque_out_nm=None), stored), "ratio_agreement")
    assert found.passed is False
    assert "the lines that convert the torque show a ratio of 121" in found.text


def test_a_tight_or_worn_unit_has_the_same_ratio() -> None:
    """A bad unit fails by its metrics: friction moves neither its ratio nor, for the shipped window, its efficiency."""
    limits = {"efficiency_low": 70.0, "efficiency_high": 86.0}
    for friction, slope in ((2.0, 1.0), (1.0, 0.8), (1.0, 1.2)):
        unit = dataclasses.replace(
            P1, input_friction_nm=friction * P1.input_friction_nm, input_friction_slope=slope * P1.input_friction_slope
        )
        result = judged(bench_trace(unit, 453.2), dataclasses.replace(KNOWN, gate_limits=limits))
        assert [one.id for one in result.gates if one.passed is False] == []


def test_at_a_locked_input_the_efficiency_is_not_measured() -> None:
    swapped = dataclasses.replace(GOOD, angle_in_rad=-GOOD.angle_in_rad, angle_out_rad=-GOOD.angle_out_rad)
    result = judged(swapped, dataclasses.replace(KNOWN, loading="output"))
    assert of(result, "efficiency_low").passed is None
    assert of(result, "ratio_agreement").figure < 1.0


def test_different_lags_without_time_are_not_passed() -> None:
    lags = {"torque_out_nm": 0.05, "angle_out_rad": 0.0}
    result = analyse(exact_trace(P1, 480.0), dataclasses.replace(METHOD, lags_s=lags), WANTED)
    found = of(result, "lag")
    assert (found.passed, found.figure) == (False, None)
    assert "no time" in found.text


def lagging(trace: Trace, lag_s: float) -> Trace:
    """A trace whose torque comes later than its angle."""
    return dataclasses.replace(trace, torque_out_nm=np.interp(trace.t_s - lag_s, trace.t_s, trace.torque_out_nm))


def test_a_lag_that_nobody_declared_is_measured_by_two_speeds() -> None:
    wanted = {"trace": timed_trace(P1, 480.0, cycles=2, speed_arcmin_s=(0.2, 2.0)), "method": METHOD, "facts": None}
    even, late = judged(**wanted), judged(**wanted | {"trace": lagging(wanted["trace"], 0.05)})
    assert of(even, "lag").figure < 0.01
    assert of(late, "lag").passed is False
    assert "as by -50" in of(late, "lag").text
    assert late.verdict is Verdict.NOT_DECIDABLE


def test_a_lag_that_cannot_be_measured_is_said_with_what_it_would_make() -> None:
    text = of(judged(lagging(timed_trace(P1, 480.0), 0.05), METHOD, None), "lag").text
    assert "not measured: the lags of the channels are not known, and one speed does not show them" in text
    assert "at 0.385 arcmin/s each 10 ms between torque and angle move the width of the loop by 0.0077 arcmin" in text
    assert "the trace has no time" in of(analyse(exact_trace(P1, 480.0), METHOD, WANTED), "lag").text


def test_the_locked_angle_may_be_replaced_by_the_fixture() -> None:
    alone = dataclasses.replace(GOOD, angle_out_rad=None)
    curve = FixtureCurve((-500.0, 500.0), (-0.05, 0.05))
    bare = dataclasses.replace(KNOWN, fixture_stiffness_nm_per_arcmin=None)
    assert of(judged(trace=alone), "locked_angle").passed
    assert of(judged(trace=alone, method=dataclasses.replace(bare, fixture_curve=curve)), "locked_angle").passed
    both = dataclasses.replace(curve, angles="both")
    assert not of(judged(trace=alone, method=dataclasses.replace(bare, fixture_curve=both)), "locked_angle").passed
    assert of(judged(method=bare), "locked_angle").passed


def test_limits_can_be_set_where_they_can() -> None:
    strict = dataclasses.replace(KNOWN, gate_limits={"repeat": 1e-6, "points_per_bin": 1e6})
    result = judged(method=strict)
    assert [gate.id for gate in result.gates if gate.passed is False] == ["repeat", "points_per_bin"]
    lax = dataclasses.replace(KNOWN, gate_limits={"drift": 20.0})
    assert judged(**BAD["drift"]() | {"method": lax}).verdict is Verdict.PASS
    for name in ("wrong_way", "no_such_gate", "missed_periods"):
        with pytest.raises(AnalysisError, match=name):
            judged(method=dataclasses.replace(KNOWN, gate_limits={name: 1.0}))


def test_a_loop_whose_reversals_are_missing_is_not_said_to_have_moved() -> None:
    """Branches of a report whose torque was masked after each reversal: what is missing is named, not the unit."""
    exact = exact_trace(P1, 480.0, cycles=2)
    starts = np.flatnonzero(np.diff(exact.segment, prepend=-1))
    kept = np.arange(exact.samples) - np.repeat(starts, 20_001) >= 3_000
    cut = {name: getattr(exact, name)[kept] for name in ("torque_out_nm", "angle_out_rad", "segment")}
    found = of(judged(dataclasses.replace(exact, **cut), METHOD, None), "loop_closure")
    assert found.passed is False
    assert "N·m are missing in the trace after a reversal" in found.text
    assert "has moved" not in found.text
    assert "has moved" in of(judged(**steps_in_angle()), "loop_closure").text


def test_a_gearbox_before_the_sensor_does_not_look_like_a_gain() -> None:
    """What it takes while loading it gives back while unloading; its friction has no place in the gap."""
    losses = np.sign(np.gradient(GOOD.torque_out_nm)) * (1.0 + 0.1 * np.abs(GOOD.torque_out_nm))
    by_output = {"angle_in_rad": -GOOD.angle_in_rad, "angle_out_rad": -GOOD.angle_out_rad}
    geared = dataclasses.replace(GOOD, drive_torque_nm=GOOD.torque_out_nm + losses, **by_output)
    result = judged(geared, dataclasses.replace(KNOWN, loading="output"))
    assert of(result, "drive_torque_agreement").figure < 1.0
    assert of(result, "drive_torque_gap").passed is None
    assert "gearbox" in of(result, "drive_torque_gap").text


def test_a_drive_that_reports_no_torque_agrees_with_nothing() -> None:
    result = judged(dataclasses.replace(GOOD, drive_torque_nm=np.zeros(GOOD.samples)))
    assert of(result, "drive_torque_agreement").figure == pytest.approx(100.0)
    assert result.verdict is Verdict.NOT_DECIDABLE


def test_without_the_drive_its_gates_are_not_measured() -> None:
    result = judged(dataclasses.replace(GOOD, drive_torque_nm=None))
    for gate in ("drive_torque_agreement", "drive_torque_gap"):
        assert of(result, gate).passed is None
        assert "not measured: the torque that the drive reports is not in the trace" in of(result, gate).text


def test_an_encoder_of_the_locked_shaft_that_stands_is_told() -> None:
    result = judged(dataclasses.replace(GOOD, angle_out_rad=np.zeros(GOOD.samples)))
    assert of(result, "locked_compliance").figure == pytest.approx(0.0)
    assert result.verdict is Verdict.NOT_DECIDABLE


def test_where_the_fixture_hardly_gives_way_its_encoder_is_not_judged() -> None:
    """A fixture too stiff to matter, and an encoder too coarse for it: neither says anything of the encoder."""
    stiff = dataclasses.replace(KNOWN, fixture_stiffness_nm_per_arcmin=1e6)
    assert "too little to matter" in of(judged(method=stiff), "locked_compliance").text
    noise = np.random.default_rng(3).normal(0.0, 20 * ARC, GOOD.samples)
    noisy = judged(dataclasses.replace(GOOD, angle_out_rad=GOOD.angle_out_rad + noise))
    assert "too coarse" in of(noisy, "locked_compliance").text


@pytest.mark.parametrize("torque_nm", [50.0, 350.0])
def test_an_angle_that_stands_while_its_shaft_is_loaded_is_told(torque_nm: float) -> None:
    """A saturated encoder: the unit reads stiffer than it is, up to no compliance at all."""
    most = float(np.abs(GOOD.angle_in_rad[np.abs(GOOD.torque_out_nm) < torque_nm]).max())
    stands = np.clip(GOOD.angle_in_rad, -most, most)
    result = judged(trace=dataclasses.replace(GOOD, angle_in_rad=stands))
    assert result.verdict is Verdict.NOT_DECIDABLE
    assert "the angle of the loaded shaft stands" in of(result, "clipping").text


def test_a_saturated_angle_with_noise_is_told() -> None:
    """One unsteady count at the end of the range must not hide it."""
    flicker = np.random.default_rng(3).integers(0, 2, GOOD.samples) * 1e-6
    most = 0.8 * float(np.abs(GOOD.angle_in_rad).max())
    stands = np.clip(GOOD.angle_in_rad, -most, most) + flicker
    result = judged(trace=dataclasses.replace(GOOD, angle_in_rad=stands))
    assert "the angle of the loaded shaft stands" in of(result, "clipping").text
    assert result.verdict is Verdict.NOT_DECIDABLE


def test_a_fixture_that_takes_the_whole_windup_is_told() -> None:
    """As soft as unit and fixture together: nothing is left for the unit, which then reads stiffer than anything."""
    soft = FixtureCurve((-500.0, 500.0), (-5.4, 5.4), "both")
    result = judged(method=dataclasses.replace(KNOWN, fixture_curve=soft))
    assert of(result, "clipping").passed is False


def test_an_angle_without_any_change_is_no_measurement() -> None:
    result = judged(trace=dataclasses.replace(GOOD, angle_in_rad=np.zeros(GOOD.samples)))
    assert of(result, "clipping").figure > 40.0


@pytest.mark.parametrize("counts", [1.0, 8.0])
def test_a_coarse_encoder_is_not_a_saturated_one(counts: float) -> None:
    """A count of an eighth arcmin at the output is poor, which the uncertainty says; nothing stands still."""
    count = counts * ARC * RATIO / 64.0
    coarse = np.round(GOOD.angle_in_rad / count) * count
    assert of(judged(trace=dataclasses.replace(GOOD, angle_in_rad=coarse)), "clipping").passed


def test_a_limit_wider_than_usual_is_told_in_the_gate() -> None:
    loose = dataclasses.replace(KNOWN, gate_limits={"drift": 100.0, "points_per_bin": 1.0, "repeat": 1.0})
    texts = {gate.id: gate.text for gate in judged(method=loose).gates}
    assert "at most by the recipe, where 1 % is usual" in texts["drift"]
    assert "at least by the recipe, where 3 samples is usual" in texts["points_per_bin"]
    assert not any("usual" in text for name, text in texts.items() if name not in ("drift", "points_per_bin"))


def test_the_recipe_has_an_option_for_every_limit_with_the_same_default() -> None:
    written = {
        option_name(name): value * 100.0 if name.endswith("_fraction") else value
        for name, value in Validity().model_dump().items()
    }
    assert written == pytest.approx({name: gate.limit for name, gate in GATES.items() if gate.configurable})


def test_gates_are_plain_data() -> None:
    plain = json.loads(json.dumps(GOOD_RUN.to_dict()["gates"], allow_nan=False))
    assert [set(one) for one in plain] == [{"id", "figure", "limit", "unit", "passed", "text"}] * len(GATES)


def test_a_bad_unit_still_fails() -> None:
    worn = dataclasses.replace(P1, f_c=2 * P1.f_c, j=0.6)
    result = analyse(bench_trace(worn, 453.2, cycles=3), KNOWN, WANTED, facts=FACTS)
    assert result.verdict is Verdict.FAIL


def test_a_drift_that_is_corrected_but_large_is_not_judged() -> None:
    trace = timed_trace(P1, 480.0, cycles=3)
    drifting = dataclasses.replace(trace, angle_out_rad=trace.angle_out_rad + 0.5 / 60 * trace.t_s * ARC)
    result = analyse(drifting, METHOD, WANTED)
    assert result.metrics[0].headline.value == pytest.approx(0.94, abs=5e-5)
    assert result.verdict is Verdict.NOT_DECIDABLE


@pytest.mark.parametrize(("slip_arcmin", "verdict"), [(0.0, "FAIL"), (0.1, "NOT DECIDABLE"), (-0.1, "FAIL")])
def test_a_slip_at_the_turn_that_the_gate_lets_pass_makes_no_pass(slip_arcmin: float, verdict: str) -> None:
    # 0.1 arcmin are one per cent of the wind-up, and a tenth of the backlash that is judged.
    one = bench_trace(P1, 453.2, cycles=1)
    later = max(index for index, info in one.segments.items() if info.role == "measure")
    direction = one.segments[later].direction
    slipped = dataclasses.replace(
        one, angle_in_rad=one.angle_in_rad + (one.segment == later) * direction * slip_arcmin * ARC * RATIO
    )
    honest = analyse(one, KNOWN, WANTED).metrics[0].headline.value
    assert honest is not None
    wanted = [MetricWanted("backlash_width_3pct", max=honest - 0.05)]
    found = analyse(slipped, KNOWN, wanted)
    (closure,) = [gate for gate in found.gates if gate.id == "loop_closure"]
    assert closure.passed
    assert found.verdict.value == verdict
    assert any("with a slip at the turn undone" in reason for reason in found.reasons) == (verdict == "NOT DECIDABLE")


@pytest.mark.parametrize("scale", [0.4, 0.6, 1.0, 1.7, 2.3])
def test_a_wrong_scale_of_the_angle_is_seen_from_a_factor_of_two(scale: float) -> None:
    passed = 0.5 < scale < 2.0
    found = of(judged(**changed(angle_in_rad=scale * GOOD.angle_in_rad)), "stiffness_agreement")
    assert found.passed is passed
    assert ("and the recipe declares 100 for this unit" in found.text) is not passed


def test_without_a_declared_stiffness_its_gate_says_so() -> None:
    found = of(judged(method=dataclasses.replace(KNOWN, catalogue_stiffness_nm_per_arcmin=None)), "stiffness_agreement")
    assert (found.passed, found.figure) == (None, None)
    assert "no stiffness is declared" in found.text


def test_a_copied_cycle_is_told_by_its_number_and_only_where_noise_is_declared() -> None:
    found = of(judged(**copied_cycle()), "copied_cycles")
    assert (found.figure, found.limit) == (pytest.approx(100.0, abs=1.0), 50.0)
    assert "cycles 1 and 2 are copies" in found.text
    assert of(judged(**copied_cycle(after=5_000)), "copied_cycles").figure > 50.0
    assert of(GOOD_RUN, "copied_cycles").figure < 1.0
    unknown = analyse(copied_cycle()["trace"], KNOWN, WANTED, facts=FACTS)
    assert "no noise of the sensors is declared" in of(unknown, "copied_cycles").text


def test_a_windup_that_does_not_change_is_told_in_plain_words() -> None:
    still = changed(angle_in_rad=np.zeros(GOOD.samples), angle_out_rad=np.zeros(GOOD.samples))
    failed = {gate.id: gate.text for gate in judged(**still).gates if gate.passed is False}
    for gate in ("wrong_way", "loop_closure", "loss"):
        assert "no measurable span" in failed[gate]
    assert not any("e+" in text for text in failed.values())
