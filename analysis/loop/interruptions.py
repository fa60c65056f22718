"""Stage: stretches of a ramp in which torque and wind-up stand or go back, and the step that they leave in the branch.

A hold, or an overshoot that is taken back, is no part of a branch: the unit creeps while it rests, and goes through a
small loop of its own. Both torque and wind-up slow down there; where a unit takes up its play one of them does not, or
both do for as long as the torque had run ahead before.
Such a stretch is left out until the torque is beyond all that it was before. What it leaves is a step of the wind-up
between the branch before and after it, read by one cubic through both sides.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy  # loads ndimage where it is used

from analysis.loop.branches import Blocks, Branch
from analysis.loop.loop import Loop
from analysis.loop.samples import BranchSamples
from analysis.loop.stages import Figure, StageRecord
from analysis.trace.units import BoolArray, FloatArray

SLOWED, CREEPS = 0.3, 0.85
"""Shares of the rates around them below which torque and wind-up have slowed down: the wind-up may creep at rest."""

STEADY = 0.15
"""Deviation of half of all rates from their median below which it is the torque that is ramped, where the wind-up is
less steady: it then stands for itself. On a ramp of constant speed it slows down wherever the unit is softer."""

AT_REST = 0.2
"""Share of the rate that half of the torque was gone through by, below which a ramp does not go on: a block there says
nothing of what is usual, for a rest may take most of a branch's time."""

UNDER_WAY = 0.7
"""Share of these rates at which a ramp is under way: what comes before is its start, what comes after its end."""

LEAST_USUAL = 0.5
"""Share of the median of all rates that the rates around a block are at least: of a long rest they are noise. As long
as friction reverses the output torque of a loaded input hardly changes, and below this share no rest is told."""

REVERSED = 0.5
"""Share of the median rate of the wind-up at which friction has reversed."""

AROUND = 20
"""Blocks on each side that say what the rates are."""

LEAST_ROWS, LEAST_BLOCKS = 4, 12
"""Rows of a block at least, and blocks of a branch of which stretches are told."""

BLOCK_SHARE = 0.0015
"""Share of the rows of a branch that a block is at least: rows that were written several times show little noise."""

NOISE_SHARE = 24.0
"""Rows of a block to the power of 3/2, in noise of the torque over its advance per row: the noise of a rate is then a
sixteenth of it."""

AT_ZERO = 0.01
"""Share of the torque of a branch on each side of zero within which the unit goes over from unloading to loading."""

GOES_OVER_S = 0.067
"""Time of the ramp that this costs, less than that [s]. From there on the input needs more torque for the same advance,
and what follows with 15/s, as the torque law of a bench does, is behind by its time of 67 ms at most. Sound and worn
units cost 4 to 22 ms at 120 N·m/s, and 17 to 50 ms at 60 N·m/s. A rest costs as much again as it lasts."""

RUNS_AHEAD = 6
"""Blocks in which the torque may run ahead through the play before it waits for its ramp: so much time is not lost."""

WAITS_S = 0.2
"""Time in which it has come back to its ramp, with one block [s]: three times that of the torque law. Units take up to
0.15 s at 40 N·m/s and more, and 0.2 s at 20 N·m/s."""

LANDS = 0.002
"""Share of the torque of a branch by which the torque goes back as the play has been taken up: the unit lands, and
rebounds by no more than 0.5 N·m of 906."""

LEAST_BACK = 0.001
"""Share of the wind-up of a branch by which it goes back: on its way over zero that of no unit does, beside noise."""

AT_TURN = 0.005
"""Share of the torque of a branch within which it has not left its turn, or has come to the next one."""

REACH_SHARE = 0.025
"""Share of the torque of a branch on each side of a stretch by which its step is read."""

LEAST_SIDE = 12
"""Rows on a side by which a step is read, at least."""


class Interruption(NamedTuple):
    """One stretch of a branch that is left out: rows of its samples, torque [N·m] and time of it, and its step.

    cycle: from 1. direction: of the branch. seconds: rows where the trace has no time. step_arcmin: wind-up after less
    before it; None where too little of the branch is beside it. u_arcmin: standard uncertainty of it by what the curve
    leaves over.
    """

    cycle: int
    direction: int
    rows: slice
    low_nm: float
    high_nm: float
    seconds: float
    step_arcmin: float | None
    u_arcmin: float

    @property
    def middle_nm(self) -> float:
        """Torque at which the step is."""
        return (self.low_nm + self.high_nm) / 2.0

    @property
    def place(self) -> str:
        """Say in words where it is: cycle, branch and torques."""
        branch = "rising" if self.direction > 0 else "falling"
        return f"cycle {self.cycle}, {branch} branch, {self.low_nm:.4g} to {self.high_nm:.4g} N·m"


def interruptions_of(sides: Sequence[BranchSamples]) -> tuple[Interruption, ...]:
    """Return the interruptions of all branches that were loaded in one ramp."""
    return tuple(one for side in sides if len(side.run.pieces) == 1 for one in _of_branch(side))


def _of_branch(side: BranchSamples) -> Iterator[Interruption]:
    torque = side.run.direction * side.torque_nm
    rows = np.arange(torque.size, dtype=np.float64)
    time = rows if side.t_s is None else side.t_s
    size = _block_rows(torque)
    if torque.size < LEAST_BLOCKS * size:
        return
    edges = np.arange(0, torque.size - size + 1, size)
    at, load, angle = (
        np.add.reduceat(values[: edges[-1] + size], edges) / size
        for values in (time, torque, side.run.direction * side.windup_arcmin)
    )
    found: list[tuple[int, int]] = []
    margin = AT_TURN * float(np.ptp(load))
    begins = int(np.flatnonzero(load <= load[0] + margin)[-1])
    ends = int(np.argmax(load >= load[-1] - margin))
    slow = list(_slow(np.diff(at), np.diff(load), np.diff(angle), begins, ends))
    own = () if side.t_s is None else _going_over(at, load, angle, slow)
    for first, last in slow:
        if (first, last) in own:
            continue
        beyond = np.flatnonzero(load[last + 1 :] > load[: last + 2].max())
        if not beyond.size:
            continue  # the ramp has ended here
        start = int(edges[first])
        stop = int(edges[max(min(last + 2, edges.size - 1), last + 1 + int(beyond[0]))])
        if found and start <= found[-1][1]:
            start, stop = found[-1][0], max(stop, found.pop()[1])
        found.append((start, stop))
    for start, stop in found:
        inside = torque[start:stop]
        step, u = _step(torque, side.run.direction * side.windup_arcmin, start, stop)
        low, high = sorted((side.run.direction * float(inside.min()), side.run.direction * float(inside.max())))
        signed = None if step is None else side.run.direction * step
        seconds = float(time[stop - 1] - time[start])
        yield Interruption(side.cycle, side.run.direction, slice(start, stop), low, high, seconds, signed, u)


def _block_rows(torque: FloatArray) -> int:
    """Rows of a block: so many that noise does not look like a rest."""
    noise = math.sqrt(float(np.square(np.diff(torque, 2)).mean()) / 6.0) if torque.size > 2 else 0.0
    advance = abs(float(torque[-1] - torque[0])) / max(torque.size - 1, 1)
    by_noise = math.ceil((NOISE_SHARE * noise / advance) ** (2.0 / 3.0)) if advance else 0
    return max(LEAST_ROWS, math.ceil(BLOCK_SHARE * torque.size), by_noise)


def _slow(step: FloatArray, load: FloatArray, angle: FloatArray, begins: int, ends: int) -> Iterator[tuple[int, int]]:
    """Yield first and last difference of blocks in which torque and wind-up are slow, between others that are not.

    begins, ends: blocks at which the branch leaves its turn and comes to the next one.
    """
    if not (step > 0.0).all():
        return
    torque_rate, angle_rate = load / step, angle / step
    goes_on = torque_rate > AT_REST * _half_way(torque_rate, load)
    if not goes_on.any():
        return
    usual = [float(np.median(rate[goes_on])) for rate in (torque_rate, angle_rate)]
    reversed_at = int(np.argmax(angle_rate > REVERSED * usual[1]))
    both = list(zip((torque_rate, angle_rate), usual, strict=True))
    rates = [_over_usual(rate, of_all, reversed_at) for rate, of_all in both]
    of_load, of_angle = (
        np.quantile(np.abs(rate[goes_on] / of_all - 1.0), (0.5, 0.95)).tolist() for rate, of_all in both
    )
    of_torque = of_load[0] < STEADY and of_load[1] < of_angle[1]
    slow: BoolArray = (rates[0] < SLOWED) & (of_torque | (rates[1] < CREEPS))
    moving = np.flatnonzero(rates[0] > UNDER_WAY)
    if not moving.size:
        return
    slow[: max(begins, int(moving[0]))] = False
    slow[min(ends, int(moving[-1])) :] = False
    borders = np.flatnonzero(np.diff(np.concatenate(([0], slow.astype(np.int8), [0]))))
    for first, behind in zip(borders[::2].tolist(), borders[1::2].tolist(), strict=True):
        before = moving[moving < first]
        after = moving[moving >= behind]
        yield int(before[-1]), int(after[0])


def _going_over(
    at: FloatArray, load: FloatArray, angle: FloatArray, slow: Sequence[tuple[int, int]]
) -> Sequence[tuple[int, int]]:
    """Return the slow stretches in which a sound ramp goes over from unloading to loading; none where it rested there.

    All at zero together: neither torque nor wind-up goes back, the ramp is soon under way again, and it loses next to
    no time, for a torque that waits for it ran ahead before, through the play and no earlier. slow: differences of
    blocks about each stretch that are not slow.
    """
    zone = AT_ZERO * float(np.ptp(load))
    there = [(first, last) for first, last in slow if load[first] <= zone and load[last] >= -zone]
    if not there:
        return ()
    first, last = there[0][0], there[-1][1]
    steps = np.diff(at)
    waits_s = float(at[last] - at[first + 1])
    if waits_s > WAITS_S + float(np.median(steps)) or _back(angle, first, last) > LEAST_BACK * float(np.ptp(angle)):
        return ()
    # of a rest that takes most of the branch the median is noise
    usual = max(float(np.median(np.diff(load) / steps)), float((load[-1] - load[0]) / (at[-1] - at[0])))
    behind = at - load / usual  # of the ramp [s], by what it was somewhere
    before = np.arange(max(first + 1 - RUNS_AHEAD, 0), first + 2)
    in_play = before[load[before] >= -zone]
    lost_s = float(behind[last] - behind[in_play if in_play.size else before[-1:]].max())
    return there if _back(load, first, last) < LANDS * float(np.ptp(load)) and lost_s < GOES_OVER_S else ()


def _back(values: FloatArray, first: int, last: int) -> float:
    """Return by how much values go back at most from one place to another."""
    between = values[first : last + 1]
    return float((np.maximum.accumulate(between) - between).max())


def _half_way(rate: FloatArray, advance: FloatArray) -> float:
    """Return the rate that half of the torque was gone through by: rests have no part in it, however long they are."""
    order = np.argsort(rate)
    gone = np.cumsum(np.maximum(advance[order], 0.0))
    return float(rate[order[np.searchsorted(gone, gone[-1] / 2.0)]])


def _over_usual(rate: FloatArray, of_all: float, reversed_at: int) -> FloatArray:
    """Return rates over the median of those around them; 1 where that tells nothing, as friction reverses.

    of_all: their median where the ramp goes on.
    """
    if rate.size > AROUND:
        usual: FloatArray = scipy.ndimage.median_filter(rate, 2 * AROUND + 1, mode="mirror")
    else:
        usual = np.full(rate.size, of_all)
    least = LEAST_USUAL * of_all
    told = (np.arange(rate.size) >= reversed_at) | (usual >= least)
    found: FloatArray = np.where(told, rate / np.maximum(usual, least), 1.0) if least > 0.0 else np.ones(rate.size)
    return found


def _step(torque: FloatArray, angle: FloatArray, start: int, stop: int) -> tuple[float | None, float]:
    """Return the step of the wind-up across rows that are left out, and its standard uncertainty [arcmin]."""
    reach = REACH_SHARE * abs(float(torque[-1] - torque[0]))
    before = np.flatnonzero(torque[:start] >= torque[:start].max(initial=-math.inf) - reach)
    after = stop + np.flatnonzero(torque[stop:] <= torque[stop:].min(initial=math.inf) + reach)
    if min(before.size, after.size) < LEAST_SIDE:
        return None, 0.0
    rows = np.concatenate((before, after))
    x = (torque[rows] - torque[rows].mean()) / (2.0 * reach)
    columns = np.stack([x**3, x**2, x, np.ones(rows.size), (rows >= stop).astype(np.float64)], axis=1)
    found, *_ = np.linalg.lstsq(columns, angle[rows], rcond=None)
    left = angle[rows] - columns @ found
    variance = float(np.square(left).sum()) / (rows.size - columns.shape[1])
    covariance = variance * np.linalg.pinv(columns.T @ columns)
    return float(found[-1]), math.sqrt(float(covariance[-1, -1]))


def without_interruptions(blocks: Blocks, some: Sequence[Interruption]) -> Blocks:
    """Return the blocks of a branch without those that hold rows of its interruptions."""
    if not some:
        return blocks
    ends = np.cumsum(blocks.counts)
    starts = ends - blocks.counts
    kept = np.ones(ends.size, dtype=np.bool_)
    for one in some:
        kept &= (ends <= one.rows.start) | (starts >= one.rows.stop)
    time = None if blocks.t_s is None else blocks.t_s[kept]
    return Blocks(blocks.torque_nm[kept], blocks.angle_arcmin[kept], time, blocks.counts[kept])


def of_branch(some: Sequence[Interruption], cycle: int, direction: int) -> list[Interruption]:
    """Return the interruptions of one branch."""
    return [one for one in some if (one.cycle, one.direction) == (cycle, direction)]


def mended(loops: Sequence[Loop], some: Sequence[Interruption]) -> list[Loop]:
    """Return each cycle with what comes after an interruption moved back by its step; none without interruptions."""
    if not some:
        return []
    found = []
    for cycle, loop in enumerate(loops, start=1):
        forward, backward = (
            _moved_back(branch, of_branch(some, cycle, direction), direction)
            for branch, direction in ((loop.forward, 1), (loop.backward, -1))
        )
        found.append(replace(loop, forward=forward, backward=backward))
    return found


def _moved_back(branch: Branch, some: Sequence[Interruption], direction: int) -> Branch:
    angle = branch.angle_arcmin
    for one in some:
        angle = angle - (one.step_arcmin or 0.0) * after(branch.torque_nm, one, direction)
    return Branch(branch.torque_nm, angle)


def after(torque_nm: FloatArray, one: Interruption, direction: int) -> FloatArray:
    """Return 1 where a branch has passed an interruption, else 0."""
    passed: FloatArray = (direction * torque_nm > direction * one.middle_nm).astype(np.float64)
    return passed


def interruption_records(some: Sequence[Interruption]) -> tuple[StageRecord, ...]:
    """Say what was left out of the branches; nothing where nothing was."""
    if not some:
        return ()
    words = "; ".join(
        f"{one.place}, " + ("step not known" if one.step_arcmin is None else f"step {one.step_arcmin:.2g} arcmin")
        for one in some
    )
    steps = [abs(one.step_arcmin) for one in some if one.step_arcmin is not None]
    figures = {
        "interruptions": Figure(len(some), "1"),
        "widest": Figure(max(one.high_nm - one.low_nm for one in some), "N·m"),
        "largest step": Figure(max(steps, default=math.inf), "arcmin"),
    }
    return (StageRecord("interruptions", f"interrupted ramps, left out: {words}", figures, applied=True),)
