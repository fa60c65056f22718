"""What the metrics of a `Kind` truly are: read off the closed form of its branches, without samples, fits or masks."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from benchmarks.simulated.kinds import Kind, mean, width

ENERGY_POINTS, TURN_POINTS = 5001, 5001
"""Torques at which the energy is summed up, which is then right to 3e-7, and the friction at a turn is read."""


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
