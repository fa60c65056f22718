"""Drives on another CANopen stack, each made of an EDS and set up and enabled by the profile drafted from it."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest
from can_drive_support import orders
from drivers_support import PERIOD_NS
from eds_drives import DRIVES
from ramp_support import mid_ramp
from table_drive import Personality
from table_drive_bus import on_the_bus

from definitions.image import Command, DriveCommand, DriveMode, DriveState, Orders, State
from definitions.protections import MISSING
from drivers.can.bus import CanLink
from drivers.config import DriveConfig
from drivers.errors import DriveSetupError
from drivers.servo_drive.cia402 import decode_state, follows_command
from drivers.servo_drive.drive import CanDrive
from drivers.servo_drive.setup import set_up_drive

CST = int(DriveMode.CYCLIC_SYNC_TORQUE)
NEXT = {
    DriveState.SWITCH_ON_DISABLED: DriveCommand.SHUTDOWN,
    DriveState.READY_TO_SWITCH_ON: DriveCommand.SWITCH_ON,
    DriveState.SWITCHED_ON: DriveCommand.ENABLE_OPERATION,
}


class Scan:
    """A scan without a bench: the drive polled and sent to."""

    def __init__(self, link: CanLink, config: DriveConfig) -> None:
        self.drive = CanDrive(link, config, 20)
        self.scan = 0

    def until(
        self, reached: Callable[[DriveState], bool], command: DriveCommand | None = None, scans: int = 1000
    ) -> int:
        """Step towards operation enabled, or order one command, until a state is reached; return the scans it took."""
        for taken in range(scans):
            self.drive.poll(self.scan)
            state = decode_state(self.drive.value("statusword"))
            if self.drive.age_scans(self.scan) < 50 and reached(state):
                return taken
            step = NEXT.get(state, DriveCommand.ENABLE_OPERATION) if command is None else command
            self.drive.send(orders(step, CST), self.scan)
            self.scan += 1
            time.sleep(0.001)
        pytest.fail(f"not reached in {scans} scans: {state!r}")


def enabled(state: DriveState) -> bool:
    return state == DriveState.OPERATION_ENABLED


@pytest.mark.parametrize("name", DRIVES)
def test_a_drive_is_set_up_by_the_profile_of_its_own_eds_and_enabled(tmp_path: Path, name: str) -> None:
    with on_the_bus(tmp_path, name) as (slave, link, config):
        log = set_up_drive(link, config, PERIOD_NS)
        missing = [line for line in log if MISSING in line]
        assert len(missing) == {"epos4-like": 2, "nanotec-like": 0, "fixed-mapping": 2}[name]
        mappings = {index for index, _ in slave.written if 0x1600 <= index < 0x1700 or 0x1A00 <= index < 0x1B00}
        assert bool(mappings) is not DRIVES[name].fixed
        Scan(link, config).until(enabled)
        assert slave.state == "enabled"
        if name == "nanotec-like":  # event-driven ones as delivered, and all the PDOs that nobody asked for
            assert all(slave.value(0x1400 + place, 1) >> 31 for place in range(2, 8))
            assert [slave.value(0x1800, subindex) for subindex in (2, 3, 5)] == [1, 0, 0]


def test_objects_that_can_only_be_read_are_fine_when_they_hold_what_is_wanted_and_told_when_not(tmp_path: Path) -> None:
    holds = Personality(read_only=((0x6072, 0, 1100), (0x605A, 0, 2), (0x1017, 0, 20)))
    with on_the_bus(tmp_path, "nanotec-like", holds) as (slave, link, config):
        log = set_up_drive(link, config, PERIOD_NS)
        assert sum(line.endswith("held already, not written") for line in log) >= 3
        assert not slave.written & {(0x6072, 0), (0x605A, 0), (0x1017, 0)}
    with on_the_bus(tmp_path, "nanotec-like", Personality(read_only=((0x6072, 0, 3000),))) as (_, link, config):
        with pytest.raises(DriveSetupError) as caught:
            set_up_drive(link, config, PERIOD_NS)
        assert {problem.where for problem in caught.value.problems} == {"node 5 6072:00"}


@pytest.mark.parametrize(("told", "ends"), [(False, "enabled"), (True, "quick stop")])
def test_a_supervised_sync_bears_late_scans_unless_it_is_told_its_period(
    tmp_path: Path, *, told: bool, ends: str
) -> None:
    personality = Personality(supervises_sync=True)
    with on_the_bus(tmp_path, "nanotec-like", personality, write_sync_period=told) as (slave, link, config):
        set_up_drive(link, config, PERIOD_NS)
        assert slave.value(0x1006) == (1000 if told else 0)
        scan = Scan(link, config)
        scan.until(lambda state: enabled(state) or state == DriveState.QUICK_STOP_ACTIVE)
        time.sleep(0.02)  # scans that come late
        scan.until(lambda _: scan.scan % 10 == 9, DriveCommand.ENABLE_OPERATION)
        assert slave.state == ends
        assert bool(slave.quick_stops) is told


def test_a_control_word_that_is_read_every_5_ms_is_waited_for(tmp_path: Path) -> None:
    with on_the_bus(tmp_path, "epos4-like", Personality(control_word_every_s=0.005)) as (slave, link, config):
        set_up_drive(link, config, PERIOD_NS)
        scan = Scan(link, config)
        scan.until(enabled)
        slave.fail()
        scan.until(lambda state: state == DriveState.FAULT)
        scan.until(lambda state: state == DriveState.SWITCH_ON_DISABLED, DriveCommand.FAULT_RESET)


def test_the_controller_waits_for_a_drive_that_reads_its_control_word_every_5_ms(tmp_path: Path) -> None:
    """The recovery from a fault, by the whole controller: an edge of one scan is one that this drive misses."""
    run = mid_ramp()
    with on_the_bus(tmp_path, "epos4-like", Personality(control_word_every_s=0.005)) as (slave, link, config):
        set_up_drive(link, config, PERIOD_NS)
        drive = CanDrive(link, config, 20)
        slave.fail()
        model = run.bench.write

        def write(given: Orders) -> None:
            model(given)
            drive.send(given, run.scan)
            time.sleep(0.001)
            drive.poll(run.scan + 1)
            run.bench.image = run.bench.image._replace(drive_state=decode_state(drive.value("statusword")))

        run.bench.write = write
        run.until_finished()
        assert "drive_fault" in run.alarms()
        run.command(Command.ACKNOWLEDGE)
        run.command(Command.RESET)
        run.until(lambda given: given.state == State.UNLOAD, most=1000)
        assert slave.state == "disabled"
        bits = [given.drive_command == DriveCommand.FAULT_RESET for given in run.orders]
        assert sum(1 for before, bit in pairwise(bits) if bit and not before) == 1, "seen at once, and not by chance"


def test_a_drive_without_bit_12_counts_as_following_while_it_is_enabled(tmp_path: Path) -> None:
    with on_the_bus(tmp_path, "epos4-like", Personality(has_bit_12=False)) as (_, link, config):
        set_up_drive(link, config, PERIOD_NS)
        scan = Scan(link, config)
        scan.until(enabled)
        word = scan.drive.value("statusword")
        assert (follows_command(word, CST), follows_command(word, CST, has_bit=False)) == (0, 1)


def test_sdo_answers_after_300_ms_are_waited_for_and_end_at_the_time_of_the_set_up(tmp_path: Path) -> None:
    with on_the_bus(tmp_path, "epos4-like", Personality(sdo_delay_s=0.3)) as (_, link, config):
        with pytest.raises(DriveSetupError) as caught:
            set_up_drive(link, dataclasses.replace(config, setup_timeout_s=1.5), PERIOD_NS)
        (problem,) = caught.value.problems
        assert "takes too long" in problem.what


def test_an_emergency_of_the_set_up_counts_from_the_first_scan(tmp_path: Path) -> None:
    with on_the_bus(tmp_path, "nanotec-like") as (slave, link, config):
        slave.tell_emergency(0x8130)  # before the restart of its communication: that is not from now
        slave.tell_emergency_when_written(0x1017, 0x3210)
        slave.tell_emergency_when_written(0x6072, 0x4210, 0x09)
        set_up_drive(link, config, PERIOD_NS)
        drive = CanDrive(link, config, 20)
        drive.poll(0)
        assert sorted(one.code for one in drive.emergencies) == [0x3210, 0x4210]
        assert drive.emcy_code == drive.emergencies[-1].code
        assert CanDrive(link, config, 20).emcy_code == 0, "they are told once"


def test_an_emergency_that_the_set_up_itself_saw_gone_is_none_in_the_scan(tmp_path: Path) -> None:
    with on_the_bus(tmp_path, "nanotec-like") as (slave, link, config):
        slave.tell_emergency_when_written(0x6072, 0x4210, 0x09)
        slave.tell_emergency_when_written(0x6072, 0, 0)
        set_up_drive(link, config, PERIOD_NS)
        drive = CanDrive(link, config, 20)
        assert [one.code for one in drive.emergencies] == [0x4210, 0]
        drive.poll(0)
        assert drive.emcy_code == 0


def test_foreign_traffic_and_a_storm_of_emergencies_keep_no_process_data_out(tmp_path: Path) -> None:
    noisy = Personality(foreign_frames=4, emcy_per_sync=4)
    with on_the_bus(tmp_path, "nanotec-like", noisy) as (_, link, config):
        set_up_drive(link, config, PERIOD_NS)
        scan = Scan(link, config)
        scan.until(enabled)
        assert scan.drive.frames_foreign > 0
        assert scan.drive.emcy_code == 0x4210
        kept = scan.drive.emergencies
        scan.until(lambda _: len(kept) == kept.maxlen, DriveCommand.ENABLE_OPERATION)
        assert scan.drive.age_scans(scan.scan) < 20
        assert scan.drive.frames_malformed == 0
