"""What a recovery takes up of the runs before it: also after one that was killed before its first record."""

from __future__ import annotations

from pathlib import Path

from ended_runs import bench_of

from station.records.data_folder import Store
from station.run.way_back.left_by import NO_FAULT, left_by, taken_up


def test_a_run_without_a_record_leaves_a_closed_lock_and_no_zeroes(tmp_path: Path) -> None:
    """The station asked for a recovery that the command refused, for a start that was killed."""
    killed = Store(tmp_path).create("SN-1", bench_of("bench-3"), {})
    left = left_by(killed, None, ())
    assert (left.fault, left.zeroes_unknown) == (NO_FAULT, True)
    assert not taken_up(left).zeroes_known
