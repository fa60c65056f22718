"""A measured run of a simulated unit, with the errors that a bench of declared figures may have; for studies.

The errors are drawn here, from what their figures mean, and not from the table that the budget is made of: one checks
the other. Profile: calibrate (0, +, −, +), then cycles (−, +), as the inverse loading recipe runs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from analysis.trace.errors import AnalysisError
from analysis.trace.trace import SegmentInfo, Trace
from analysis.trace.units import FloatArray, IntArray
from analysis.uncertainty.figures import AngleFigures, SensorFigures, TorqueFigures
from benchmarks.simulated.simulated_unit import SimulatedUnit
from definitions.units import RAD_PER_ARCMIN

PERIOD_S = 1e-3
DWELL_S = 0.2
DRIFT_ARCMIN_PER_MIN = 0.05
"""Limit of a steady drift, which the analysis has to take out: uncorrected it is three times U of a backlash."""


@dataclass(frozen=True)
class SimulatedBench:
    """How a run goes: ratio, peak and rate of torque, cycles, stiffness of the lock, delay of every sensor."""

    ratio: float = 121.0
    peak_nm: float = 453.2
    rate_nm_s: float = 60.0
    cycles: int = 3
    fixture_nm_per_arcmin: float = 10_000.0
    lag_s: float = 1e-3


@dataclass(frozen=True)
class Course:
    """What truly happens: torque at the output [N·m], wind-up [arcmin] and torque at the input [N·m] in time."""

    torque_nm: FloatArray
    windup_arcmin: FloatArray
    torque_in_nm: FloatArray
    direction: IntArray
    segment: IntArray
    segments: dict[int, SegmentInfo]


def as_built(bench: SimulatedBench, figures: SensorFigures, random: np.random.Generator) -> SimulatedBench:
    """Return a bench whose fixture is as stiff as it may be by what is declared of it."""
    factor = 1.0 + random.uniform(-1.0, 1.0) * figures.fixture_fraction
    return replace(bench, fixture_nm_per_arcmin=bench.fixture_nm_per_arcmin * factor)


def course_of(unit: SimulatedUnit, bench: SimulatedBench) -> Course:
    """Run the profile on a unit."""
    peak, step = bench.peak_nm, bench.rate_nm_s * PERIOD_S
    windup, rising, falling = unit.loop(peak)
    virgin_windup, virgin = unit.virgin(peak)
    up, down, rest = np.arange(-peak, peak, step), np.arange(peak, -peak, -step), round(DWELL_S / PERIOD_S)
    first = np.arange(0.0, peak, step)
    pieces = [(SegmentInfo("calibrate", 1, 0), first, np.interp(first, virgin, virgin_windup))]
    plan = [("calibrate", -1, 0), ("calibrate", 1, 0)]
    plan += [("measure", direction, cycle) for cycle in range(1, bench.cycles + 1) for direction in (-1, 1)]
    for role, direction, cycle in plan:
        turn = windup[-1] if direction < 0 else windup[0]
        pieces.append((SegmentInfo("dwell"), np.full(rest, -direction * peak), np.full(rest, turn)))
        torque, branch = (down, falling) if direction < 0 else (up, rising)
        pieces.append((SegmentInfo(role, direction, cycle), torque, np.interp(torque, branch, windup)))
    torque = np.concatenate([piece[1] for piece in pieces])
    angle = np.concatenate([piece[2] for piece in pieces])
    sizes = [piece[1].size for piece in pieces]
    turned = (angle + torque / bench.fixture_nm_per_arcmin) * (bench.ratio * RAD_PER_ARCMIN)
    moving = [info.direction or plan[0][1] for info, _, _ in pieces]
    return Course(
        torque_nm=torque,
        windup_arcmin=angle,
        torque_in_nm=unit.input_torque(turned, torque, bench.ratio),
        direction=np.repeat(np.array(moving, dtype=np.int64), sizes),
        segment=np.repeat(np.arange(len(pieces)), sizes),
        segments={index: piece[0] for index, piece in enumerate(pieces)},
    )


def exact_trace(course: Course, bench: SimulatedBench) -> Trace:
    """Return the first cycle as it truly was: no noise, no errors, no delays, no steps."""
    measured = [key for key, info in course.segments.items() if info.role == "measure" and info.cycle == 1]
    first, last = (int(np.flatnonzero(course.segment == key)[end]) for key, end in zip(measured, (0, -1), strict=True))
    part = slice(first, last + 1)
    deflected = course.torque_nm[part] / bench.fixture_nm_per_arcmin
    return Trace(
        torque_out_nm=course.torque_nm[part],
        angle_in_rad=(course.windup_arcmin[part] + deflected) * (bench.ratio * RAD_PER_ARCMIN),
        angle_out_rad=deflected * RAD_PER_ARCMIN,
        segment=course.segment[part],
        segments=course.segments,
    )


class TorqueErrors(NamedTuple):
    """Errors that a torque sensor keeps from run to run: of its gain, and its hysteresis, of full scale."""

    gain: float
    reversibility: float

    @classmethod
    def drawn(cls, figures: TorqueFigures, random: np.random.Generator) -> TorqueErrors:
        """Draw what a sensor of these figures may have."""
        limits = (figures.gain_fraction, figures.reversibility_fraction)
        if figures.stated_by == "certificate":
            return cls(*(random.normal(0.0, limit / 2.0) for limit in limits))
        return cls(*(random.uniform(-limit, limit) for limit in limits))


Sensors = dict[str, TorqueErrors]
"""Errors of the torque sensors of one bench, by the name of their figures."""


def measured_trace(
    course: Course, bench: SimulatedBench, figures: SensorFigures, random: np.random.Generator,
    sensors: Sensors | None = None,
) -> Trace:  # fmt: skip
    """Return a run as a bench of these figures shows it: one draw of every error, noise in every sample.

    sensors: of a bench that measured before; else they are drawn.
    """
    if figures.torque_in is None or figures.torque_out is None or figures.angle_in is None or figures.angle_out is None:
        raise AnalysisError("simulated bench: all four sensors are needed")
    time = np.arange(course.torque_nm.size, dtype=np.float64) * PERIOD_S
    torque, torque_in = course.torque_nm, course.torque_in_nm
    teeth = 1.0 + random.uniform(-1.0, 1.0) * figures.lock_windup_fraction
    width = random.uniform(-1.0, 1.0) * figures.lock_width_arcmin
    drift = random.uniform(-1.0, 1.0) * DRIFT_ARCMIN_PER_MIN * time / 60.0
    creep = random.uniform(-1.0, 1.0) * figures.drift_arcmin_per_min * np.cumsum(np.sign(torque)) * (PERIOD_S / 60.0)
    windup = course.windup_arcmin * teeth + width * course.direction / 2.0 + drift + creep
    deflected = torque / bench.fixture_nm_per_arcmin
    turned_in = (windup + deflected) * (bench.ratio * RAD_PER_ARCMIN)
    turned_out = deflected * RAD_PER_ARCMIN
    torque_s = bench.lag_s + random.uniform(-1.0, 1.0) * figures.skew_s
    seen = [_delayed(values, time, delay) for values, delay in (
        (torque_in, torque_s), (torque, torque_s), (turned_in, bench.lag_s), (turned_out, bench.lag_s),
    )]  # fmt: skip
    lens = -course.direction * (1.0 - np.square(torque / bench.peak_nm))
    return Trace(
        t_s=time,
        torque_in_nm=_torque(seen[0], lens, figures.torque_in, random, (sensors or {}).get("torque_in")),
        torque_out_nm=_torque(seen[1], lens, figures.torque_out, random, (sensors or {}).get("torque_out")),
        angle_in_rad=_angle(seen[2], figures.angle_in, random),
        angle_out_rad=_angle(seen[3], figures.angle_out, random),
        segment=course.segment,
        segments=course.segments,
    )


def _delayed(values: FloatArray, time_s: FloatArray, delay_s: float) -> FloatArray:
    return np.interp(time_s - delay_s, time_s, values)


def _torque(
    torque: FloatArray, lens: FloatArray, figures: TorqueFigures, random: np.random.Generator, own: TorqueErrors | None
) -> FloatArray:
    scale = figures.full_scale_nm
    gain, reversibility = own or TorqueErrors.drawn(figures, random)
    zero = random.uniform(-figures.zero_fraction, figures.zero_fraction)
    noise = random.normal(0.0, figures.noise_fraction * scale, torque.size)
    found: FloatArray = torque * (1.0 + gain) + zero * scale + reversibility * scale * lens + noise
    return found


def _angle(angle: FloatArray, figures: AngleFigures, random: np.random.Generator) -> FloatArray:
    place = random.uniform(0.0, 2.0 * math.pi)  # where on its scale the encoder stands at the start
    shown = angle + place
    for limit, period in ((figures.accuracy_rad, 2.0 * math.pi), (figures.interpolation_rad, figures.line_rad)):
        phase = random.uniform(0.0, 2.0 * math.pi)
        shown = shown + limit * np.sin(2.0 * math.pi * (angle + place) / period + phase)
    if figures.noise_rad > 0.0:
        shown = shown + random.normal(0.0, figures.noise_rad, angle.size)
    found: FloatArray = np.round(shown / figures.step_rad) * figures.step_rad - place
    return found
