from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import pytest
from label_setup import set_up
from zpl_printer import ZplPrinter, printing

from station.web.labels import outbox
from station.web.labels.settings import load_labels
from station.web.station import Station


@pytest.fixture
def printer() -> Iterator[ZplPrinter]:
    with printing() as found:
        yield found


@pytest.fixture
def plant(station: Station, printer: ZplPrinter) -> Station:
    set_up(station.data, printer.port)
    found = dataclasses.replace(station, labels=load_labels(station.data))
    outbox.begin_here(found.database, found.data)
    return found
