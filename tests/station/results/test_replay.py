"""Replay of damaged, cut and changed records, on a controller small enough to see through."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from station_samples import IMAGE, ORDERS

from definitions.image import Image, Orders
from station.records.samples.scan_record import RECORD_BYTES, pack
from station.results.replay import replay

SCANS = 12


class Sums:
    """Orders the sum of what it has seen, so that every scan depends on all before it."""

    def __init__(self) -> None:
        self.sum = 0.0

    def step(self, image: Image, scan: int) -> Orders:
        self.sum += image.torque_in_nm + scan
        return ORDERS._replace(reference_torque_nm=self.sum, cycle=scan)


def recorded(scans: int = SCANS) -> list[bytes]:
    line = Sums()
    images = [IMAGE._replace(torque_in_nm=0.1 * n) for n in range(scans)]
    return [pack((n, 2 * n, 5, 9), image, line.step(image, 2 * n)) for n, image in enumerate(images)]


def test_same_controller_is_identical() -> None:
    assert replay(b"".join(recorded()), Sums()) == (SCANS, None, "", 0)


@given(cut=st.integers(min_value=0, max_value=SCANS * RECORD_BYTES))
def test_a_record_cut_anywhere_replays_up_to_the_cut(cut: int) -> None:
    found = replay(b"".join(recorded())[:cut], Sums())
    assert found.same
    assert (found.identical, found.cut_bytes) == divmod(cut, RECORD_BYTES)


@given(position=st.integers(min_value=0, max_value=SCANS * RECORD_BYTES - 1), bit=st.integers(0, 7))
def test_any_flipped_bit_is_damage_at_its_record(position: int, bit: int) -> None:
    content = bytearray(b"".join(recorded()))
    content[position] ^= 1 << bit
    found = replay(bytes(content), Sums())
    assert not found.same
    assert found.identical == position // RECORD_BYTES
    assert "CRC" in found.damage


def test_missing_records_are_named() -> None:
    rows = recorded()
    found = replay(b"".join(rows[:4] + rows[7:]), Sums())
    assert (found.identical, found.same) == (4, False)
    assert "records 4 to 6 are missing" in found.damage


def test_one_missing_record_is_one() -> None:
    rows = recorded()
    found = replay(b"".join(rows[:4] + rows[5:]), Sums())
    assert found.damage == "record 4 is missing: the record buffer was full, or the file was changed"


@pytest.mark.parametrize("order", [[0, 1, 3, 2, 4, 5], [0, 1, 5, 2, 3, 4], [0, 1, 5, 3, 4, 2], [0, 1, 5, 3, 4]])
def test_records_out_of_order_are_not_called_missing(order: list[int]) -> None:
    rows = recorded()
    found = replay(b"".join(rows[number] for number in order), Sums())
    assert (found.identical, found.same) == (2, False)
    assert found.damage == (f"record {order[2]} is in the place of record 2, which comes later: the file was changed")


@pytest.mark.parametrize("again", [0, 5, SCANS - 1])
def test_a_record_that_stands_there_twice_is_not_called_missing(again: int) -> None:
    rows = recorded()
    found = replay(b"".join([*rows, rows[again]]), Sums())
    assert found.identical == SCANS
    assert found.damage == (f"record {again} is repeated in the place of record {SCANS}: the file was changed")


@pytest.mark.parametrize("at", [0, 5, SCANS - 1])
def test_first_differing_scan_is_shown_field_by_field(at: int) -> None:
    class Changed(Sums):
        def step(self, image: Image, scan: int) -> Orders:
            orders = super().step(image, scan)
            return orders._replace(cycle=999) if scan >= 2 * at else orders

    found = replay(b"".join(recorded()), Changed())
    assert found.identical == at
    difference = found.difference
    assert difference is not None
    assert (difference.sequence, difference.scan) == (at, 2 * at)
    assert [(pair.name, pair.recorded, pair.replayed) for pair in difference.pairs() if pair.differs] == [
        ("cycle", 2 * at, 999),
    ]
    assert [line.split()[1] for line in difference.lines(1_000_000)[2:] if line.startswith("  * ")] == ["cycle"]


def test_negative_zero_is_a_difference() -> None:
    class Negative:
        def step(self, _image: Image, _scan: int) -> Orders:
            return ORDERS._replace(reference_torque_nm=-0.0)

    found = replay(pack((0, 0, 0, 0), IMAGE, ORDERS._replace(reference_torque_nm=0.0)), Negative())
    assert found.difference is not None
