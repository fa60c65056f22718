"""From a bench file to the virtual bench that plays it: plant, drive, sensors and servers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from drivers.virtual.config import (
    AngleSensor,
    BenchConfig,
    BrakeConfig,
    CanBus,
    DriveConfig,
    DriveProfile,
    ModbusPort,
    Protections,
    RegisterMap,
    ServerConfig,
    SlcanPort,
    SlowPoll,
    Socketcand,
    TorqueSensor,
)
from drivers.virtual.fault_vocabulary import ONLY_IN_VIRTUAL_TIME, ONLY_OVER_WIRES
from drivers.virtual.scenario import Scenario
from drivers.virtual.units import default_unit, find_unit
from recipes import Bench, Problem, RecipeError, load_document, parse_document
from recipes.bench_schema import AngleSensor as AngleSensorFile
from recipes.bench_schema import ModbusDevice
from recipes.bench_schema import TorqueSensor as TorqueSensorFile

Profiles = Mapping[str, Path]


def choose_unit(asked: str | None, model: str) -> str:
    """Return the unit to put on the virtual bench, NAME[:SEED]; VirtualBenchError when there is none like it."""
    unit = asked or default_unit(model)
    find_unit(unit)
    return unit


def load_scenario(path: Path) -> Scenario:
    """Load a scenario file; RecipeError with every problem and its place."""
    return load_document(path, Scenario)


def parse_scenario(raw: bytes, path: str) -> Scenario:
    """Load a scenario from the bytes of its file; RecipeError with every problem and its place."""
    return parse_document(raw, path, Scenario)


def check_clock(path: Path, scenario: Scenario, *, wires: bool) -> None:
    """Refuse faults that the clock of the run cannot have; RecipeError with every one of them."""
    lacking, hint = (ONLY_IN_VIRTUAL_TIME, "leave --wires out") if wires else (ONLY_OVER_WIRES, "run it over wires")
    where = "virtual time" if wires else "wires"
    problems = [
        Problem(
            str(path),
            0,
            0,
            f"faults.{place}",
            f"{fault.target} {fault.verb}",
            f"a fault that is not for {where} only",
            hint,
        )
        for place, fault in enumerate(scenario.faults)
        if (fault.target, fault.verb) in lacking
    ]
    if problems:
        raise RecipeError(problems)


def plain_document(path: Path) -> Mapping[str, Any]:
    """Return a YAML file as plain data."""
    document: Mapping[str, Any] = YAML(typ="safe").load(path)
    return document


def virtual_config(bench: Bench, profiles: Profiles, unit: str) -> BenchConfig:
    """Return the plant, drive and sensors that stand in for the hardware of a bench file."""
    sensors, brake = bench.sensors, bench.brake
    return BenchConfig(
        unit=unit,
        loading=bench.bench.loading,
        drive=_drive(bench, profiles),
        brake=BrakeConfig(brake.torque_constant_nm_per_a, brake.max_current_a, brake.time_constant_s),
        torque_in=_torque(sensors.torque_in),
        torque_out=_torque(sensors.torque_out),
        angle_in=_angle(sensors.angle_in),
        angle_out=None if sensors.angle_out is None else _angle(sensors.angle_out),
        fixture_stiffness_nm_per_arcmin=_lock_nm_per_arcmin(bench),
        seed=find_unit(unit).seed or 1,
        amplifier_poll=SlowPoll(bench.amplifier.poll_every_s),
        brake_poll=SlowPoll(brake.poll_every_s),
        remote_io_poll=SlowPoll(bench.remote_io.poll_every_s),
    )


def _lock_nm_per_arcmin(bench: Bench) -> float:
    """Return the stiffness of the virtual lock, at the locked shaft: all of its fixture that gives way."""
    parts = bench.fixture.parts
    if parts is None or bench.bench.loading == "input":
        return bench.fixture.output_side_nm_per_arcmin
    return parts.input_nm_per_arcmin


def _torque(sensor: TorqueSensorFile | None) -> TorqueSensor | None:
    if sensor is None:
        return None
    return TorqueSensor(sensor.full_scale_nm, sensor.accuracy_fraction, sensor.noise_fraction, sensor.lag_s)


def _angle(sensor: AngleSensorFile) -> AngleSensor:
    return AngleSensor(round(sensor.resolution_bits), sensor.noise_rad, sensor.lag_s)


def _drive(bench: Bench, profiles: Profiles) -> DriveConfig:
    drive = bench.drive
    return DriveConfig(
        node_id=drive.node_id,
        controller_node_id=drive.controller_node_id,
        gear_ratio=drive.gear_ratio,
        rated_torque_nm=drive.rated_torque_nm,
        profile=DriveProfile.from_mapping(plain_document(profiles[drive.profile])),
        protections=Protections(
            max_torque_nm=drive.max_torque_nm,
            max_speed_rad_s=drive.max_speed_rad_s,
            torque_slope_nm_s=drive.torque_slope_nm_s,
            controller_heartbeat_timeout_s=drive.controller_heartbeat_timeout_s,
            setpoint_timeout_s=drive.setpoint_timeout_s,
            drive_heartbeat_s=drive.drive_heartbeat_s,
            abort_connection_option=drive.abort_connection_option,
            quick_stop_option=drive.quick_stop_option,
            fault_reaction_option=drive.fault_reaction_option,
        ),
        controller_heartbeat_s=drive.controller_heartbeat_s,
    )


def server_config(
    bench: Bench,
    profiles: Profiles,
    unit: str,
    *,
    scenario: Path | None,
    embedded: bool,
    truth: Path | None = None,
) -> ServerConfig:
    """Return the virtual bench as a process; an embedded one takes free loopback ports and ends with its parents."""
    can = bench.can

    def port(device: ModbusDevice) -> ModbusPort:
        registers = RegisterMap.from_mapping(plain_document(profiles[device.profile]))
        if embedded:
            return ModbusPort(registers, device.unit_id)
        if device.transport == "rtu":
            return ModbusPort(registers, device.unit_id, rtu=True, serial_port=device.serial_port)
        return ModbusPort(registers, device.unit_id, device.host, device.port)

    bus: Socketcand | CanBus | SlcanPort = CanBus(can.interface, can.channel, can.bitrate)
    if embedded or can.interface == "socketcand":
        bus = Socketcand(channel=can.channel) if embedded else Socketcand(can.host, can.port, can.channel)
    elif can.interface == "slcan":
        bus = SlcanPort(can.channel, bitrate=can.bitrate)
    return ServerConfig(
        bench=virtual_config(bench, profiles, unit),
        amplifier=port(bench.amplifier),
        brake=port(bench.brake),
        remote_io=port(bench.remote_io),
        can=bus,
        scenario=scenario,
        end_with_parent=embedded,
        truth=truth,
    )
