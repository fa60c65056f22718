"""What a person is shown before the question of a recovery: as it is now, or that it is not known."""

from __future__ import annotations

import pytest

from definitions.faults import FAULT_BY_ID
from definitions.first_image import first_image
from definitions.image import AGE_NEVER, DriveState, Link, Orders
from station.bench.request import load_job
from station.run.way_back.guide import situation

DEVICES = {
    "drive_age_scans": (Link.CAN, {"Servo drive"}),
    "brake_age_scans": (Link.BRAKE, {"Lock"}),
    "io_age_scans": (Link.REMOTE_IO, {"Emergency stop", "Guard"}),
}
"""Age of what a device said, its connection, and the lines that it stands in."""


@pytest.mark.parametrize("age", DEVICES)
@pytest.mark.parametrize("lost", [False, True])
def test_what_a_silent_device_said_last_is_not_shown_as_what_is(age: str, *, lost: bool) -> None:
    """A recovery asked whether all was checked below a list that called a dead guard closed."""
    link, lines = DEVICES[age]
    image = first_image()
    for name in DEVICES:
        setattr(image, name, 0)
    image.brake_on, image.brake_current_a, image.drive_state = 1, 6.0, int(DriveState.SWITCH_ON_DISABLED)
    image.estop_released = image.guard_closed = 1
    fault = FAULT_BY_ID["remote_io_lost"].number
    orders = Orders(*[0] * len(Orders._fields))._replace(fault=fault)
    program = load_job("rv-40e-121-quick", None).program
    assert not _unknown(situation(image, orders, program))
    if lost:
        image.links_lost = int(link)
    else:
        setattr(image, age, AGE_NEVER)
    assert _unknown(situation(image, orders, program)) == lines


def _unknown(lines: list[str]) -> set[str]:
    return {line.split("  ")[0] for line in lines if "NOT KNOWN" in line and not line.startswith("Torque")}
