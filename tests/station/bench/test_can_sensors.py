"""Sensors on CAN before a run: their profiles, DBC files, who sends what, and whether all of it fits on the bus."""

from __future__ import annotations

import shutil
from pathlib import Path

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.can.sensors import SensorFrame
from recipes import RecipeError, load_bench, load_recipe
from recipes.checks.bus_load import BusFrame
from recipes.schema.channel_schema import CanSensor
from station.bench.assemble import drive_profile
from station.bench.bus_traffic import bus_frames
from station.bench.can_profile import can_sensor
from station.bench.files import FileAt
from station.bench.measuring import can_sensors
from station.bench.request import DRIVER_PROFILES, load_job
from virtual_bench.devices.can_sensors import encode_frame

TESTS = Path(__file__).parents[2]
BENCHES = TESTS / "data" / "benches"
DBC = DRIVER_PROFILES / "sensor-box.dbc"
QUICK = TESTS.parent / "recipes" / "rv-40e-121-quick.yaml"
NAMED = {"Torques.OutputTorque", "Angles.InputAngle"}


@given(
    torque=st.integers(-8_000_000, 8_000_000),  # what the signals may say, and the codec lets itself be asked for
    small=st.integers(-524_288, 475_000),
    cycle=st.integers(0, 4095),
    angle=st.floats(-360, 360, width=32),
)
def test_a_frame_of_a_dbc_file_means_what_cantools_says(torque: int, small: int, cycle: int, angle: float) -> None:
    database = cantools.database.load_file(DBC)
    torques = {"OutputTorque": torque * 0.0005, "InputTorque": small * 0.00002 + 0.5, "Cycle": cycle}
    angles = {"InputAngle": angle, "OutputAngle": -angle}
    sensor = can_sensor(FileAt(DBC), CanSensor(name="box", profile="sensor-box"), NAMED)
    for frame, values in zip(sensor.frames, (torques, angles), strict=True):
        message = database.get_message_by_frame_id(frame.identifier)
        data = message.encode(values)
        seen = SensorFrame(frame, synchronous=False)
        seen.take(data, 3)
        assert seen.values[:-1] == pytest.approx([values[signal.name] for signal in message.signals])
        assert [name.split(".")[1] for name in seen.names] == [signal.name for signal in message.signals]
        sent = encode_frame(frame, dict(zip(seen.names, seen.values, strict=False)))
        assert message.decode(sent) == pytest.approx(values), "the virtual sensor sends what it was told"
        assert (seen.age_scans(7), seen.frames) == (4, 1)
        seen.take(data[:-1], 9)
        assert (seen.age_scans(9), seen.malformed) == (6, 1), "another length is not believed"


def bench_with(folder: Path, name: str, file: str, old: str, new: str) -> str:
    shutil.copytree(BENCHES, folder / "benches")
    for shipped in (DBC, DRIVER_PROFILES / "can-torque.yaml"):
        shutil.copy(shipped, folder / "benches" / "profiles")
    path = folder / "benches" / file
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    return str(folder / "benches" / f"{name}.yaml")


REFUSED = {
    "outputs that no PDO has": (
        "can-dbc", "can-dbc.yaml", "profile: drive-with-outputs", "profile: virtual-drive", r"digital_outputs \(60FE",
    ),
    "two brakes": ("can-dbc", "can-dbc.yaml", "drive_brake: ", "brake: {transport: tcp}\ndrive_brake: ", "brake"),
    "no brake": ("can-dbc", "can-dbc.yaml", "drive_brake: ", "pace: {port: 1}\n# ", "neither brake nor drive_brake"),
    "signal that is not there": ("can-dbc", "can-dbc.yaml", "Torques.InputTorque", "Torques.InTorque", "InputTorque"),
    "proof in another frame": (
        "can-dbc", "can-dbc.yaml", "alive: noise, still: 50 ms", "alive: counter, alive_field: Angles.InputAngle",
        "Angles.InputAngle in channel torque_out_nm",
    ),
    "29 bits": ("can-dbc", "profiles/sensor-box.dbc", "BO_ 291 ", "BO_ 2147483939 ", "29 bits of identifier"),
    "no dbc": ("can-dbc", "profiles/sensor-box.dbc", "BO_ 291 ", "BO_ torques ", "not a readable DBC file"),
    "multiplexed": (
        "can-dbc", "profiles/sensor-box.dbc", "OutputTorque :", "OutputTorque M :", "the multiplexed signal",
    ),
    "identifier of the drive": ("can-sensors", "can-sensors.yaml", "node_id: 11", "node_id: 5", "TPDO 1 of the drive"),
    "two sensors of one identifier": (
        "can-sensors", "can-sensors.yaml", "node_id: 12", "node_id: 11", "flange on CAN, node 11; allowed: a free one",
    ),
    "a node id that is not given": (
        "can-sensors", "can-sensors.yaml", "profile: can-encoders, node_id: 12", "profile: can-encoders",
        "only if the bench file gives this sensor a 'node_id'",
    ),
    "set up without a node id": (
        "can-sensors", "can-sensors.yaml", "node_id: 11, update_every: 1 ms, heartbeat: 50 ms", "update_every: 1 ms",
        "'identity'; allowed: only if the bench file gives this sensor a 'node_id'",
    ),
    "a heartbeat without a node id": ("can-sensors", "can-sensors.yaml", "node_id: 11, ", "", "heartbeat without node"),
    "the controller's node id": (
        "can-sensors", "can-sensors.yaml", "can-encoders, node_id: 12", "can-encoders, node_id: 126", "the controller",
    ),
    "field outside its frame": (
        "can-sensors", "profiles/can-torque.yaml", "offset: 6", "offset: 7", "outside the 8 bytes of the frame",
    ),
    "a bus that is too slow": (
        "can-sensors", "can-sensors.yaml", "bitrate: 1000000", "bitrate: 500000",
        "SYNC, RPDO 1, TPDO 1, TPDO 2, 0x18C of encoders, 0x28C of encoders: 600 bits at worst",
    ),
    "a bus that is full": (
        "can-sensors", "can-sensors.yaml", "bitrate: 1000000", "bitrate: 100000", "is full without the scan: 0x18B of",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_refused_before_a_run(tmp_path: Path, case: str) -> None:
    *change, said = REFUSED[case]
    with pytest.raises(RecipeError, match=said):
        load_job(str(QUICK), bench_with(tmp_path, *change))


def test_what_is_on_the_bus_is_what_the_profiles_send() -> None:
    job = load_job(str(QUICK), str(BENCHES / "can-sensors.yaml"))
    sensors = can_sensors(job.bench, job.profile_sources)
    drive = drive_profile(job.profile_sources[job.bench.drive.profile])
    frames = {one.what: one for one in bus_frames(job.recipe, job.bench, drive, sensors)}
    assert (BusFrame("", 8).bits, BusFrame("", 0).bits, BusFrame("", 1).bits) == (135, 55, 65)
    assert frames["0x18B of flange"].every_s == pytest.approx(1e-3)
    assert frames["0x28C of encoders"].every_s == 0.0, "with every SYNC"
    assert "RPDO 2" not in frames, "the speed set-point is sent in cycles by speed only"
    by_speed = load_recipe("rv-40e-121-output")
    assert "RPDO 2" in {one.what for one in bus_frames(by_speed, load_bench("virtual-output"), drive, ())}
