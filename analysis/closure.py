"""Closure of a loop: how far the wind-up at the end of a cycle is from the one at its start, at the same torque."""

from __future__ import annotations

from collections.abc import Sequence

from analysis.branches import Blocks
from analysis.samples import BranchSamples

END_SHARE = 50
"""The slope at the end of a branch is read over a fiftieth of its blocks."""


def closure_gaps_arcmin(
    pairs: Sequence[tuple[BranchSamples, BranchSamples]], blocks: Sequence[Blocks]
) -> list[float] | None:
    """Return the gap of each cycle [arcmin, not negative]; None where the torque after a reversal is masked.

    pairs: rising and falling branch of each cycle; blocks: the same branches in turn, in order of time.
    """
    gaps = []
    for number, pair in enumerate(pairs):
        both = blocks[2 * number : 2 * number + 2]
        order = (0, 1) if pair[0].run.pieces[0].start < pair[1].run.pieces[0].start else (1, 0)
        if pair[order[0]].masked:
            return None
        leaving, arriving = both[order[0]], both[order[1]]
        reach = max(1, arriving.torque_nm.size // END_SHARE)
        way = float(arriving.torque_nm[-1] - arriving.torque_nm[-1 - reach])
        slope = float(arriving.angle_arcmin[-1] - arriving.angle_arcmin[-1 - reach]) / way if way else 0.0
        between = slope * float(leaving.torque_nm[0] - arriving.torque_nm[-1])
        gaps.append(abs(float(leaving.angle_arcmin[0] - arriving.angle_arcmin[-1]) - between))
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
