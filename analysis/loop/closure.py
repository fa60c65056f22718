"""Closure of a loop: how far the wind-up at the end of a cycle is from the one at its start, at the same torque."""

from __future__ import annotations

from collections.abc import Sequence

from analysis.loop.branches import Blocks, Branch
from analysis.loop.loop import Loop
from analysis.loop.measured import Measured
from analysis.loop.samples import BranchSamples

END_SHARE = 50
"""The slope at the end of a branch is read over a fiftieth of its blocks."""


def closure_gaps_arcmin(found: Measured) -> list[float]:
    """Return the gap of each cycle [arcmin, not negative]."""
    return [abs(gap) for gap, _ in _signed_gaps(found)]


def closed_loops(found: Measured) -> list[Loop]:
    """Return each cycle as it would be if its whole gap had been a slip at the turn: its later branch moved back."""
    closed = []
    for loop, (gap, rising_first) in zip(found.loops, _signed_gaps(found), strict=True):
        later = loop.backward if rising_first else loop.forward
        moved = Branch(later.torque_nm, later.angle_arcmin + gap)
        closed.append(
            Loop(loop.forward, moved, loop.method) if rising_first else Loop(moved, loop.backward, loop.method)
        )
    return closed


def _signed_gaps(found: Measured) -> list[tuple[float, bool]]:
    """Gap of each cycle: what its later branch lacks [arcmin], and whether the rising one came first."""
    gaps = []
    for pair, blocks in _cycles(found):
        rising_first = pair[0].run.pieces[0].start < pair[1].run.pieces[0].start
        first, last = (0, 1) if rising_first else (1, 0)
        leaving, arriving = blocks[first], blocks[last]
        reach = max(1, arriving.torque_nm.size // END_SHARE)
        way = float(arriving.torque_nm[-1] - arriving.torque_nm[-1 - reach])
        slope = float(arriving.angle_arcmin[-1] - arriving.angle_arcmin[-1 - reach]) / way if way else 0.0
        between = slope * _jump_nm(found, (pair[first], leaving), (pair[last], arriving))
        gaps.append((_first(pair[first], leaving) - float(arriving.angle_arcmin[-1]) - between, rising_first))
    return gaps


def _cycles(found: Measured) -> list[tuple[tuple[BranchSamples, BranchSamples], Sequence[Blocks]]]:
    """Rising and falling branch of each cycle, and their blocks."""
    return [(pair, found.blocks[2 * number : 2 * number + 2]) for number, pair in enumerate(found.pairs)]


def _first(samples: BranchSamples, blocks: Blocks) -> float:
    """Wind-up at the turn that a branch leaves [arcmin]: its first block, masked or not."""
    if not samples.masked:
        return float(blocks.angle_arcmin[0])
    return float(samples.cut.windup_arcmin[: int(blocks.counts[0])].mean())


def _jump_nm(found: Measured, leaving: tuple[BranchSamples, Blocks], arriving: tuple[BranchSamples, Blocks]) -> float:
    """Torque at the start of a branch less that at the end of the other one of its cycle [N·m].

    Where the start is masked it is that of the output as measured, for the torque may creep while the input stands;
    without one, it is that of the line before the turn, which still holds there.
    """
    (samples, blocks), (other, end) = leaving, arriving
    if not samples.masked:
        return float(blocks.torque_nm[0] - end.torque_nm[-1])
    output, first, last = found.trace.torque_out_nm, int(blocks.counts[0]), int(end.counts[-1])
    if output is None:
        return float(samples.cut.turn_nm[:first].mean() - end.torque_nm[-1])
    return float(samples.run.take(output)[:first].mean() - other.run.take(output)[-last:].mean())


def widest_jump_nm(found: Measured) -> float:
    """Return the largest torque between the end of a branch and the start of the other one of its cycle [N·m].

    What lies in such a jump is not in the trace.
    """
    jumps = []
    for pair, blocks in _cycles(found):
        rising, falling = zip(pair, blocks, strict=True)
        jumps.append(min(abs(_jump_nm(found, *turn)) for turn in ((rising, falling), (falling, rising))))
    return max(jumps)
