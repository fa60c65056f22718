"""A good run, what makes each check fail in it, and how both are judged."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from reference_unit import ARC, RATIO, ReferenceUnit, bench_trace, exact_trace
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter

from analysis.evaluation.pipeline import Result, analyse
from analysis.loop.method import Method, MetricWanted
from analysis.torque_ratio.quadrants import QUADRANTS, Quadrants
from analysis.trace.trace import CHANNELS, Trace
from analysis.uncertainty.figures import SensorFigures, TorqueFigures
from analysis.validity.cycle_checks import COMPARED
from analysis.validity.evidence import RunFacts

P1 = ReferenceUnit()


METHOD = Method(
    ratio=RATIO, rated_torque_nm=412, fixture_stiffness_nm_per_arcmin=1e4, catalogue_stiffness_nm_per_arcmin=100.0,
    planned_nm_s=(60.0, 60.0),
)  # fmt: skip


WANTED = [MetricWanted("backlash_width_3pct", max=1.0)]


LAGS = {"torque_out_nm": 0.001, "torque_in_nm": 0.001, "angle_in_rad": 0.001, "angle_out_rad": 0.001}


FACTS = RunFacts(
    periods=100_000, missed=3, missed_allowed=0.001, oldest_sample_scans=2, sample_age_allowed_scans=10,
    zeroes_again=200, torque_in_zero_shift_nm=0.001, torque_out_zero_shift_nm=-0.5,
)  # fmt: skip


DRIVE_COUNT_NM = 0.004
"""A thousandth of the motor's rated torque: what 0x6077 of a drive counts in."""


DRIVE_COUNT_RAD, COUPLING_RAD_PER_NM = 2.0 * np.pi / 2**17, 3e-4
"""What 0x6064 of a drive counts in at the shaft, and by how much the coupling twists: a minute of arc per N·m."""


RUN = bench_trace(P1, 453.2, cycles=3)


GOOD = dataclasses.replace(
    RUN,
    temperature_c=np.linspace(22.0, 23.0, RUN.samples),
    drive_torque_nm=np.round(RUN.torque_in_nm / DRIVE_COUNT_NM) * DRIVE_COUNT_NM,
    drive_angle_rad=np.round((RUN.angle_in_rad + RUN.torque_in_nm * COUPLING_RAD_PER_NM) / DRIVE_COUNT_RAD)
    * DRIVE_COUNT_RAD,
)


KNOWN = dataclasses.replace(METHOD, lags_s=LAGS)


CONVERTED = dataclasses.replace(KNOWN, output_torque="calibrated")

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


def each_row(times: int) -> dict[str, Any]:
    """Every row of the record written so many times."""
    rows = np.repeat(np.arange(GOOD.samples), times)
    names = (*CHANNELS, "segment")
    return {"trace": dataclasses.replace(GOOD, **{name: getattr(GOOD, name)[rows] for name in names})}


def set_back() -> dict[str, Any]:
    """A ramp of the first cycle runs on by a twentieth of its way, is set back, and comes again."""
    key = next(index for index, info in GOOD.segments.items() if info.role == "measure")
    rows = np.flatnonzero(GOOD.segment == key)
    at, over = rows[round(0.7 * rows.size)], rows[round(0.75 * rows.size)]
    order = np.concatenate((np.arange(over), np.arange(over - 1, at, -1), np.arange(at, GOOD.samples)))
    names = (*(name for name in CHANNELS if name != "t_s"), "segment")
    step = float(np.median(np.diff(GOOD.t_s)))
    moved = {name: getattr(GOOD, name)[order] for name in names}
    return changed(**moved, t_s=np.arange(order.size) * step)


def drifting(arcmin_per_min: float) -> dict[str, Any]:
    """The unit drifts, and its input shaft with it: the drive's position too."""
    turned = arcmin_per_min / 60.0 * GOOD.t_s * ARC * RATIO
    return changed(angle_in_rad=GOOD.angle_in_rad + turned, drive_angle_rad=GOOD.drive_angle_rad + turned)


def creeping(arcmin_per_min: float) -> dict[str, Any]:
    """The wind-up creeps the way the torque points; below zero against it."""
    crept = np.cumsum(np.sign(GOOD.torque_out_nm) * np.gradient(GOOD.t_s)) * arcmin_per_min / 60.0
    return changed(angle_in_rad=GOOD.angle_in_rad + crept * ARC * RATIO)


def repeating(angle_rad: np.ndarray, peak_rad: float, per_turn: float) -> np.ndarray:
    """An encoder's angle with an error that comes so often in its turn."""
    return angle_rad - peak_rad * np.sin(per_turn * angle_rad)


def uneven_ramp() -> dict[str, Any]:
    """Every second stretch of the way is run ten times as slowly."""
    step = np.where((np.arange(GOOD.samples) // 700) % 2, 1e-3, 1e-2)
    return changed(t_s=np.cumsum(step))


def rising_cycles_off(arcmin: float) -> Trace:
    """The lock slips at each lower turn of the cycles and goes back at each upper one: the loop is narrower by that."""
    rising = [index for index, info in GOOD.segments.items() if info.role == "measure" and info.direction > 0]
    slip = np.isin(GOOD.segment, rising) * arcmin * ARC * RATIO
    return dataclasses.replace(GOOD, angle_in_rad=GOOD.angle_in_rad + slip)


def by_stored_lines(trace: Trace) -> Result:
    """Judge a trace with its torque converted by lines without a transition: masked after each reversal."""
    lines = analyse(GOOD, dataclasses.replace(KNOWN, output_torque="calibrated"), WANTED).quadrants
    stored = Quadrants(*(getattr(lines, name) for name in QUADRANTS))
    method = dataclasses.replace(KNOWN, output_torque="calibrated", quadrants=stored)
    return analyse(trace, method, WANTED, facts=FACTS, figures=FIGURES)


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
    return loaded_alone(dataclasses.replace(KNOWN, ratio=ratio, check_limits=limits))


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


def kept(trace: Trace, samples: np.ndarray) -> Trace:
    """Only some samples of a trace."""
    names = [name for name in (*CHANNELS, "segment") if getattr(trace, name) is not None]
    return dataclasses.replace(trace, **{name: getattr(trace, name)[samples] for name in names})


def calibrates(trace: Trace) -> np.ndarray:
    """Say of each sample whether its segment calibrates."""
    return np.isin(trace.segment, [index for index, info in trace.segments.items() if info.role == "calibrate"])


def calibrated_to(peak_nm: float) -> dict[str, Any]:
    """The good cycles after a calibration to another peak torque."""
    other = bench_trace(P1, peak_nm, cycles=1, seed=5)
    last = int(np.flatnonzero(calibrates(GOOD))[-1]) + 1
    before, after = kept(other, np.arange(np.flatnonzero(calibrates(other))[-1] + 1)), kept(GOOD, np.s_[last:])
    joined = {name: np.concatenate([getattr(before, name), getattr(after, name)])
              for name in (*COMPARED, "segment")}  # fmt: skip
    time = np.arange(joined["segment"].size) * float(GOOD.t_s[1])
    return {"trace": dataclasses.replace(GOOD, t_s=time, temperature_c=None, drive_torque_nm=None,
                                         drive_angle_rad=None, **joined),
            "method": CONVERTED}  # fmt: skip


def calibrated_without(torque_nm: float) -> dict[str, Any]:
    """The calibration has no samples about zero."""
    lost = calibrates(GOOD) & (np.abs(GOOD.torque_out_nm) < torque_nm)
    return {"trace": kept(GOOD, ~lost), "method": CONVERTED}


def angles_times(factor: float) -> dict[str, Any]:
    return changed(angle_in_rad=factor * GOOD.angle_in_rad, angle_out_rad=factor * GOOD.angle_out_rad)


def late(values: np.ndarray, lag_s: float) -> np.ndarray:
    """A channel that is late by a time."""
    return np.interp(GOOD.t_s - lag_s, GOOD.t_s, values)


def late_once(lag_s: float) -> np.ndarray:
    """The angle of the input, late by a time in the second cycle alone."""
    second = [index for index, info in GOOD.segments.items() if info.role == "measure" and info.cycle == 2]
    return np.where(np.isin(GOOD.segment, second), late(GOOD.angle_in_rad, lag_s), GOOD.angle_in_rad)


def late_within(lag_s: float) -> np.ndarray:
    """The angle of the input, late by a time within every ramp, and not at its ends."""
    late_s = np.zeros(GOOD.samples)
    for key, info in GOOD.segments.items():
        if info.direction:
            rows = np.flatnonzero(GOOD.segment == key)
            at = np.linspace(0.0, 1.0, rows.size)
            late_s[rows] = lag_s * np.clip(np.minimum(at - 0.1, 0.9 - at) / 0.1, 0.0, 1.0)
    return np.interp(GOOD.t_s - late_s, GOOD.t_s, GOOD.angle_in_rad)


def gain_after_calibration(gain: float) -> dict[str, Any]:
    """The gain of the output torque changes once the calibration is over."""
    return changed(torque_out_nm=GOOD.torque_out_nm * np.where(calibrates(GOOD), 1.0, gain))


def zero_moved_in_a_branch(moved_nm: float) -> dict[str, Any]:
    """The zero of the output torque moves for as long as the calibration loads the negative side."""
    falls = calibrates(GOOD) & (GOOD.torque_out_nm < -5.0) & (np.gradient(GOOD.torque_out_nm) < 0.0)
    return changed(torque_out_nm=GOOD.torque_out_nm + moved_nm * falls)


BAD: dict[str, Bad] = {
    "record": lambda: {"invalid": ("200 records were lost",)},
    "missed_periods": lambda: facts(missed=400),
    "sample_age": lambda: facts(oldest_sample_scans=11),
    "torque_in_saturated": lambda: facts(torque_in_saturated=1),
    "torque_out_saturated": lambda: facts(torque_out_saturated=7),
    "not_ready": lambda: facts(not_ready=2),
    "torque_zeroes": lambda: facts(torque_out_zero_shift_nm=-16.9),
    "clipping": lambda: changed(torque_out_nm=np.clip(GOOD.torque_out_nm, -430.0, 430.0)),
    "wrong_way": lambda: changed(angle_in_rad=-GOOD.angle_in_rad, angle_out_rad=-GOOD.angle_out_rad),
    "loop_closure": steps_in_angle,
    "drift": lambda: drifting(1.0),
    "repeat": one_cycle_off,
    "copied_cycles": copied_cycle,
    "repeated_samples": lambda: each_row(2),
    "lag": lambda: {"method": dataclasses.replace(KNOWN, lags_s=LAGS | {"torque_out_nm": 0.2})},
    "points_per_bin": sparse,
    "angle_steps": lambda: changed(angle_in_rad=np.round(GOOD.angle_in_rad, 1)),
    "late_torque": lambda: changed(torque_out_nm=late(GOOD.torque_out_nm, 0.025)),
    "noise_low": lambda: changed(torque_out_nm=uniform_filter1d(GOOD.torque_out_nm, 9)),
    "noise_high": lambda: changed(torque_in_nm=np.round(GOOD.torque_in_nm, 1)),
    "time_scale": lambda: changed(t_s=30.0 * GOOD.t_s),
    "ramp_rate": uneven_ramp,
    "interrupted": set_back,
    "width_growth": lambda: creeping(-2.0),
    "creep_back": lambda: creeping(-1.0),
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
    "stiffness_low": lambda: angles_times(60.0),
    "stiffness_high": lambda: angles_times(1.0 / 60.0),
    "loss": nearly_one_curve,
    "angle_waves": lambda: changed(angle_in_rad=repeating(GOOD.angle_in_rad, 20.0 * ARC, 60.0)),
    "calibrated_turn": lambda: calibrated_to(500.0),
    "calibrated_gap": lambda: calibrated_without(5.0),
    "calibrated_zero": lambda: changed(torque_out_nm=GOOD.torque_out_nm + 10.0) | {"method": CONVERTED},
    "calibration_agreement": lambda: gain_after_calibration(1.015),
    "calibration_torque": lambda: zero_moved_in_a_branch(4.0),
    "torque_out_zero": lambda: changed(torque_out_nm=GOOD.torque_out_nm + 10.0),
    "torque_lines": lambda: changed(torque_in_nm=GOOD.torque_in_nm + 0.1 * np.sin(3.0 * GOOD.torque_in_nm)),
    "torque_bend": lambda: changed(
        torque_out_nm=GOOD.torque_out_nm * (0.97 + 0.06 * np.abs(GOOD.torque_out_nm) / 453.2)
    ),
    "drive_torque_agreement": lambda: both_torques(gain=1.25),
    "drive_torque_gap": lambda: both_torques(lag_s=0.4),
    "drive_angle_agreement": lambda: changed(angle_in_rad=repeating(GOOD.angle_in_rad, 60.0 * ARC, 8.0)),
    "drive_angle_direction": lambda: changed(angle_in_rad=late_within(0.1)),
    "drive_angle_repeat": lambda: changed(angle_in_rad=late_once(0.05)),
    "locked_compliance": lambda: changed(angle_out_rad=-GOOD.angle_out_rad),
}
"""What makes each check fail."""


GOOD_RUN = judged()

GOOD_CONVERTED = judged(method=CONVERTED)

OF_CONVERTED = ("calibrated_turn", "calibrated_gap", "calibrated_zero")
"""Validity checks that look at how the torque was converted."""


def of(result: Result, check: str):
    (found,) = [one for one in result.checks if one.id == check]
    return found
