"""More frames than a scan takes: how many are read, which value is the newest, and what is not fresh."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from can_drive_support import EMCY, FAULT, HEARTBEAT, DriveOnBus, emergency, orders

from definitions.image import DriveCommand
from drivers.servo_drive.drive import (
    FRAMES_AFTER_GAP,
    FRAMES_PER_POLL,
    MOST_FRAMES_PER_POLL,
    SHORTEST_FRAME_BITS,
    frames_per_poll,
)


@pytest.fixture
def bench() -> Iterator[DriveOnBus]:
    one = DriveOnBus()
    yield one
    one.close()


def test_a_babbling_bus_does_not_hold_the_scan(bench: DriveOnBus) -> None:
    for _ in range(FRAMES_PER_POLL + 10):
        bench.put(0x123, b"")
    bench.drive.poll(0)
    assert bench.drive.frames_foreign == FRAMES_PER_POLL
    bench.drive.poll(1)
    assert bench.drive.frames_foreign == FRAMES_PER_POLL + 10


def test_a_queue_after_a_gap_is_drained_to_the_newest(bench: DriveOnBus) -> None:
    for torque in range(FRAMES_AFTER_GAP // 2):
        bench.answer(torque=torque)
    bench.drive.poll(30, missed_periods=29)
    assert bench.drive.value("actual_torque") == FRAMES_AFTER_GAP // 2 - 1
    assert bench.drive.age_scans(30) == 0


def test_data_with_newer_ones_behind_them_are_not_fresh(bench: DriveOnBus) -> None:
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


def test_the_queue_after_a_gap_is_bounded_and_told(bench: DriveOnBus) -> None:
    for torque in range(FRAMES_AFTER_GAP):
        bench.answer(torque=torque)
    bench.drive.poll(50, missed_periods=40)
    assert bench.drive.value("actual_torque") == FRAMES_AFTER_GAP // 2 - 1
    assert bench.drive.age_scans(50) == 1
    bench.drive.poll(60, missed_periods=9)
    assert bench.drive.age_scans(60) == 0, "the frame that was looked at does not get lost"
    assert bench.drive.value("actual_torque") == FRAMES_AFTER_GAP - 1


@pytest.mark.parametrize(("frames", "age"), [(FRAMES_PER_POLL, 0), (FRAMES_PER_POLL + 2, 1)])
def test_exactly_as_many_frames_as_a_poll_takes(bench: DriveOnBus, frames: int, age: int) -> None:
    for _ in range(frames // 2):
        bench.answer()
    bench.drive.poll(5)
    assert bench.drive.age_scans(5) == age


@pytest.mark.parametrize("bitrate", [125_000, 500_000, 1_000_000])
@pytest.mark.parametrize("period_ns", [500_000, 1_000_000, 2_000_000, 5_000_000, 20_000_000])
def test_a_scan_takes_more_than_a_full_bus_delivers_in_its_period(period_ns: int, bitrate: int) -> None:
    most = frames_per_poll(period_ns, bitrate)
    assert most >= 1.5 * period_ns * 1e-9 * bitrate / SHORTEST_FRAME_BITS
    assert FRAMES_PER_POLL <= most <= MOST_FRAMES_PER_POLL


def test_at_1_ms_a_scan_takes_what_it_always_took_and_a_longest_period_is_bounded() -> None:
    assert frames_per_poll(1_000_000, 1_000_000) == FRAMES_PER_POLL == 64
    assert FRAMES_AFTER_GAP == 512
    assert frames_per_poll(1_000_000_000, 1_000_000) == MOST_FRAMES_PER_POLL


def test_a_bus_with_half_load_leaves_no_backlog_at_20_ms_and_a_gap_is_drained() -> None:
    half = 20_000_000 * 1e-9 * 1_000_000 / SHORTEST_FRAME_BITS / 2
    bench = DriveOnBus("at 20 ms", frames_per_poll(20_000_000, 1_000_000))
    for scan, periods in ((1, 1), (2, 1), (6, 4), (7, 1)):
        for _ in range(periods):
            for _ in range(round(half)):
                bench.put(0x123, b"")
            bench.answer(torque=scan)
            bench.put(HEARTBEAT, b"\x05")
        bench.drive.poll(scan, missed_periods=periods - 1)
        assert (bench.drive.age_scans(scan), bench.drive.heartbeat_age_scans(scan)) == (0, 0)
        assert bench.drive.value("actual_torque") == scan
    bench.close()


def test_an_old_status_word_does_not_end_a_reset(bench: DriveOnBus) -> None:
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
