from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from station_samples import IMAGE, ORDERS

from controller.image import IMAGE_FIELDS, ORDERS_FIELDS
from station.record.check import NUMPY_TYPES, RECORD_DTYPE, check_bytes, check_file, read_table
from station.record.scan_record import BODY_BYTES, RECORD_BYTES, describe, pack, unpack


def records(count: int) -> bytes:
    return b"".join(pack((n, n + n // 3, 20 * n, 30 * n), IMAGE._replace(command=n % 5), ORDERS) for n in range(count))


def test_numpy_and_struct_see_the_same_bytes() -> None:
    assert RECORD_DTYPE.itemsize == RECORD_BYTES
    row = np.frombuffer(pack((7, 9, -3, 4), IMAGE, ORDERS), dtype=RECORD_DTYPE)[0]
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
    for row in describe():
        assert row["offset"] == at
        at += struct.calcsize("<" + str(row["format"]))
    assert at == RECORD_BYTES


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


def test_a_record_cut_off_is_found_and_left_out(tmp_path: Path) -> None:
    path = tmp_path / "samples.bin"
    path.write_bytes(records(5)[:-10])
    assert not check_file(path).sound
    assert len(read_table(path)) == 4


def test_a_missing_file_is_a_problem_not_an_exception(tmp_path: Path) -> None:
    assert not check_file(tmp_path / "none.bin").sound
