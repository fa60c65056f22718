"""A brake at a digital output of the drive: what is sent, what is taken for it, and what a profile must have for it."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest
from can_drive_support import DriveOnBus, orders
from drivers_support import PERIOD_NS, drive_config, raw_profile
from durand.datatypes import DatatypeEnum as Type
from durand.object_dictionary import Record, Variable
from durand_drive import DurandDrive

from definitions.image import AGE_NEVER
from drivers.can.bus import open_can
from drivers.config import CanConfig, DriveBrakeConfig
from drivers.errors import DriveSetupError
from drivers.servo_drive.objects import output_brake_problems, output_rows
from drivers.servo_drive.output_brake import OutputBrake, read_outputs
from drivers.servo_drive.setup import set_up_drive

OUTPUTS, INPUTS = 0x405, 0x385
BRAKE = DriveBrakeConfig(output_bit=16, input_bit=17)
ON, SEEN = 1 << 16, 1 << 17


def with_outputs() -> dict[str, Any]:
    """The sections of a profile whose third PDOs are the digital outputs and inputs."""
    raw = raw_profile("virtual-drive")
    out = {"index": 0x60FE, "subindex": 1, "type": "u32", "name": "digital_outputs"}
    into = {"index": 0x60FD, "subindex": 0, "type": "u32", "name": "digital_inputs"}
    third = {"number": 3, "transmission_type": 1}
    return {
        "receive_pdos": [*raw["receive_pdos"], third | {"timeout": False, "objects": [out]}],
        "transmit_pdos": [*raw["transmit_pdos"], third | {"objects": [into]}],
    }


@pytest.fixture
def bus() -> Iterator[DriveOnBus]:
    one = DriveOnBus("output-brake", **with_outputs())
    yield one
    one.close()


def sent(bus: DriveOnBus, scan: int) -> int:
    bus.sent()
    bus.drive.send(orders(), scan)
    ((number,),) = [struct.unpack("<I", data) for cob_id, data in bus.sent() if cob_id == OUTPUTS]
    return int(number)


def seen(bus: DriveOnBus, brake: OutputBrake, scan: int, inputs: int) -> float:
    bus.answer()
    bus.put(INPUTS, struct.pack("<I", inputs))
    bus.drive.poll(scan)
    brake.look()
    return brake.values[brake.place("brake_on")]


def test_the_order_goes_out_in_its_bit_and_the_contact_comes_back_in_its_own(bus: DriveOnBus) -> None:
    brake = OutputBrake(BRAKE)
    assert brake.age_scans(0) == AGE_NEVER
    brake.opened(bus.drive, 0b101)
    assert sent(bus, 0) == 0b101, "other outputs stay as they were found"
    brake.order({"brake_on": 1, "brake_current_a": 6.0})
    assert (sent(bus, 1), brake.ordered("brake_current_a")) == (ON | 0b101, 6.0)
    assert seen(bus, brake, 2, 0) == 0, "ordered, and the contact does not say so yet"
    assert seen(bus, brake, 3, SEEN | 1) == 1
    assert brake.age_scans(7) == 4
    assert seen(bus, brake, 8, ON) == 0, "another input says nothing of it"
    brake.order({"brake_on": 0, "brake_current_a": 0.0})
    assert sent(bus, 9) == 0b101


def test_without_a_contact_what_was_ordered_is_taken_for_it(bus: DriveOnBus) -> None:
    brake = OutputBrake(DriveBrakeConfig(output_bit=16))
    brake.opened(bus.drive, 0)
    brake.order({"brake_on": 1, "brake_current_a": 6.0})
    assert seen(bus, brake, 1, 0) == 1


def test_a_lock_that_is_closed_when_the_bench_is_opened_stays_so_until_it_is_ordered_open(bus: DriveOnBus) -> None:
    brake = OutputBrake(BRAKE)
    brake.opened(bus.drive, ON)
    assert sent(bus, 0) == ON, "it may hold a wound-up unit"
    assert seen(bus, brake, 1, SEEN) == 1


def test_a_profile_must_map_what_the_brake_needs() -> None:
    plain = drive_config().profile
    assert [one.what for one in output_brake_problems(BRAKE, plain)] == [
        "does not map digital_outputs", "does not map digital_inputs",
    ]  # fmt: skip
    assert [one.what for one in output_brake_problems(replace(BRAKE, input_bit=None), plain)] == [
        "does not map digital_outputs"
    ]


def test_the_mask_lets_our_output_through_and_leaves_the_others() -> None:
    (row,) = output_rows(drive_config(output_mask=ON))
    assert (row.index, row.subindex, row.written_over(0b11)) == (0x60FE, 2, ON | 0b11)
    assert row.matches(ON | 0b11)
    assert not row.matches(0b11)
    assert output_rows(drive_config()) == []


def test_the_mask_is_set_in_the_drive_and_its_outputs_are_read_before_any_is_sent() -> None:
    drive = DurandDrive("output-mask")
    outputs = Record(name="Digital outputs")
    for subindex, value in ((1, ON), (2, 0b11)):
        outputs[subindex] = Variable(Type.UNSIGNED32, "rw", value, name="outputs")
    drive.node.object_dictionary[0x60FE] = outputs
    link = open_can(CanConfig("virtual", "output-mask"))
    try:
        config = drive_config(output_mask=ON)
        log = set_up_drive(link, config, PERIOD_NS)
        assert drive.node.object_dictionary.read(0x60FE, 2) == ON | 0b11
        assert any("60FE:02 mask of the digital outputs" in line and "read back" in line for line in log)
        assert read_outputs(link, config) == ON
        with pytest.raises(DriveSetupError, match="60FE:01"):
            read_outputs(link, replace(config, node_id=9, sdo_reply_timeout_s=0.02, sdo_tries=1))
    finally:
        link.close()
        drive.close()
