"""How the end of a scan process is told that never took its spec: nothing has moved, and the reason is said."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from station.atomic_file import Appender
from station.errors import BenchFaultError
from station.records.ring.reader import RingReader
from station.records.ring.ring import W_LOST, W_WRITTEN, create
from station.records.ring.to_disk import RecordWriter
from station.records.run_record import RunRecord
from station.run import children
from station.run.scan_end import SCAN_LOG, outcome_of
from station.run.silent_scan import WHY_ENDED
from station.scan.scan_spec import SpecFile
from station.wall_clock import JumpWatch


@contextmanager
def _ring(folder: Path) -> Iterator[RingReader]:
    path = create(folder)
    ring = RingReader(path)
    try:
        yield ring
    finally:
        ring.close()
        path.unlink()


def test_a_spec_that_was_changed_ends_the_run_before_anything_moves(tmp_path: Path) -> None:
    spec = SpecFile(tmp_path / "scan-spec.json", "0" * 64)
    spec.path.write_text("{}")
    process = children.start_scanning("station.scan.scan_process", spec, tmp_path / SCAN_LOG, None)
    process.wait(60.0)
    record = RunRecord(tmp_path)
    with _ring(tmp_path) as ring:
        file = Appender(tmp_path / "samples.bin")
        writer = RecordWriter(ring, file)
        with pytest.raises(BenchFaultError, match=r"scan-spec\.json was changed after it was checked"):
            outcome_of(process, ring, record, writer, JumpWatch(), embedded=False, interrupted=False)
        file.close()


def test_records_that_found_the_ring_full_are_no_written_ones_of_a_scan_that_did_not_report(tmp_path: Path) -> None:
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait(60.0)
    with _ring(tmp_path) as ring:
        ring._words[W_WRITTEN], ring._words[W_LOST] = 100, 30
        file = Appender(tmp_path / "samples.bin")
        writer = RecordWriter(ring, file)
        outcome = outcome_of(
            process, ring, RunRecord(tmp_path), writer, JumpWatch(), embedded=False, interrupted=False, given_up=True
        )
        file.close()
    assert (outcome.written, outcome.lost) == (100, 30)
    assert WHY_ENDED in outcome.trouble
