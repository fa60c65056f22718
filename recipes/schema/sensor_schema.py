"""Sensors in a bench file: ranges, errors, noise and delays of those that measure torque and angle."""

from __future__ import annotations

from typing import Literal

from definitions.units import RAD_PER_ARCSEC
from recipes.text.section import (
    AngleError,
    AngleNoise,
    BitCount,
    Lag,
    Section,
    SensorError,
    SensorNoise,
    Torque,
    UsableRange,
)


class TorqueSensor(Section):
    """Torque sensor; noise (one standard deviation), usable range, zero and reversibility are fractions of full scale.

    accuracy: gain error, of the reading. reversibility: half the difference between falling and rising. stated_by: who
    states these two: data_sheet, as limits; or certificate, of a calibration of this sensor with its amplifier, as
    expanded uncertainties with k = 2. tared_zero: limit of what the tare leaves of the zero, with the friction that
    stands on the sensor then. at_rest: limit of the torque that friction keeps on the sensor when the lock is open and
    the drive off: by so much more may the zero read after a run differ from the one before it.
    """

    full_scale_nm: Torque
    usable_fraction: UsableRange = 1.0
    accuracy_fraction: SensorError
    noise_fraction: SensorNoise
    lag_s: Lag
    tared_zero_fraction: SensorError = 0.0002
    at_rest_fraction: SensorError = 0.002
    reversibility_fraction: SensorError = 0.0002
    stated_by: Literal["data_sheet", "certificate"] = "data_sheet"

    @property
    def usable_nm(self) -> float:
        """Largest torque that is measured; the amplifier saturates above it [N·m]."""
        return self.full_scale_nm * self.usable_fraction


class AngleSensor(Section):
    """Encoder of a shaft. accuracy: limit of its error over a turn; interpolation: limit of its error within a line."""

    resolution_bits: BitCount
    noise_rad: AngleNoise
    lag_s: Lag
    accuracy_rad: AngleError = 10 * RAD_PER_ARCSEC
    interpolation_rad: AngleError = 0.5 * RAD_PER_ARCSEC


class Sensors(Section):
    """Sensors of the bench; what it does not have is left out.

    skew: limit of the difference between the delays of torque and angle, where nothing aligns them.
    """

    torque_in: TorqueSensor | None = None
    torque_out: TorqueSensor | None = None
    angle_in: AngleSensor
    angle_out: AngleSensor | None = None
    skew_s: Lag = 0.0002
