"""Set-up of the drive against an independent CANopen stack: what is written, what is refused, and how it is told."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import pytest
from drivers_support import PERIOD_NS, drive_config, drive_profile, raw_profile
from durand.datatypes import DatatypeEnum as Type
from durand.object_dictionary import Variable
from durand_drive import DurandDrive

from definitions.image import NmtState
from definitions.protections import BY_NAME, MISSING
from drivers.can.bus import CanLink, open_can
from drivers.config import CanConfig, DriveConfig
from drivers.errors import DriveSetupError
from drivers.servo_drive.objects import protection_rows, protections_of
from drivers.servo_drive.setup import set_up_drive

CHANNEL = "drive-setup"


@pytest.fixture
def drive() -> Iterator[DurandDrive]:
    one = DurandDrive(CHANNEL)
    yield one
    one.close()


@pytest.fixture
def link() -> Iterator[CanLink]:
    one = open_can(CanConfig("virtual", CHANNEL))
    yield one
    one.close()


def refused(link: CanLink, config: DriveConfig | None = None) -> list[str]:
    with pytest.raises(DriveSetupError) as caught:
        set_up_drive(link, config or drive_config(), PERIOD_NS)
    return [str(problem) for problem in caught.value.problems]


WRITTEN = {
    (0x1016, 1): 126 << 16 | 100,
    (0x1017, 0): 20,
    (0x6007, 0): 2,
    (0x605A, 0): 2,
    (0x605E, 0): 2,
    (0x6072, 0): 1100,
    (0x6080, 0): 120,
    (0x6087, 0): 10_000,
    (0x6098, 0): 37,
    (0x1400, 1): 0x205,
    (0x1400, 2): 1,
    (0x1400, 5): 50,
    (0x1401, 1): 0x305,
    (0x1401, 5): 0,
    (0x1402, 1): 0x80000405,
    (0x1600, 0): 3,
    (0x1600, 1): 0x60400010,
    (0x1600, 2): 0x60600008,
    (0x1600, 3): 0x60710010,
    (0x1601, 1): 0x60FF0020,
    (0x1800, 2): 1,
    (0x1A00, 0): 4,
    (0x1A00, 4): 0x10010008,
    (0x1A01, 1): 0x60640020,
}


def test_everything_is_written_and_the_drive_started(drive: DurandDrive, link: CanLink) -> None:
    log = set_up_drive(link, drive_config(), PERIOD_NS)
    assert {place: drive.od.read(*place) for place in WRITTEN} == WRITTEN
    assert drive.node.nmt.state == NmtState.OPERATIONAL
    assert "node 5 6072:00 largest torque (0.1 % of rated torque) = 1100: written, read back" in log
    assert "node 5 1018:01 vendor id = 0x4C4D0001: checked" in log
    assert "node 5 1019:00 SYNC carries no counter: this drive has no such object" in log
    assert log[-1] == "node 5: started, heartbeat says operational"


def test_every_protection_is_reported_as_read_back(drive: DurandDrive, link: CanLink) -> None:
    log = "\n".join(set_up_drive(link, drive_config(), PERIOD_NS))
    assert drive.node.nmt.state == NmtState.OPERATIONAL
    for row in protections_of(drive_config().profile):
        assert f"{row.index:04X}:{row.subindex:02X} {row.meaning}" in log


def test_set_up_can_be_repeated(drive: DurandDrive, link: CanLink) -> None:
    first = set_up_drive(link, drive_config(), PERIOD_NS)
    again = set_up_drive(link, drive_config(), PERIOD_NS)
    assert [line.replace("held already, not written", "written, read back") for line in again] == [
        line.replace("held already, not written", "written, read back") for line in first
    ]
    assert not any(line.endswith("written, read back") for line in again)
    assert drive.node.nmt.state == NmtState.OPERATIONAL


def test_what_cannot_be_written_but_holds_what_is_wanted_is_fine(drive: DurandDrive, link: CanLink) -> None:
    set_up_drive(link, drive_config(), PERIOD_NS)

    def refuse(_value: int) -> None:
        raise ValueError

    for place in WRITTEN:
        drive.od.validate_callbacks[place].add(refuse)
    log = set_up_drive(link, drive_config(), PERIOD_NS)
    assert "node 5 1600:01 set-point PDO 1: controlword = 0x60400010: held already, not written" in log
    assert drive.node.nmt.state == NmtState.OPERATIONAL


def test_a_drive_that_keeps_the_old_value_is_refused(drive: DurandDrive, link: CanLink) -> None:
    drive.forgets(0x6072, 0, 3000)
    (problem,) = refused(link)
    assert problem == (
        "node 5 6072:00: largest torque (0.1 % of rated torque) is not what it must be: found 3000, expected 1100; "
        "set this value with the drive's own tool, or correct the bench file"
    )
    assert drive.node.nmt.state == NmtState.PRE_OPERATIONAL


@pytest.mark.parametrize("row", protection_rows(drive_config()), ids=lambda row: f"{row.index:04X}")
def test_each_protection_alone_refuses_the_drive(drive: DurandDrive, link: CanLink, row: Any) -> None:
    drive.forgets(row.index, row.subindex, row.value + 1)
    problems = refused(link)
    assert len(problems) == 1
    assert problems[0].startswith(f"node 5 {row.index:04X}:{row.subindex:02X}: {row.meaning}")


def test_a_drive_that_would_move_to_find_its_reference_is_refused(drive: DurandDrive, link: CanLink) -> None:
    drive.forgets(0x6098, 0, 17)
    (problem,) = refused(link)
    assert problem.startswith("node 5 6098:00: homing method (current position, no motion) is not what it must be")
    assert "found 17, expected 37" in problem
    assert drive.node.nmt.state == NmtState.PRE_OPERATIONAL


def test_a_drive_that_refuses_the_homing_method_is_refused(drive: DurandDrive, link: CanLink) -> None:
    drive.od[0x6098] = Variable(Type.INTEGER8, "rw", 35, maximum=35)
    (problem,) = refused(link)
    assert problem.startswith("node 5 6098:00: homing method (current position, no motion) cannot be written")
    assert "abort 0x06090031" in problem


def test_all_findings_are_told_at_once(drive: DurandDrive, link: CanLink) -> None:
    drive.forgets(0x6007, 0, 1)
    drive.forgets(0x6076, 0, 4000)
    drive.forgets(0x1A01, 2, 0x60FF0020)
    drive.od[0x6080] = Variable(Type.UNSIGNED32, "ro", 6000)
    drive.od[0x6087] = Variable(Type.UNSIGNED32, "rw", 0, maximum=1000)
    del drive.od._objects[0x1016]
    problems = refused(link)
    places = [problem.split(": ")[0].removeprefix("node 5 ") for problem in problems]
    assert sorted(places) == ["1016:01", "1A01:02", "6007:00", "6076:00", "6080:00", "6087:00"]
    text = "\n".join(problems)
    assert "abort 0x06010002, the object can only be read" in text
    assert "set it with the vendor's tool" in text
    assert "lower the value in the bench file" in text
    assert "abort 0x06020000, the object does not exist" in text
    assert "found 4000, expected 5000" in text


def test_nothing_is_written_to_another_drive(drive: DurandDrive, link: CanLink) -> None:
    drive.identify(0x4C4D0001, 0x999)
    (problem,) = refused(link)
    assert problem == (
        "node 5 1018:02: product code is not what it must be: found 0x00000999, expected 0x00000402; "
        "check that the drive profile belongs to this drive"
    )
    assert drive.od.read(0x6072, 0) == 3000


def test_a_drive_without_a_mode_is_refused(drive: DurandDrive, link: CanLink) -> None:
    drive.forgets(0x6502, 0, 0x1A0)
    (problem,) = refused(link)
    assert problem.startswith("node 5 6502:00: supported modes is not what it must be: found 0x000001A0")


@pytest.mark.parametrize(("value", "fits"), [(0x80, True), (0x80000080, True), (0x40000080, False), (0x81, False)])
def test_the_drive_must_follow_our_sync(drive: DurandDrive, link: CanLink, value: int, fits: bool) -> None:  # noqa: FBT001
    drive.forgets(0x1005, 0, value)
    if fits:
        set_up_drive(link, drive_config(), PERIOD_NS)
    else:
        (problem,) = refused(link)
        assert problem.startswith("node 5 1005:00: COB-ID of SYNC")
    assert (drive.node.nmt.state == NmtState.OPERATIONAL) is fits


def test_no_drive_at_all_is_told_within_the_time_out(link: CanLink) -> None:
    start = time.monotonic()
    (problem,) = refused(link, drive_config(boot_timeout_s=0.1))
    assert problem.startswith("node 5: the drive does not start: found no boot-up message within 0.1 s")
    assert "check power, node id, bit rate" in problem
    assert time.monotonic() - start < 1.0


def test_a_drive_that_falls_silent_is_not_asked_for_ever(drive: DurandDrive, link: CanLink) -> None:
    def vanish() -> int:
        drive.network.subscriptions.pop(0x605, None)
        return 5000

    drive.od.set_read_callback(0x6076, 0, vanish)
    start = time.monotonic()
    problems = refused(link, drive_config(sdo_reply_timeout_s=0.2))
    assert len(problems) == 2
    assert all("found no answer" in problem for problem in problems)
    assert time.monotonic() - start < 3.0


SDO_ANSWER = 0x585


def test_a_lost_answer_is_asked_for_again(drive: DurandDrive, link: CanLink) -> None:
    send = drive.network.send
    answers: list[bytes] = []

    def lose_the_first(cob_id: int, data: bytes) -> None:
        answers.append(bytes(data))
        if bytes(data[1:4]) != b"\x76\x60\x00" or answers.count(bytes(data)) > 1:
            send(cob_id, data)

    drive.network.send = lose_the_first
    log = set_up_drive(link, drive_config(sdo_reply_timeout_s=0.3), PERIOD_NS)
    assert sum(data[1:4] == b"\x76\x60\x00" for data in answers) == 2
    assert "node 5 6076:00 rated torque of the motor (mN·m) = 5000: checked" in log


def test_a_second_answer_is_not_taken_for_that_of_the_next_object(drive: DurandDrive, link: CanLink) -> None:
    send = drive.network.send
    late: list[bytes] = []

    def answer_again_before_the_next(cob_id: int, data: bytes) -> None:
        if cob_id == SDO_ANSWER:
            if late:
                send(cob_id, late.pop())
            late.append(bytes(data))
        send(cob_id, data)

    drive.network.send = answer_again_before_the_next
    set_up_drive(link, drive_config(), PERIOD_NS)
    assert {place: drive.od.read(*place) for place in WRITTEN} == WRITTEN
    assert late, "answers were repeated"


def test_a_drive_that_answers_late_cannot_prolong_the_set_up(drive: DurandDrive, link: CanLink) -> None:
    send = drive.network.send

    def answer_late(cob_id: int, data: bytes) -> None:
        time.sleep(0.05 if cob_id == SDO_ANSWER else 0)
        send(cob_id, data)

    drive.network.send = answer_late
    start = time.monotonic()
    (problem,) = refused(link, drive_config(setup_timeout_s=0.3))
    assert problem.startswith("node 5: the set-up takes too long: found not finished after 0.3 s")
    assert time.monotonic() - start < 2.0


def test_a_busy_computer_does_not_make_the_drive_silent() -> None:
    config = DriveConfig(**{name: value for name, value in vars(drive_config()).items() if not name.startswith("sdo_")})
    assert config.sdo_reply_timeout_s >= 1.0
    assert config.sdo_tries == 2


def test_a_drive_that_does_not_start_is_told(drive: DurandDrive, link: CanLink) -> None:
    drive.heartbeats = False
    (problem,) = refused(link, drive_config(boot_timeout_s=0.2))
    assert "the drive does not become operational" in problem


OFF = {
    "controller_heartbeat_timeout_s": 0.0,
    "drive_heartbeat_s": 0.0,
    "abort_connection_option": 0,
    "max_torque_nm": 0.0,
    "max_speed_rad_s": 0.05,
    "torque_slope_nm_s": 0.0,
}


@pytest.mark.parametrize(("option", "value"), OFF.items())
def test_a_protection_that_is_off_is_refused_before_anything_is_sent(link: CanLink, option: str, value: float) -> None:
    (problem,) = refused(link, drive_config(**{option: value}))
    assert "would be switched off: found 0, expected above 0; correct the bench file" in problem


def test_every_protection_that_zero_switches_off_is_tried() -> None:
    assert len(OFF) == sum(row.zero_is_off for row in protections_of(drive_config().profile))


def test_a_value_too_large_for_its_object_is_refused(drive: DurandDrive, link: CanLink) -> None:
    (problem,) = refused(link, drive_config(max_torque_nm=500.0))
    assert "does not fit its object: found 100000, expected a number of type u16" in problem
    assert drive.od.read(0x6072, 0) == 3000


def with_profile(**options: Any) -> DriveConfig:
    return drive_config(profile=drive_profile(dict(raw_profile("virtual-drive")) | options))


def test_what_a_drive_lacks_is_not_asked_for_and_stands_in_what_was_verified(drive: DurandDrive, link: CanLink) -> None:
    for index in (0x6007, 0x6072, 0x6087):
        del drive.od._variables[index]
    drive.od[0x6073] = Variable(Type.UNSIGNED16, "rw", 2000)
    lacking = {"abort_connection": "none", "torque_slope": "none", "torque_limit": "max_current"}
    log = set_up_drive(link, with_profile(protections=lacking), PERIOD_NS)
    missing = [line for line in log if MISSING in line]
    assert len(missing) == 2
    assert BY_NAME["abort_connection"].meaning in missing[0]
    assert BY_NAME["torque_slope"].meaning in missing[1]
    assert "node 5 6073:00 largest current (0.1 % of rated current) = 1100: written, read back" in log
    assert drive.node.nmt.state == NmtState.OPERATIONAL


def test_what_the_drive_needs_at_its_start_is_written_and_read_back(drive: DurandDrive, link: CanLink) -> None:
    drive.od[0x3000] = Variable(Type.UNSIGNED8, "rw", 0)
    startup = [{"index": 0x3000, "subindex": 0, "type": "u8", "value": 7, "meaning": "torque by this source"}]
    log = set_up_drive(link, with_profile(startup=startup), PERIOD_NS)
    assert drive.od.read(0x3000, 0) == 7
    assert "node 5 3000:00 torque by this source = 7: written, read back" in log


def test_a_start_up_object_that_is_a_protection_too_is_refused_before_anything_is_sent(link: CanLink) -> None:
    startup = [{"index": 0x6072, "subindex": 0, "type": "u16", "value": 3000, "meaning": "more torque"}]
    (problem,) = refused(link, with_profile(startup=startup))
    assert problem.startswith("node 5 6072:00: more torque is written at start-up")


def test_a_fixed_mapping_other_than_the_profiles_is_refused_and_an_equal_one_is_not_written(
    drive: DurandDrive, link: CanLink
) -> None:
    set_up_drive(link, drive_config(), PERIOD_NS)
    written: list[int] = []
    for subindex in range(5):
        drive.od.validate_callbacks[0x1A00, subindex].add(written.append)
    fixed = dict(raw_profile("virtual-drive"))
    fixed["transmit_pdos"][0]["fixed_mapping"] = True
    config = drive_config(profile=drive_profile(fixed))
    log = set_up_drive(link, config, PERIOD_NS)
    assert "node 5 1A00:01 drive PDO 1: statusword = 0x60410010: checked" in log
    drive.forgets(0x1A00, 2, 0x60770010)
    (problem,) = refused(link, config)
    assert problem.startswith("node 5 1A00:02: drive PDO 1: mode_display is not what it must be: found 0x60770010")
    assert not written


def test_a_drive_whose_polarity_is_turned_is_turned_back(drive: DurandDrive, link: CanLink) -> None:
    drive.od[0x607E] = Variable(Type.UNSIGNED8, "rw", 0xC0)
    set_up_drive(link, drive_config(), PERIOD_NS)
    assert drive.od.read(0x607E, 0) == 0
