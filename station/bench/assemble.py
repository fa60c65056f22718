"""From bench and recipe files to what the drivers want to be told: plain configurations, field by field."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Literal

from definitions.profiles.drive import DriveProfile
from definitions.profiles.modbus import ModbusProfile
from drivers.config import CanConfig, DriveBrakeConfig, DriveConfig, ModbusConfig, WireBenchConfig
from drivers.pace import PaceConfig
from recipes import Bench, parse_document
from recipes.schema.device_schema import ModbusDevice
from station.bench.bench_spec import Ports
from station.bench.files import File
from station.bench.measuring import blocks, can_sensors, channels, sources
from station.errors import StationError

PARITY_LETTERS: dict[str, Literal["N", "E", "O"]] = {"none": "N", "even": "E", "odd": "O"}


def wire_config(
    bench: Bench, profiles: Mapping[str, File], period_ns: int, ports: Ports | None, *, waits: bool = False
) -> WireBenchConfig:
    """Return the configuration of a `WireBench`; `ports` of a started virtual bench replace the file's.

    `profiles`: the files of the device profiles, by name. `waits`: the bench is one that waits for the scan, where its
    ready line or its file says.

    Raises:
        recipes.RecipeError: a profile has problems, each with its place.

    """
    devices = {name: _modbus(device, profiles, ports, name) for name, device in bench.modbus_devices.items()}
    return WireBenchConfig(
        period_ns=period_ns,
        can=can_config(bench, ports),
        drive=drive_config(bench, drive_profile(profiles[bench.drive.profile])),
        amplifier=devices.get("amplifier"),
        brake=devices.get("brake"),
        drive_brake=drive_brake_config(bench),
        remote_io=devices["remote_io"],
        pace=_pace(bench, ports) if waits else None,
        channels=channels(bench),
        brake_fixed_current_a=bench.lock_brake.max_current_a,
        measuring=tuple(block for one in bench.devices for block in blocks(one.name, devices[one.name])),
        sources=sources(bench),
        can_sensors=can_sensors(bench, profiles),
        modbus_devices=tuple(devices),
    )


def drive_profile(file: File) -> DriveProfile:
    """Return the profile of a drive; RecipeError with every problem and its place."""
    return _drive_profile(file.content, str(file.path))


def modbus_profile(file: File) -> ModbusProfile:
    """Return the profile of a Modbus device; RecipeError with every problem and its place."""
    return _modbus_profile(file.content, str(file.path))


@lru_cache(maxsize=32)
def _drive_profile(content: bytes, path: str) -> DriveProfile:
    """Parse a profile once, for its check and for whoever takes it."""
    return parse_document(content, path, DriveProfile)


@lru_cache(maxsize=32)
def _modbus_profile(content: bytes, path: str) -> ModbusProfile:
    return parse_document(content, path, ModbusProfile)


def _pace(bench: Bench, ports: Ports | None) -> PaceConfig | None:
    if ports is not None:
        if ports.pace is None:
            raise StationError(
                "the virtual bench cannot keep step with the scan process: its first line names no 'pace'. "
                "Start the virtual bench of this version of lostmotion"
            )
        return PaceConfig(ports.pace.host, ports.pace.port)
    return None if bench.pace is None else PaceConfig(bench.pace.host, bench.pace.port)


def can_config(bench: Bench, ports: Ports | None = None) -> CanConfig:
    """Return how to reach the CAN bus of a bench file; `ports` of a started virtual bench replace the file's."""
    can = bench.can
    if ports is not None:
        there = ports.can
        interface: Literal["socketcand"] = "socketcand"
        return CanConfig(interface, channel=there.channel, host=there.host, port=there.port)
    serial_port = can.channel if can.interface == "slcan" else ""
    return CanConfig(can.interface, can.channel, can.host, can.port, can.bitrate, serial_port)


def drive_config(bench: Bench, profile: DriveProfile) -> DriveConfig:
    """Return the drive of a bench file with its profile."""
    drive = bench.drive
    return DriveConfig(
        node_id=drive.node_id,
        controller_node_id=drive.controller_node_id,
        profile=profile,
        gear_ratio=drive.gear_ratio,
        rated_torque_nm=drive.rated_torque_nm,
        max_torque_nm=drive.max_torque_nm,
        max_speed_rad_s=drive.max_speed_rad_s,
        torque_slope_nm_s=drive.torque_slope_nm_s,
        controller_heartbeat_s=drive.controller_heartbeat_s,
        controller_heartbeat_timeout_s=drive.controller_heartbeat_timeout_s,
        drive_heartbeat_s=drive.drive_heartbeat_s,
        setpoint_timeout_s=drive.setpoint_timeout_s,
        abort_connection_option=drive.abort_connection_option,
        quick_stop_option=drive.quick_stop_option,
        fault_reaction_option=drive.fault_reaction_option,
        output_mask=0 if bench.drive_brake is None else 1 << bench.drive_brake.output_bit,
        reversed=drive.reversed,
    )


def drive_brake_config(bench: Bench) -> DriveBrakeConfig | None:
    """Return the brake at an output of the drive; None where it is a device on Modbus."""
    brake = bench.drive_brake
    return None if brake is None else DriveBrakeConfig(brake.output_bit, brake.input_bit)


def _modbus(device: ModbusDevice, profiles: Mapping[str, File], ports: Ports | None, part: str) -> ModbusConfig:
    there = device if ports is None else ports.devices[part]
    return ModbusConfig(
        transport=device.transport if ports is None else "tcp",
        host=there.host,
        port=there.port,
        unit_id=device.unit_id,
        profile=modbus_profile(profiles[device.profile]),
        poll_every_s=device.poll_every_s,
        timeout_s=device.timeout_s,
        serial_port=device.serial_port,
        baudrate=device.baudrate,
        parity=PARITY_LETTERS[device.parity],
        stop_bits=device.stopbits,
    )
