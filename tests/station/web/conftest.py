from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from served import Served
from station_support import station_in

from station.web.station import Station

if TYPE_CHECKING:
    from browser import Enter


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


@pytest.fixture(scope="module")
def enter(station: Served) -> Iterator[Enter]:
    """Open a page of the module's station for somebody, by their role: what they see first is the bench."""
    from browser import opened  # noqa: PLC0415 - skips the tests of a browser where playwright is missing

    with opened(station.url) as entered:
        yield entered
