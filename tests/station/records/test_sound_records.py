"""What is decoded of a record: only what is sound, and a number that this version does not know by what it is."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from station_samples import IMAGE, ORDERS

from definitions.faults import FAULTS
from definitions.image import Image, Link, Orders, State
from station.atomic_file import as_json
from station.documents.entries import plain
from station.records.left_state import left_state
from station.records.program_file import ProgramEntries, StoredProgram
from station.records.samples.check import check_bytes, sound_table
from station.records.samples.event_log import events_of
from station.records.samples.scan_record import RECORD_BYTES, pack

ENTRIES = ProgramEntries(period_s=0.001, has_torque_out=True, release_torque_nm=8.0, segments=())
PROGRAM = StoredProgram(ENTRIES, Path("program.json"))
QUIET = ORDERS._replace(state=int(State.RAMP_POS), fault=0, alarms=0)
UNKNOWN_STATE, UNKNOWN_FAULT, UNKNOWN_COMMAND = 130, 62, 77


def records(*orders: Orders, sequences: list[int] | None = None, image: Image | None = None) -> bytes:
    image = IMAGE._replace(command=0) if image is None else image
    numbers = sequences or list(range(len(orders)))
    return b"".join(pack((sequence, sequence, 0, 0), image, one) for sequence, one in zip(numbers, orders, strict=True))


@pytest.mark.parametrize("broken", [0, 1, 2])
def test_a_record_that_fails_its_crc_is_not_decoded(broken: int) -> None:
    content = bytearray(records(QUIET, QUIET, QUIET))
    content[broken * RECORD_BYTES + 100] ^= 130
    table = sound_table(bytes(content))
    assert list(table["sequence"]) == [number for number in range(3) if number != broken]
    events_of(table, 1_000_000, [])
    assert left_state(table, PROGRAM) is not None


@pytest.mark.parametrize(
    ("sequences", "kept"),
    [([0, 1, 2], [0, 1, 2]), ([0, 1, 5], [0, 1, 5]), ([0, 2, 1], [0, 2]), ([0, 1, 1], [0, 1]), ([3, 0, 1], [3])],
    ids=["gapless", "lost records", "out of order", "twice", "from the start again"],
)
def test_what_stands_behind_a_sequence_that_goes_back_is_not_decoded(sequences: list[int], kept: list[int]) -> None:
    content = records(QUIET, QUIET, QUIET, sequences=sequences)
    assert list(sound_table(content)["sequence"]) == kept


def test_a_file_of_half_a_record_or_none_has_nothing_to_decode() -> None:
    whole = records(QUIET)
    for content in (b"", whole[:-1], b"x"):
        assert len(sound_table(content)) == 0
    assert len(sound_table(whole + b"x")) == 1


def test_numbers_that_this_version_does_not_know_are_named() -> None:
    strange = QUIET._replace(state=UNKNOWN_STATE, fault=UNKNOWN_FAULT, alarms=1 << UNKNOWN_FAULT, reaction=4)
    content = records(QUIET, strange, image=IMAGE._replace(command=UNKNOWN_COMMAND, drive_state=200))
    assert check_bytes(content).problems == ()
    table = sound_table(content)
    events = events_of(table, 1_000_000, [])
    (alarm,) = (event for event in events if event.kind == "alarm")
    assert (alarm.id, alarm.reaction, alarm.first) == ("unknown_fault_62", "quick_stop", True)
    assert [event.to for event in events if event.kind == "transition"][-1] == "unknown state 130"
    assert {event.text for event in events if event.kind == "command"} == {"unknown command 77"}
    left = left_state(table, PROGRAM)
    assert left is not None
    assert left.drive == "off"


@pytest.mark.parametrize("channel", ["torque_out_nm", "brake_current_a"])
def test_a_sensor_that_gives_no_number_is_unknown_and_no_torque_counts_as_none(channel: str) -> None:
    last = QUIET._replace(state=int(State.FAULT), fault=1, alarms=2)
    image = IMAGE._replace(command=0, brake_on=0, **{channel: math.nan})
    table = sound_table(records(QUIET, last, image=image))
    left = left_state(table, PROGRAM)
    assert left is not None
    assert not (left.torque_known if channel == "torque_out_nm" else left.lock_known)
    assert (left.torque_nm is None) == (channel == "torque_out_nm")
    assert "treat the unit as wound up" in left.next_action
    as_json([plain(left), [plain(event) for event in events_of(table, 1_000_000, [])]])


@pytest.mark.parametrize("link", [Link.CAN, Link.CAN_SHARED])
def test_a_drive_that_another_controller_may_switch_on_again_is_not_known_to_be_off(link: Link) -> None:
    """Nobody is told to turn a shaft by hand while another controller is on the bus."""
    last = QUIET._replace(state=int(State.FAULT))
    stored = {"torque_out_nm": 100.0, "brake_on": 1, "brake_current_a": 2.0, "drive_state": 0}
    known = IMAGE._replace(drive_age_scans=0, sample_age_scans=0, brake_age_scans=0, links_lost=0, **stored)
    alone, shared = (
        left_state(sound_table(records(QUIET, last, image=known._replace(links_lost=lost))), PROGRAM)
        for lost in (0, int(link))
    )
    assert alone is not None
    assert shared is not None
    assert (alone.drive_known, shared.drive_known) == (True, False)
    assert "by hand" in alone.next_action
    assert "by hand" not in shared.next_action


def test_an_emergency_message_behind_the_state_fault_explains_it() -> None:
    """A drive shows FAULT in its process data, and says in a message of its own why: either may come first."""
    number = next(one.number for one in FAULTS if one.id == "drive_fault")
    fault = QUIET._replace(state=int(State.FAULT), fault=number, alarms=1 << number)
    before = records(QUIET, fault, image=IMAGE._replace(command=0, drive_emcy_code=0))
    image = IMAGE._replace(command=0, drive_emcy_code=0x7121)
    content = before + pack((2, 2, 0, 0), image, fault)
    (alarm,) = (event for event in events_of(sound_table(content), 1_000_000, []) if event.kind == "alarm")
    assert alarm.scan == 1
    assert alarm.detail is not None
    assert alarm.detail.startswith("emergency code 0x7121: motor blocked; check")
