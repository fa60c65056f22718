"""Folders of runs with a chain of their own."""

from __future__ import annotations

from pathlib import Path

import pytest
from stored_runs import metric, store_run

from station.own_place import PLACE


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A place of the service's own for this test alone."""
    monkeypatch.setenv(PLACE, str(tmp_path / "place"))
    return tmp_path / "place"


@pytest.fixture
def data(place: Path, tmp_path: Path) -> Path:
    """Four concluded runs: a FAIL, a PASS, the retest of the first, and another unit."""
    assert not place.exists()
    folder = tmp_path / "runs"
    store_run(folder, "A", [metric(2.0)], failed="too large")
    store_run(folder, "B", [metric(0.5)])
    store_run(folder, "A", [metric(0.4)])
    store_run(folder, "C", [metric(0.3)])
    return folder
