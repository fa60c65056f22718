"""Loops of a reducer that shares nothing with the virtual bench or with the analysis, and what they truly are.

The torque at the output drives a generalised Prandtl–Ishlinskii operator: many plays in parallel, of different
thresholds that grow with the load. Its output loads an arctangent gap, Hertz contact (angle ∝ torque^⅔) and a straight
spring. Friction at the input is another operator, many stops over the angle turned, times a level that grows with the
load: it has its own transition after a reversal. So every branch is a closed form of torque and history, and the truth
of a metric is read off that form at the very torque, without samples, fits or masks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from analysis.loop.method import Method
from analysis.trace.trace import CHANNELS, SegmentInfo, Trace
from analysis.uncertainty.figures import AngleFigures, SensorFigures, TorqueFigures

ARCMIN_RAD = math.pi / 10_800.0
PLAYS = 24
EXACT_EVERY = 4
"""Samples between which the wind-up is straight; it is off by 2e-4 arcmin at most, where a play begins to move."""

ROWS_AT_ONCE = 2000

ENERGY_POINTS, TURN_POINTS = 5001, 5001
"""Torques at which the energy is summed up, which is then right to 3e-7, and the friction at a turn is read."""

STOPS = 16
PERIOD_S = 1e-3


@dataclass(frozen=True)
class Kind:
    """A type of reducer. Torques are shares of the rated torque at the output, angles arcmin at the output.

    threshold: least and largest friction threshold of the plays; the torque must turn back by twice that before the
    angle follows wholly. yields: least and largest angle over which friction at the input reverses, halved.
    """

    name: str
    ratio: float
    rated_nm: float
    spring_nm_per_arcmin: float
    gap_arcmin: float
    hertz_arcmin: float
    threshold: tuple[float, float] = (0.01, 0.05)
    threshold_grows: float = 0.2
    gap_torque: float = 0.006
    negative_angle: float = 1.0
    input_friction: float = 0.034
    input_friction_grows: float = 0.27
    yields: tuple[float, float] = (0.002, 0.06)

    def varied(self, random: np.random.Generator, spread: float = 0.15) -> Kind:
        """Return another unit of this type."""
        names = ("spring_nm_per_arcmin", "gap_arcmin", "hertz_arcmin", "threshold_grows", "gap_torque",
                 "input_friction", "input_friction_grows")  # fmt: skip
        moved = {name: getattr(self, name) * (1.0 + spread * random.uniform(-1.0, 1.0)) for name in names}
        low, high = self.threshold
        wider = 1.0 + spread * random.uniform(-1.0, 1.0)
        return replace(self, **moved, threshold=(low, high * wider))

    @property
    def thresholds_nm(self) -> np.ndarray:
        """Threshold of each play without load, N·m."""
        return np.linspace(*self.threshold, PLAYS) * self.rated_nm

    def elastic(self, torque_nm: np.ndarray | float) -> np.ndarray:
        """Angle [arcmin] of gap, contacts and spring under a torque that no friction takes from."""
        torque = np.asarray(torque_nm, dtype=np.float64)
        share = np.abs(torque) / self.rated_nm
        # by logarithms: a power takes four times as long
        contact = np.copysign(np.exp(np.log(share + 1e-3) * (2.0 / 3.0)) - 1e-2, torque)
        gap = np.arctan(torque / (self.gap_torque * self.rated_nm)) / math.pi
        angle = self.gap_arcmin * gap + self.hertz_arcmin * contact + torque / self.spring_nm_per_arcmin
        return angle if self.negative_angle == 1.0 else np.where(torque < 0.0, self.negative_angle * angle, angle)

    def mean_angle(self, plays: np.ndarray) -> np.ndarray:
        """Mean angle [arcmin] of all plays, a row each time; so many rows at a time as stay near the processor."""
        pieces = [plays[first : first + ROWS_AT_ONCE] for first in range(0, len(plays), ROWS_AT_ONCE)]
        return np.concatenate([np.asarray(self.elastic(piece)).mean(axis=1) for piece in pieces])

    def _reach(self, torque_nm: np.ndarray, direction: int) -> np.ndarray:
        """Where each play is when it is dragged along: a column per play."""
        torque = np.atleast_1d(torque_nm)[:, None]
        drag = self.thresholds_nm * (1.0 + self.threshold_grows * np.abs(torque) / self.rated_nm)
        return torque - direction * drag

    def moved(self, plays: np.ndarray, torque_nm: np.ndarray, direction: int) -> np.ndarray:
        """Return each play along a torque of one direction; plays: where they are before it."""
        reach = self._reach(torque_nm, direction)
        return np.maximum(plays, reach) if direction > 0 else np.minimum(plays, reach)

    def angle(self, torque_nm: np.ndarray | float, direction: int, peak_nm: float) -> np.ndarray:
        """Angle [arcmin] on a branch of the closed loop between ±peak: the truth."""
        turn = self._reach(np.array([-direction * peak_nm]), -direction)[0]
        along = self.moved(turn, np.atleast_1d(np.asarray(torque_nm, dtype=np.float64)), direction)
        return self.mean_angle(along)


KINDS = {
    kind.name: kind
    for kind in (
        Kind("RV-20E", 105.0, 167.0, 58.0, 0.35, 0.55),
        Kind("RV-40E", 121.0, 412.0, 125.0, 0.3, 0.6),
        Kind("RV-320E", 129.0, 3136.0, 1150.0, 0.25, 0.5),
        Kind("RV-50", 121.0, 50.0, 33.0, 0.5, 0.4, threshold=(0.01, 0.04), gap_torque=0.02),
        Kind("strain-wave", 100.0, 67.0, 12.0, 0.1, 1.6, threshold=(0.02, 0.25), gap_torque=0.05,
             input_friction=0.05, input_friction_grows=0.35, yields=(0.01, 0.4)),
        Kind("asymmetric", 121.0, 412.0, 125.0, 0.4, 0.6, negative_angle=1.25),
    )
}  # fmt: skip
"""Types of units by name. Scales are those of their catalogues; stiffness_of says what they come to."""


def width(unit: Kind, torque_nm: float, peak_nm: float) -> float:
    """Loop width at a torque [arcmin]: return less forward branch."""
    return float(unit.angle(torque_nm, -1, peak_nm)[0] - unit.angle(torque_nm, 1, peak_nm)[0])


def mean(unit: Kind, torque_nm: float, peak_nm: float) -> float:
    """Mean of both branches at a torque [arcmin]."""
    return float(unit.angle(torque_nm, -1, peak_nm)[0] + unit.angle(torque_nm, 1, peak_nm)[0]) / 2.0


def _secant(unit: Kind, side: int, peak_nm: float, *, loading: bool) -> float:
    half, full = 0.5 * side * unit.rated_nm, side * unit.rated_nm
    if loading:
        turned = float(np.diff(unit.angle(np.array([half, full]), side, peak_nm))[0])
    else:
        turned = mean(unit, full, peak_nm) - mean(unit, half, peak_nm)
    return 0.5 * unit.rated_nm / abs(turned)


FIT_POINTS, LSQ_POINTS = 400, 200
"""Equally spaced torques, ends among them, at which a segment and the least squares stiffness are fitted. They belong
to the definition: an end weighs as much as a point between, which moves a spring constant by 0.02 %."""


def _least_squares(unit: Kind, side: int, peak_nm: float) -> float:
    torque = side * np.linspace(0.2, 0.8, LSQ_POINTS) * unit.rated_nm
    return 1.0 / float(np.polyfit(torque, unit.angle(torque, side, peak_nm), 1)[0])


def _energy(unit: Kind, _: int, peak_nm: float) -> float:
    grid = np.linspace(-peak_nm, peak_nm, ENERGY_POINTS)
    return float(np.trapezoid(unit.angle(grid, -1, peak_nm) - unit.angle(grid, 1, peak_nm), grid))


def _chord(unit: Kind, side: int, peak_nm: float, low: float, high: float) -> float:
    """Chord of the loading branch between two shares of the rated torque."""
    torque = side * np.array([low, high]) * unit.rated_nm
    return (high - low) * unit.rated_nm / abs(float(np.diff(unit.angle(torque, side, peak_nm))[0]))


def _end_point(unit: Kind, side: int, peak_nm: float) -> float:
    loaded, unloaded = unit.angle(side * unit.rated_nm, side, peak_nm), unit.angle(0.0, -side, peak_nm)
    return unit.rated_nm / abs(float(loaded[0] - unloaded[0]))


def _asymmetry(unit: Kind, _: int, peak_nm: float) -> float:
    """With its sign: positive where the positive side winds up more."""
    positive, negative, zero = (mean(unit, share * unit.rated_nm, peak_nm) for share in (1.0, -1.0, 0.0))
    return (positive + negative - 2.0 * zero) * 30.0


BREAK, FIT_END, STEP_NM = 90.0 / 412.0, 420.0 / 412.0, 10.0
"""Break and end of the six-segment fit of the rated torque, step of the spring constant, as the sources have them."""


def reversing_nm(unit: Kind, peak_nm: float) -> tuple[float, float]:
    """Torque after the negative and the positive turn that no fit sees, by its definition in words.

    1.125 times the torque by which the height of the loop comes to 95 % of its largest within 2.25 times the friction
    torque, and by 2.25 times the friction torque at most; that times how far the steepness over it lies between a third
    and two thirds.
    """
    grid = np.linspace(-peak_nm, peak_nm, TURN_POINTS)
    rising, falling = unit.angle(grid, 1, peak_nm), unit.angle(grid, -1, peak_nm)
    middle = rising[0] + (rising[-1] - rising[0]) * np.linspace(0.25, 0.75, 501)
    friction = float(np.median(np.interp(middle, rising, grid) - np.interp(middle, falling, grid))) / 2.0
    found = []
    for end, left, arrived in ((-1, rising, falling), (1, falling, rising)):
        depth = np.linspace(0.0, 2.25 * friction, 2001)
        away = np.interp(end * (peak_nm - depth), grid, left)
        height = end * (np.interp(away, arrived, grid) - end * (peak_nm - depth))
        whole = depth[int(np.argmax(height >= 0.95 * height.max()))]
        stretch = min(2.0 * friction, float(whole))
        ends = end * (peak_nm - np.array([0.0, stretch]))
        ways = [abs(float(np.diff(np.interp(ends, grid, branch))[0])) for branch in (left, arrived)]
        found.append(1.125 * stretch * float(np.clip(3.0 * (1.0 - ways[0] / ways[1]) - 1.0, 0.0, 1.0)))
    return found[0], found[1]


@lru_cache(maxsize=4)
def _fitted_mean(unit: Kind, peak_nm: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coefficients of the mean of both branches as fitted: negative, middle with the mean gap added, positive."""
    reference, (below, above) = unit.rated_nm, reversing_nm(unit, peak_nm)
    end = FIT_END * reference
    ends = {1: (max(-end, below - peak_nm), end), -1: (-end, min(end, peak_nm - above))}
    parts: list[list[np.ndarray]] = [[], [], []]
    for direction, (low, high) in ends.items():
        borders = (low, -BREAK * reference, BREAK * reference, high)
        for part, degree in enumerate((2, 1, 2)):
            torque = np.linspace(borders[part], borders[part + 1], FIT_POINTS)
            parts[part].append(np.polyfit(torque / reference, unit.angle(torque, direction, peak_nm), degree))
    negative, middle, positive = (np.mean(part, axis=0) for part in parts)
    gaps = [np.polyval(outer, at) - np.polyval(middle, at) for outer, at in ((negative, -BREAK), (positive, BREAK))]
    middle[-1] += np.mean(gaps)
    return negative, middle, positive


def _fitted_at(unit: Kind, side: int, peak_nm: float, *torques_nm: float) -> list[float]:
    outer = _fitted_mean(unit, peak_nm)[0 if side < 0 else 2]
    return [float(np.polyval(outer, side * torque / unit.rated_nm)) for torque in torques_nm]


def _spring(unit: Kind, side: int, peak_nm: float) -> float:
    low, high = _fitted_at(unit, side, peak_nm, unit.rated_nm - STEP_NM, unit.rated_nm)
    return STEP_NM / abs(high - low)


def _slope_at_half(unit: Kind, side: int, peak_nm: float) -> float:
    low, high = _fitted_at(unit, side, peak_nm, (0.5 - 1e-6) * unit.rated_nm, (0.5 + 1e-6) * unit.rated_nm)
    return 2e-6 * unit.rated_nm / abs(high - low)


def _windup(unit: Kind, _: int, peak_nm: float) -> float:
    return _fitted_at(unit, 1, peak_nm, unit.rated_nm)[0] - _fitted_at(unit, -1, peak_nm, unit.rated_nm)[0]


TRUTH = {
    "backlash_width_3pct": lambda unit, side, peak: width(unit, side * 0.03 * unit.rated_nm, peak),
    "backlash_width_zero": lambda unit, _, peak: width(unit, 0.0, peak),
    "lost_motion": lambda unit, _, peak: (
        mean(unit, 0.03 * unit.rated_nm, peak) - mean(unit, -0.03 * unit.rated_nm, peak)
    ),
    "stiffness_50_100 load": lambda unit, side, peak: _secant(unit, side, peak, loading=True),
    "stiffness_50_100 mean": lambda unit, side, peak: _secant(unit, side, peak, loading=False),
    "stiffness_lsq": _least_squares,
    "stiffness_two_point": lambda unit, side, peak: _chord(unit, side, peak, 0.2, 0.8),
    "stiffness_estimate": lambda unit, side, peak: _chord(unit, side, peak, 0.0, 1.0),
    "stiffness_end_point": _end_point,
    "hysteresis_energy": _energy,
    "hysteresis_angle": lambda unit, side, peak: 60.0 * width(unit, side * 0.5 * unit.rated_nm, peak),
    "asymmetry_at_rated": _asymmetry,
    "stiffness_at": _slope_at_half,
    "spring_constant": _spring,
    "windup": _windup,
}
"""What each metric truly is, by its definition in words: of a unit, a side (+1, -1) and the peak torque [N·m]."""


def truth(unit: Kind, metric: str, side: int, peak_nm: float) -> float:
    """Return what a metric truly is, from the closed form of the branches."""
    return float(TRUTH[metric](unit, side, peak_nm))


def with_backlash(unit: Kind, arcmin: float, peak_nm: float) -> Kind:
    """Return the unit whose width at +3 % is so much, by bisection of its thresholds on its own noise-free curve."""
    low, high = 0.05, 20.0

    def scaled(factor: float) -> Kind:
        return replace(unit, threshold=(unit.threshold[0] * factor, unit.threshold[1] * factor))

    for _ in range(60):
        middle = math.sqrt(low * high)
        if width(scaled(middle), 0.03 * unit.rated_nm, peak_nm) < arcmin:
            low = middle
        else:
            high = middle
    return scaled(low)


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


def _windup(unit: Kind, torque_nm: np.ndarray, plays: np.ndarray) -> np.ndarray:
    """Wind-up [arcmin] along one direction: exact at every fourth sample, straight between; plays: a row per sample."""
    there = np.unique(np.append(np.arange(0, torque_nm.size, EXACT_EVERY), torque_nm.size - 1))
    exact = unit.mean_angle(plays[there])
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
        along = unit.moved(plays, torque, direction)
        windup = _windup(unit, torque, along) + crept
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
