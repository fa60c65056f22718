"""Live values of the bench as OPC UA shows them: unit, and a status that says how good a value is now.

Made of the fields of the process image: every measured value with a unit is one variable.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from asyncua import ua

from definitions.image import AGE_NEVER, IMAGE_FIELDS, Field, Image
from definitions.program import Program
from station.web.bench.sight import DEVICES, device_of

UNECE = "http://www.opcfoundation.org/UA/units/un/cefact"


class UnitRow(NamedTuple):
    """A unit: its common code in UN/ECE recommendation 20, and its name."""

    code: str
    name: str


UNITS: dict[str, UnitRow] = {
    "N·m": UnitRow("NU", "newton metre"),
    "rad": UnitRow("C81", "radian"),
    "rad/s": UnitRow("2A", "radian per second"),
    "A": UnitRow("AMP", "ampere"),
    "°C": UnitRow("CEL", "degree Celsius"),
}
"""Units of the process image that are shown; scans, numbers and bits are none."""

VALUES: tuple[Field, ...] = tuple(field for field in IMAGE_FIELDS if field.unit in UNITS)
"""The variables, in the order of the process image."""

Codes = ua.StatusCodes
NO_SENSOR, NEVER_CAME, LOST = Codes.BadNotSupported, Codes.BadWaitingForInitialData, Codes.BadNoCommunication
STALE, BROKEN, GOOD = Codes.UncertainLastUsableValue, Codes.BadSensorFailure, Codes.Good

Value = tuple[float | None, int]
"""A value with its status code."""

NOTHING: dict[str, Value] = {field.name: (None, NEVER_CAME) for field in VALUES}
"""While no run was seen."""


def unit_information(unit: str) -> ua.EUInformation:
    """Return what OPC UA says of a unit; its number is made of the letters of its code (part 8, 5.6.3)."""
    row = UNITS[unit]
    number = int.from_bytes(row.code.encode(), "big")
    return ua.EUInformation(UNECE, number, ua.LocalizedText(unit), ua.LocalizedText(row.name))


def values_of(image: Image, program: Program, *, on: bool) -> dict[str, Value]:
    """Return every value with its status; on: records come now, else these are the last that came."""
    return {field.name: _value(field, image, program, on=on) for field in VALUES}


def _value(field: Field, image: Image, program: Program, *, on: bool) -> Value:
    device = next(row for row in DEVICES if row.title == device_of(field.name))
    age = getattr(image, device.age) if device.age else 0
    if (field.name == "torque_in_nm" and not program.has_torque_in) or (
        field.name == "torque_out_nm" and not program.has_torque_out
    ):
        return None, NO_SENSOR
    if age == AGE_NEVER:
        return None, NEVER_CAME
    value = float(getattr(image, field.name))
    if not math.isfinite(value):
        return None, BROKEN
    if image.links_lost & device.link:
        return value, LOST
    stale = bool(device.age) and age > getattr(program.limits, device.oldest)
    return value, STALE if stale or not on else GOOD


def aged(values: dict[str, Value]) -> dict[str, Value]:
    """Return values of a run that is over: what was good is the last that is known."""
    return {name: (value, STALE if status == GOOD else status) for name, (value, status) in values.items()}
