"""Samples that a model is identified from: wind-up and output torque along the loop, thinned, and what they show."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy  # loads optimize where it is used

from analysis.loop.branches import Branch
from analysis.trace.errors import AnalysisError
from analysis.trace.runs import Run, found_runs
from analysis.trace.units import FloatArray

MOST_POINTS = 4000
"""Samples of a loop that are identified from, unless asked for otherwise."""

LEAST_POINTS = 40
"""Fewer samples do not show a loop."""

UNUSED_ROLES = ("calibrate", "fatigue", "dwell", "sweep", "unload", "other", "virgin")


@dataclass(frozen=True)
class LoopSamples:
    """Wind-up [arcmin] and output torque [N·m] in order of time, with the direction (+1, −1) of each sample's branch.

    Every branch runs from its turn to its end without turning back. The first sample continues the last one: whole
    cycles, from one reversal to the same one. angle_noise_arcmin: rms that the wind-up is uncertain by from sample to
    sample: what was taken from it to make it monotone, or the steps of the encoders, if those are known to be larger.
    """

    angle_arcmin: FloatArray
    torque_nm: FloatArray
    direction: FloatArray
    angle_noise_arcmin: float = 0.0

    @cached_property
    def branches(self) -> tuple[slice, ...]:
        """Stretches between two turns."""
        borders = np.flatnonzero(np.diff(self.direction)) + 1
        return tuple(slice(*ends) for ends in itertools.pairwise([0, *borders.tolist(), self.direction.size]))

    @property
    def peak_nm(self) -> float:
        """Largest torque."""
        return float(np.abs(self.torque_nm).max())

    @property
    def angle_range_arcmin(self) -> tuple[float, float]:
        """Least and largest wind-up."""
        return float(self.angle_arcmin.min()), float(self.angle_arcmin.max())


@dataclass(frozen=True)
class LoopShape:
    """What a loop shows at a glance, for start values.

    half_height_nm: half the height of the loop at mid angle; offset_arcmin: angle where the mean is at zero torque;
    stiffness_nm_per_arcmin of the outer quarters; soft_zone_arcmin by which their straight lines miss the origin.
    """

    half_height_nm: float
    offset_arcmin: float
    stiffness_nm_per_arcmin: float
    soft_zone_arcmin: float


def loop_samples(
    angle_arcmin: FloatArray,
    torque_nm: FloatArray,
    runs: Sequence[Run] | None = None,
    most_points: int = MOST_POINTS,
) -> LoopSamples:
    """Take the measured branches of a loop, every n-th sample as measured.

    Means of neighbours would round the corner after a reversal, which is where presliding shows. runs: from
    `commanded_runs`; None finds the turning points on the torque. Raises AnalysisError for lengths that differ, values
    that are not finite, no rising and falling branch, or fewer than 40 samples.
    """
    angle, torque = np.asarray(angle_arcmin, dtype=np.float64), np.asarray(torque_nm, dtype=np.float64)
    if angle.ndim != 1 or angle.shape != torque.shape:
        raise AnalysisError(
            f"model: found {angle.size} angles and {torque.size} torques; expected one of each per sample"
        )
    if not (np.isfinite(angle).all() and np.isfinite(torque).all()):
        at = int(np.argmax(~(np.isfinite(angle) & np.isfinite(torque))))
        raise AnalysisError(
            f"model: row {at + 1}: found angle {angle[at]:g} and torque {torque[at]:g}; expected numbers. Correct or "
            "remove the row"
        )
    if angle.size < LEAST_POINTS:
        raise AnalysisError(
            f"model: found {angle.size} samples; expected {LEAST_POINTS} or more of a whole loop; record more samples"
        )
    measured = [run for run in (found_runs(torque) if runs is None else runs) if run.role not in UNUSED_ROLES]
    if {run.direction for run in measured} != {-1, 1}:
        raise AnalysisError(
            f"model: found {len(measured)} measured branches; expected a rising and a falling one; record a loop"
        )
    if len(measured) % 2:
        measured = measured[:-1]
    samples = _joined([(run.take(angle), run.take(torque), run.direction) for run in measured], most_points)
    if np.ptp(samples.angle_arcmin) <= 0.0 or np.ptp(samples.torque_nm) <= 0.0:
        raise AnalysisError("model: angle or torque does not change; expected a loop; check the channels")
    return samples


def samples_of_branches(
    forward: Sequence[Branch],
    backward: Sequence[Branch],
    most_points: int = MOST_POINTS,
    *,
    angle_noise_arcmin: float = 0.0,
) -> LoopSamples:
    """Join the branches of the cycles, as they were evaluated, to a path: falling, then rising, cycle after cycle.

    Their torque is at the output, and fixture and reversal were taken care of. angle_noise_arcmin: rms that is known of
    the wind-up, as the steps of encoders; where the branches show more, that counts. Raises AnalysisError for
    branches that are no pairs, or hold fewer than 40 points.
    """
    if not forward or len(forward) != len(backward):
        raise AnalysisError(
            f"model: {len(forward)} rising and {len(backward)} falling branches; expected as many of each; record "
            "whole loops"
        )
    path = [
        piece
        for rising, falling in zip(forward, backward, strict=True)
        for piece in (
            (falling.angle_arcmin[::-1], falling.torque_nm[::-1], -1),
            (rising.angle_arcmin, rising.torque_nm, 1),
        )
    ]
    joined = _joined(path, most_points)
    return replace(joined, angle_noise_arcmin=max(joined.angle_noise_arcmin, angle_noise_arcmin))


def _joined(path: Sequence[tuple[FloatArray, FloatArray, int]], most_points: int) -> LoopSamples:
    """Thin the branches of a path and join them; AnalysisError when too little is left."""
    turned = [(*_from_turn(angle, torque, direction), direction) for angle, torque, direction in path]
    total = sum(angle.size for angle, _, _ in turned)
    taken = sum(
        float(np.square(angle[-ahead.size :] - ahead).sum())
        for (angle, _, _), (ahead, _, _) in zip(path, turned, strict=True)
    )
    if total < LEAST_POINTS:
        raise AnalysisError(f"model: {total} points in the branches; expected {LEAST_POINTS} or more")
    stride = max(1, -(-total // most_points))
    return LoopSamples(
        np.concatenate([angle[::stride] for angle, _, _ in turned]),
        np.concatenate([torque[::stride] for _, torque, _ in turned]),
        np.concatenate([np.full(angle[::stride].size, float(direction)) for angle, _, direction in turned]),
        math.sqrt(taken / total),
    )


def _from_turn(angle: FloatArray, torque: FloatArray, direction: int) -> tuple[FloatArray, FloatArray]:
    """Return a branch from where its wind-up turns, the wind-up made monotone.

    While the torque begins to go back, friction may still creep on: that is no part of the branch. The steps of an
    encoder at one shaft are no turns of the reducer: followed as such, each would cost a model part of its friction.
    """
    start = int(np.argmin(direction * angle))
    ahead = scipy.optimize.isotonic_regression(direction * angle[start:]).x
    return direction * ahead, torque[start:]


def loop_shape(loop: LoopSamples) -> LoopShape:
    """Read start values off a loop."""
    low, high = loop.angle_range_arcmin
    angle = np.linspace(low + 0.05 * (high - low), high - 0.05 * (high - low), 200)
    rising, falling = (_torque_at(loop, direction, angle) for direction in (1.0, -1.0))
    mean = 0.5 * (rising + falling)
    stiffness = max(
        float(np.polyfit(angle[-50:], mean[-50:], 1)[0] + np.polyfit(angle[:50], mean[:50], 1)[0]) / 2, 1e-9
    )
    offset = float(angle[int(np.argmin(np.abs(mean)))])
    missing = np.abs(angle - offset) - np.abs(mean) / stiffness
    outer = np.concatenate([missing[:50], missing[-50:]])
    return LoopShape(
        half_height_nm=max(0.5 * float(np.median(rising - falling)), 1e-6 * loop.peak_nm),
        offset_arcmin=offset,
        stiffness_nm_per_arcmin=stiffness,
        soft_zone_arcmin=max(float(np.median(outer)), 1e-3 * (high - low)),
    )


def _torque_at(loop: LoopSamples, direction: float, angle: FloatArray) -> FloatArray:
    chosen = loop.direction == direction
    order = np.argsort(loop.angle_arcmin[chosen], kind="stable")
    return np.asarray(np.interp(angle, loop.angle_arcmin[chosen][order], loop.torque_nm[chosen][order]))
