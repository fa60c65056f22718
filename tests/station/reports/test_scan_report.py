"""The report of the scan process on a disk that refuses it, or has no more room than was taken for it."""

from __future__ import annotations

import sys
from errno import ENOSPC
from pathlib import Path

import pytest

from station.documents.reading import read_document
from station.documents.scan_report import ScanReport
from station.scan import scan_process


class FullFile:
    """Standard error in a file on the same disk."""

    def write(self, _text: str) -> int:
        raise OSError(ENOSPC, "No space left on device")


def test_a_report_that_nobody_takes_ends_no_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", FullFile())
    path = tmp_path / "moved away" / "scan-report.json"
    scan_process._take_room(path)
    scan_process._tell(path, ScanReport(state="finished"), flush=True)


def test_the_last_report_goes_where_its_room_was_taken(tmp_path: Path) -> None:
    path = tmp_path / "scan-report.json"
    scan_process._tell(path, ScanReport(state="running"), flush=False)
    scan_process._take_room(path)
    (beside,) = tmp_path.glob(".*.part")
    room, inode = beside.stat().st_size, beside.stat().st_ino
    assert room >= 1 << 18
    assert read_document(ScanReport, path) == ScanReport(state="running")
    scan_process._tell(path, ScanReport(state="finished"), flush=True)
    assert read_document(ScanReport, path) == ScanReport(state="finished")
    assert path.stat().st_ino == inode
    assert [one.name for one in tmp_path.iterdir()] == ["scan-report.json"]
