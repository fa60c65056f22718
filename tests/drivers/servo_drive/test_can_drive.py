"""The drive inside the scan, against frames put on a virtual bus by the test."""

from __future__ import annotations

import struct
from collections.abc import Iterator

import pytest
from can_drive_support import (
    CSV,
    EMCY,
    ENABLED,
    FAULT,
    HEARTBEAT,
    HEARTBEAT_SCANS,
    SENSOR_NODE,
    TPDO1,
    TPDO2,
    DriveOnBus,
    emergency,
    orders,
)
from drivers_support import drive_config
from hypothesis import given, settings
from hypothesis import strategies as st

from definitions.image import AGE_NEVER, DriveCommand, NmtState, Orders
from drivers.servo_drive.drive import OTHER_HEARD_FOR_S, SILENT_AFTER_SCANS, VELOCITY_SCANS_AFTER_CSV


@pytest.fixture
def bench() -> Iterator[DriveOnBus]:
    one = DriveOnBus()
    yield one
    one.close()


def test_one_scan_on_the_wire(bench: DriveOnBus) -> None:
    bench.drive.send(orders(torque=3.0), 0)  # 1.5 N·m at the motor of 5 N·m rated: 300 per mille
    assert bench.sent() == [(0x205, bytes.fromhex("0f000a2c01")), (0x080, b""), (0x77E, b"\x05")]
    bench.drive.send(orders(torque=-3.0), 1)
    assert bench.sent() == [(0x205, bytes.fromhex("0f000ad4fe")), (0x080, b"")]


def test_heartbeat_every_n_scans_also_after_skipped_ones(bench: DriveOnBus) -> None:
    beats = []
    for scan in (*range(45), 100, 101):
        bench.drive.send(orders(), scan)
        beats += [scan] if (0x77E, b"\x05") in bench.sent() else []
    assert beats == [0, 20, 40, 100]


def test_velocity_is_sent_in_its_mode_and_zeroed_after_it(bench: DriveOnBus) -> None:
    bench.drive.send(orders(speed=1.0), 0)
    assert 0x305 not in dict(bench.sent())
    bench.drive.send(orders(mode=CSV, speed=0.5), 1)
    frames = dict(bench.sent())
    assert frames[0x305] == struct.pack("<i", 166886)  # behind a gear of 2 the motor turns at 1 rad/s
    assert frames[0x205][2] == CSV
    zeroed = []
    for scan in range(2, 20):
        bench.drive.send(orders(speed=0.5), scan)
        zeroed.append(dict(bench.sent()).get(0x305))
    assert zeroed == [bytes(4)] * VELOCITY_SCANS_AFTER_CSV + [None] * (18 - VELOCITY_SCANS_AFTER_CSV)


@pytest.mark.parametrize(
    ("torque", "counts"),
    [(1e6, 0x7FFF), (-1e6, -0x8000), (float("inf"), 0x7FFF), (float("-inf"), -0x8000), (float("nan"), 0)],
)
def test_a_set_point_that_does_not_fit_is_flagged(bench: DriveOnBus, torque: float, counts: int) -> None:
    bench.drive.send(orders(torque=torque), 0)
    assert struct.unpack("<h", dict(bench.sent())[0x205][3:])[0] == counts
    assert bench.drive.setpoint_is_clamped
    assert bench.drive.setpoints_clamped == 1
    bench.drive.send(orders(torque=1.0), 1)
    assert not bench.drive.setpoint_is_clamped
    assert bench.drive.setpoints_clamped == 1


def test_process_data(bench: DriveOnBus) -> None:
    bench.put(TPDO1, struct.pack("<HbhB", ENABLED, 10, -300, 0x05))
    bench.put(TPDO2, struct.pack("<ii", -524288, 166886))
    bench.drive.poll(7)
    names = ("statusword", "mode_display", "actual_torque", "actual_position", "actual_velocity")
    assert [bench.drive.value(name) for name in names] == [ENABLED, 10, -300, -524288, 166886]
    assert bench.drive.value("error_register") == 5
    assert bench.drive.age_scans(7) == 0
    assert bench.drive.age_scans(12) == 5


def test_age_is_that_of_the_oldest_pdo(bench: DriveOnBus) -> None:
    assert bench.drive.age_scans(0) == AGE_NEVER
    bench.answer()
    bench.drive.poll(1)
    bench.put(TPDO1, struct.pack("<HbhB", ENABLED, 10, 0, 0))
    bench.drive.poll(4)
    assert bench.drive.age_scans(4) == 3
    assert bench.drive.age_scans(10**6) == AGE_NEVER


def test_a_pdo_of_wrong_length_keeps_the_old_value_ageing(bench: DriveOnBus) -> None:
    bench.answer(torque=5)
    bench.drive.poll(1)
    bench.put(TPDO1, bytes(5))
    bench.put(TPDO2, bytes(8))
    bench.drive.poll(2)
    assert bench.drive.value("actual_torque") == 5
    assert bench.drive.age_scans(2) == 1
    assert bench.drive.frames_malformed == 1


def test_heartbeat_and_its_age(bench: DriveOnBus) -> None:
    assert bench.drive.nmt_state == NmtState.NEVER_HEARD
    assert bench.drive.heartbeat_age_scans(0) == AGE_NEVER
    bench.put(HEARTBEAT, b"\x05")
    bench.drive.poll(3)
    assert bench.drive.nmt_state == NmtState.OPERATIONAL
    assert bench.drive.heartbeat_age_scans(8) == 5
    bench.put(HEARTBEAT, b"\x00")
    bench.drive.poll(9)
    assert bench.drive.nmt_state == NmtState.BOOT_UP


def test_emergency_and_its_reset(bench: DriveOnBus) -> None:
    bench.put(EMCY, emergency(0x8130, 0x11))
    bench.drive.poll(1)
    assert bench.drive.emcy_code == 0x8130
    bench.drive.poll(2)
    assert bench.drive.emcy_code == 0x8130
    bench.put(EMCY, emergency(0, 0))
    bench.drive.poll(3)
    assert bench.drive.emcy_code == 0
    assert [(e.scan, e.code, e.vendor) for e in bench.drive.emergencies] == [(1, 0x8130, b"abcde"), (3, 0, b"abcde")]


def test_an_emergency_withdrawn_in_the_same_scan_is_seen_once(bench: DriveOnBus) -> None:
    bench.put(EMCY, emergency(0x8611))
    bench.put(EMCY, emergency(0, 0))
    bench.drive.poll(1)
    assert bench.drive.emcy_code == 0x8611
    bench.drive.poll(2)
    assert bench.drive.emcy_code == 0


def test_one_of_several_errors_gone_withdraws_nothing(bench: DriveOnBus) -> None:
    for scan, (code, register) in enumerate([(0x4210, 0x09), (0x3210, 0x0D), (0, 0x09)]):
        bench.put(EMCY, emergency(code, register))
        bench.drive.poll(scan)
    assert bench.drive.emcy_code == 0x3210
    bench.drive.poll(3)
    assert bench.drive.emcy_code == 0x3210
    bench.put(EMCY, emergency(0, 0))
    bench.drive.poll(4)
    assert bench.drive.emcy_code == 0


@pytest.mark.parametrize(
    ("messages", "then"),
    [
        ([(0x4210, 0x09), (0, 0x08)], 0x4210),
        ([(0x4210, 0x09), (0, 0x08), (0, 0)], 0),
        ([(0x4210, 0x09), (0, 0), (0, 0x08)], 0x4210),
        ([(0x4210, 0x09), (0, 0), (0x3210, 0x05), (0, 0x01)], 0x3210),
        ([(0x4210, 0x09), *[(0, 0x08)] * 40, (0, 0)], 0),
    ],
    ids=["one gone", "all gone", "all gone, one left", "another one, one gone", "more than are kept"],
)
def test_several_emergencies_in_one_scan(bench: DriveOnBus, messages: list[tuple[int, int]], then: int) -> None:
    for code, register in messages:
        bench.put(EMCY, emergency(code, register))
    last = [code for code, _ in messages if code][-1]
    bench.drive.poll(1)
    assert bench.drive.emcy_code == last, "seen for that scan at least"
    bench.drive.poll(2)
    assert bench.drive.emcy_code == then


def test_a_drive_that_never_says_reset(bench: DriveOnBus) -> None:
    bench.put(EMCY, emergency(0x7121))
    bench.answer(FAULT)
    bench.drive.poll(1)
    bench.answer(0x0250)
    bench.drive.poll(2)
    assert bench.drive.emcy_code == 0x7121, "only our reset withdraws it"
    bench.drive.send(orders(command=DriveCommand.FAULT_RESET), 2)
    bench.answer(FAULT)
    bench.drive.poll(3)
    assert bench.drive.emcy_code == 0x7121
    bench.answer(0x0250)
    bench.drive.poll(4)
    assert bench.drive.emcy_code == 0


@pytest.mark.parametrize("before_the_word", [True, False])
def test_an_emergency_of_the_scan_in_which_the_fault_is_left_stays(bench: DriveOnBus, *, before_the_word: bool) -> None:
    bench.put(EMCY, emergency(0x7121))
    bench.answer(FAULT)
    bench.drive.poll(1)
    bench.drive.send(orders(command=DriveCommand.FAULT_RESET), 1)
    if before_the_word:
        bench.put(EMCY, emergency(0x4210))
    bench.answer(0x0250)
    if not before_the_word:
        bench.put(EMCY, emergency(0x4210))
    for scan in (2, 3):
        bench.drive.poll(scan)
        assert bench.drive.emcy_code == 0x4210
    bench.put(EMCY, emergency(0, 0))
    bench.drive.poll(4)
    assert bench.drive.emcy_code == 0


def test_frames_of_others_are_counted_only(bench: DriveOnBus) -> None:
    bench.put(0x186, bytes(6))
    bench.put(TPDO1, bytes(6), is_extended_id=True)
    bench.put(HEARTBEAT, b"", is_remote_frame=True)
    bench.put(TPDO1, bytes(1), is_error_frame=True)
    bench.drive.poll(1)
    assert bench.drive.frames_foreign == 4
    assert bench.drive.age_scans(1) == AGE_NEVER
    assert bench.drive.nmt_state == NmtState.NEVER_HEARD


@pytest.mark.parametrize(
    ("cob_id", "data"),
    [
        *((cob_id, bytes(1)) for cob_id in (0x000, 0x080, 0x77E, 0x205, 0x305)),
        (0x605, b"\x2b\x72\x60\x00\x88\x13\x00\x00"),
        (0x605, b"\xc2\x00\x16\x01\x08\x00\x00\x00"),
        (0x605, b"\x01\x00\x00\x00\x00\x00\x00\x00"),
        (0x600 + SENSOR_NODE, b"\x2b\x72\x60\x00\x88\x13\x00\x00"),
    ],
    ids=("nmt", "sync", "heartbeat", "rpdo1", "rpdo2", "sdo write", "block write", "segment", "sensor's sdo"),
)
def test_a_frame_that_only_we_may_send_tells_of_another_controller_for_a_while(
    bench: DriveOnBus, cob_id: int, data: bytes
) -> None:
    bench.answer(0x0250)
    bench.drive.poll(1)
    assert not bench.drive.other_commands(1), "the drive's own frames say nothing"
    bench.put(cob_id, data)
    bench.drive.poll(2)
    last = 2 + round(OTHER_HEARD_FOR_S / drive_config().controller_heartbeat_s * HEARTBEAT_SCANS)
    assert [bench.drive.other_commands(scan) for scan in (2, last, last + 1)] == [True, True, False]


def test_who_only_reads_by_sdo_or_writes_to_another_node_commands_nobody(bench: DriveOnBus) -> None:
    for cob_id, first in ((0x605, 0x40), (0x605, 0x60), (0x605, 0xA0), (0x605, 0x80), (0x606, 0x2B), (0x585, 0x60)):
        bench.put(cob_id, bytes((first, *bytes(7))))
    bench.put(0x605, b"")
    bench.drive.poll(1)
    assert not bench.drive.other_commands(1)


FRAMES = st.tuples(
    st.sampled_from([TPDO1, TPDO2, HEARTBEAT, EMCY, 0x080, 0x000, 0x585]) | st.integers(0, 0x7FF),
    st.binary(max_size=8),
    st.sampled_from([{}, {"is_remote_frame": True}, {"is_error_frame": True}, {"is_extended_id": True}]),
)


@settings(max_examples=100, deadline=None)
@given(st.lists(FRAMES, max_size=20), st.integers(-1000, 1000), st.integers(-1000, 1000), st.floats(), st.floats())
def test_no_frame_and_no_order_raises(
    frames: list[tuple[int, bytes, dict[str, bool]]], command: int, mode: int, torque: float, speed: float
) -> None:
    bench = DriveOnBus("can-drive-any")
    try:
        for scan, (cob_id, data, kind) in enumerate(frames):
            bench.put(cob_id, b"" if kind.get("is_remote_frame") else data, **kind)
            bench.drive.poll(scan)
        bench.drive.send(orders(command, mode, torque, speed), len(frames))
        assert 0 <= bench.drive.value("statusword") <= 0xFFFF
        assert [cob_id for cob_id, _ in bench.sent()][-1] in {0x080, 0x77E}
    finally:
        bench.close()


def test_a_drive_that_is_to_be_off_and_does_not_say_so_gets_no_set_points(bench: DriveOnBus) -> None:
    off = orders(DriveCommand.DISABLE_VOLTAGE)

    def setpoints(ordered: Orders, scan: int) -> bool:
        bench.drive.poll(scan)
        bench.drive.send(ordered, scan)
        sent = [cob_id for cob_id, _ in bench.sent()]
        assert 0x080 in sent, "SYNC goes on, for a drive that can still hear it"
        return 0x205 in sent

    assert setpoints(off, 0), "nothing has come yet: the drive may only be waiting for its first SYNC"
    bench.answer()
    assert setpoints(off, 1)
    assert setpoints(off, SILENT_AFTER_SCANS)
    assert not setpoints(off, 1 + SILENT_AFTER_SCANS)
    assert setpoints(orders(), 2 + SILENT_AFTER_SCANS), "who still wants torque goes on asking"
    bench.answer(statusword=0x0250)
    assert setpoints(off, 3 + SILENT_AFTER_SCANS), "it is heard again"
