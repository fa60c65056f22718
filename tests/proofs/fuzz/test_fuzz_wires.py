"""Bent frames and replies into the running controller, in small: the full count is `make fuzz-wires`."""

from __future__ import annotations

import logging

import pytest
from orders_watch import OrdersWatch
from wires import RECIPES, campaign, job

from definitions.image import DriveCommand, DriveMode, Image, Orders, State

FRAMES, REPLIES, SEED = 20_000, 2_000, 20_260_101
IMAGE = Image(*[0] * len(Image._fields))
RAMP = Orders(*[0] * len(Orders._fields))._replace(
    drive_command=DriveCommand.ENABLE_OPERATION,
    drive_mode=DriveMode.CYCLIC_SYNC_TORQUE,
    drive_target_torque_nm=1.0,
    state=State.RAMP_POS,
    brake_on=1,
)


def test_whatever_the_wires_say_nothing_raises_and_no_order_leaves_its_limits():
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL + 1)
    for told in campaign(FRAMES, REPLIES, SEED, most=1):
        last = told
    assert last.frames >= FRAMES
    assert last.replies >= REPLIES
    assert {"fault", "ramp_pos", "reverse", "ramp_neg", "unload"} <= set(last.states)
    assert len(last.faults) >= 5, "the attacks are all of one kind"
    assert last.ends["goes on"] >= 5


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"drive_target_torque_nm": 1.1}, "torque steps"),
        ({"drive_target_torque_nm": 1e9}, "N·m ordered"),
        ({"drive_target_torque_nm": float("nan")}, "nan"),
        ({"drive_target_velocity_rad_s": 1.0}, "rad/s ordered"),
        ({"brake_on": 0}, "lock open"),
        ({"state": State.RELEASE}, "RAMP_POS -> RELEASE"),
        ({"state": State.FAULT, "fault": 1, "alarms": 2, "reaction": 5}, "enables the drive"),
        ({"state": State.FAULT, "drive_command": 0}, "fault without its number"),
        ({"brake_current_a": 99.0}, "A ordered"),
    ],
)
def test_the_watch_sees_orders_beyond_their_limits(changed, words):
    watch = OrdersWatch(job(next(iter(RECIPES))).program, RAMP, State.RAMP_POS)
    watch.look(IMAGE, RAMP)
    with pytest.raises(AssertionError, match=words):
        watch.look(IMAGE, RAMP._replace(**changed))


def test_the_watch_sees_a_fault_that_goes_by_itself():
    fault = RAMP._replace(state=State.FAULT, drive_command=0, drive_target_torque_nm=0.0, fault=1, alarms=2, reaction=5)
    watch = OrdersWatch(job(next(iter(RECIPES))).program, fault, State.FAULT)
    watch.acknowledged = watch.reset_asked = False
    watch.look(IMAGE, fault)
    with pytest.raises(AssertionError, match="without acknowledgement"):
        watch.look(IMAGE, fault._replace(state=State.UNLOAD, fault=0, alarms=0, reaction=0))
