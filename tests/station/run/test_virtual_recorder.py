"""Records of a virtual-time run: what is in the file, when, and what one bad record costs."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from station_samples import IMAGE, ORDERS

from station.atomic_file import Appender
from station.records.samples.scan_record import RECORD_BYTES, pack, unpack
from station.run.virtual_run import BLOCK_RECORDS, VirtualRecorder


@pytest.mark.parametrize("count", [0, 1, BLOCK_RECORDS - 1, BLOCK_RECORDS, 2 * BLOCK_RECORDS + 3])
def test_every_record_is_in_the_file_as_it_would_be_packed_alone(tmp_path: Path, count: int) -> None:
    path = tmp_path / "samples.bin"
    file = Appender(path)
    recorder = VirtualRecorder(file)
    for scan in range(count):
        assert recorder.append(3 * scan, 0, 0, IMAGE, ORDERS)
    assert path.stat().st_size == count // BLOCK_RECORDS * BLOCK_RECORDS * RECORD_BYTES
    recorder.flush()
    recorder.flush()
    file.close()
    assert path.read_bytes() == b"".join(pack((n, 3 * n, 0, 0), IMAGE, ORDERS) for n in range(count))


def test_the_newest_record_is_there_to_be_shown_at_any_time(tmp_path: Path) -> None:
    recorder = VirtualRecorder(Appender(tmp_path / "samples.bin"))
    assert not recorder.last()
    for scan in range(BLOCK_RECORDS + 2):
        recorder.append(scan, 0, 0, IMAGE, ORDERS)
        if scan % 100 == 0 or scan >= BLOCK_RECORDS - 1:
            assert unpack(recorder.last())[0] == scan
    assert unpack(recorder.last())[0] == BLOCK_RECORDS + 1, "asked twice"


def test_a_record_that_cannot_be_packed_costs_none_before_it(tmp_path: Path) -> None:
    path = tmp_path / "samples.bin"
    recorder = VirtualRecorder(Appender(path))
    for scan in range(100):
        recorder.append(scan, 0, 0, IMAGE, ORDERS)
    recorder.append(100, 0, 0, IMAGE._replace(drive_state=-1), ORDERS)
    with pytest.raises(struct.error):
        recorder.flush()
    assert path.read_bytes() == b"".join(pack((n, n, 0, 0), IMAGE, ORDERS) for n in range(100))
