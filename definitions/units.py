"""Units: the kinds of quantity that people write and read, each with its unit inside and for people; angle factors."""

from __future__ import annotations

import math
from typing import NamedTuple

RAD_PER_ARCMIN = math.pi / 10_800.0
"""1 arcmin in rad; also 1 N·m·arcmin in J."""

ARCMIN_PER_RAD = 1.0 / RAD_PER_ARCMIN
"""1 rad in arcmin: 3437.747."""

RAD_PER_ARCSEC = math.pi / 648_000.0

ARCMIN_PER_DEGREE = 60.0
ARCSEC_PER_ARCMIN = 60.0
ARCSEC_PER_RAD = ARCSEC_PER_ARCMIN * ARCMIN_PER_RAD


class Kind(NamedTuple):
    """Kind of quantity: name with article, unit of the loaded number, unit for people, an example."""

    name: str
    unit: str
    shown: str
    example: str

    @property
    def plain_name(self) -> str:
        """Name without its article."""
        return self.name.split(" ", 1)[1]


class Range(NamedTuple):
    """Values that an option may have, in the unit for people."""

    least: float
    most: float
    beyond_least: bool = False
    """The least value itself is not allowed."""


TORQUE = Kind("a torque", "N*m", "N·m", "412 N·m")
TORQUE_RATE = Kind("a torque rate", "N*m/s", "N·m/s", "60 N·m/s")
STIFFNESS = Kind("a stiffness", "N*m/arcmin", "N·m/arcmin", "27.6 N·m/arcmin")
LOSS = Kind("a hysteresis loss", "N*m*arcmin", "N·m·arcmin", "470 N·m·arcmin")
TORQUE_CONSTANT = Kind("a torque constant", "N*m/A", "N·m/A", "100 N·m/A")
ANGLE = Kind("an angle", "rad", "arcmin", "1 arcmin")
TRAVEL = Kind("an angle", "rad", "deg", "60 deg")
ARCMINUTES = Kind("an angle", "arcmin", "arcmin", "1 arcmin")
ARCSECONDS = Kind("an angle", "arcsec", "arcsec", "30 arcsec")
SPEED = Kind("a speed", "rad/s", "rpm", "0.05 rpm")
ACCELERATION = Kind("an acceleration", "rad/s^2", "rad/s²", "2 rad/s²")
FREQUENCY = Kind("a frequency", "Hz", "Hz", "2 Hz")
DURATION = Kind("a time", "s", "s", "200 ms")
PERIOD = Kind("a time", "s", "ms", "1 ms")
CURRENT = Kind("a current", "A", "A", "10 A")
TEMPERATURE = Kind("a temperature", "degC", "degC", "60 degC")
TEMPERATURE_CHANGE = Kind("a temperature difference", "K", "K", "5 K")
FRACTION = Kind("a fraction", "one", "%", "0.1 %")
DRIFT = Kind("a drift", "arcmin/min", "arcmin/min", "0.005 arcmin/min")
RESOLUTION = Kind("a resolution", "bit", "bit", "20 bit")

KINDS = (
    TORQUE,
    TORQUE_RATE,
    STIFFNESS,
    LOSS,
    TORQUE_CONSTANT,
    FREQUENCY,
    ANGLE,
    TRAVEL,
    ARCMINUTES,
    ARCSECONDS,
    SPEED,
    ACCELERATION,
    DURATION,
    PERIOD,
    CURRENT,
    TEMPERATURE,
    TEMPERATURE_CHANGE,
    FRACTION,
    DRIFT,
    RESOLUTION,
)
"""Kinds that documents write as a number with its unit."""

NUMBER = Kind("a plain number", "", "1", "2")
SAMPLES = Kind("a number of samples", "", "samples", "3")
SCANS = Kind("a number of scans", "", "scans", "20")
"""Counts, and what has no unit: written as a bare number."""
