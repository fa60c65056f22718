from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from station_samples import IMAGE, ORDERS

import station.records.ring.ring
from definitions.image import Command
from station.records.ring.reader import RingReader
from station.records.ring.ring import create
from station.records.ring.writer import RingWriter
from station.scan.scan_loop import Stop
from station.scan.supervisor_watch import LONGEST_SILENCE_S, SUPERVISOR_GONE, SupervisorWatch

PERIOD_NS = 10_000_000
LIMIT_SCANS = round(LONGEST_SILENCE_S * 1e9 / PERIOD_NS)


@pytest.fixture
def ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[RingWriter, RingReader]]:
    monkeypatch.setattr(station.records.ring.ring, "SHARED_MEMORY", tmp_path)
    path = create(tmp_path, 16)
    writer, reader = RingWriter(path), RingReader(path)
    yield writer, reader
    writer.close()
    reader.close()


def test_a_supervisor_that_beats_is_never_given_up(ends: tuple[RingWriter, RingReader]) -> None:
    writer, reader = ends
    stop = Stop()
    watch = SupervisorWatch(writer, stop, PERIOD_NS)
    for _ in range(5):
        for _ in range(LIMIT_SCANS):
            watch.take_command()
        reader.beat()
    assert not stop.wanted
    assert watch.notes() == ()


def test_a_silent_supervisor_stops_the_run_once_and_the_record_says_so(ends: tuple[RingWriter, RingReader]) -> None:
    writer, reader = ends
    stop = Stop()
    watch = SupervisorWatch(writer, stop, PERIOD_NS)
    writer.append(41, 0, 0, IMAGE, ORDERS)
    for _ in range(LIMIT_SCANS):
        watch.take_command()
    assert not stop.wanted
    watch.take_command()
    assert stop.wanted
    assert [note.scan for note in watch.notes()] == [41]
    writer.append(42, 0, 0, IMAGE, ORDERS)
    for _ in range(2 * LIMIT_SCANS):
        watch.take_command()
    assert [note.scan for note in watch.notes()] == [41]
    reader.send(Command.QUICK_STOP)
    assert watch.take_command() == Command.QUICK_STOP


def test_a_supervisor_that_was_gone_before_the_start_is_told_as_the_cause(ends: tuple[RingWriter, RingReader]) -> None:
    stop = Stop()
    stop.supervisor_gone = True
    assert [note.text for note in SupervisorWatch(ends[0], stop, PERIOD_NS).notes()] == [SUPERVISOR_GONE]
