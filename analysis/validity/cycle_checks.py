"""Figures of the validity checks that hold cycles against each other, and the end of a cycle against its start.

Each returns a Reading, or the reason in words why the figure does not apply here.
"""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np

from analysis.loop.closure import closure_gaps_arcmin, widest_jump_nm
from analysis.loop.measured import Measured
from analysis.trace.units import FloatArray
from analysis.validity.evidence import (
    MIDDLE,
    NO_SPAN,
    NOT_EVALUATED,
    Evidence,
    Figure,
    Reading,
    has_span,
    of_measured,
    of_span,
    once,
)
from analysis.validity.noise_checks import BLOCK, SLOWEST_S

GRID_POINTS = 81
JUMP = 0.02
"""Share of a branch's torque that may be missing at a reversal before the closure of its loop cannot be told."""

CHANCE = 0.1
"""Correlation of the noise of two cycles that chance may make."""

COMPARED = ("torque_in_nm", "torque_out_nm", "angle_in_rad", "angle_out_rad")
"""Channels of the trace in which a copied cycle is the same."""


@of_measured
def wrong_way(found: Measured) -> Reading | str:
    """Energy of the cycle that loses least, N·m·arcmin."""
    if not has_span(found):
        return Reading(-math.inf, NO_SPAN)
    energy = min(loop.energy_nm_arcmin for loop in found.loops)
    text = f"the direction of the loop is wrong (energy {energy:.3g} N·m·arcmin in a cycle; a loss is positive)"
    return Reading(energy, text if energy < 0 else "")


@of_measured
def loop_closure(found: Measured) -> Reading | str:
    """Wind-up between start and end of a cycle at the same torque, % of the wind-up of the loop."""
    gaps = closure_gaps_arcmin(found)
    jump = widest_jump_nm(found)
    words = (
        f"the branches do not meet: {jump:.3g} N·m are missing in the trace after a reversal, so it is not known "
        "whether the loop closes"
    )
    missing = jump > JUMP * float(np.ptp(found.blocks[0].torque_nm))
    return of_span(found, max(gaps), words if missing else "")


@of_measured
def drift(found: Measured) -> Reading | str:
    """Drift of the wind-up in a cycle, whether corrected or not, % of the wind-up."""
    shift = found.drift.per_cycle_arcmin
    if shift is None:
        return "needs two cycles in the same direction and to the same torque"
    return of_span(found, abs(shift), f"the wind-up drifts over the cycle by {abs(shift):.3g} arcmin in a cycle")


@of_measured
def repeat(found: Measured) -> Reading | str:
    """Largest deviation (rms over torque) of a branch from the mean of its direction, % of the wind-up."""
    if len(found.loops) < 2:
        return "needs two cycles"
    peak = min(min(-loop.forward.torque_nm[0], loop.backward.torque_nm[-1]) for loop in found.loops)
    if not peak > 0.0:
        return "needs loops that pass through zero torque"
    grid = np.linspace(-MIDDLE * peak, MIDDLE * peak, GRID_POINTS)
    worst = 0.0
    for branches in ([loop.forward for loop in found.loops], [loop.backward for loop in found.loops]):
        angles = np.array([branch.at(grid) for branch in branches])
        worst = max(worst, float(np.sqrt(np.square(angles - angles.mean(axis=0)).mean(axis=1)).max()))
    return of_span(found, worst)


def copied_cycles(evidence: Evidence) -> Reading | str:
    """Largest share of a branch's samples that another cycle has bit by bit in the same place, or of its noise, %.

    Cycles that are copies have no scatter, and the uncertainty would believe them. Noise makes every cycle another one,
    so only where noise is declared is a copy no measurement. A copy to which a little was added has the noise of the
    torques all the same.
    """
    found = evidence.measured
    if found is None:
        return NOT_EVALUATED
    if len(found.loops) < 2:
        return "needs two cycles"
    if not evidence.noise_declared:
        return "needs the noise of the sensors in the bench file: without noise, identical cycles are possible"
    torques = sum(getattr(found.recorded, name) is not None for name in COMPARED if name.startswith("torque"))
    step_s = found.trace.step_s
    fast = step_s is not None and step_s <= SLOWEST_S
    worst, where = 0.0, ""
    for side in (0, 1):
        samples = [of_cycle[side] for of_cycle in _as_measured(found)]
        own = [np.diff(values[:torques], 2) for values in samples] if fast else []
        for first, second in combinations(range(len(samples)), 2):
            one, other = samples[first], samples[second]
            noise = _noise_alike(own[first], own[second]) if fast else 0.0
            share = max(_alike(one, other), noise)
            if share > worst:
                cycles = [found.pairs[place][side].cycle for place in (first, second)]
                worst, where = share, f"cycles {cycles[0]} and {cycles[1]} are copies of each other, sample by sample"
    return Reading(100.0 * worst, where)


def repeated_samples(evidence: Evidence) -> Reading | str:
    """Largest share of a branch's samples that are bit by bit the one before, %.

    A sample that was written twice is no second measurement, and the uncertainty would count it as one.
    """
    found = evidence.measured
    if found is None:
        return NOT_EVALUATED
    if not evidence.noise_declared:
        return "needs the noise of the sensors in the bench file: without noise, identical samples are possible"
    worst, where = 0.0, ""
    for pair, of_cycle in zip(found.pairs, _as_measured(found), strict=True):
        for one, values in zip(pair, of_cycle, strict=True):
            share = float((values[:, 1:] == values[:, :-1]).all(axis=0).mean())
            if share > worst:
                worst, where = share, f"{one.where}: samples repeat the sample before"
    return Reading(100.0 * worst, where)


@once
def _as_measured(found: Measured) -> list[tuple[FloatArray, FloatArray]]:
    """Torques and angles of both branches of each cycle as they were recorded, shape (channels, samples)."""
    channels = [values for name in COMPARED if (values := getattr(found.recorded, name)) is not None]
    rising, falling = ([np.stack([pair[side].run.take(values) for values in channels]) for pair in found.pairs]
                       for side in (0, 1))  # fmt: skip
    return list(zip(rising, falling, strict=True))


def _alike(one: FloatArray, other: FloatArray) -> float:
    """Share of equal samples, counted from the start or from the end, whichever has more."""
    return max(float((first == second).all(axis=0).mean()) for first, second in _beside(one, other))


def _beside(one: FloatArray, other: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Samples of two branches side by side from the start and, where one of them is longer, from the end."""
    lengths = one.shape[1], other.shape[1]
    size = min(lengths)
    from_start = (one[:, :size], other[:, :size])
    return [from_start] if lengths == (size, size) else [from_start, (one[:, -size:], other[:, -size:])]


def _noise_alike(one: FloatArray, other: FloatArray) -> float:
    """Correlation of what each sample has that its neighbours have not, counted from the start or from the end.

    one, other: second differences of the torques of two branches. Median over short blocks, of the channel that is most
    alike: what the load does at a turn comes again in each cycle.
    """
    if min(one.shape[1], other.shape[1]) < BLOCK:
        return 0.0
    found = 0.0
    for first, second in _beside(one, other):
        left, right = _in_blocks(first), _in_blocks(second)
        both = np.sqrt(np.square(left).sum(axis=0) * np.square(right).sum(axis=0))
        shared = (left * right).sum(axis=0) / np.where(both > 0.0, both, np.inf)
        found = max(found, *np.median(shared, axis=1).tolist(), 0.0)
    return found if found > CHANCE else 0.0


def _in_blocks(values: FloatArray) -> FloatArray:
    """Whole blocks of channels, shape (samples of a block, channels, blocks).

    Laid out so, sums over the samples of a block take a tenth of the time.
    """
    channels, size = values.shape
    whole = size // BLOCK * BLOCK
    return np.ascontiguousarray(values[:, :whole].reshape(channels, -1, BLOCK).transpose(2, 0, 1))


FIGURES: dict[str, Figure] = {
    "wrong_way": wrong_way,
    "loop_closure": loop_closure,
    "drift": drift,
    "repeat": repeat,
    "copied_cycles": copied_cycles,
    "repeated_samples": repeated_samples,
}
"""Figures of these checks, by their ids."""
