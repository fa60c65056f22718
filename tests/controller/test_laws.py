"""Laws that hold for whatever the devices send: no exception, no torque from a fault, nothing that clears itself."""

from __future__ import annotations

import math

from bench_model import READY
from hypothesis import given, settings
from hypothesis import strategies as st
from programs import short_program
from ramp_support import entered, whole_run
from timeline import Timeline

from controller.controller import Controller
from definitions.image import AGE_NEVER, Command, DriveCommand, DriveMode, DriveState, Image, Reaction, State

PROGRAM = short_program()
TORQUES = st.one_of(st.floats(-600.0, 600.0), st.sampled_from([math.nan, math.inf, -math.inf]))
CHANGES: dict[str, st.SearchStrategy] = {
    "missed_periods": st.integers(0, 100),
    "command": st.sampled_from(list(Command)),
    "drive_state": st.sampled_from(list(DriveState)),
    "drive_mode": st.sampled_from([0, 6, 9, 10, -1]),
    "drive_internal_limit": st.integers(0, 1),
    "drive_homing_attained": st.integers(0, 1),
    "drive_age_scans": st.sampled_from([0, 1, 9, 12, AGE_NEVER]),
    "drive_heartbeat_age_scans": st.sampled_from([0, 99, 150, AGE_NEVER]),
    "drive_emcy_code": st.sampled_from([0, 0x8130, 0x2310]),
    "torque_in_nm": TORQUES,
    "torque_out_nm": TORQUES,
    "angle_in_rad": TORQUES,
    "sample_counter": st.integers(0, 3),
    "sample_age_scans": st.sampled_from([0, 1, 6, 20, AGE_NEVER]),
    "brake_current_a": st.floats(0.0, 10.0),
    "brake_on": st.integers(0, 1),
    "estop_released": st.integers(0, 1),
    "links_lost": st.integers(0, 31),
}


@st.composite
def episodes(draw) -> list[dict[str, float]]:
    names = draw(st.lists(st.sampled_from(sorted(CHANGES)), max_size=4, unique=True))
    return [{name: draw(CHANGES[name]) for name in names} for _ in range(draw(st.integers(1, 4)))]


def check_laws(before: State, image: Image, orders) -> None:
    limit = PROGRAM.control.torque_limit_nm
    assert math.isfinite(orders.drive_target_torque_nm)
    assert abs(orders.drive_target_torque_nm) <= limit
    if before == State.FAULT:
        assert orders.state in (State.FAULT, State.UNLOAD)
    if orders.state == State.FAULT:
        assert orders.fault
        if orders.reaction >= Reaction.QUICK_STOP:
            assert orders.drive_command != DriveCommand.ENABLE_OPERATION
            assert orders.drive_target_torque_nm == 0.0
    if orders.drive_target_torque_nm and orders.state != State.FAULT:
        assert orders.brake_on
    assert image is not None


def way_to(target: State) -> Timeline:
    """A run that has just come to a state, or to its end without it."""
    return entered(target) if target in whole_run().states() else whole_run().branch()


def test_branches_go_on_like_the_run_and_do_not_touch_each_other() -> None:
    run = Timeline(PROGRAM)
    run.until_state(State.CALIBRATE)
    first, second = run.branch(), run.branch()
    second.bench.frozen = {"estop_released": 0}
    second.go(1000)
    first.go(3000)
    run.go(3000)
    assert first.orders == run.orders
    assert first.images == run.images
    assert second.controller.state == State.FAULT


@settings(max_examples=60, deadline=None)
@given(at=st.integers(0, 11), episode=episodes(), scans=st.integers(1, 40))
def test_any_input_at_any_state(at, episode, scans):
    run = way_to(list(State)[at])
    for change in episode:
        run.bench.frozen = change
        for _ in range(scans):
            before = run.controller.state
            orders = run.go()
            check_laws(before, run.images[-1], orders)


@settings(max_examples=200, deadline=None)
@given(st.lists(st.fixed_dictionaries({}, optional=CHANGES), max_size=30))
def test_arbitrary_images_never_raise(changes):
    controller = Controller(PROGRAM)
    scan = 0
    for change in changes:
        image = READY._replace(drive_mode=DriveMode.CYCLIC_SYNC_TORQUE)._replace(**change)
        orders = controller.step(image, scan)
        assert math.isfinite(orders.drive_target_torque_nm)
        scan += 1 + image.missed_periods


@settings(max_examples=30, deadline=None)
@given(st.lists(st.sampled_from([Command.NONE, Command.START, Command.STOP, Command.RESET]), max_size=20))
def test_an_unacknowledged_fault_never_clears(commands):
    run = way_to(State.CALIBRATE)
    run.bench.frozen = {"estop_released": 0}
    run.until_finished()
    run.bench.frozen = {}
    for command in commands:
        assert run.command(command).state == State.FAULT
