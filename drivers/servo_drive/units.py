"""Units between the loaded shaft and the drive's numbers.

Torque: 0x6071 and 0x6077 count parts of the motor's rated torque, 0.1 % by CiA 402-2; the gear between motor and loaded
shaft multiplies it. Position and velocity: the vendor's counts at the motor, from the profile. A drive that is mounted
the other way round has the opposite sign in all three.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from drivers.config import DriveConfig


@dataclass(frozen=True)
class DriveUnits:
    """Factors at the loaded shaft: SI value per count."""

    torque_nm_per_count: float
    angle_rad_per_count: float
    velocity_rad_s_per_count: float


def drive_units(config: DriveConfig) -> DriveUnits:
    """Factors of this drive behind this gear."""
    scaling = config.profile.scaling
    sign = -1.0 if config.reversed else 1.0
    return DriveUnits(
        torque_nm_per_count=sign * config.rated_torque_nm * config.gear_ratio / scaling.torque_counts_per_rated,
        angle_rad_per_count=sign * 2 * math.pi / scaling.position_counts_per_motor_rev / config.gear_ratio,
        velocity_rad_s_per_count=sign / scaling.velocity_counts_per_rad_s / config.gear_ratio,
    )
