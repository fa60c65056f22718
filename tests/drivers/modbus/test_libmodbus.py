"""Channels, a brake on a coil and contacts from devices on libmodbus, compiled here: no stack of ours on either end."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from can_drive_support import orders
from drivers_support import PERIOD_NS, drive_config, modbus_config, modbus_profile, raw_profile
from durand_drive import DurandDrive
from libmodbus import compiled
from ruamel.yaml import YAML

from definitions.image import Command, Image
from drivers.config import CanConfig, ChannelConfig, WireBenchConfig
from drivers.wire_bench import WireBench
from station.bench.measuring import blocks

HERE = Path(__file__).parent
PROFILES = HERE.parents[1] / "data" / "benches" / "profiles"
CHANNEL = "libmodbus-bench"
CONTACTS = {
    "profile": {"name": "contacts", "kind": "modbus"},
    "read": {
        "table": "discrete", "address": 0, "count": 2,
        "fields": [
            {"name": "estop_released", "offset": 0, "type": "bit"},
            {"name": "guard_closed", "offset": 1, "type": "bit"},
        ],
    },
}  # fmt: skip
SOURCES = (
    ChannelConfig("torque_in_nm", "torques", "channel_1", -1.0, 0.25, "cycle"),
    ChannelConfig("torque_out_nm", "torques", "channel_2", 1.0, 0.0, "cycle"),
    ChannelConfig("angle_in_rad", "angles", "input_angle", 1.0, 0.0, "input_stamp"),
    ChannelConfig("angle_out_rad", "angles", "output_angle", 2.0, 0.0, "output_stamp"),
)
CLOSED = orders()._replace(brake_on=1, brake_current_a=6.0)


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled(HERE / "libmodbus_bench.c", tmp_path_factory.mktemp("libmodbus"))


class Stand:
    """The devices of libmodbus, a drive on a virtual bus, and the bench."""

    def __init__(self, program: Path) -> None:
        self.process = subprocess.Popen([str(program)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        port = int(self.process.stdout.readline())
        self.drive = DurandDrive(CHANNEL)

        def device(unit: int, profile: object, host: str) -> object:
            return modbus_config(
                "virtual-brake", unit, profile=modbus_profile(profile), host=host, port=port, timeout_s=0.5
            )

        torques, angles = (
            YAML(typ="safe").load(PROFILES / f"{name}.yaml") for name in ("float-torques", "float-angles")
        )
        measuring = [
            *blocks("torques", device(4, torques, "127.0.0.1")),
            *blocks("angles", device(5, angles, "localhost")),
        ]
        slow = {"brake": device(2, raw_profile("coil-brake"), "localhost")}
        self.bench = WireBench(
            WireBenchConfig(
                PERIOD_NS, CanConfig("virtual", CHANNEL), drive_config(), None, **slow,
                remote_io=device(3, CONTACTS, "localhost"), measuring=tuple(measuring), sources=SOURCES,
                brake_fixed_current_a=9.0, modbus_devices=("brake", "remote_io", "torques", "angles"),
            )
        )  # fmt: skip
        self.scan = 0

    def say(self, word: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(f"{word}\n")
        self.process.stdin.flush()

    def run(self, until: Callable[[Image], bool], scans: int = 2000) -> Image:
        for _ in range(scans):
            image = self.bench.read(self.scan, 0, Command.NONE)
            self.bench.write(CLOSED, self.scan)
            self.scan += 1
            if until(image):
                return image._replace()
            time.sleep(0.001)
        pytest.fail(f"not reached in {scans} scans: {image}")

    def close(self) -> None:
        self.bench.close()
        self.drive.close()
        self.process.communicate(timeout=5)


@pytest.fixture
def stand(program: Path) -> Iterator[Stand]:
    one = Stand(program)
    yield one
    one.close()


def test_everything_arrives_from_devices_of_another_stack(stand: Stand) -> None:
    log = "\n".join(stand.bench.open())
    assert "float-angles" in log
    assert "identity = 'ENC2': checked" in log
    image = stand.run(lambda image: bool(image.brake_on) and image.torque_out_nm != 0.0 and image.sample_counter > 20)
    assert (image.torque_in_nm, image.torque_out_nm) == (pytest.approx(-1.25), pytest.approx(-250.0))
    assert (image.angle_in_rad, image.angle_out_rad) == (pytest.approx(1.5707963), pytest.approx(-1.5707963))
    assert (image.estop_released, image.guard_closed) == (1, 1)
    assert (image.brake_on, image.brake_current_a) == (1, 6.0), "the coil, and what was ordered while it is on"
    assert image.links_lost == 0


def test_counters_that_stand_make_the_sample_old_although_every_request_is_answered(stand: Stand) -> None:
    stand.bench.open()
    stand.run(lambda image: image.sample_counter > 20)
    stand.say("freeze")
    image = stand.run(lambda image: 50 < image.sample_age_scans < 1000)
    assert image.io_age_scans < 50, "they answer"
    assert image.links_lost == 0
    stand.say("run")
    stand.run(lambda image: image.sample_age_scans < 5)
