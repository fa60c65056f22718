"""The whole bench on wires: a durand drive on a virtual CAN bus and a real pymodbus server."""

from __future__ import annotations

import dataclasses
import math
import struct
import time
from collections.abc import Callable, Iterator

import can
import pytest
from drivers_support import PERIOD_NS, drive_config, modbus_config, modbus_profile, raw_profile
from durand_drive import DurandDrive
from pymodbus.constants import ExcCodes
from pymodbus_bench import AMPLIFIER, BRAKE, REMOTE_IO, REMOTE_IO_SHOWS, PymodbusBench

from definitions.image import (
    AGE_NEVER,
    Command,
    DriveCommand,
    DriveMode,
    DriveState,
    Image,
    Link,
    NmtState,
    Orders,
)
from drivers.config import CanConfig, WireBenchConfig
from drivers.errors import DriverError, ProfileError
from drivers.servo_drive.drive import FRAMES_PER_POLL, frames_per_poll
from drivers.wire_bench import WireBench, in_scans

CHANNEL = "wire-bench"


def orders(**fields: float) -> Orders:
    return Orders(*[0] * len(Orders._fields))._replace(**fields)  # type: ignore[arg-type]


TORQUE = orders(
    drive_command=DriveCommand.ENABLE_OPERATION,
    drive_mode=DriveMode.CYCLIC_SYNC_TORQUE,
    drive_target_torque_nm=3.0,
    brake_on=1,
    brake_current_a=2.5,
)


class Stand:
    """Everything on the other end of the wires, and the bench."""

    def __init__(self) -> None:
        self.drive = DurandDrive(CHANNEL)
        self.modbus = PymodbusBench()
        port = self.modbus.port
        self.config = WireBenchConfig(
            period_ns=PERIOD_NS,
            can=CanConfig("virtual", CHANNEL),
            drive=drive_config(),
            amplifier=modbus_config("virtual-amplifier", AMPLIFIER, port=port, timeout_s=0.5),
            # "localhost" makes it another line than the amplifier's; brake and remote I/O share theirs
            brake=modbus_config("virtual-brake", BRAKE, host="localhost", port=port, poll_every_s=0.005, timeout_s=0.5),
            remote_io=modbus_config(
                "virtual-remote-io", REMOTE_IO, host="localhost", port=port, poll_every_s=0.005, timeout_s=0.5
            ),
        )
        self.bench = WireBench(self.config)
        self.scan = 0

    def run(self, until: Callable[[Image], bool], ordered: Orders = TORQUE, scans: int = 2000) -> Image:
        """Scan until the image is as wanted."""
        for _ in range(scans):
            image = self.bench.read(self.scan, 0, Command.NONE)
            self.bench.write(ordered, self.scan)
            self.scan += 1
            if until(image):
                return image._replace()  # the bench writes in its image
            time.sleep(0.001)
        pytest.fail(f"not reached in {scans} scans: {image}")

    def close(self) -> None:
        self.bench.close()
        self.modbus.close()
        self.drive.close()


@pytest.fixture
def stand() -> Iterator[Stand]:
    one = Stand()
    yield one
    one.close()


@pytest.fixture
def running(stand: Stand) -> Stand:
    stand.bench.open()
    stand.run(lambda image: max(image.io_age_scans, image.brake_age_scans, image.sample_age_scans) < AGE_NEVER)
    return stand


def test_open_tells_what_it_verified(stand: Stand) -> None:
    log = stand.bench.open()
    port = stand.modbus.port
    assert f"virtual-amplifier at 127.0.0.1:{port} unit 1 input register 0 identity = 0x4C41: checked" in log
    assert f"virtual-remote-io at localhost:{port} unit 3 input register 0 identity = 0x4C49: checked" in log
    assert "virtual wire-bench: open" in log
    assert any("6007:00" in line and "read back" in line for line in log)


def test_first_image_says_that_nothing_has_come(stand: Stand) -> None:
    stand.bench.open()
    image = stand.bench.read(0, 3, Command.START)
    assert (image.missed_periods, image.command) == (3, Command.START)
    assert image.drive_age_scans == image.sample_age_scans == image.brake_age_scans == image.io_age_scans == AGE_NEVER
    assert image.drive_state == DriveState.UNKNOWN, "no status word is not the status word 0"
    assert image.links_lost == 0


def test_the_frames_that_a_scan_takes_follow_from_its_period(stand: Stand) -> None:
    slow = dataclasses.replace(stand.config, period_ns=20_000_000)
    stand.bench = WireBench(slow)
    stand.bench.open()
    most = frames_per_poll(slow.period_ns, slow.can.bitrate)
    with can.Bus(interface="virtual", channel=CHANNEL) as other:
        for _ in range(most + 100):
            other.send(can.Message(arbitration_id=0x123, is_extended_id=False))
    stand.bench.read(0, 0, Command.NONE)
    assert FRAMES_PER_POLL < most - 20 <= stand.bench.drive.frames_foreign <= most


def test_everything_arrives_in_the_image(running: Stand) -> None:
    running.drive.od.write(0x6041, 0, 0x1E37)
    running.drive.od.write(0x6061, 0, 10)
    running.drive.od.write(0x6077, 0, -300)
    running.drive.od.write(0x6064, 0, 1_048_576)
    running.drive.od.write(0x606C, 0, -333772)
    image = running.run(
        lambda image: image.drive_mode == 10 and image.brake_current_a > 0 and image.drive_nmt_state == 5
    )
    assert image.drive_state == DriveState.OPERATION_ENABLED
    assert (image.drive_internal_limit, image.drive_follows_command, image.drive_homing_attained) == (1, 1, 0)
    assert image.drive_torque_nm == pytest.approx(-3.0)
    assert image.drive_angle_rad == pytest.approx(math.pi)
    assert image.drive_velocity_rad_s == pytest.approx(-1.0, rel=1e-5)
    assert image.drive_nmt_state == NmtState.OPERATIONAL
    assert image.drive_heartbeat_age_scans < 200
    assert image.torque_out_nm == pytest.approx(123.4567)
    assert image.sample_counter > 1
    assert {name: getattr(image, name) for name in REMOTE_IO_SHOWS} == pytest.approx(REMOTE_IO_SHOWS)
    assert (image.brake_on, image.brake_current_a) == (1, 2.5)
    assert image.links_lost == 0


def test_a_life_counter_that_stands_still_makes_values_age(running: Stand) -> None:
    running.modbus.alive = False
    running.run(lambda image: min(image.io_age_scans, image.brake_age_scans) > 300)
    running.modbus.alive = True
    running.run(lambda image: max(image.io_age_scans, image.brake_age_scans) < 50)


def test_orders_arrive_at_the_devices(running: Stand) -> None:
    running.run(lambda _: running.drive.od.read(0x6071, 0) == 300 and running.modbus.orders == [1, 2500])
    assert running.drive.od.read(0x6040, 0) == 0x0F
    assert running.drive.od.read(0x6060, 0) == 10
    assert running.bench.counters()["can.frames_malformed"] == 0


def test_a_set_point_that_was_clamped_shows_as_internal_limit(running: Stand) -> None:
    image = running.run(
        lambda image: bool(image.drive_internal_limit), TORQUE._replace(drive_target_torque_nm=1000.0), scans=5
    )
    assert not image.drive_statusword & 0x800
    assert running.bench.counters()["drive.setpoints_clamped"] > 0


def test_emergency_reaches_the_image(running: Stand) -> None:
    running.drive.node.emcy.set(0x7121, 0x21)
    image = running.run(lambda image: image.drive_emcy_code != 0)
    assert image.drive_emcy_code == 0x7121
    image = running.run(lambda image: image.drive_error_register != 0)
    assert image.drive_error_register == 0x21


def test_a_closed_modbus_connection_stays_lost(running: Stand) -> None:
    running.modbus.close()
    image = running.run(lambda image: image.links_lost == Link.AMPLIFIER | Link.BRAKE | Link.REMOTE_IO)
    assert image.torque_out_nm == pytest.approx(123.4567), "the last value stays, its age tells"
    image = running.run(lambda image: image.sample_age_scans > 20)
    assert image.links_lost == Link.AMPLIFIER | Link.BRAKE | Link.REMOTE_IO


def test_a_device_that_answers_with_exceptions_is_lost(running: Stand) -> None:
    running.modbus.exception = ExcCodes.DEVICE_FAILURE
    running.run(lambda image: image.links_lost == Link.AMPLIFIER | Link.BRAKE)
    running.modbus.exception = None
    running.run(lambda image: image.links_lost == 0)
    assert running.bench.counters()["amplifier.exceptions"] >= 3


def test_a_position_goes_on_where_its_32_bits_wrap(running: Stand) -> None:
    rad_per_count = running.bench.drive.units.angle_rad_per_count
    running.drive.od.write(0x6064, 0, 2**31 - 5)
    before = running.run(lambda image: image.drive_angle_rad > 1.0)
    running.drive.od.write(0x6064, 0, -(2**31) + 5)
    after = running.run(lambda image: image.drive_angle_rad != before.drive_angle_rad)
    assert after.drive_angle_rad - before.drive_angle_rad == pytest.approx(10 * rad_per_count, rel=1e-3)


def test_a_frozen_amplifier_ages(running: Stand) -> None:
    running.modbus.counting = False
    running.run(lambda image: image.sample_age_scans > 10)
    running.modbus.counting = True
    running.run(lambda image: image.sample_age_scans < 10)


def test_a_silent_drive_ages(running: Stand) -> None:
    running.drive.node.nmt.handle_msg(0, bytes((0x02, 5)))  # stopped: no more process data
    running.run(lambda image: image.drive_age_scans > 10)
    running.run(lambda image: image.drive_nmt_state == NmtState.STOPPED)


def test_close_takes_the_power_and_the_process_data_away(running: Stand) -> None:
    running.run(lambda _: running.drive.od.read(0x6040, 0) == 0x0F)
    nmt_commands: list[int] = []
    handle = running.drive.network.subscriptions[0]
    running.drive.network.subscriptions[0] = lambda cob_id, data: (nmt_commands.append(data[0]), handle(cob_id, data))
    running.bench.close()
    deadline = time.monotonic() + 2
    while len(nmt_commands) < 2 and time.monotonic() < deadline:
        time.sleep(0.001)
    assert nmt_commands == [0x80, 0x82]
    assert running.drive.node.nmt.state == NmtState.PRE_OPERATIONAL
    assert running.drive.od.read(0x6040, 0) == 0x00
    running.bench.close()


def test_open_again_after_close(running: Stand) -> None:
    running.bench.close()
    running.bench.open()
    running.run(lambda image: image.links_lost == 0 and image.drive_age_scans < 5 and image.brake_current_a == 2.5)


def test_findings_of_all_devices_at_once(stand: Stand) -> None:
    stand.drive.forgets(0x6072, 0, 3000)
    config = dataclasses.replace(
        stand.config,
        amplifier=dataclasses.replace(stand.config.amplifier, unit_id=REMOTE_IO),
        brake=dataclasses.replace(stand.config.brake, unit_id=77),
        remote_io=dataclasses.replace(stand.config.remote_io, host="127.0.0.1", port=1, connect_timeout_s=0.3),
    )
    bench = WireBench(config)
    with pytest.raises(DriverError) as caught:
        bench.open()
    text = [str(problem) for problem in caught.value.problems]
    assert len(text) == 4
    assert "unit 3: no connection: found" in text[0]
    assert "another device answers: found 0x4C49, expected 0x4C41; check address" in text[1]
    assert "identity cannot be read: found exception" in text[2]
    assert "6072:00: largest torque" in text[3]


def test_no_can_bus_is_a_finding_too(stand: Stand) -> None:
    config = dataclasses.replace(stand.config, can=CanConfig("socketcand", port=1, connect_timeout_s=0.3))
    with pytest.raises(DriverError, match="the CAN bus cannot be opened"):
        WireBench(config).open()


def test_profiles_must_fit_their_parts(stand: Stand) -> None:
    config = dataclasses.replace(
        stand.config, amplifier=stand.config.brake, brake=stand.config.amplifier, remote_io=stand.config.brake
    )
    with pytest.raises(ProfileError) as caught:
        WireBench(config)
    text = "\n".join(str(problem) for problem in caught.value.problems)
    assert "amplifier profile virtual-brake: does not deliver angle_in_rad, angle_out_rad, sample_counter" in text
    assert "brake profile virtual-amplifier: cannot be given the brake's orders: found nothing to write" in text
    assert "remote_io profile virtual-brake: does not deliver estop_released, guard_closed" in text


def test_a_channel_without_sensor_is_not_asked_for(stand: Stand) -> None:
    raw = modbus_profile(raw_profile("virtual-amplifier"))
    read = dataclasses.replace(raw.read, fields=tuple(f for f in raw.read.fields if f.name != "torque_in_nm"))
    amplifier = dataclasses.replace(stand.config.amplifier, profile=dataclasses.replace(raw, read=read))
    with pytest.raises(ProfileError, match="does not deliver torque_in_nm"):
        WireBench(dataclasses.replace(stand.config, amplifier=amplifier))
    channels = ("torque_out_nm", "angle_in_rad", "angle_out_rad")
    WireBench(dataclasses.replace(stand.config, amplifier=amplifier, channels=channels))


def test_the_record_can_pack_the_image(running: Stand) -> None:
    from definitions.image import IMAGE_STRUCT  # noqa: PLC0415 - only this test needs it

    image = running.run(lambda image: image.drive_age_scans < 5)
    try:
        assert len(IMAGE_STRUCT.pack(*image)) == IMAGE_STRUCT.size
    except struct.error as error:
        pytest.fail(f"{error}: {image}")


@pytest.mark.parametrize(("seconds", "scans"), [(0.001, 1), (0.0001, 1), (0.02, 20), (0.0049, 5)])
def test_times_in_scans(seconds: float, scans: int) -> None:
    assert in_scans(seconds, PERIOD_NS) == scans


def test_a_lock_is_ordered_to_nothing_before_it_is_known_whether_it_is_closed(stand: Stand) -> None:
    stand.modbus.orders = [1, 2500]
    stand.bench.open()
    image = stand.run(lambda now: now.brake_age_scans < AGE_NEVER, ordered=orders())
    assert (image.brake_on, image.brake_current_a) == (1, 2.5)
    stand.run(lambda now: not now.brake_on, ordered=orders())
    assert stand.modbus.writes == 1
