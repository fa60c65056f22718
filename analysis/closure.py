"""Closure of a loop: how far the wind-up at the end of a cycle is from the one at its start, at the same torque."""

from __future__ import annotations

from collections.abc import Sequence

from analysis.branches import Blocks, Branch
from analysis.loop import Loop
from analysis.samples import BranchSamples

END_SHARE = 50
"""The slope at the end of a branch is read over a fiftieth of its blocks."""


def closure_gaps_arcmin(
    pairs: Sequence[tuple[BranchSamples, BranchSamples]], blocks: Sequence[Blocks]
) -> list[float] | None:
    """Return the gap of each cycle [arcmin, not negative]; None where the torque after a reversal is masked.

    pairs: rising and falling branch of each cycle; blocks: the same branches in turn, in order of time.
    """
    found = _signed_gaps(pairs, blocks)
    return None if found is None else [abs(gap) for gap, _ in found]


def closed_loops(
    loops: Sequence[Loop], pairs: Sequence[tuple[BranchSamples, BranchSamples]], blocks: Sequence[Blocks]
) -> list[Loop] | None:
    """Return each cycle as it would be if its whole gap had been a slip at the turn: its later branch moved back.

    loops, pairs, blocks: of the same cycles. None where the torque after a reversal is masked.
    """
    found = _signed_gaps(pairs, blocks)
    if found is None:
        return None
    closed = []
    for loop, (gap, rising_first) in zip(loops, found, strict=True):
        later = loop.backward if rising_first else loop.forward
        moved = Branch(later.torque_nm, later.angle_arcmin + gap)
        closed.append(
            Loop(loop.forward, moved, loop.method) if rising_first else Loop(moved, loop.backward, loop.method)
        )
    return closed


def _signed_gaps(
    pairs: Sequence[tuple[BranchSamples, BranchSamples]], blocks: Sequence[Blocks]
) -> list[tuple[float, bool]] | None:
    """Gap of each cycle: what its later branch lacks [arcmin], and whether the rising one came first."""
    gaps = []
    for number, pair in enumerate(pairs):
        both = blocks[2 * number : 2 * number + 2]
        rising_first = pair[0].run.pieces[0].start < pair[1].run.pieces[0].start
        if pair[0 if rising_first else 1].masked:
            return None
        leaving, arriving = both if rising_first else both[::-1]
        reach = max(1, arriving.torque_nm.size // END_SHARE)
        way = float(arriving.torque_nm[-1] - arriving.torque_nm[-1 - reach])
        slope = float(arriving.angle_arcmin[-1] - arriving.angle_arcmin[-1 - reach]) / way if way else 0.0
        between = slope * float(leaving.torque_nm[0] - arriving.torque_nm[-1])
        gaps.append((float(leaving.angle_arcmin[0] - arriving.angle_arcmin[-1]) - between, rising_first))
    return gaps


def widest_jump_nm(blocks: Sequence[Blocks]) -> float:
    """Return the largest torque between the end of a branch and the start of the other one of its cycle [N·m].

    blocks: rising and falling branch of each cycle in turn. What lies in such a jump is not in the trace.
    """
    pairs = zip(blocks[::2], blocks[1::2], strict=True)
    jumps = [
        min(abs(float(one.torque_nm[0] - other.torque_nm[-1])) for one, other in ((rising, falling), (falling, rising)))
        for rising, falling in pairs
    ]
    return max(jumps)
