"""What the driver tests share: profiles read from the shipped files, and configurations on top of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from definitions.plain_data import exact
from drivers.config import DriveConfig, ModbusConfig
from drivers.profile import DriveProfile, ModbusProfile
from recipes.schema.modbus_profile_schema import ModbusProfileFile
from recipes.schema.profile_schema import DriveProfileFile

PROFILES = Path(__file__).parents[2] / "drivers" / "profiles"
PERIOD_NS = 1_000_000


def raw_profile(name: str) -> Any:
    return YAML(typ="rt").load(PROFILES / f"{name}.yaml")


def drive_profile(raw: Any) -> DriveProfile:
    """Check a profile as its file is checked, and return it as the drivers want it."""
    return exact(DriveProfile, DriveProfileFile.model_validate(raw).model_dump(mode="json"))


def modbus_profile(raw: Any) -> ModbusProfile:
    return exact(ModbusProfile, ModbusProfileFile.model_validate(raw).model_dump(mode="json"))


def drive_config(**changes: Any) -> DriveConfig:
    values: dict[str, Any] = {
        "node_id": 5,
        "controller_node_id": 126,
        "profile": drive_profile(raw_profile("virtual-drive")),
        "gear_ratio": 2.0,
        "rated_torque_nm": 5.0,
        "max_torque_nm": 5.5,
        "max_speed_rad_s": 12.566370614359172,
        "torque_slope_nm_s": 50.0,
        "controller_heartbeat_s": 0.02,
        "controller_heartbeat_timeout_s": 0.1,
        "drive_heartbeat_s": 0.02,
        "setpoint_timeout_s": 0.05,
        "abort_connection_option": 2,
        "quick_stop_option": 2,
        "fault_reaction_option": 2,
        "boot_timeout_s": 2.0,
        "listen_before_reset_s": 0.01,
    }
    return DriveConfig(**(values | changes))


def modbus_config(name: str, unit_id: int, **changes: Any) -> ModbusConfig:
    values: dict[str, Any] = {
        "transport": "tcp",
        "unit_id": unit_id,
        "profile": modbus_profile(raw_profile(name)),
        "poll_every_s": 0.001,
        "timeout_s": 0.005,
        "connect_timeout_s": 1.0,
    }
    return ModbusConfig(**(values | changes))
