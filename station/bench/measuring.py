"""From the channels of a bench file to what the drivers read: devices with their blocks, and each channel's source."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from definitions.device_proofs import unproven_text
from definitions.profiles.modbus import ModbusProfile
from drivers.config import CanSensorConfig, ChannelConfig, ModbusConfig, NamedDevice
from drivers.errors import Problem
from drivers.modbus.part_fields import source_problems
from recipes import Bench
from recipes.schema.device_schema import DriveBrake
from station.bench.can_profile import can_sensor
from station.bench.files import File

CHANNEL_OF_SENSOR = {
    "torque_in": "torque_in_nm",
    "torque_out": "torque_out_nm",
    "angle_in": "angle_in_rad",
    "angle_out": "angle_out_rad",
}


def channels(bench: Bench) -> tuple[str, ...]:
    """Return the channels of the process image that this bench has sensors for."""
    sensors = bench.sensors
    return tuple(channel for name, channel in CHANNEL_OF_SENSOR.items() if getattr(sensors, name) is not None)


def sources(bench: Bench) -> tuple[ChannelConfig, ...]:
    """Return where each measured channel comes from; none where all are the amplifier's."""
    by_name = {} if bench.channels is None else bench.channels.by_name
    return tuple(
        ChannelConfig(
            channel=CHANNEL_OF_SENSOR[name],
            device=source.device,
            field=source.field,
            scale=source.scale,
            zero=source.offset,
            proof_field=source.proof_field,
            still_s=source.still_s or 0.0,
        )
        for name, source in by_name.items()
    )


def blocks(name: str, device: ModbusConfig) -> Iterator[NamedDevice]:
    """Yield a measuring device once for each block of its profile: each is read by a request of its own."""
    profile = device.profile
    for block in (profile.read, *profile.read_also):
        yield NamedDevice(name, replace(device, profile=replace(profile, read=block, read_also=(), write=None)))


def can_sensors(bench: Bench, profiles: Mapping[str, File]) -> tuple[CanSensorConfig, ...]:
    """Return the sensors on CAN with the frames that they send; RecipeError with the problems of a profile."""
    named: dict[str, set[str]] = {}
    for source in sources(bench):
        named.setdefault(source.device, set()).update({source.field, source.proof_field})
    return tuple(can_sensor(profiles[one.profile], one, named.get(one.name, set())) for one in bench.can_devices)


def channel_problems(
    bench: Bench, profiles: Mapping[str, ModbusProfile], sensors: tuple[CanSensorConfig, ...]
) -> list[Problem]:
    """Return the channels that name a field which their device does not deliver; profiles: of `devices`, by name."""
    delivered = [
        (name, [field.name for field in block.fields])
        for name, profile in profiles.items()
        for block in (profile.read, *profile.read_also)
    ]
    delivered += [(one.name, [field.name for field in frame.fields]) for one in sensors for frame in one.frames]
    return source_problems(sources(bench), delivered)


def channels_not_proven(bench: Bench, sensors: Sequence[CanSensorConfig]) -> Iterator[str]:
    """Yield what is not proven of the measured channels, a sentence each; `sensors`: those on CAN."""
    for sensor in sensors:
        if sensor.identity is None:
            yield unproven_text(f"Sensor {sensor.name} on CAN", "can_identity")
        if not sensor.heartbeat_s:
            yield unproven_text(f"Sensor {sensor.name} on CAN", "can_heartbeat")
    by_name = {} if bench.channels is None else bench.channels.by_name
    for name, source in by_name.items():
        if not source.proof_field:
            yield unproven_text(f"Channel {name} of {source.device}", "new_values")


def missing_of_drive_brake(brake: DriveBrake) -> Iterator[str]:
    """Yield what is not proven of a brake at an output of the drive, a sentence each."""
    yield unproven_text("Brake", "drive_output")
    yield unproven_text("Brake", "set_point")
    yield unproven_text("Brake", "current")
    if brake.input_bit is None:
        yield unproven_text("Brake", "contact")


def missing_of_brake(profile: ModbusProfile) -> Iterator[str]:
    """Yield what is not proven of a brake with this profile, a sentence each."""
    shown = {field.name for field in profile.read.fields}
    taken = {field.name for field in profile.write.fields} if profile.write else set()
    if "brake_current_a" not in taken:
        yield unproven_text("Brake", "set_point")
    if "brake_current_a" not in shown:
        yield unproven_text("Brake", "current")
    if "brake_on" not in shown:
        yield unproven_text("Brake", "switch")
