"""A bench that was left wound up, and a controller that has just been started: the plant goes on, nobody remembers."""

from __future__ import annotations

import copy
import dataclasses
import itertools

import pytest

from controller.controller import Controller
from controller.held_lock import HeldLock, Left
from definitions.faults import FAULT_BY_ID
from definitions.image import Command, DriveCommand, Orders, State
from faultlab.run import Bench, FaultRun
from station.bench.assemble_virtual import choose_unit, virtual_config
from station.bench.request import load_job
from station.bench.virtual_unit import FIXED_SEED
from station.documents.events import LeftState
from station.records.left_state import left_action
from virtual_bench.faults.scenario import Fault, When

ENABLING = (DriveCommand.SWITCH_ON, DriveCommand.ENABLE_OPERATION, DriveCommand.START_HOMING)
RATED_NM = 412.0


@pytest.fixture(scope="module")
def stopped() -> Bench:
    """The bench after a quick stop in a ramp: friction keeps a torque behind the closed lock."""
    job = load_job("rv-40e-121-faults", None)
    bench = Bench(
        job.program, virtual_config(job.bench, job.profile_paths, choose_unit(None, job.recipe, FIXED_SEED)), None
    )
    assert bench.until(lambda orders: orders.state == State.RAMP_POS and orders.controlled_torque_nm > 200.0)
    bench.order(Command.QUICK_STOP)
    bench.finish()
    assert abs(bench.run.torque_nm[-1]) > 0.025 * RATED_NM
    return bench


def restarted(bench: Bench, *, knowing: bool, zeroes_known: bool = True, zero_limit_nm: float | None = None) -> Bench:
    """The same bench, lock closed as it was left, with a new controller that has been given its start."""
    before = bench.run.orders[-1]
    zeroes = (before.torque_in_tare_nm, before.torque_out_tare_nm) if zeroes_known else (0.0, 0.0)
    left = Left(before.fault, *zeroes, zeroes_known=zeroes_known)
    bench.run, run = FaultRun(bench.run.period_s), bench.run
    twin = copy.deepcopy(bench)
    bench.run = run
    program = twin.controller.program
    if zero_limit_nm is not None:
        program = dataclasses.replace(program, tare=dataclasses.replace(program.tare, torque_out_zero_nm=zero_limit_nm))
    twin.controller = Controller(program, left=left if knowing else None)
    for _ in range(30):
        twin.go()
    twin.order(Command.START)
    return twin


def settle(bench: Bench, scans: int = 1500) -> Orders:
    for _ in range(scans):
        orders = bench.go()
    return orders


def commands(bench: Bench) -> set[int]:
    return {orders.drive_command for orders in bench.run.orders}


def test_an_ordinary_run_neither_opens_the_lock_of_a_loaded_unit_nor_enables_anything(stopped):
    bench = restarted(stopped, knowing=False)
    assert settle(bench).fault == FAULT_BY_ID["brake_stays_closed"].number
    assert bench.controller.finished
    assert all(orders.brake_on for orders in bench.run.orders[1:]), "the lock stays as it was found"
    assert not commands(bench) & set(ENABLING)
    assert abs(bench.run.torque_nm[-1]) > 0.025 * RATED_NM


def test_nothing_is_enabled_before_a_person_has_acknowledged_and_asked(stopped):
    bench = restarted(stopped, knowing=True)
    orders = settle(bench)
    assert (orders.state, orders.fault) == (State.FAULT, FAULT_BY_ID["operator_quick_stop"].number)
    assert not bench.controller.finished, "it waits"
    bench.order(Command.RESET)
    assert settle(bench, 200).state == State.FAULT, "no reset without an acknowledgement"
    assert not commands(bench) & set(ENABLING)
    bench.order(Command.STOP)
    settle(bench, 5)
    assert bench.controller.finished, "a stop leaves everything as it is"
    assert bench.run.orders[-1].brake_on


def test_the_way_back_unloads_behind_the_closed_lock_and_opens_it_near_zero(stopped):
    bench = restarted(stopped, knowing=True)
    settle(bench)
    bench.order(Command.ACKNOWLEDGE)
    bench.go()
    bench.order(Command.RESET)
    assert bench.until(lambda orders: orders.state == State.STOPPED)
    run, program = bench.run, bench.controller.program
    assert run.states[-4:] == ["fault", "unload", "release", "stopped"]
    opened = next(i for i in range(1, len(run.orders)) if run.orders[i - 1].brake_on and not run.orders[i].brake_on)
    assert abs(run.torque_nm[opened]) < 0.02 * RATED_NM
    assert run.orders[opened].drive_command == DriveCommand.DISABLE_VOLTAGE
    proven = next(event.scan for event in run.events if event.text.startswith("lock proven by"))
    enabled = next(i for i, orders in enumerate(run.orders) if orders.drive_command in ENABLING)
    assert run.place(proven) <= enabled, "no drive before the lock is proven"
    torques = [orders.drive_target_torque_nm for orders in run.orders]
    steps = [abs(b - a) for a, b in itertools.pairwise(torques)]
    assert max(steps) <= program.control.slew_nm_s * program.period_s + 1e-9
    settle(bench, program.settle_scans)
    assert bench.controller.finished


@pytest.mark.parametrize(("zero_limit_nm", "end"), [(1.0, State.STOPPED), (RATED_NM, State.FAULT)])
def test_what_may_be_the_zero_error_of_a_sensor_proves_no_lock(stopped, zero_limit_nm, end):
    """Without zeroes the error of a sensor counted as torque that the lock holds, and the drive was enabled."""
    bench = restarted(stopped, knowing=True, zeroes_known=False, zero_limit_nm=zero_limit_nm)
    settle(bench)
    bench.order(Command.ACKNOWLEDGE)
    bench.go()
    bench.order(Command.RESET)
    assert bench.until(lambda orders: orders.state == State.UNLOAD)
    assert bench.until(lambda orders: orders.state == end)
    assert bool(commands(bench) & set(ENABLING)) == (end == State.STOPPED)
    assert bench.run.orders[-1].brake_on == (end == State.FAULT)


@pytest.mark.parametrize(
    ("target", "verb", "value"),
    [("brake.current", "fade", 0.5), ("sensor.angle_out", "drift", 0.001), ("modbus.brake", "silence", None)],
)
def test_a_lock_that_does_not_hold_gets_no_drive(stopped, target, verb, value):
    bench = restarted(stopped, knowing=True)
    settle(bench)
    bench.order(Command.ACKNOWLEDGE)
    bench.go()
    bench.order(Command.RESET)
    bench.until(lambda orders: orders.state == State.UNLOAD)
    fault = Fault(target=target, verb=verb, value=value, when=When(scan=bench.run.scans[-1] + 5))
    bench.faults.inject((fault,))
    orders = settle(bench, 2 * HeldLock.PATIENCE * HeldLock.HOLD_SCANS)
    assert orders.state == State.FAULT
    assert not commands(bench) & set(ENABLING)
    assert orders.brake_on


def test_a_bench_whose_devices_do_not_answer_ends_the_way_back(stopped):
    bench = restarted(stopped, knowing=True)
    bench.faults.inject((Fault(target="modbus.amplifier", verb="silence", when=When(scan=bench.run.scans[-1] + 1)),))
    bench.order(Command.NONE)
    settle(bench, 50)
    bench.order(Command.START)
    assert settle(bench, 5000).fault == FAULT_BY_ID["devices_not_ready"].number
    assert bench.controller.finished
    assert bench.run.orders[-1].brake_on


@pytest.mark.parametrize("command", [Command.STOP, Command.QUICK_STOP])
def test_a_command_that_comes_before_the_devices_leaves_a_closed_lock_closed(stopped, command):
    bench = restarted(stopped, knowing=False)
    bench.controller = Controller(bench.controller.program)
    bench.order(command)
    settle(bench, 300)
    assert bench.run.states[-1] in ("stopped", "fault")
    assert all(orders.brake_on for orders in bench.run.orders)
    assert abs(bench.run.torque_nm[-1]) > 0.025 * RATED_NM


def test_a_jammed_unit_is_left_to_a_person_with_its_torque_behind_the_closed_lock():
    job = load_job("rv-40e-121-faults", None)
    bench = Bench(
        job.program, virtual_config(job.bench, job.profile_paths, choose_unit(None, job.recipe, FIXED_SEED)), None
    )
    assert bench.until(lambda orders: orders.state == State.RAMP_POS and orders.controlled_torque_nm > 100.0)
    bench.faults.inject((Fault(target="unit", verb="jam", value=8, when=When(scan=bench.run.scans[-1])),))
    bench.finish()
    assert bench.run.alarms()[0].text == "torque_channels_disagree"
    assert "jammed" in FAULT_BY_ID["torque_channels_disagree"].cause
    kept_nm = abs(bench.run.torque_nm[-1])
    assert kept_nm > 0.4 * RATED_NM
    back = restarted(bench, knowing=True)
    settle(back)
    for _ in range(2):
        back.order(Command.ACKNOWLEDGE)
        back.go()
        back.order(Command.RESET)
        assert settle(back).state == State.FAULT
    assert "reset refused: a cause is still present" in [event.text for event in back.run.events]
    assert not commands(back) & set(ENABLING)
    assert all(orders.brake_on for orders in back.run.orders[1:])
    assert abs(back.run.torque_nm[-1]) == pytest.approx(kept_nm, rel=0.01)
    known = {f"{name}_known": True for name in ("torque", "lock", "drive")}
    left = LeftState(torque_nm=kept_nm, release_torque_nm=8.2, lock="closed", drive="off", **known)
    assert "turn the loaded shaft back by hand" in left_action(left)
    still_on = dataclasses.replace(left, drive="on", torque_nm=0.1, lock="open")
    assert "switch its power off" in left_action(still_on), "it can be removed otherwise"


@pytest.fixture(scope="module")
def loaded() -> Bench:
    """The bench in its first ramp, where friction keeps a rest in the unit once the drive is off."""
    job = load_job("rv-40e-121-faults", None)
    bench = Bench(
        job.program, virtual_config(job.bench, job.profile_paths, choose_unit(None, job.recipe, FIXED_SEED)), None
    )
    assert bench.until(lambda orders: orders.state == State.RAMP_POS and orders.controlled_torque_nm > 100.0)
    return bench


def with_a_fault(bench: Bench, target: str, verb: str, value: float | None) -> Bench:
    """A copy of the bench in which this fault has led to its end."""
    fault = Fault(target=target, verb=verb, value=value, when=When(scan=bench.run.scans[-1]))
    bench.run, run = FaultRun(bench.run.period_s), bench.run
    twin = copy.deepcopy(bench)
    bench.run = run
    twin.faults.inject((fault,))
    assert not twin.until(lambda _: False)
    assert twin.controller.finished
    return twin


def goes_back(bench: Bench) -> None:
    """One acknowledgement and one reset bring the torque to zero and open the lock, without another alarm."""
    known = len(bench.run.alarms())
    bench.order(Command.ACKNOWLEDGE)
    bench.go()
    bench.order(Command.RESET)
    assert bench.until(lambda orders: orders.state == State.STOPPED), [event.text for event in bench.run.events]
    assert bench.run.states[-4:] == ["fault", "unload", "release", "stopped"]
    assert [event.text for event in bench.run.alarms()[known:]] == []
    assert abs(bench.run.torque_nm[-1]) < 0.02 * RATED_NM
    assert not bench.run.orders[-1].brake_on


@pytest.mark.parametrize(("verb", "value"), [("stuck", None), ("flip", None), ("scale", 2.0), ("lag", 1.0)])
def test_a_wrong_angle_sensor_does_not_stand_against_the_way_back(loaded, verb, value):
    bench = with_a_fault(loaded, "sensor.angle_in", verb, value)
    assert [event.text for event in bench.run.alarms()] == ["angle_channels_disagree"]
    assert abs(bench.run.torque_nm[-1]) > 0.02 * RATED_NM, "friction keeps a rest to be unwound"
    goes_back(bench)


def test_a_wrong_angle_sensor_does_not_stand_against_it_after_everything_was_restarted_either(loaded):
    bench = restarted(with_a_fault(loaded, "sensor.angle_in", "stuck", None), knowing=True)
    settle(bench)
    goes_back(bench)


def test_a_reversed_angle_sensor_counts_anew_from_where_the_shaft_stands():
    """What it shows is an over-travel that stays, so that the reset of the run itself is refused."""
    job = load_job("rv-40e-121-output", None)
    bench = Bench(
        job.program, virtual_config(job.bench, job.profile_paths, choose_unit(None, job.recipe, FIXED_SEED)), None
    )
    assert bench.until(lambda orders: orders.state == State.RAMP_POS and orders.controlled_torque_nm > 200.0)
    bench = with_a_fault(bench, "sensor.angle_out", "flip", None)
    assert bench.run.alarms()[0].text == "over_travel"
    twin = restarted(bench, knowing=True)
    bench.order(Command.ACKNOWLEDGE)
    bench.go()
    bench.order(Command.RESET)
    assert settle(bench, 100).state == State.FAULT
    assert "reset refused: a cause is still present" in [event.text for event in bench.run.events]
    assert "'lostmotion recover'" in FAULT_BY_ID["over_travel"].next_action
    settle(twin)
    goes_back(twin)
