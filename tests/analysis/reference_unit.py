"""Quasi-static reference of unit P1, an RV-40E-121: elastic part, Dahl hysteresis and input friction in closed form.

Independent of the virtual bench: no time steps, so its values are exact up to the density of the grid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from analysis.trace.trace import SegmentInfo, Trace
from analysis.uncertainty.figures import AngleFigures, SensorFigures, TorqueFigures

ARC = math.pi / 10_800
RATIO = 121.0
RATED_NM = 412.0
FIGURES = SensorFigures(
    torque_in=TorqueFigures(5.0),
    torque_out=TorqueFigures(1000.0),
    angle_in=AngleFigures(2 * math.pi / 2**20),
    angle_out=AngleFigures(2 * math.pi / 2**23, accuracy_rad=1e-5, interpolation_rad=5e-7),
    skew_s=2e-4,
    drift_arcmin_per_min=0.005,
    fixture_fraction=0.05,
    lock_width_arcmin=0.002,
    lock_windup_fraction=5e-4,
)
"""What a bench with such sensors states of them."""


@dataclass(frozen=True)
class ReferenceUnit:
    k_inf: float = 110.86950329
    b: float = 0.7789045
    t0: float = 100.0
    j: float = 0.2
    t_j: float = 2.0
    f_c: float = 23.47536281
    sigma: float = 2000.0
    k_fix: float = 1e4
    negative_softer: float = 1.0
    input_friction_nm: float = 13.889 / 94.689
    input_friction_slope: float = RATIO / 94.689 - 1.0
    input_presliding: float = 30.0 / (RATIO * ARC)

    def elastic(self, torque: np.ndarray) -> np.ndarray:
        phi = (
            torque / self.k_inf
            + self.b * np.sign(torque) * (1 - np.exp(-np.abs(torque) / self.t0))
            + self.j / 2 * np.tanh(torque / self.t_j)
        )
        return np.where(torque < 0, phi * self.negative_softer, phi)

    @lru_cache(maxsize=4)  # noqa: B019 - units are few, and equal ones share
    def branches(self, peak: float, points: int = 200_001) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angle [arcmin], torque rising and torque falling along it [N·m], of the closed loop to ±peak."""
        elastic = np.linspace(-(peak - self.f_c), peak - self.f_c, points)
        phi = self.elastic(elastic)
        rising = elastic + self.f_c - 2 * self.f_c * np.exp(-self.sigma * (phi - phi[0]) / self.f_c)
        falling = elastic - self.f_c + 2 * self.f_c * np.exp(-self.sigma * (phi[-1] - phi) / self.f_c)
        return phi, rising, falling

    def virgin(self, peak: float, points: int = 100_001) -> tuple[np.ndarray, np.ndarray]:
        elastic = np.linspace(0, peak - self.f_c, points)
        phi = self.elastic(elastic)
        return phi, elastic + self.f_c * (1 - np.exp(-self.sigma * phi / self.f_c))


def exact_trace(unit: ReferenceUnit, peak: float, points: int = 20_001, cycles: int = 1) -> Trace:
    """Noise-free loop, torque at the output and wind-up, with its segments."""
    phi, rising, falling = unit.branches(peak, points)
    torque = np.tile(np.concatenate([rising, falling[::-1]]), cycles)
    angle = np.tile(np.concatenate([phi, phi[::-1]]), cycles)
    segment = np.repeat(np.arange(2 * cycles), points)
    table = {2 * n + k: SegmentInfo("measure", 1 - 2 * k, n + 1) for n in range(cycles) for k in (0, 1)}
    return Trace(torque_out_nm=torque, angle_out_rad=angle * ARC, segment=segment, segments=table)


@dataclass(frozen=True)
class Bench:
    """Figures of the default virtual bench."""

    rate_nm_s: float = 60.0
    period_s: float = 1e-3
    torque_out_noise_nm: float = 0.2
    torque_in_noise_nm: float = 1e-3
    angle_in_bits: int | None = 20
    angle_out_bits: int | None = 23
    dwell_s: float = 0.1


class Course(NamedTuple):
    """What truly happens in a run of the inverse bench, sample by sample; many runs of a test have the same."""

    torque_in_nm: np.ndarray
    torque_out_nm: np.ndarray
    angle_in_rad: np.ndarray
    angle_out_rad: np.ndarray
    segment: np.ndarray
    segments: dict[int, SegmentInfo]


@lru_cache(maxsize=8)
def course(unit: ReferenceUnit, peak: float, cycles: int, bench: Bench) -> Course:
    """Calibrate (0, +, 0, -, 0), virgin quarter, cycles, unload."""
    phi, rising, falling = unit.branches(peak)
    virgin_phi, virgin = unit.virgin(peak)
    step = bench.rate_nm_s * bench.period_s
    up, down = np.arange(-peak, peak, step), np.arange(peak, -peak, -step)
    torque, angle, segment, table = [], [], [], {}

    def add(role: str, direction: int, cycle: int, torques: np.ndarray, angles: np.ndarray) -> None:
        table[len(table)] = SegmentInfo(role, direction, cycle)
        torque.append(torques)
        angle.append(angles)
        segment.append(np.full(torques.size, len(table) - 1))

    def dwell(sign: int) -> None:
        count = round(bench.dwell_s / bench.period_s)
        add("dwell", 0, 0, np.full(count, sign * peak), np.full(count, sign * phi[-1] if sign > 0 else phi[0]))

    first = np.arange(0, peak, step)
    add("calibrate", 1, 0, first, np.interp(first, virgin, virgin_phi))
    dwell(1)
    add("calibrate", -1, 0, down, np.interp(down, falling, phi))
    dwell(-1)
    add("calibrate", 1, 0, up, np.interp(up, rising, phi))
    dwell(1)
    for cycle in range(1, cycles + 1):
        add("measure", -1, cycle, down, np.interp(down, falling, phi))
        dwell(-1)
        add("measure", 1, cycle, up, np.interp(up, rising, phi))
        dwell(1)
    last = np.arange(peak, 0, -step)
    add("unload", -1, 0, last, np.interp(last, falling, phi))

    torque_out, windup = np.concatenate(torque), np.concatenate(angle)
    fixture = torque_out / unit.k_fix
    angle_in = (windup + fixture) * RATIO * ARC
    torque_in = torque_out / RATIO + input_friction(unit, angle_in, torque_out)
    return Course(torque_in, torque_out, angle_in, fixture * ARC, np.concatenate(segment), table)


def bench_trace(unit: ReferenceUnit, peak: float, cycles: int = 3, bench: Bench | None = None, seed: int = 1) -> Trace:
    """Run of the inverse bench: its course in all channels, with noise."""
    bench = bench or Bench()
    random = np.random.default_rng(seed)
    true = course(unit, peak, cycles, bench)
    count = true.segment.size
    return Trace(
        t_s=np.arange(count) * bench.period_s,
        torque_in_nm=true.torque_in_nm + random.normal(0, bench.torque_in_noise_nm, count),
        torque_out_nm=true.torque_out_nm + random.normal(0, bench.torque_out_noise_nm, count),
        angle_in_rad=quantised(true.angle_in_rad, bench.angle_in_bits).copy(),
        angle_out_rad=quantised(true.angle_out_rad, bench.angle_out_bits).copy(),
        segment=true.segment.copy(),
        segments=dict(true.segments),
    )


def input_friction(unit: ReferenceUnit, angle_in: np.ndarray, torque_out: np.ndarray) -> np.ndarray:
    """Friction torque at the input: presliding approaches the sliding level exponentially with the angle turned."""
    level = unit.input_friction_nm + unit.input_friction_slope * np.abs(torque_out) / RATIO
    steps = np.diff(angle_in, prepend=angle_in[0])
    share = np.exp(-unit.input_presliding * np.abs(steps) / level)
    friction, found = 0.0, []
    for sliding, keep in zip((np.sign(steps) * level).tolist(), share.tolist(), strict=True):
        friction = sliding + (friction - sliding) * keep
        found.append(friction)
    return np.array(found)


def quantised(angle_rad: np.ndarray, bits: int | None) -> np.ndarray:
    if bits is None:
        return angle_rad
    step = 2 * math.pi / 2**bits
    return np.round(angle_rad / step) * step


def timed_trace(  # noqa: PLR0917
    unit: ReferenceUnit,
    peak: float,
    cycles: int = 2,
    speed_arcmin_s: float | tuple[float, ...] = 0.385,
    dwell_s: float = 0.0,
    period_s: float = 1e-3,
) -> Trace:
    """Noise-free cycles from +peak at a constant speed of the wind-up (one, or one per cycle), all channels at once."""
    phi, rising, falling = unit.branches(peak)
    speeds = speed_arcmin_s if isinstance(speed_arcmin_s, tuple) else (speed_arcmin_s,) * cycles
    torque, angle, segment, table = [], [], [], {}
    for cycle, speed in enumerate(speeds, start=1):
        for direction, way in ((-1, phi[::-1]), (1, phi)):
            turned = np.arange(0.0, phi[-1] - phi[0], speed * period_s)
            along = way[0] + direction * turned
            torque.append(np.interp(along, phi, rising if direction > 0 else falling))
            angle.append(along)
            table[len(table)] = SegmentInfo("measure", direction, cycle)
            segment.append(np.full(along.size, len(table) - 1))
            rest = round(dwell_s / period_s)
            torque.append(np.full(rest, torque[-1][-1]))
            angle.append(np.full(rest, along[-1]))
            table[len(table)] = SegmentInfo("dwell", 0, cycle)
            segment.append(np.full(rest, len(table) - 1))
    torque_out = np.concatenate(torque)
    return Trace(
        t_s=np.arange(torque_out.size) * period_s,
        torque_out_nm=torque_out,
        angle_out_rad=np.concatenate(angle) * ARC,
        segment=np.concatenate(segment),
        segments=table,
    )
