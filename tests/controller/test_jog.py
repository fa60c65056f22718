"""A jog as timelines: what turns the shaft, what stops it, and what never lets it start."""

from __future__ import annotations

import itertools
from dataclasses import replace

import pytest
from programs import short_program
from timeline import Timeline

from controller.aftermath import DRIVE_IS_OFF
from definitions.faults import FAULT_BY_ID
from definitions.image import Command, DriveCommand, DriveMode, DriveState, Orders, State
from definitions.jog import DIRECTIONS, PHASE_ROWS, PHASES, TOKEN_EVERY_S, JogPhase
from definitions.program import Jog
from recipes import find_bench, load_bench
from recipes.compiler.budgets import budget
from recipes.compiler.jog import PERIOD_S, compile_jog, jog_bench, jog_speed_rad_s, jog_torque_nm

P, S = JogPhase, State
SPEED_RAD_S = 0.5
JOG = Jog(SPEED_RAD_S, 5.0, 10.0, token_scans=100, longest_press_scans=2000, stop_scans=300)
PROGRAM = replace(short_program(), jog=JOG)
TOKEN_SCANS = round(TOKEN_EVERY_S / PERIOD_S)
WAITING = {P.RELEASE_DEVICE, P.HOLD_KEY, P.PRESS_DEVICE}


class Hands:
    """The person of a jog: `go` with a key held or not, and the enabling device pressed or not."""

    def __init__(self, program=PROGRAM) -> None:
        self.run = Timeline(program)
        self.run.until_state(S.JOG)

    def go(self, scans: int, *, key: Command = Command.NONE, device: bool = False) -> Orders:
        self.run.bench.frozen |= {"enabling_device": int(device)}
        for scan in range(scans):
            if key and scan % TOKEN_SCANS == 0:
                self.run.bench.command = key
            self.run.go()
        return self.run.orders[-1]

    def turning(self, key: Command = Command.JOG_POSITIVE) -> Orders:
        """Key first, then the device, until the shaft turns at its speed."""
        self.go(TOKEN_SCANS, key=key)
        return self.go(4 * TOKEN_SCANS, key=key, device=True)

    def stopped_within(self, scans: int, **what: bool | Command) -> int:
        """Go on so long; the scans that it took until the drive is off for good."""
        first = len(self.run.orders)
        self.go(scans, **what)
        on = [n for n, image in enumerate(self.run.images[first:]) if image.drive_state not in DRIVE_IS_OFF]
        return max(on, default=0) + 1


@pytest.mark.parametrize(("key", "direction"), [(Command(key), sign) for key, sign in DIRECTIONS.items()])
def test_key_and_then_enabling_device_turn_the_shaft_at_its_speed(key, direction):
    hands = Hands()
    assert (hands.go(1).phase, hands.go(1).phase) == (P.HOLD_KEY, P.HOLD_KEY)
    orders = hands.turning(key)
    assert (orders.phase, orders.drive_command) == (P.TURNING, DriveCommand.ENABLE_OPERATION)
    assert orders.drive_target_velocity_rad_s == pytest.approx(direction * SPEED_RAD_S)
    assert hands.run.images[-1].angle_in_rad * direction > 0.0
    speeds = [one.drive_target_velocity_rad_s for one in hands.run.orders]
    steps = [abs(after - before) for before, after in itertools.pairwise(speeds)]
    assert max(steps) <= JOG.acceleration_rad_s2 * PERIOD_S * (1 + 1e-9)
    assert not any(orders.brake_on for orders in hands.run.orders)


def test_a_token_of_exactly_its_age_counts_and_the_next_scan_stops():
    hands = Hands()
    hands.turning()
    age = TOKEN_SCANS - 1  # of the newest token after `turning`
    assert hands.go(JOG.token_scans - age, device=True).phase == P.TURNING
    orders = hands.go(1, device=True)
    assert orders.phase == P.STOPPING
    ramp = SPEED_RAD_S / JOG.deceleration_rad_s2 / PERIOD_S
    assert hands.stopped_within(1000, device=True) <= ramp + 5
    assert hands.run.orders[-1].phase == P.RELEASE_DEVICE


LOSSES = {
    "key let go": {"device": True},
    "enabling device let go, or pressed through": {"key": Command.JOG_POSITIVE},
    "both let go": {},
    "key of the other direction": {"key": Command.JOG_NEGATIVE, "device": True},
}


@pytest.mark.parametrize("what", LOSSES.values(), ids=LOSSES)
def test_either_of_both_lost_stops_on_a_ramp_and_switches_the_drive_off(what):
    hands = Hands()
    hands.turning()
    scan = len(hands.run.orders)
    allowed = JOG.token_scans + SPEED_RAD_S / JOG.deceleration_rad_s2 / PERIOD_S + 5
    assert hands.stopped_within(1500, **what) <= allowed
    speeds = [one.drive_target_velocity_rad_s for one in hands.run.orders[scan:]]
    assert min(speeds) == 0.0, "it never turns the other way"
    assert speeds[-1] == 0.0
    assert hands.run.orders[-1].state == S.JOG
    assert not hands.run.alarms()


def test_the_enabling_device_let_go_stops_in_the_same_scan():
    hands = Hands()
    hands.turning()
    assert hands.go(1, key=Command.JOG_POSITIVE).phase == P.STOPPING


CLOSED = {name: what for name, what in LOSSES.items() if what.get("device") or not what}


@pytest.mark.parametrize("what", CLOSED.values(), ids=CLOSED)
def test_what_comes_back_starts_nothing_without_a_new_press(what):
    hands = Hands()
    hands.turning()
    hands.go(1500, **what)
    both = {"key": Command.JOG_POSITIVE, "device": True}
    first = len(hands.run.orders)
    assert hands.go(300, **both).phase == P.RELEASE_DEVICE
    assert {one.drive_command for one in hands.run.orders[first:]} == {DriveCommand.DISABLE_VOLTAGE}
    hands.go(10)
    assert hands.turning().phase == P.TURNING


def test_an_enabling_device_pressed_before_the_key_moves_nothing():
    hands = Hands()
    hands.go(10, device=True)
    orders = hands.go(500, key=Command.JOG_POSITIVE, device=True)
    assert orders.phase == P.RELEASE_DEVICE
    assert {one.drive_command for one in hands.run.orders} == {DriveCommand.DISABLE_VOLTAGE}


def test_a_contact_that_stays_closed_is_a_fault():
    hands = Hands()
    hands.turning()
    hands.go(JOG.longest_press_scans, key=Command.JOG_POSITIVE, device=True)
    assert hands.run.orders[-1].state == S.FAULT
    assert hands.run.orders[-1].fault == FAULT_BY_ID["enabling_device_stuck"].number
    assert hands.run.orders[-1].drive_target_velocity_rad_s == 0.0
    hands.run.until_finished()


def test_a_bench_without_the_input_never_enables_its_drive():
    hands = Hands()
    hands.go(2000, key=Command.JOG_POSITIVE)
    assert hands.run.orders[-1].phase == P.PRESS_DEVICE
    assert {one.drive_command for one in hands.run.orders} == {DriveCommand.DISABLE_VOLTAGE}


def test_a_run_has_no_ear_for_a_jog():
    run, jogged = Timeline(short_program()), Timeline(short_program())
    for timeline in (run, jogged):
        timeline.until_state(S.LOCK)
    jogged.bench.frozen["enabling_device"] = 1
    for _ in range(20):
        jogged.command(Command.JOG_POSITIVE)
        run.go()
    assert jogged.orders == run.orders


@pytest.mark.parametrize("shown", [{"brake_on": 1}, {"brake_current_a": 1.0}])
@pytest.mark.parametrize("when", ["before", "while it turns"])
def test_with_the_lock_closed_nothing_turns(shown, when):
    hands = Hands()
    if when == "while it turns":
        hands.turning()
    hands.run.bench.frozen |= shown
    orders = hands.go(3, key=Command.JOG_POSITIVE, device=True)
    assert (orders.state, orders.fault) == (S.FAULT, FAULT_BY_ID["brake_stays_closed"].number)
    assert orders.drive_command == DriveCommand.DISABLE_VOLTAGE


def test_a_stop_ends_the_jog_once_the_shaft_stands_and_the_drive_is_off():
    hands = Hands()
    hands.turning()
    hands.run.command(Command.STOP)
    hands.go(500, key=Command.JOG_POSITIVE, device=True)
    assert hands.run.states() == [S.JOG, S.STOPPED]
    last = next(orders for orders in hands.run.orders if orders.state == S.STOPPED)
    assert (last.drive_command, last.drive_target_velocity_rad_s) == (DriveCommand.DISABLE_VOLTAGE, 0.0)
    assert hands.run.controller.finished


def test_a_shaft_that_does_not_stop_loses_its_power():
    hands = Hands()
    hands.turning()
    hands.run.bench.shaft_follows = False
    hands.go(JOG.stop_scans + 10)
    assert hands.run.alarms() == ["jog_not_stopped"]
    assert hands.run.orders[-1].drive_command == DriveCommand.DISABLE_VOLTAGE


@pytest.mark.parametrize(
    ("phase", "shown", "fault"),
    [
        (P.ENABLING, {"drive_state": DriveState.SWITCH_ON_DISABLED}, "drive_enable_timeout"),
        (P.SWITCHING_OFF, {"drive_state": DriveState.OPERATION_ENABLED}, "jog_not_stopped"),
    ],
)
def test_a_drive_that_does_not_follow_ends_in_a_fault(phase, shown, fault):
    hands = Hands()
    if phase == P.SWITCHING_OFF:
        hands.turning()
    hands.run.bench.frozen |= shown
    hands.go(TOKEN_SCANS, key=Command.JOG_POSITIVE)
    hands.go(500, key=Command.JOG_POSITIVE, device=phase == P.ENABLING)
    assert hands.run.alarms() == [fault]


@pytest.mark.parametrize(
    ("shown", "fault"),
    [
        ({"estop_released": 0}, "estop"),
        ({"guard_closed": 0}, "guard_open"),
        ({"torque_in_nm": 6.0}, "torque_in_trip"),
        ({"drive_velocity_rad_s": 7.0}, "overspeed"),
        ({"drive_follows_command": 0}, "drive_not_following"),
        ({"io_age_scans": 101}, "remote_io_lost"),
        ({"drive_mode": DriveMode.CYCLIC_SYNC_TORQUE}, "drive_mode_refused"),
    ],
)
def test_the_interlocks_watch_a_jog(shown, fault):
    hands = Hands()
    hands.turning()
    hands.run.bench.frozen |= shown
    orders = hands.go(20, key=Command.JOG_POSITIVE, device=True)
    assert orders.state == S.FAULT
    assert fault in hands.run.alarms()


def test_a_scan_that_was_held_up_ages_the_token():
    hands = Hands()
    hands.turning()
    hands.run.bench.frozen |= {"missed_periods": 18}
    for _ in range(6):
        orders = hands.go(1, device=True)
    assert orders.phase != P.TURNING


def test_every_phase_has_its_row():
    assert [row.phase for row in PHASES] == list(JogPhase)
    assert all(row.words and row.next_action for row in PHASES)
    assert set(PHASE_ROWS) == set(JogPhase)
    assert {row.phase for row in PHASES if not row.drive_on} == WAITING


@pytest.mark.parametrize("name", ["virtual", "virtual-output", "virtual-static"])
def test_the_program_of_a_bench_is_slow_and_weak(name):
    bench = load_bench(find_bench(name))
    speed_rad_s, torque_nm = jog_speed_rad_s(bench), jog_torque_nm(bench)
    program = compile_jog(bench, speed_rad_s)
    assert speed_rad_s == pytest.approx(bench.max_loading_speed_rad_s / 10)
    assert torque_nm <= bench.max_loading_torque_nm / 4
    assert program.jog is not None
    assert program.jog.token_scans * PERIOD_S == pytest.approx(0.1)
    assert program.limits.speed_rad_s == pytest.approx(budget("jog_speed_over_limit") * speed_rad_s)
    drive = jog_bench(bench).drive
    assert drive.max_torque_nm * drive.gear_ratio == pytest.approx(torque_nm)
    assert drive.max_speed_rad_s < bench.drive.max_speed_rad_s
