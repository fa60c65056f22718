"""What the targets share: the bench and recipe that inputs are held against, and the drive as an image sees it."""

from __future__ import annotations

from functools import cache
from typing import Any

from wire_rig import PORTS

from definitions.image import DriveMode, Orders
from drivers.config import WireBenchConfig
from drivers.servo_drive.drive import CanDrive
from station.bench.assemble import wire_config
from station.bench.request import Job, load_job

RECIPE = "rv-40e-121-faults"
SCANS = 12


@cache
def the_job() -> Job:
    return load_job(RECIPE, None)


@cache
def the_config() -> WireBenchConfig:
    return wire_config(the_job().bench, the_job().profile_sources, the_job().recipe.sampling.period_ns, PORTS)


@cache
def no_orders() -> Orders:
    return Orders(*[0] * len(Orders._fields))._replace(drive_mode=DriveMode.CYCLIC_SYNC_TORQUE)


def all_of(drive: CanDrive, scan: int) -> tuple[Any, ...]:
    """Everything that the image takes from the drive."""
    names = ("statusword", "mode_display", "actual_torque", "actual_position", "actual_velocity")
    ages = (drive.age_scans(scan), drive.heartbeat_age_scans(scan))
    assert all(0 <= age <= 0xFFFF for age in ages), ages
    return (*map(drive.value, names), *ages, drive.nmt_state, drive.emcy_code, drive.value("error_register"))
