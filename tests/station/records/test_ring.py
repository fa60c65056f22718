from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from station_samples import IMAGE, ORDERS

import station.records.ring.ring
from definitions.image import Command
from station.records.ring.reader import RingReader
from station.records.ring.ring import MAILBOX_SLOTS, W_COMMANDS_WRITTEN, W_SLOTS, RingError, ScanState, create
from station.records.ring.writer import RingWriter
from station.records.samples.check import check_bytes
from station.records.samples.scan_record import RECORD_BYTES

Ends = tuple[RingWriter, RingReader]


@pytest.fixture(autouse=True)
def _in_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(station.records.ring.ring, "SHARED_MEMORY", tmp_path)


def both_ends(folder: Path, capacity: int) -> Ends:
    path = create(folder, capacity)
    return RingWriter(path), RingReader(path)


@pytest.fixture
def ends(tmp_path: Path) -> Iterator[Ends]:
    writer, reader = both_ends(tmp_path, 8)
    yield writer, reader
    writer.close()
    reader.close()


def drained(reader: RingReader) -> bytes:
    parts: list[bytes] = []
    reader.drain(parts.append)
    return b"".join(parts)


def append(writer: RingWriter, count: int) -> list[bool]:
    return [writer.append(writer.sequence, 0, 0, IMAGE, ORDERS) for _ in range(count)]


def test_the_start_of_the_scan_is_known_without_its_report(ends: Ends) -> None:
    writer, reader = ends
    assert reader.started_ns == 0
    writer.note_start(123_456_789_012)
    assert reader.started_ns == 123_456_789_012


@given(moves=st.lists(st.integers(min_value=0, max_value=8), max_size=30))
@settings(max_examples=40, deadline=None)
def test_what_is_drained_in_time_arrives_complete_and_in_order(
    tmp_path_factory: pytest.TempPathFactory,
    moves: list[int],
) -> None:
    writer, reader = both_ends(tmp_path_factory.mktemp("ring"), 8)
    received = b""
    for count in moves:
        assert all(append(writer, count))
        received += drained(reader)
    assert check_bytes(received, expected=sum(moves)).sound
    assert reader.lost == 0
    writer.close()
    reader.close()


def test_overflow_drops_counts_and_leaves_a_gap(ends: Ends) -> None:
    writer, reader = ends
    assert append(writer, 10) == [True] * 8 + [False] * 2
    assert reader.lost == 2
    received = drained(reader)
    assert len(received) == 8 * RECORD_BYTES
    assert append(writer, 1) == [True]
    report = check_bytes(received + drained(reader))
    assert report.problems == ("the sequence has a gap: position 8 holds record 10",)


def test_a_writer_that_died_loses_no_written_record(ends: Ends) -> None:
    writer, reader = ends
    append(writer, 5)
    writer.close()
    reader.mark_died()
    assert check_bytes(drained(reader), expected=5).sound
    assert reader.state is ScanState.DIED


def test_each_command_is_seen_once_and_in_order(ends: Ends) -> None:
    writer, reader = ends
    reader.send(Command.START)
    reader.send(Command.STOP)
    assert [writer.take_command() for _ in range(4)] == [Command.START, Command.STOP, 0, 0]
    reader.send(Command.STOP)
    assert [writer.take_command() for _ in range(2)] == [Command.STOP, 0]


def test_a_mailbox_that_nobody_empties_says_so(ends: Ends) -> None:
    _, reader = ends
    for _ in range(16):
        reader.send(Command.STOP)
    with pytest.raises(RingError, match="no longer accepts commands"):
        reader.send(Command.STOP)


def test_state_travels_to_the_supervisor(ends: Ends) -> None:
    writer, reader = ends
    for state in ScanState:
        writer.set_state(state)
        assert reader.state is state


def test_the_run_folder_is_used_without_shared_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(station.records.ring.ring, "SHARED_MEMORY", tmp_path / "absent")
    assert create(tmp_path, 4).parent == tmp_path


def test_another_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other"
    path.write_bytes(bytes(8192))
    with pytest.raises(RingError, match="another version of lostmotion made this record buffer"):
        RingReader(path)


def test_no_room_leaves_no_file_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.posix_fallocate", full)
    with pytest.raises(RingError, match="No space left on device"):
        create(tmp_path, 4)
    assert list(tmp_path.iterdir()) == []


def test_records_that_could_not_be_kept_stay_in_the_ring(ends: Ends) -> None:
    writer, reader = ends
    append(writer, 3)

    def disk_full(_: bytes) -> None:
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space"):
        reader.drain(disk_full)
    assert check_bytes(drained(reader), expected=3).sound


@pytest.mark.parametrize("number", [len(Command), 255, 256, 2**63])
def test_a_number_that_is_no_command_is_taken_counted_and_ignored(ends: Ends, number: int) -> None:
    writer, reader = ends
    reader._words[W_SLOTS] = number
    reader._words[W_SLOTS + 1] = int(Command.STOP)
    reader._words[W_COMMANDS_WRITTEN] = 2
    assert writer.take_command() == Command.NONE
    assert writer.take_command() == Command.STOP, "the command behind it is heard"
    assert writer.strange_commands == 1
    assert append(writer, 1) == [True]


@pytest.mark.parametrize("count", [MAILBOX_SLOTS + 1, 2**64 - 1])
def test_a_count_that_no_supervisor_can_have_reached_gives_no_commands(ends: Ends, count: int) -> None:
    writer, reader = ends
    reader._words[W_SLOTS] = int(Command.START)
    reader._words[W_COMMANDS_WRITTEN] = count
    assert [writer.take_command() for _ in range(3)] == [Command.NONE] * 3
    assert writer.strange_commands == 1
