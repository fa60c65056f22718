"""A drive that does not home, one without bit 12, and PDOs with entries that nobody looks at, in the scan."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import pytest
from can_drive_support import CST, ENABLED, TPDO1, DriveOnBus, orders
from drivers_support import raw_profile

from definitions.image import DriveCommand, DriveMode, DriveState, Image
from drivers.servo_drive.cia402 import follows_command
from drivers.wire_image import WireImage

HOMING = int(DriveMode.HOMING)
RPDO1 = 0x205


class NoDevice:
    """A Modbus device that has said nothing yet."""

    values: list[float] | None = None
    lost = False

    def place(self, name: str) -> int:
        del name
        return 0

    def age_scans(self, scan: int) -> int:
        return scan


@pytest.fixture
def without_homing() -> Iterator[DriveOnBus]:
    with closing(DriveOnBus("without-homing", homing_method=0)) as one:
        yield one


def look(on_bus: DriveOnBus, image: WireImage, scan: int, position: int, statusword: int = ENABLED) -> Image:
    on_bus.answer(statusword, CST)
    on_bus.put(0x285, struct.pack("<ii", position, 0))
    on_bus.drive.poll(scan)
    return image.take(on_bus.drive, scan, 0, 0)._replace()


def test_a_drive_that_does_not_home_stays_in_torque_mode_and_counts_from_where_it_stands(
    without_homing: DriveOnBus,
) -> None:
    image = WireImage(NoDevice(), NoDevice(), NoDevice())  # type: ignore[arg-type]
    drive = without_homing.drive
    drive.send(orders(DriveCommand.ENABLE_OPERATION, HOMING, torque=1.0), 0)
    sent = dict(without_homing.sent())
    assert struct.unpack("<Hbh", sent[RPDO1]) == (0x0F, CST, 0)
    seen = look(without_homing, image, 1, 5000)
    assert (seen.drive_mode, seen.drive_homing_attained, seen.drive_state) == (HOMING, 0, DriveState.OPERATION_ENABLED)
    assert seen.drive_angle_rad == 5000 * drive.units.angle_rad_per_count
    drive.send(orders(DriveCommand.START_HOMING, HOMING), 1)
    assert struct.unpack("<Hbh", dict(without_homing.sent())[RPDO1]) == (0x0F, CST, 0)
    seen = look(without_homing, image, 2, 5000)
    assert (seen.drive_mode, seen.drive_homing_attained, seen.drive_angle_rad) == (HOMING, 1, 0.0)
    drive.send(orders(torque=1.0), 2)
    seen = look(without_homing, image, 3, 5100)
    assert (seen.drive_mode, seen.drive_homing_attained) == (CST, 0)
    assert seen.drive_angle_rad == 100 * drive.units.angle_rad_per_count


@pytest.mark.parametrize(
    ("statusword", "mode", "has_bit", "follows"),
    [
        (0x1637, CST, True, 1),
        (0x0637, CST, True, 0),
        (0x0637, CST, False, 1),
        (0x0633, CST, False, 0),
        (0x0637, HOMING, False, 0),
    ],
)
def test_without_bit_12_nothing_more_is_known_than_that_the_drive_is_enabled(
    *, statusword: int, mode: int, has_bit: bool, follows: int
) -> None:
    assert follows_command(statusword, mode, has_bit=has_bit) == follows


def test_entries_that_nobody_looks_at_are_passed_over_and_hold_their_value() -> None:
    raw: Any = raw_profile("virtual-drive")
    raw["receive_pdos"][0]["objects"].insert(
        1, {"index": 0x60B2, "subindex": 0, "type": "i16", "name": "ignored", "value": -2}
    )
    raw["transmit_pdos"][0]["objects"].insert(1, {"index": 0x603F, "subindex": 0, "type": "u16", "name": "ignored"})
    pdos = {key: raw[key] for key in ("receive_pdos", "transmit_pdos")}
    with closing(DriveOnBus("ignored-entries", **pdos)) as on_bus:
        on_bus.drive.send(orders(torque=0.01), 0)
        assert struct.unpack("<Hhbh", dict(on_bus.sent())[RPDO1]) == (0x0F, -2, CST, 1)
        on_bus.put(TPDO1, struct.pack("<HHbhB", ENABLED, 0xFFFF, CST, 12, 0))
        on_bus.drive.poll(1)
        assert (on_bus.drive.value("statusword"), on_bus.drive.value("actual_torque")) == (ENABLED, 12)
        assert on_bus.drive.frames_malformed == 0


def test_a_control_word_in_two_pdos_is_sent_in_both() -> None:
    raw: Any = raw_profile("virtual-drive")
    raw["receive_pdos"][0]["objects"] = raw["receive_pdos"][0]["objects"][:2]
    word = {"index": 0x6040, "subindex": 0, "type": "u16", "name": "controlword"}
    torque = {"index": 0x6071, "subindex": 0, "type": "i16", "name": "target_torque"}
    raw["receive_pdos"].append(
        {"number": 5, "cob_id": 0x225, "transmission_type": 255, "timeout": True, "objects": [word, torque]}
    )
    with closing(DriveOnBus("two-control-words", receive_pdos=raw["receive_pdos"])) as on_bus:
        on_bus.drive.send(orders(torque=0.01), 0)
        sent = dict(on_bus.sent())
        assert struct.unpack("<Hb", sent[RPDO1]) == (0x0F, CST)
        assert struct.unpack("<Hh", sent[0x225]) == (0x0F, 1)
