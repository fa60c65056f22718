"""The drive's position beyond the 32 bits of its object 0x6064: a count that goes on where the drive's wraps."""

from __future__ import annotations

HALF_TURN_OF_COUNTS = 1 << 31
ALL_COUNTS = (1 << 32) - 1


class PositionCount:
    """Follows a position of 32 bits that wraps; between two values it moves by less than half of its range.

    The count starts as the drive's own. A reference that the drive sets anew (homing) may leave the two apart by whole
    ranges: only differences of positions mean anything, and those are right.
    """

    def __init__(self) -> None:
        self._counts = 0

    def follow(self, position_counts: int) -> int:
        """Return the count that a position (-2³¹ … 2³¹ - 1, or any number of the same 32 bits) stands for."""
        moved = (position_counts - self._counts + HALF_TURN_OF_COUNTS & ALL_COUNTS) - HALF_TURN_OF_COUNTS
        self._counts += moved
        return self._counts
