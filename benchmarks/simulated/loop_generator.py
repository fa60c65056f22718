"""Measured loops of a `Kind`: how a run goes, what truly happens in it, and what a bench with defects records of it.

Friction at the input is an operator of its own, many stops over the angle turned, times a level that grows with the
load: it has its own transition after a reversal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from analysis.loop.method import Method
from analysis.trace.trace import CHANNELS, SegmentInfo, Trace
from analysis.uncertainty.figures import AngleFigures, SensorFigures, TorqueFigures
from benchmarks.simulated.kinds import PLAYS, Kind, mean

ARCMIN_RAD = math.pi / 10_800.0
EXACT_EVERY = 4
"""Samples between which the wind-up is straight; it is off by 2e-4 arcmin at most, where a play begins to move."""

STOPS = 16
PERIOD_S = 1e-3


@dataclass(frozen=True)
class Hold:
    """A ramp that is held: in a measured branch (from 0), at a share of its way; for how long, and how far it goes.

    overshoot_nm: by which it runs on first, and is then set back. creep_arcmin: of the wind-up while it rests, which
    the unit keeps.
    """

    branch: int
    share: float
    rest_s: float = 0.06
    overshoot_nm: float = 0.0
    creep_arcmin: float = 0.0


@dataclass(frozen=True)
class Bench:
    """How a run goes: rate as share of the rated torque per second, dwell at each turn, and what is recorded."""

    peak: float = 1.1
    rate_per_s: float = 0.146
    cycles: int = 3
    dwell_s: float = 0.5
    calibrate: bool = True
    fixture_stiffer: float = 90.0
    lag_s: float = 1e-3
    period_s: float = PERIOD_S
    holds: tuple[Hold, ...] = ()
    noise: float = 1.0
    """Noise of the torques, of what is declared."""


@dataclass(frozen=True)
class Course:
    """What truly happens, sample by sample: torques [N·m], wind-up [arcmin], angle of the lock [arcmin], segments."""

    t_s: np.ndarray
    torque_nm: np.ndarray
    torque_in_nm: np.ndarray
    windup_arcmin: np.ndarray
    locked_arcmin: np.ndarray
    segment: np.ndarray
    segments: dict[int, SegmentInfo] = field(default_factory=dict)


def _windup(unit: Kind, torque_nm: np.ndarray, plays: np.ndarray, direction: int) -> np.ndarray:
    """Wind-up [arcmin] along one direction: exact at every fourth sample, straight between; plays: before the first."""
    last = torque_nm.size - 1
    there = np.append(np.arange(0, last, EXACT_EVERY), last)
    exact = unit.mean_angle(unit.moved(plays, torque_nm[there], direction))
    return np.interp(np.arange(torque_nm.size), there, exact)


def course_of(unit: Kind, bench: Bench) -> Course:
    """Run the profile: calibrate (0, +, −, +), cycles (−, +), unload; a dwell at each turn."""
    peak = bench.peak * unit.rated_nm
    fixture = bench.fixture_stiffer * unit.spring_nm_per_arcmin
    plan = [("calibrate" if bench.calibrate else "virgin", 1, 0, 0.0, peak)]
    if bench.calibrate:
        plan += [("calibrate", -1, 0, peak, -peak), ("calibrate", 1, 0, -peak, peak)]
    for cycle in range(1, bench.cycles + 1):
        plan += [("measure", -1, cycle, peak, -peak), ("measure", 1, cycle, -peak, peak)]
    plan += [("unload", -1, 0, peak, 0.0)]
    step = bench.rate_per_s * unit.rated_nm * bench.period_s
    plays, stops = np.zeros(PLAYS), np.zeros(STOPS)
    yields = np.linspace(*unit.yields, STOPS)
    parts: dict[str, list[np.ndarray]] = {name: [] for name in ("torque", "torque_in", "windup", "segment")}
    table: dict[int, SegmentInfo] = {}
    at = 0.0
    rest = round(bench.dwell_s / bench.period_s)
    crept, branch = 0.0, 0
    for number, (role, direction, cycle, start, stop) in enumerate(plan):
        torque = np.arange(start, stop, direction * step)
        # where the plays are all along the way only a hold asks; a column for each of them is most of the work
        along = unit.moved(plays, torque if bench.holds else torque[-1:], direction)
        windup = _windup(unit, torque, plays, direction) + crept
        for hold in bench.holds if role == "measure" else ():
            if hold.branch == branch:
                torque, along, windup = held(unit, (torque, along, windup), hold, bench.period_s)
                crept += direction * hold.creep_arcmin
        branch += role == "measure"
        turned = np.abs(windup + torque / fixture - at)
        slid = stops + direction * turned[:, None] / yields
        slid = np.minimum(slid, 1.0) if direction > 0 else np.maximum(slid, -1.0)
        level = (unit.input_friction * unit.rated_nm + unit.input_friction_grows * np.abs(torque)) / unit.ratio
        torque_in = torque / unit.ratio + slid.mean(axis=1) * level
        plays, stops, at = along[-1], slid[-1], float(windup[-1] + torque[-1] / fixture)
        dwells = rest if number < len(plan) - 1 else 0
        for name, values in (("torque", torque), ("torque_in", torque_in), ("windup", windup)):
            parts[name] += [values, np.full(dwells, values[-1])]
        for info, count in ((SegmentInfo(role, direction, cycle), torque.size), (SegmentInfo("dwell"), dwells)):
            if count:
                parts["segment"].append(np.full(count, len(table)))
                table[len(table)] = info
    torque, torque_in, windup, segment = (np.concatenate(parts[name]) for name in parts)
    time = np.arange(torque.size) * bench.period_s
    return Course(time, torque, torque_in, windup, torque / fixture, segment, table)


Ramp = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Torque [N·m], plays, and wind-up [arcmin] of one ramp."""


def held(unit: Kind, ramp: Ramp, hold: Hold, period_s: float) -> Ramp:
    """Return torque, plays and wind-up of a ramp with a hold in it: on, back, rest with creep, and on again."""
    torque, along, windup = ramp
    step, direction = abs(float(torque[1] - torque[0])), 1 if torque[1] > torque[0] else -1
    at = round(hold.share * torque.size)
    over = at + max(1, round(hold.overshoot_nm / step))
    back = torque[at:over][::-1]
    after = unit.moved(along[over - 1], back, -direction)
    returned = unit.mean_angle(after) + windup[0] - np.asarray(unit.elastic(along[:1])).mean()
    rest = max(1, round(hold.rest_s / period_s))
    creep = direction * hold.creep_arcmin
    again = unit.moved(after[-1], torque[at:], direction)
    onward = unit.mean_angle(again) + windup[0] - np.asarray(unit.elastic(along[:1])).mean()
    return (
        np.concatenate((torque[:over], back, np.full(rest, back[-1]), torque[at:])),
        np.concatenate((along[:over], after, np.repeat(after[-1:], rest, axis=0), again)),
        np.concatenate((
            windup[:over], returned, returned[-1] + creep * np.linspace(0.0, 1.0, rest), onward + creep,
        )),
    )  # fmt: skip


@dataclass(frozen=True)
class Defect:
    """What is wrong with the measurement and nobody has declared. Gains are factors, bends shares of the peak torque.

    lag_s: first-order filter of both torques; out_gain_positive: of the positive side alone; bend: torque · (1 + bend
    · torque/peak) about both zero and peak of each side. ripple_arcmin, ripple_per_turn, ripple_phase_rad: error of the
    input encoder that repeats so often in its turn. creep_arcmin_per_min: wind-up that creeps the way the torque
    points, and below zero against it. hysteresis_nm: of the output sensor at mid-range; falling torque reads high.
    """

    lag_s: float = 0.0
    lag_out_s: float = 0.0
    delay_s: float = 0.0
    in_gain: float = 1.0
    out_gain: float = 1.0
    out_gain_positive: float = 1.0
    bend: float = 0.0
    ripple_arcmin: float = 0.0
    ripple_per_turn: float = 8.0
    ripple_phase_rad: float = 0.0
    creep_arcmin_per_min: float = 0.0
    hysteresis_nm: float = 0.0


SOUND = Defect()


def figures_of(unit: Kind) -> SensorFigures:
    """Return what the bench of a unit declares: sensors of fitting size with certificates."""
    torque = unit.rated_nm * 2.4
    return SensorFigures(
        torque_in=TorqueFigures(1.5 * torque / unit.ratio, stated_by="certificate"),
        torque_out=TorqueFigures(torque, stated_by="certificate"),
        angle_in=AngleFigures(2.0 * math.pi / 2**20),
        angle_out=AngleFigures(2.0 * math.pi / 2**23, accuracy_rad=1e-5, interpolation_rad=5e-7),
        skew_s=2e-4,
    )


def method_of(unit: Kind, bench: Bench, **changes: object) -> Method:
    """Return how a recipe for the type would have it evaluated."""
    lags = dict.fromkeys(("torque_in_nm", "torque_out_nm", "angle_in_rad", "angle_out_rad"), bench.lag_s)
    peak = bench.peak * unit.rated_nm
    low, high = (share * min(peak, unit.rated_nm) for share in (0.25, 0.75))
    stiffness = (high - low) / abs(mean(unit, high, peak) - mean(unit, low, peak))
    common = {
        "ratio": unit.ratio,
        "rated_torque_nm": unit.rated_nm,
        "lags_s": lags,
        "fixture_stiffness_nm_per_arcmin": bench.fixture_stiffer * unit.spring_nm_per_arcmin,
        "catalogue_stiffness_nm_per_arcmin": float(f"{stiffness:.2g}"),
    }
    return Method(**(common | changes))  # type: ignore[arg-type]


def measured(unit: Kind, course: Course, bench: Bench, random: np.random.Generator, defect: Defect = SOUND) -> Trace:
    """Return the run as a bench within its declared figures shows it, and with a defect that it does not declare."""
    figures = figures_of(unit)
    rising = np.sign(np.gradient(course.torque_nm))
    lens = -rising * (1.0 - np.square(course.torque_nm / np.abs(course.torque_nm).max()))
    skew_s = random.uniform(-1.0, 1.0) * figures.skew_s
    peak = np.abs(course.torque_nm).max()
    true_out = course.torque_nm * np.where(course.torque_nm > 0.0, defect.out_gain_positive, 1.0) * defect.out_gain
    true_out = true_out * (1.0 + defect.bend * (np.abs(course.torque_nm) / peak - 1.0))

    def torque(values: np.ndarray, one: TorqueFigures, lag_s: float) -> np.ndarray:
        seen = np.interp(course.t_s - bench.lag_s - skew_s - defect.delay_s, course.t_s, values)
        seen = first_order(seen, lag_s, bench.period_s)
        scale = one.full_scale_nm
        seen = seen * (1.0 + random.normal(0.0, one.gain_fraction / 2.0))
        seen += random.uniform(-1.0, 1.0) * one.zero_fraction * scale
        seen += random.normal(0.0, one.reversibility_fraction / 2.0) * scale * lens
        return seen + random.normal(0.0, bench.noise * one.noise_fraction * scale, seen.size)

    def angle(arcmin: np.ndarray, one: AngleFigures) -> np.ndarray:
        rad = np.interp(course.t_s - bench.lag_s, course.t_s, arcmin * ARCMIN_RAD)
        rad = rad + random.uniform(0.0, 2.0 * math.pi)  # where on its scale the encoder stands at the start
        shown = rad.copy()
        for limit, period in ((one.accuracy_rad, 2.0 * math.pi), (one.interpolation_rad, one.line_rad)):
            shown += limit * np.sin(2.0 * math.pi * rad / period + random.uniform(0.0, 2.0 * math.pi))
        shown = np.round(shown / one.step_rad) * one.step_rad
        return shown - shown[0]

    true_out = true_out + defect.hysteresis_nm * lens
    crept = np.cumsum(np.sign(course.torque_nm)) * bench.period_s / 60.0 * defect.creep_arcmin_per_min
    turned = (course.windup_arcmin + crept + course.locked_arcmin) * unit.ratio
    phase = defect.ripple_per_turn * turned * ARCMIN_RAD + defect.ripple_phase_rad
    turned = turned + defect.ripple_arcmin * np.sin(phase)
    return Trace(
        t_s=course.t_s,
        drive_angle_rad=drive_angle(unit, course),
        drive_torque_nm=drive_torque(course),
        torque_in_nm=torque(course.torque_in_nm * defect.in_gain, figures.torque_in, defect.lag_s),
        torque_out_nm=torque(true_out, figures.torque_out, max(defect.lag_s, defect.lag_out_s)),
        angle_in_rad=angle(turned, figures.angle_in),
        angle_out_rad=angle(course.locked_arcmin, figures.angle_out),
        segment=course.segment,
        segments=course.segments,
    )


COUPLING_TWIST = 0.005
"""Twist of the coupling between drive and input shaft at the peak torque, of the way of that shaft."""

DRIVE_WAVE_ARCMIN, DRIVE_WAVES, DRIVE_STEP_RAD = 1.0 / 3.0, 2.0, 2.0 * math.pi / 2**17
"""Error of the motor's encoder: its peak, how often it comes in a turn, and one count."""


def drive_angle(unit: Kind, course: Course) -> np.ndarray:
    """Return the position that the drive reports [rad]: its own encoder, behind a coupling, as it is in that moment."""
    turned = (course.windup_arcmin + course.locked_arcmin) * unit.ratio
    twist = COUPLING_TWIST * np.abs(turned).max() / np.abs(course.torque_in_nm).max()
    rad = (turned + twist * course.torque_in_nm) * ARCMIN_RAD
    shown = rad + DRIVE_WAVE_ARCMIN * ARCMIN_RAD * np.sin(DRIVE_WAVES * rad)
    return np.round(shown / DRIVE_STEP_RAD) * DRIVE_STEP_RAD


DRIVE_GAIN, DRIVE_FRICTION, DRIVE_COUNTS = 1.03, 0.002, 1000
"""Torque that the drive reports: the gain of its motor's torque constant, friction of the motor as a share of the peak
torque, and counts in the peak torque."""


def drive_torque(course: Course) -> np.ndarray:
    """Return the torque that the drive reports [N·m], from its current: coarse, with a gain and friction of its own."""
    peak = float(np.abs(course.torque_in_nm).max())
    shown = DRIVE_GAIN * course.torque_in_nm + DRIVE_FRICTION * peak * np.sign(np.gradient(course.torque_nm))
    return np.round(shown / peak * DRIVE_COUNTS) * peak / DRIVE_COUNTS


def first_order(values: np.ndarray, lag_s: float, period_s: float) -> np.ndarray:
    """What a filter of the first order makes of samples."""
    if lag_s <= 0.0:
        return values
    keep = math.exp(-period_s / lag_s)
    found, last = np.empty_like(values), float(values[0])
    for index, value in enumerate(values.tolist()):
        last = value + (last - value) * keep
        found[index] = last
    return found


def rows_kept(trace: Trace, kept: np.ndarray, *, renumbered: bool = False) -> Trace:
    """Return the trace with some of its rows; renumbered: with a time that shows no gap."""
    names = (*CHANNELS, "segment")
    channels = {name: values[kept] for name in names if (values := getattr(trace, name)) is not None}
    if renumbered:
        channels["t_s"] = np.arange(channels["t_s"].size) * float(np.median(np.diff(trace.t_s)))
    return replace(trace, **channels)


def without_dwells(trace: Trace, *, renumbered: bool = False) -> Trace:
    """Return the trace without the rows of its dwells."""
    resting = [index for index, info in trace.segments.items() if info.role == "dwell"]
    return rows_kept(trace, ~np.isin(trace.segment, resting), renumbered=renumbered)


def without_segments(trace: Trace) -> Trace:
    """Return the trace as somebody exports it who knows no segments and has nothing of the drive."""
    return replace(trace, segment=None, segments={}, drive_angle_rad=None, drive_torque_nm=None)
