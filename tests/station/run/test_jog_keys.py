"""Keys of a jog before a scan that is held up: nothing queues up for it, and it can still be ended."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from station_samples import IMAGE, ORDERS

import station.records.ring.ring
from definitions.image import Command
from station.records.ring.reader import RingReader
from station.records.ring.ring import MAILBOX_SLOTS, create
from station.records.ring.writer import RingWriter
from station.run.jog.keys import END, Heard, Keys


@pytest.fixture
def ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[RingWriter, RingReader]]:
    monkeypatch.setattr(station.records.ring.ring, "SHARED_MEMORY", tmp_path)
    path = create(tmp_path, 16)
    writer, reader = RingWriter(path), RingReader(path)
    writer.append(0, 0, 0, IMAGE, ORDERS)
    yield writer, reader
    writer.close()
    reader.close()


def taken(scan: RingWriter) -> list[int]:
    """Return all that a scan takes which goes on."""
    return [command for command in (scan.take_command() for _ in range(2 * MAILBOX_SLOTS)) if command]


def test_a_key_that_is_held_before_a_scan_that_stands_still_leaves_one_token(ends: tuple[RingWriter, RingReader]):
    scan, ring = ends
    said = [Heard("+")]
    keys = Keys(lambda: said, lambda _: None, lambda: None)
    for _ in range(3 * MAILBOX_SLOTS):
        keys.attend(ring)
    assert taken(scan) == [Command.JOG_POSITIVE]
    for _ in range(3):  # it goes on: each token is taken, and the next one follows
        keys.attend(ring)
        assert taken(scan) == [Command.JOG_POSITIVE]
    for _ in range(3 * MAILBOX_SLOTS):
        keys.attend(ring)
    said = [Heard(END)]
    keys.attend(ring)
    assert taken(scan) == [Command.JOG_POSITIVE, Command.STOP], "the end of the jog is not behind a queue"
