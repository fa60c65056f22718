"""What a profile leaves out, against what the drive has: on a second CANopen stack, made of EDS files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from table_drive_bus import on_the_bus

from definitions.protections import DRIVE_PROTECTIONS
from drivers.servo_drive.unused import missing_on

HAS = {
    "controller_heartbeat": "protections: {controller_heartbeat: consumer_heartbeat}",
    "torque_limit": "protections: {torque_limit: max_torque}",
    "speed_limit": "protections: {speed_limit: max_motor_speed}",
    "torque_slope": "protections: {torque_slope: torque_slope}",
}


@pytest.mark.parametrize("protection", HAS)
def test_what_the_drive_has_and_its_profile_leaves_out_is_named_with_its_entry(tmp_path: Path, protection: str) -> None:
    with on_the_bus(tmp_path, "nanotec-like", protections={protection: "none"}) as (_, link, config):
        (found,) = [one for one in missing_on(link, config) if one.protection.name == protection]
    assert (found.asked, found.entry) == (True, HAS[protection])
    assert found.there in found.what
    assert f"'{found.entry}' into profile {config.profile.profile.name}" in found.cure(config.profile.profile.name)


def test_what_the_drive_does_not_have_is_told_with_what_is_then_left(tmp_path: Path) -> None:
    with on_the_bus(tmp_path, "epos4-like") as (_, link, config):
        missing = missing_on(link, config)
    assert missing
    assert not any(one.there for one in missing)
    without = {row.name: row.without for row in DRIVE_PROTECTIONS}
    for one in missing:
        assert one.asked == (one.protection.name != "follows_command")
        expected = f"{without[one.protection.name]}." if one.asked else "Compare the profile with the drive's manual."
        assert one.cure("p") == expected


def test_nothing_is_told_of_a_profile_that_uses_everything(tmp_path: Path) -> None:
    with on_the_bus(tmp_path, "nanotec-like") as (_, link, config):
        assert missing_on(link, config) == []


def test_a_time_out_of_set_points_that_is_not_used_is_named_too(tmp_path: Path) -> None:
    with on_the_bus(tmp_path, "nanotec-like") as (_, link, config):
        torque = config.profile.torque_pdo
        pdos = tuple(replace(pdo, timeout=False) if pdo is torque else pdo for pdo in config.profile.receive_pdos)
        (found,) = missing_on(link, replace(config, profile=replace(config.profile, receive_pdos=pdos)))
    assert found.entry == "timeout: true"
