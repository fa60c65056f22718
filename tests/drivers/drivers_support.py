"""What the driver tests share: profiles read from the shipped files, and configurations on top of them."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from definitions.profiles.can import CanProfile
from definitions.profiles.drive import DriveProfile
from definitions.profiles.modbus import ModbusProfile
from drivers.config import DriveConfig, ModbusConfig
from recipes.text.section import reader

PROFILES = Path(__file__).parents[2] / "drivers" / "profiles"
PERIOD_NS = 1_000_000


@cache
def _profile_as_json(name: str) -> str:
    return json.dumps(YAML(typ="safe", pure=True).load(PROFILES / f"{name}.yaml"))


def raw_profile(name: str) -> Any:
    """Return a shipped profile, to be changed at will: parsed once, for that takes longer than most of these tests."""
    return json.loads(_profile_as_json(name))


def drive_profile(raw: Any) -> DriveProfile:
    """Read a profile as its file is read."""
    return reader(DriveProfile).validate_json(json.dumps(raw))


def modbus_profile(raw: Any) -> ModbusProfile:
    return reader(ModbusProfile).validate_json(json.dumps(raw))


def can_profile(raw: Any) -> CanProfile:
    return reader(CanProfile).validate_json(json.dumps(raw))


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
