"""The vocabulary of faults: what the virtual bench can do wrong, one row per target and verb.

A scenario names a row, gives its value where it has one, and says when it starts. `acts_on` is what a controller finds
changed: a fault counts as seen only once that has happened.
"""

from __future__ import annotations

from typing import NamedTuple

INF = float("inf")
DEVICES = ("amplifier", "brake", "remote_io")
TORQUES = ("torque_in", "torque_out")
ANGLES = ("angle_in", "angle_out")


class Verb(NamedTuple):
    """Row of the vocabulary: meaning of the value ('' when it takes none), its range, and what is found changed."""

    value: str
    low: float
    high: float
    acts_on: str


def _plain(acts_on: str) -> Verb:
    return Verb("", 0.0, 0.0, acts_on)


def _devices() -> dict[tuple[str, str], Verb]:
    rows = {}
    for device in DEVICES:
        target = f"modbus.{device}"
        rows[target, "off"] = _plain("connections are closed")
        rows[target, "exception"] = _plain("every answer is an exception")
        rows[target, "silence"] = _plain("requests stay without answer")
        rows[target, "slow"] = Verb("ms by which answers are late", 0.0, 10_000.0, "answers come late")
        rows[target, "freeze"] = _plain("the registers keep their values")
    return rows


def _sensors() -> dict[tuple[str, str], Verb]:
    rows = {}
    for channel in TORQUES + ANGLES:
        unit = "N·m" if channel in TORQUES else "rad"
        target = f"sensor.{channel}"
        rows[target, "stuck"] = _plain("the signal stands still")
        rows[target, "offset"] = Verb(f"{unit} added to the signal", -INF, INF, "the signal is shifted")
        rows[target, "drift"] = Verb(f"{unit}/s by which the signal drifts", -INF, INF, "the signal wanders")
        rows[target, "spike"] = Verb(f"{unit} added to one sample", -INF, INF, "one sample is wrong")
        rows[target, "flip"] = _plain("the signal has the wrong sign")
        rows[target, "nan"] = _plain("not a number; over wires the lowest count")
        if channel in TORQUES:
            rows[target, "saturate"] = _plain("the channel reports saturation")
    return rows


FAULTS: dict[tuple[str, str], Verb] = {
    ("can.drive.heartbeat", "off"): _plain("no heartbeat of the drive"),
    ("can.drive.tpdo1", "off"): _plain("no status of the drive"),
    ("can.drive.tpdo1", "drop"): Verb("share of the frames that is lost, 0 to 1", 0.0, 1.0, "frames are missing"),
    ("can.drive.tpdo1", "drop_next"): Verb("number of frames that are lost", 1, 1_000_000, "frames are missing"),
    ("can.drive.tpdo1", "delay"): Verb("ms by which frames are late", 0.0, 10_000.0, "frames are late"),
    ("can.drive.tpdo1", "duplicate"): _plain("every frame comes twice"),
    ("can.drive.node", "reset"): _plain("the drive boots and stays pre-operational"),
    ("drive.statusword", "stuck"): _plain("the status word keeps its value"),
    ("drive.mode", "stuck"): _plain("the mode display keeps its value"),
    ("drive.mode", "refuse"): _plain("the mode display shows 0"),
    ("drive.internal_limit", "raise"): _plain("bit 11 of the status word is set"),
    ("drive.torque", "scale"): Verb("factor on the actual torque", -1000.0, 1000.0, "the actual torque is wrong"),
    ("drive.state", "drop"): _plain("safe torque off without the emergency stop's contact"),
    ("drive.emcy", "raise"): Verb("error code, 1 to 0xFFFF", 1, 0xFFFF, "an emergency message and the state fault"),
    ("drive.emcy", "storm"): Verb("error code, 1 to 0xFFFF", 1, 0xFFFF, "emergency messages without end"),
    **_devices(),
    **_sensors(),
    ("lock", "slip"): Verb("share of the brake's torque that is left, 0 to 1", 0.0, 1.0, "the lock holds less"),
    ("brake.current", "fade"): Verb("share of the current that is left, 0 to 1", 0.0, 1.0, "the current is lower"),
    ("coupling", "break"): _plain("no torque goes through the reducer any more"),
    ("io.estop", "trip"): _plain("contact open, safe torque off"),
    ("io.guard", "open"): _plain("contact open"),
    ("io.housing_temp", "offset"): Verb("K added to the housing's temperature", -INF, INF, "the housing is warmer"),
    ("scan.overrun", "miss"): Verb("whole periods that are missed at once", 1, 1_000_000, "periods are missing"),
}

ONLY_IN_VIRTUAL_TIME = frozenset({("scan.overrun", "miss")})
"""Over wires the period belongs to the controller's process, which the virtual bench cannot hold up."""
