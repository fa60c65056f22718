from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from station_support import station_in

from station.web.actions import Station


@pytest.fixture(scope="module")
def shared_station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    """A station whose accounts stay as they are: to make them takes a while."""
    station = station_in(tmp_path_factory.mktemp("station") / "runs")
    yield station
    station.close()


@pytest.fixture
def station(tmp_path: Path) -> Iterator[Station]:
    found = station_in(tmp_path / "runs")
    yield found
    found.close()
