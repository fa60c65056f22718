"""A position of 32 bits that wraps: what counts on, and that two channels which agree go on agreeing."""

from __future__ import annotations

import pytest

from drivers.servo_drive.position_count import PositionCount

LEAST, MOST = -(2**31), 2**31 - 1


@pytest.mark.parametrize("first", [0, 1, -1, LEAST, MOST, 123_456_789])
def test_it_begins_as_the_drive_counts(first):
    assert PositionCount().follow(first) == first


@pytest.mark.parametrize(
    ("positions", "counts"),
    [
        ((MOST - 1, LEAST + 1), (MOST - 1, MOST + 2)),
        ((LEAST, MOST, LEAST), (LEAST, LEAST - 1, LEAST)),
        ((MOST, LEAST, LEAST + 10, 0), (MOST, MOST + 1, MOST + 11, MOST + 1 + 2**31)),
        # half of the range at once, as when a frame is wrong: back where it was
        ((5, MOST, 5), (5, MOST, 5)),
        ((5, LEAST, 5), (5, MOST + 1, 5)),
    ],
)
def test_it_counts_on_over_both_ends(positions, counts):
    count = PositionCount()
    assert tuple(count.follow(position) for position in positions) == counts


def test_many_turns_are_counted():
    count, turned = PositionCount(), 0
    for step in range(20):
        turned = count.follow((step * 2**29 + 2**31) % 2**32 - 2**31)
    assert turned == 19 * 2**29
