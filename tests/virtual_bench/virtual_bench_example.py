"""The default bench as the virtual bench is told of it, from the shipped profiles; for tests and benchmarks."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from pathlib import Path

from drivers.config import DriveConfig
from station.bench.assemble import drive_profile, modbus_profile
from station.bench.files import FileAt
from virtual_bench.config import (
    AngleSensor,
    BenchConfig,
    BrakeConfig,
    ModbusPort,
    ServerConfig,
    TorqueSensor,
)

PROFILES = Path(__file__).parents[2] / "drivers" / "profiles"


def profile(name: str) -> FileAt:
    return FileAt(PROFILES / f"{name}.yaml")


def example_bench_config() -> BenchConfig:
    """Return the default bench: servo at the input, brake at the output."""
    return BenchConfig(
        unit="P1",
        loading="input",
        drive=DriveConfig(
            node_id=5,
            controller_node_id=126,
            gear_ratio=1.0,
            rated_torque_nm=5.0,
            profile=drive_profile(profile("virtual-drive")),
            max_torque_nm=5.5,
            max_speed_rad_s=4 * pi,
            torque_slope_nm_s=50.0,
            controller_heartbeat_s=0.02,
            controller_heartbeat_timeout_s=0.1,
            drive_heartbeat_s=0.02,
            setpoint_timeout_s=0.05,
            abort_connection_option=2,
            quick_stop_option=2,
            fault_reaction_option=2,
        ),
        brake=BrakeConfig(torque_constant_nm_per_a=100.0, max_current_a=10.0, time_constant_s=0.08),
        torque_in=TorqueSensor(5.0),
        torque_out=TorqueSensor(1000.0),
        angle_in=AngleSensor(20),
        angle_out=AngleSensor(23),
    )


def example_output_config() -> BenchConfig:
    """Return a bench with servo and gearbox at the output, brake at the input."""
    bench_config = example_bench_config()
    drive = replace(bench_config.drive, gear_ratio=100.0, max_speed_rad_s=100.0)
    brake = BrakeConfig(torque_constant_nm_per_a=1.0, max_current_a=10.0, time_constant_s=0.08)
    return replace(bench_config, loading="output", drive=drive, brake=brake, torque_in=None)


def example_server_config() -> ServerConfig:
    """Return the default bench on free loopback ports."""
    return ServerConfig(
        bench=example_bench_config(),
        devices={
            "amplifier": ModbusPort(modbus_profile(profile("virtual-amplifier")), unit_id=1),
            "brake": ModbusPort(modbus_profile(profile("virtual-brake")), unit_id=2),
            "remote_io": ModbusPort(modbus_profile(profile("virtual-remote-io")), unit_id=3),
        },
    )
