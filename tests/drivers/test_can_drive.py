"""The drive inside the scan, against frames put on a virtual bus by the test."""

from __future__ import annotations

import struct
from collections.abc import Iterator

import can
import pytest
from drivers_support import drive_config
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.image import AGE_NEVER, DriveCommand, DriveMode, NmtState, Orders
from drivers.can_bus import CanLink, open_can
from drivers.can_drive import (
    FRAMES_AFTER_GAP,
    FRAMES_PER_POLL,
    SILENT_AFTER_SCANS,
    VELOCITY_SCANS_AFTER_CSV,
    CanDrive,
)
from drivers.config import CanConfig

HEARTBEAT_SCANS = 20
TPDO1, TPDO2, HEARTBEAT, EMCY = 0x185, 0x285, 0x705, 0x085
ENABLED, FAULT = 0x1637, 0x0218
CST, CSV = int(DriveMode.CYCLIC_SYNC_TORQUE), int(DriveMode.CYCLIC_SYNC_VELOCITY)


class Bench:
    """A drive on a virtual bus and the other end of the bus."""

    def __init__(self, channel: str = "can-drive") -> None:
        self.link: CanLink = open_can(CanConfig("virtual", channel))
        self.other = can.Bus(interface="virtual", channel=channel)
        self.drive = CanDrive(self.link, drive_config(), HEARTBEAT_SCANS)

    def put(self, cob_id: int, data: bytes, **kind: bool) -> None:
        self.other.send(can.Message(arbitration_id=cob_id, data=data, **({"is_extended_id": False} | kind)))

    def answer(self, statusword: int = ENABLED, mode: int = CST, torque: int = 0) -> None:
        self.put(TPDO1, struct.pack("<HbhB", statusword, mode, torque, 0))
        self.put(TPDO2, struct.pack("<ii", 0, 0))

    def sent(self) -> list[tuple[int, bytes]]:
        frames = []
        while (message := self.other.recv(0)) is not None:
            frames.append((message.arbitration_id, bytes(message.data)))
        return frames

    def close(self) -> None:
        self.link.close()
        self.other.shutdown()


@pytest.fixture
def bench() -> Iterator[Bench]:
    one = Bench()
    yield one
    one.close()


def orders(
    command: int = DriveCommand.ENABLE_OPERATION, mode: int = CST, torque: float = 0.0, speed: float = 0.0
) -> Orders:
    return Orders(*[0] * len(Orders._fields))._replace(
        drive_command=command, drive_mode=mode, drive_target_torque_nm=torque, drive_target_velocity_rad_s=speed
    )


def test_one_scan_on_the_wire(bench: Bench) -> None:
    bench.drive.send(orders(torque=3.0), 0)  # 1.5 N·m at the motor of 5 N·m rated: 300 per mille
    assert bench.sent() == [(0x205, bytes.fromhex("0f000a2c01")), (0x080, b""), (0x77E, b"\x05")]
    bench.drive.send(orders(torque=-3.0), 1)
    assert bench.sent() == [(0x205, bytes.fromhex("0f000ad4fe")), (0x080, b"")]


def test_heartbeat_every_n_scans_also_after_skipped_ones(bench: Bench) -> None:
    beats = []
    for scan in (*range(45), 100, 101):
        bench.drive.send(orders(), scan)
        beats += [scan] if (0x77E, b"\x05") in bench.sent() else []
    assert beats == [0, 20, 40, 100]


def test_velocity_is_sent_in_its_mode_and_zeroed_after_it(bench: Bench) -> None:
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
def test_a_set_point_that_does_not_fit_is_flagged(bench: Bench, torque: float, counts: int) -> None:
    bench.drive.send(orders(torque=torque), 0)
    assert struct.unpack("<h", dict(bench.sent())[0x205][3:])[0] == counts
    assert bench.drive.setpoint_is_clamped
    assert bench.drive.setpoints_clamped == 1
    bench.drive.send(orders(torque=1.0), 1)
    assert not bench.drive.setpoint_is_clamped
    assert bench.drive.setpoints_clamped == 1


def test_process_data(bench: Bench) -> None:
    bench.put(TPDO1, struct.pack("<HbhB", ENABLED, 10, -300, 0x05))
    bench.put(TPDO2, struct.pack("<ii", -524288, 166886))
    bench.drive.poll(7)
    names = ("statusword", "mode_display", "actual_torque", "actual_position", "actual_velocity")
    assert [bench.drive.value(name) for name in names] == [ENABLED, 10, -300, -524288, 166886]
    assert bench.drive.error_register == 5
    assert bench.drive.age_scans(7) == 0
    assert bench.drive.age_scans(12) == 5


def test_age_is_that_of_the_oldest_pdo(bench: Bench) -> None:
    assert bench.drive.age_scans(0) == AGE_NEVER
    bench.answer()
    bench.drive.poll(1)
    bench.put(TPDO1, struct.pack("<HbhB", ENABLED, 10, 0, 0))
    bench.drive.poll(4)
    assert bench.drive.age_scans(4) == 3
    assert bench.drive.age_scans(10**6) == AGE_NEVER


def test_a_pdo_of_wrong_length_keeps_the_old_value_ageing(bench: Bench) -> None:
    bench.answer(torque=5)
    bench.drive.poll(1)
    bench.put(TPDO1, bytes(5))
    bench.put(TPDO2, bytes(8))
    bench.drive.poll(2)
    assert bench.drive.value("actual_torque") == 5
    assert bench.drive.age_scans(2) == 1
    assert bench.drive.frames_malformed == 1


def test_heartbeat_and_its_age(bench: Bench) -> None:
    assert bench.drive.nmt_state == NmtState.NEVER_HEARD
    assert bench.drive.heartbeat_age_scans(0) == AGE_NEVER
    bench.put(HEARTBEAT, b"\x05")
    bench.drive.poll(3)
    assert bench.drive.nmt_state == NmtState.OPERATIONAL
    assert bench.drive.heartbeat_age_scans(8) == 5
    bench.put(HEARTBEAT, b"\x00")
    bench.drive.poll(9)
    assert bench.drive.nmt_state == NmtState.BOOT_UP


def emergency(code: int, register: int = 1) -> bytes:
    return struct.pack("<HB5s", code, register, b"abcde")


def test_emergency_and_its_reset(bench: Bench) -> None:
    bench.put(EMCY, emergency(0x8130, 0x11))
    bench.drive.poll(1)
    assert bench.drive.emcy_code == 0x8130
    bench.drive.poll(2)
    assert bench.drive.emcy_code == 0x8130
    bench.put(EMCY, emergency(0, 0))
    bench.drive.poll(3)
    assert bench.drive.emcy_code == 0
    assert [(e.scan, e.code, e.vendor) for e in bench.drive.emergencies] == [(1, 0x8130, b"abcde"), (3, 0, b"abcde")]


def test_an_emergency_withdrawn_in_the_same_scan_is_seen_once(bench: Bench) -> None:
    bench.put(EMCY, emergency(0x8611))
    bench.put(EMCY, emergency(0))
    bench.drive.poll(1)
    assert bench.drive.emcy_code == 0x8611
    bench.drive.poll(2)
    assert bench.drive.emcy_code == 0


def test_a_drive_that_never_says_reset(bench: Bench) -> None:
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


def test_frames_of_others_are_counted_only(bench: Bench) -> None:
    bench.put(0x186, bytes(6))
    bench.put(TPDO1, bytes(6), is_extended_id=True)
    bench.put(HEARTBEAT, b"", is_remote_frame=True)
    bench.put(TPDO1, bytes(1), is_error_frame=True)
    bench.drive.poll(1)
    assert bench.drive.frames_foreign == 4
    assert bench.drive.age_scans(1) == AGE_NEVER
    assert bench.drive.nmt_state == NmtState.NEVER_HEARD


def test_a_babbling_bus_does_not_hold_the_scan(bench: Bench) -> None:
    for _ in range(FRAMES_PER_POLL + 10):
        bench.put(0x123, b"")
    bench.drive.poll(0)
    assert bench.drive.frames_foreign == FRAMES_PER_POLL
    bench.drive.poll(1)
    assert bench.drive.frames_foreign == FRAMES_PER_POLL + 10


def test_a_queue_after_a_gap_is_drained_to_the_newest(bench: Bench) -> None:
    for torque in range(FRAMES_AFTER_GAP // 2):
        bench.answer(torque=torque)
    bench.drive.poll(30, missed_periods=29)
    assert bench.drive.value("actual_torque") == FRAMES_AFTER_GAP // 2 - 1
    assert bench.drive.age_scans(30) == 0


def test_data_with_newer_ones_behind_them_are_not_fresh(bench: Bench) -> None:
    answers = 2 * FRAMES_PER_POLL
    for torque in range(answers):
        bench.answer(torque=torque)
        bench.put(HEARTBEAT, b"\x05")
    ages = []
    for scan in range(10, 18):
        bench.drive.poll(scan)
        ages.append((bench.drive.age_scans(scan), bench.drive.heartbeat_age_scans(scan)))
    left = (3 * answers - 1) // (FRAMES_PER_POLL + 1)  # one more frame is taken to see whether any is left
    assert ages[:left] == [(age, age) for age in range(1, left + 1)]
    assert ages[left] == (0, 0)
    assert ages[-1] == (7 - left, 7 - left)
    assert bench.drive.value("actual_torque") == answers - 1


def test_the_queue_after_a_gap_is_bounded_and_told(bench: Bench) -> None:
    for torque in range(FRAMES_AFTER_GAP):
        bench.answer(torque=torque)
    bench.drive.poll(50, missed_periods=40)
    assert bench.drive.value("actual_torque") == FRAMES_AFTER_GAP // 2 - 1
    assert bench.drive.age_scans(50) == 1
    bench.drive.poll(60, missed_periods=9)
    assert bench.drive.age_scans(60) == 0, "the frame that was looked at does not get lost"
    assert bench.drive.value("actual_torque") == FRAMES_AFTER_GAP - 1


@pytest.mark.parametrize(("frames", "age"), [(FRAMES_PER_POLL, 0), (FRAMES_PER_POLL + 2, 1)])
def test_exactly_as_many_frames_as_a_poll_takes(bench: Bench, frames: int, age: int) -> None:
    for _ in range(frames // 2):
        bench.answer()
    bench.drive.poll(5)
    assert bench.drive.age_scans(5) == age


def test_an_old_status_word_does_not_end_a_reset(bench: Bench) -> None:
    bench.put(EMCY, emergency(0x7121))
    bench.answer(FAULT)
    bench.drive.poll(1)
    bench.drive.send(orders(command=DriveCommand.FAULT_RESET), 1)
    for _ in range(FRAMES_PER_POLL):
        bench.answer(0x0250)
    bench.drive.poll(2)
    assert bench.drive.emcy_code == 0x7121, "newer frames wait"
    bench.drive.poll(3)
    assert bench.drive.emcy_code == 0


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
    bench = Bench("can-drive-any")
    try:
        for scan, (cob_id, data, kind) in enumerate(frames):
            bench.put(cob_id, b"" if kind.get("is_remote_frame") else data, **kind)
            bench.drive.poll(scan)
        bench.drive.send(orders(command, mode, torque, speed), len(frames))
        assert 0 <= bench.drive.value("statusword") <= 0xFFFF
        assert [cob_id for cob_id, _ in bench.sent()][-1] in {0x080, 0x77E}
    finally:
        bench.close()


def test_a_drive_that_is_to_be_off_and_does_not_say_so_gets_no_set_points(bench: Bench) -> None:
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
