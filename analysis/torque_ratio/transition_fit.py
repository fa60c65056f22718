"""Where and how friction goes over from one line of the torque ratio to another: after a reversal, and at zero torque.

Both are read from the calibration branches that begin at a turn; one that starts at rest has other friction.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy  # loads optimize where it is used

from analysis.torque_ratio.quadrants import Quadrants, blended, by_lines, turn_lines, zero_length_rad
from analysis.trace.runs import Run
from analysis.trace.trace import Trace
from analysis.trace.units import BoolArray, FloatArray

TURN_POINTS, ZERO_POINTS = 20_000, 2_000
"""Samples of a branch that each is fitted to at most, evenly picked."""

TRANSITION_BOUNDS_RAD = (1e-6, 0.3)
"""Bounds of the transition length L at the input shaft."""

TRANSITION_RESIDUAL = 0.03
"""A transition that fits worse than this share of the peak torque is masked instead."""

ZERO_REACH = 0.1
"""Torques about zero, as a share of the peak torque, in which the zero is sought."""

ZERO_BOUND, ZERO_STEP = 0.01, 2e-4
"""Largest reading at zero torque, and first step of its search, in shares of the peak torque."""

LENGTH_BOUND, LENGTH_STEP = 3.0, 0.7
"""The same of the transition there: natural logarithm of its length over what is guessed."""


class Branch(NamedTuple):
    """A calibration run from turn to turn: +1 rising or -1, and its samples."""

    direction: int
    torque_in_nm: FloatArray
    torque_out_nm: FloatArray
    angle_in_rad: FloatArray

    @property
    def stiffness_nm_per_rad(self) -> float:
        """Torque at the output over angle at the input, from end to end; 0 of a shaft that stands."""
        turned = float(np.ptp(self.angle_in_rad))
        return float(np.ptp(self.torque_out_nm)) / turned if turned else 0.0

    def only(self, chosen: BoolArray, points: int) -> Branch:
        """Return its first sample, which is the turn, and so many of the chosen ones at most, evenly picked."""
        places = np.flatnonzero(chosen)
        places = places[:: max(-(-places.size // points), 1)]
        kept = np.concatenate(([0], places[places > 0]))
        return Branch(self.direction, *(values[kept] for values in self[1:]))


def whole_branches(trace: Trace, calibration: Sequence[Run], peak_nm: float) -> list[Branch]:
    """Return the calibration runs that begin at a turn; none where a torque or the input angle was not measured."""
    channels = (trace.torque_in_nm, trace.torque_out_nm, trace.angle_in_rad)
    measured = [channel for channel in channels if channel is not None]
    if len(measured) < len(channels):
        return []
    found = [Branch(run.direction, *(run.take(channel) for channel in measured)) for run in calibration]
    return [branch for branch in found if -branch.direction * branch.torque_out_nm[0] > 0.5 * peak_nm]


def fit_transition(branches: Sequence[Branch], steady: Quadrants, peak_nm: float) -> float | None:
    """Return the transition length L after a reversal [rad at the input].

    None when it cannot be seen or does not describe what was measured.
    """
    pieces = []
    for whole in branches:
        branch = whole.only(-whole.direction * whole.torque_out_nm > 0.5 * peak_nm, TURN_POINTS)
        if branch.torque_out_nm.size > 10:
            lines, turn = turn_lines(steady, branch.direction), float(branch.torque_in_nm[0])
            travel = np.abs(branch.angle_in_rad - branch.angle_in_rad[0])
            pieces.append((lines, turn, branch.torque_in_nm, travel, branch.torque_out_nm))
    if not pieces:
        return None

    def mean_square(log_length: float) -> float:
        length = float(np.exp(log_length))
        errors = [
            blended(*lines, torque_in, turn, np.exp(-travel / length)) - torque_out
            for lines, turn, torque_in, travel, torque_out in pieces
        ]
        return float(np.square(np.concatenate(errors)).mean())

    shortest, longest = np.log(TRANSITION_BOUNDS_RAD)
    log_length = _lowest(mean_square, np.linspace(float(shortest), float(longest), 40))
    if not np.sqrt(mean_square(log_length)) <= TRANSITION_RESIDUAL * peak_nm:
        return None
    return float(np.exp(log_length))


def fit_zero(branches: Sequence[Branch], quadrants: Quadrants, peak_nm: float) -> Quadrants:
    """Return the quadrants with what the output sensor reads at zero torque, and the length of the transition there.

    The zero of the sensor is not that of the torque: its tare leaves an offset, and friction knows the torque alone.
    """
    near = [one.only(np.abs(one.torque_out_nm) <= ZERO_REACH * peak_nm, ZERO_POINTS) for one in branches]
    guess_rad = zero_length_rad(quadrants, near[0].direction, float(near[0].torque_in_nm[0]))
    guess_rad = max(guess_rad, TRANSITION_BOUNDS_RAD[0])

    def moved(share: float, log_length: float) -> Quadrants:
        length = guess_rad * float(np.exp(log_length))
        return replace(quadrants, zero_nm=float(share) * peak_nm, zero_transition_rad=length)

    def square(where: FloatArray) -> float:
        candidate = moved(*where)
        squares = 0.0
        for one in near:
            found = by_lines(candidate, one.torque_in_nm, one.direction, one.angle_in_rad).torque_nm
            squares += float(np.square((found - one.torque_out_nm)[1:]).sum())
        return squares

    start = _lowest(lambda share: square(np.array([share, 0.0])), np.linspace(-ZERO_BOUND, ZERO_BOUND, 21))
    simplex = np.array([[start, 0.0], [start + ZERO_STEP, 0.0], [start, LENGTH_STEP]])
    options = {"initial_simplex": simplex, "xatol": 1e-5, "fatol": 0.0, "maxfev": 80}
    found = scipy.optimize.minimize(
        square,
        simplex[0],
        method="Nelder-Mead",
        bounds=((-ZERO_BOUND, ZERO_BOUND), (-LENGTH_BOUND, LENGTH_BOUND)),
        options=options,
    )
    return moved(*found.x)


def _lowest(cost: Callable[[float], float], grid: FloatArray) -> float:
    """Return where a cost is lowest: the best point of a grid, then anywhere between its neighbours."""
    best = int(np.argmin([cost(float(point)) for point in grid]))
    bounds = (grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)])
    return float(scipy.optimize.minimize_scalar(cost, bounds=bounds, method="bounded").x)
