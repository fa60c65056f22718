"""The virtual drive's CiA 402 machine: every transition made or refused, and its reactions as timelines."""

from __future__ import annotations

import itertools
from dataclasses import replace

import pytest

from virtual_bench.drive import cia402_tables as tables
from virtual_bench.drive.cia402_machine import Cia402Machine
from virtual_bench.drive.cia402_tables import Mode, PowerCommand, PowerState
from virtual_bench.physics.motor_stop import MotorView
from virtual_bench.physics.plant_numbers import DriveLoop

MS = 1_000_000
COUNTS = 1048576.0
STILL = MotorView(0, 0, 0, limited=False)
LOADED = MotorView(800, 0, 0, limited=False)
WORDS = {
    PowerCommand.DISABLE_VOLTAGE: 0x00,
    PowerCommand.QUICK_STOP: 0x02,
    PowerCommand.SHUTDOWN: 0x06,
    PowerCommand.SWITCH_ON: 0x07,
    PowerCommand.ENABLE_OPERATION: 0x0F,
    PowerCommand.FAULT_RESET: 0x80,
}
MASKS = {
    PowerState.NOT_READY_TO_SWITCH_ON: (0x4F, 0x00),
    PowerState.SWITCH_ON_DISABLED: (0x4F, 0x40),
    PowerState.READY_TO_SWITCH_ON: (0x6F, 0x21),
    PowerState.SWITCHED_ON: (0x6F, 0x23),
    PowerState.OPERATION_ENABLED: (0x6F, 0x27),
    PowerState.QUICK_STOP_ACTIVE: (0x6F, 0x07),
    PowerState.FAULT_REACTION_ACTIVE: (0x4F, 0x0F),
    PowerState.FAULT: (0x4F, 0x08),
}


def machine(motor: MotorView = STILL) -> Cia402Machine:
    drive = Cia402Machine(COUNTS)
    drive.objects.disable_option = 0
    drive.objects.quick_stop_option = 6
    drive.step(0, motor)
    return drive


def put_into(state: PowerState) -> Cia402Machine:
    drive = machine(LOADED)
    if state is PowerState.FAULT:
        drive.raise_fault(0x7121, 0)
    elif state is PowerState.FAULT_REACTION_ACTIVE:
        enable(drive)
        drive.raise_fault(0x7121, 0)
    elif state is PowerState.QUICK_STOP_ACTIVE:
        enable(drive)
        drive.write_controlword(0x02, 0)
        drive.step(10 * MS, STILL)  # the stop is done, option 6 stays here
    else:
        chain = (PowerState.READY_TO_SWITCH_ON, PowerState.SWITCHED_ON, PowerState.OPERATION_ENABLED)
        for word, reached in zip((0x06, 0x07, 0x0F), chain, strict=True):
            if drive.state is state:
                break
            drive.write_controlword(word, 0)
            assert drive.state is reached
    assert drive.state is state
    return drive


def enable(drive: Cia402Machine, mode: Mode = Mode.CYCLIC_SYNC_TORQUE) -> None:
    drive.motion.write_mode(mode)
    for word in (0x06, 0x07, 0x0F):
        drive.write_controlword(word, 0)
    assert drive.state is PowerState.OPERATION_ENABLED


REACHABLE = [state for state in PowerState if state is not PowerState.NOT_READY_TO_SWITCH_ON]


@pytest.mark.parametrize(("state", "command"), list(itertools.product(REACHABLE, PowerCommand)))
def test_every_transition_is_made_or_refused(state: PowerState, command: PowerCommand) -> None:
    drive = put_into(state)
    expected = tables.TRANSITIONS.get((state, command), state)
    word = WORDS[command]
    if command is PowerCommand.FAULT_RESET and state is not PowerState.FAULT:
        expected = tables.TRANSITIONS.get((state, PowerCommand.DISABLE_VOLTAGE), state)  # 0x80 also lacks bit 1
    if command is PowerCommand.DISABLE_VOLTAGE:
        drive.write_controlword(0x06 if state is PowerState.SWITCH_ON_DISABLED else drive.controlword, 0)
        expected = tables.TRANSITIONS.get((drive.state, command), drive.state)
    drive.write_controlword(word, 20 * MS)
    assert drive.state is expected


@pytest.mark.parametrize("state", REACHABLE)
def test_the_status_word_names_the_state(state: PowerState) -> None:
    drive = put_into(state)
    mask, pattern = MASKS[state]
    assert drive.statusword & mask == pattern
    others = [other for other, (mask, pattern) in MASKS.items() if drive.statusword & mask == pattern]
    assert others == [state]


def test_every_table_is_total() -> None:
    assert set(tables.STATUS_BITS) == set(PowerState)
    assert {tables.decode_command(word) for word in range(0x10000)} == set(PowerCommand) - {PowerCommand.FAULT_RESET}
    assert all(state in PowerState and after in PowerState for (state, _), after in tables.TRANSITIONS.items())


def test_the_motor_has_torque_only_while_energized() -> None:
    for state in REACHABLE:
        drive = put_into(state)
        assert (drive.motion.demand.loop is DriveLoop.OFF) == (state not in tables.ENERGIZED), state


def test_a_fault_is_left_only_by_a_rising_edge() -> None:
    drive = machine()
    drive.write_controlword(0x80, 0)
    drive.raise_fault(0x4310, 0)
    drive.write_controlword(0x80, MS)
    assert drive.state is PowerState.FAULT
    drive.write_controlword(0x00, 2 * MS)
    drive.write_controlword(0x80, 3 * MS)
    assert drive.state is PowerState.SWITCH_ON_DISABLED
    assert drive.error_code == 0
    drive.write_controlword(0x0F, 4 * MS)
    assert drive.state is PowerState.SWITCH_ON_DISABLED


def test_quick_stop_in_torque_mode_takes_the_torque_away_then_disables() -> None:
    drive = machine()
    drive.objects.quick_stop_option = 2
    enable(drive)
    drive.motion.write_target_torque(800)
    assert drive.motion.demand.torque_permille == 800
    drive.step(10 * MS, LOADED)
    drive.write_controlword(0x02, 10 * MS)
    assert drive.state is PowerState.QUICK_STOP_ACTIVE
    assert drive.motion.demand == (DriveLoop.TORQUE, 0, 0.0)
    drive.step(50 * MS, replace(LOADED, torque_permille=200))
    assert drive.state is PowerState.QUICK_STOP_ACTIVE
    drive.write_controlword(0x0F, 60 * MS)
    assert drive.state is PowerState.QUICK_STOP_ACTIVE
    drive.step(100 * MS, STILL)
    assert drive.state is PowerState.SWITCH_ON_DISABLED


def test_quick_stop_in_velocity_mode_ramps_the_speed_down() -> None:
    drive = machine()
    drive.objects.quick_stop_option = 2
    drive.objects.quick_stop_counts_s2 = 1_000_000
    enable(drive, Mode.CYCLIC_SYNC_VELOCITY)
    drive.motion.write_target_velocity(100_000)
    drive.step(0, replace(STILL, velocity_counts_s=100_000))
    drive.write_controlword(0x02, 0)
    drive.step(50 * MS, replace(STILL, velocity_counts_s=60_000))
    assert drive.motion.demand.velocity_counts_s == pytest.approx(50_000)
    drive.step(101 * MS, STILL)
    drive.step(102 * MS, STILL)
    assert drive.state is PowerState.SWITCH_ON_DISABLED


def test_a_stop_that_does_not_end_is_cut() -> None:
    drive = machine()
    drive.objects.quick_stop_option = 2
    enable(drive)
    drive.write_controlword(0x02, 0)
    drive.step(2001 * MS, LOADED)
    assert drive.state is PowerState.SWITCH_ON_DISABLED
    assert "stop_cut" in [event.kind for event in drive.events]


@pytest.mark.parametrize(
    ("option", "state", "loop"),
    [
        (0, PowerState.OPERATION_ENABLED, DriveLoop.TORQUE),
        (1, PowerState.FAULT_REACTION_ACTIVE, DriveLoop.TORQUE),
        (2, PowerState.SWITCH_ON_DISABLED, DriveLoop.OFF),
        (3, PowerState.QUICK_STOP_ACTIVE, DriveLoop.TORQUE),
    ],
)
@pytest.mark.parametrize("how", ["heartbeat", "setpoint"])
def test_a_lost_controller_is_met_by_the_abort_connection_option(
    option: int, state: PowerState, loop: DriveLoop, how: str
) -> None:
    emcys: list[tuple[int, int]] = []
    drive = Cia402Machine(COUNTS, lambda code, register: emcys.append((code, register)))
    drive.objects.abort_connection = option
    drive.step(0, LOADED)
    enable(drive)
    drive.motion.write_target_torque(800)
    if how == "heartbeat":
        drive.consume_heartbeats_of(126, 100)
        drive.heartbeat(126, 0)
    else:
        drive.objects.setpoint_timeout_ms = 100
        drive.setpoint_received(0)
    drive.step(100 * MS, LOADED)
    assert emcys == []
    drive.step(101 * MS, LOADED)
    assert emcys == [(0x8130 if how == "heartbeat" else 0x8250, 0x11)]
    assert drive.state is state
    assert drive.motion.demand.loop is loop
    drive.write_controlword(0x0F, 102 * MS)
    assert drive.state is state
    if option == 0:
        assert drive.statusword & tables.WARNING


def test_supervision_waits_for_the_first_heartbeat_and_starts_again_with_the_next() -> None:
    drive = machine()
    drive.consume_heartbeats_of(126, 100)
    drive.step(10_000 * MS, STILL)
    assert drive.events == []
    drive.heartbeat(126, 10_000 * MS)
    drive.step(10_101 * MS, STILL)
    assert drive.error_code == 0x8130
    drive.step(20_000 * MS, STILL)
    assert [event.code for event in drive.events if event.kind == "emcy"] == [0x8130]
    drive.heartbeat(126, 20_000 * MS)
    assert drive.error_code == 0


@pytest.mark.parametrize("how", ["heartbeat", "setpoint"])
def test_a_standstill_of_the_computer_is_no_silence_and_silence_after_it_counts(how: str) -> None:
    drive = machine(LOADED)
    enable(drive)
    if how == "heartbeat":
        drive.consume_heartbeats_of(126, 100)
        drive.heartbeat(126, 0)
    else:
        drive.objects.setpoint_timeout_ms = 100
        drive.setpoint_received(0)
    drive.excuse_silence(70 * MS)
    drive.step(170 * MS, LOADED)
    assert drive.error_code == 0
    drive.step(171 * MS, LOADED)
    assert drive.error_code == (0x8130 if how == "heartbeat" else 0x8250)


def test_an_emergency_stop_cuts_the_torque_and_keeps_it_off() -> None:
    drive = machine(LOADED)
    enable(drive)
    drive.set_safe_torque_off(active=True, now_ns=0)
    assert drive.motion.demand.loop is DriveLoop.OFF
    assert not drive.statusword & tables.VOLTAGE_ENABLED
    for word in (0x06, 0x07, 0x0F):
        drive.write_controlword(word, MS)
    assert drive.state is PowerState.SWITCH_ON_DISABLED
    drive.set_safe_torque_off(active=False, now_ns=2 * MS)
    assert drive.state is PowerState.SWITCH_ON_DISABLED
    enable(drive)


def test_homing_by_the_current_position() -> None:
    drive = machine(replace(STILL, position_counts=12_345))
    enable(drive, Mode.HOMING)
    drive.write_controlword(0x1F, MS)
    assert drive.position_counts == 0
    assert drive.statusword & tables.HOMING_ATTAINED
    assert not drive.statusword & tables.HOMING_ERROR


def test_homing_is_refused_while_the_motor_moves() -> None:
    drive = machine(replace(STILL, velocity_counts_s=200_000))
    enable(drive, Mode.HOMING)
    drive.write_controlword(0x1F, MS)
    assert drive.statusword & tables.HOMING_ERROR
    assert not drive.statusword & tables.HOMING_ATTAINED


def test_an_unknown_mode_leaves_the_display() -> None:
    drive = machine()
    drive.motion.write_mode(10)
    drive.motion.write_mode(3)
    assert drive.motion.mode_display is Mode.CYCLIC_SYNC_TORQUE


def test_halt_takes_the_torque_away_and_gives_it_back() -> None:
    drive = machine()
    enable(drive)
    drive.motion.write_target_torque(500)
    drive.write_controlword(0x010F, MS)
    assert drive.state is PowerState.OPERATION_ENABLED
    assert drive.motion.demand.torque_permille == 0
    assert not drive.statusword & tables.FOLLOWS_COMMAND
    drive.write_controlword(0x000F, 2 * MS)
    assert drive.motion.demand.torque_permille == 500


@pytest.mark.parametrize(
    ("code", "register"), [(0, 0), (0x2310, 0x03), (0x3210, 0x05), (0x4310, 0x09), (0x8130, 0x11), (0x8611, 0x21)]
)
def test_error_register_by_class_of_error(code: int, register: int) -> None:
    assert tables.error_register(code) == register
