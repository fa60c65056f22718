from __future__ import annotations

import struct

import numpy as np
import pytest
from station_samples import IMAGE, ORDERS

from definitions.image import IMAGE_FIELDS, ORDERS_FIELDS
from station.records.samples.check import check_bytes
from station.records.samples.layout import CURRENT, NUMPY_TYPES
from station.records.samples.scan_record import BODY_BYTES, RECORD_BYTES, pack, unpack
from station.records.samples.table import table_of


def records(count: int) -> bytes:
    return b"".join(pack((n, n + n // 3, 20 * n, 30 * n), IMAGE._replace(command=n % 5), ORDERS) for n in range(count))


def test_numpy_and_struct_see_the_same_bytes() -> None:
    assert CURRENT.dtype.itemsize == CURRENT.record_bytes == RECORD_BYTES
    row = np.frombuffer(pack((7, 9, -3, 4), IMAGE, ORDERS), dtype=CURRENT.dtype)[0]
    assert (row["sequence"], row["scan"], row["lateness_ns"], row["work_ns"]) == (7, 9, -3, 4)
    assert tuple(row["image"].item()) == tuple(IMAGE)
    assert tuple(row["orders"].item()) == tuple(ORDERS)


def test_every_format_of_the_field_tables_has_a_numpy_type() -> None:
    for field in (*IMAGE_FIELDS, *ORDERS_FIELDS):
        assert np.dtype(NUMPY_TYPES[field.format]).itemsize == struct.calcsize("<" + field.format)


def test_unpack_returns_what_was_packed() -> None:
    assert unpack(pack((7, 9, -3, 4), IMAGE, ORDERS)) == (9, IMAGE, ORDERS)


def test_description_covers_the_record_without_gaps() -> None:
    at = 0
    for channel in CURRENT.channels:
        assert channel.offset == at
        at += struct.calcsize("<" + channel.format)
    assert at == RECORD_BYTES


def test_joined_tables_keep_the_layout() -> None:
    rows = table_of(records(3)).rows
    assert np.concatenate([rows, rows]).tobytes() == records(3) * 2


def test_sound_records_read_back() -> None:
    assert check_bytes(records(20), expected=20).sound


@pytest.mark.parametrize("offset", [0, 8, 20, 100, BODY_BYTES - 1, BODY_BYTES, RECORD_BYTES - 1])
def test_one_flipped_bit_anywhere_is_found_and_placed(offset: int) -> None:
    content = bytearray(records(20))
    content[13 * RECORD_BYTES + offset] ^= 0x10
    report = check_bytes(bytes(content))
    assert report.problems == ("1 of 20 records fail their CRC, the first at position 13",)


def test_a_missing_record_is_found() -> None:
    content = records(20)
    report = check_bytes(content[: 5 * RECORD_BYTES] + content[6 * RECORD_BYTES :])
    assert report.problems == ("the sequence has a gap: position 5 holds record 6",)


def test_a_missing_tail_is_found_by_its_count() -> None:
    assert check_bytes(records(19), expected=20).problems == ("19 records found, 20 were written",)


def test_a_record_cut_off_is_found_and_left_out() -> None:
    content = records(5)[:-10]
    assert not check_bytes(content).sound
    assert len(table_of(content)) == 4
