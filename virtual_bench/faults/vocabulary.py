"""The vocabulary of faults: what the virtual bench can do wrong, one row per target and verb.

A scenario names a row, gives its value where it has one, and says when it starts. `acts_on` is what a controller finds
changed: a fault counts as seen only once that has happened. `FAULTS` has what every bench can do; what the devices of
one bench can do by their names stands in `faults_of_devices`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from definitions.profiles.modbus import ModbusProfile

INF = float("inf")
DEVICES = ("amplifier", "brake", "remote_io")
TORQUES = ("torque_in", "torque_out")
ANGLES = ("angle_in", "angle_out")
FRAMES = {
    "can.sync": "SYNC",
    "can.setpoint": "set-points (receive PDO 1)",
    "can.controller.heartbeat": "heartbeat of the controller",
    "can.drive.heartbeat": "heartbeat of the drive",
    "can.drive.tpdo1": "status of the drive (transmit PDO 1)",
    "can.drive.tpdo2": "position of the drive (transmit PDO 2)",
    "can.drive.emcy": "emergency messages of the drive",
    "can.drive.sdo": "parameter answers (SDO) of the drive",
}
"""Frames that can be lost, by the name of their target."""

CYCLIC = tuple(target for target in FRAMES if target not in ("can.drive.emcy", "can.drive.sdo"))

REGISTERS = (
    "amplifier.torque_out_nm",
    "amplifier.sample_counter",
    "brake.brake_current_a",
    "brake.life_counter",
    "remote_io.life_counter",
)
"""Registers that can be frozen alone."""


class Verb(NamedTuple):
    """Row of the vocabulary: meaning of the value ('' when it takes none), its range, and what is found changed."""

    value: str
    low: float
    high: float
    acts_on: str


def _plain(acts_on: str) -> Verb:
    return Verb("", 0.0, 0.0, acts_on)


def _frames() -> dict[tuple[str, str], Verb]:
    rows = {}
    for target, name in FRAMES.items():
        rows[target, "off"] = _plain(f"no {name}")
    for target in CYCLIC:
        rows[target, "drop"] = Verb("share of the frames that is lost, 0 to 1", 0.0, 1.0, "frames are missing")
    for target in ("can.drive.tpdo1", "can.setpoint"):
        rows[target, "drop_next"] = Verb("number of frames that are lost", 1, 1_000_000, "frames are missing")
    return rows | {("can.drive.tpdo1", verb): row for verb, row in BYTES_OF_FRAMES.items()}


BYTES_OF_FRAMES: dict[str, Verb] = {
    "delay": Verb("ms by which frames are late", 0.0, 10_000.0, "frames are late"),
    "jitter": Verb("ms by which frames are late at most", 0.0, 10_000.0, "each frame is late by a random time"),
    "duplicate": _plain("every frame comes twice"),
    "reorder": _plain("every second frame comes before the one that was sent first"),
    "truncate": Verb("bytes that are missing at the end, 1 to 8", 1, 8, "frames are too short"),
    "corrupt": _plain("frames carry wrong data with a valid check sum"),
    "stuck": _plain("frames repeat old data"),
}
"""What becomes of the frames of one identifier that arrive."""

OF_A_DEVICE: dict[str, Verb] = {
    "off": _plain("connections are closed and refused"),
    "reset": _plain("connections are closed once"),
    "exception": _plain("every answer is an exception"),
    "silence": _plain("requests stay without answer"),
    "slow": Verb("ms by which answers are late", 0.0, 10_000.0, "answers come late"),
    "freeze": _plain("the registers keep their values"),
    "truncate": _plain("answers lack their last register"),
    "wrong_id": _plain("answers carry another transaction's number"),
    "wrong_unit": _plain("answers come from another unit"),
}
"""What a device on Modbus can do wrong."""

OF_A_MEASURING_DEVICE: dict[str, Verb] = {
    "jitter": Verb("ms by which answers are late at most", 0.0, 10_000.0, "each answer is late by a random time"),
    "split": _plain("answers come in two pieces"),
    "garbage": _plain("registers hold random values, except the identity"),
    "swap": _plain("the words of 32-bit values are swapped"),
}
"""What one that measures can do wrong besides."""

REGISTER_FREEZE = _plain("this register keeps its value, the others change")


def _devices() -> dict[tuple[str, str], Verb]:
    rows = {(f"modbus.{device}", verb): row for device in DEVICES for verb, row in OF_A_DEVICE.items()}
    rows |= {("modbus.amplifier", verb): row for verb, row in OF_A_MEASURING_DEVICE.items()}
    return rows | {(f"modbus.{register}", "freeze"): REGISTER_FREEZE for register in REGISTERS}


def faults_of_devices(modbus: Mapping[str, Iterable[str]], sensors: Mapping[str, bool]) -> dict[tuple[str, str], Verb]:
    """Return what the devices of a bench that measure can do wrong, by their names; all of it over wires only.

    `modbus`: devices on Modbus with their fields. `sensors`: those on CAN, and whether each is a CANopen node.
    """
    rows = {}
    for device, fields in modbus.items():
        for verb, row in (OF_A_DEVICE | OF_A_MEASURING_DEVICE).items():
            rows[f"modbus.{device}", verb] = row
        for field in fields:
            rows[f"modbus.{device}.{field}", "freeze"] = REGISTER_FREEZE
    for sensor, is_node in sensors.items():
        target = f"can.{sensor}"
        rows[target, "off"] = _plain("no frames of this sensor")
        rows[target, "drop"] = Verb("share of the frames that is lost, 0 to 1", 0.0, 1.0, "frames are missing")
        rows |= {(target, verb): row for verb, row in BYTES_OF_FRAMES.items()}
        if is_node:
            rows[f"{target}.heartbeat", "off"] = _plain("no heartbeat of this sensor")
            rows[f"{target}.node", "reset"] = _plain("the sensor restarts: what was set in it is lost")
    return rows


def _sensors() -> dict[tuple[str, str], Verb]:
    rows = {}
    for channel in TORQUES + ANGLES:
        unit = "N·m" if channel in TORQUES else "rad"
        target = f"sensor.{channel}"
        rows[target, "stuck"] = _plain("the signal stands still")
        rows[target, "offset"] = Verb(f"{unit} added to the signal", -INF, INF, "the signal is shifted")
        rows[target, "scale"] = Verb("factor on the signal", -1000.0, 1000.0, "the signal is too large or small")
        rows[target, "drift"] = Verb(f"{unit}/s by which the signal drifts", -INF, INF, "the signal wanders")
        rows[target, "spike"] = Verb(f"{unit} added to one sample", -INF, INF, "one sample is wrong")
        rows[target, "noise"] = Verb(f"{unit} rms added to the signal", 0.0, INF, "the signal is noisy")
        rows[target, "lag"] = Verb("s, time constant of a lag", 1e-6, 1000.0, "the signal comes late")
        rows[target, "flip"] = _plain("the signal has the wrong sign")
        rows[target, "nan"] = _plain("not a number; over wires the lowest count")
        if channel in TORQUES:
            rows[target, "saturate"] = _plain("the channel reports saturation")
    return rows


FAULTS: dict[tuple[str, str], Verb] = {
    **_frames(),
    ("can.drive.node", "reset"): _plain("the drive boots and stays pre-operational"),
    ("can.drive.sdo", "lie"): Verb(
        "index of an object, 0x1000 to 0xFFFF", 0x1000, 0xFFFF, "the drive accepts writes to it and keeps the old value"
    ),
    ("can.drive.sdo", "abort"): Verb("SDO abort code", 1, 0xFFFFFFFF, "the drive aborts every write"),
    ("can.bus", "off"): _plain("bus-off: no frame passes in either direction"),
    ("can.bus", "cut"): _plain("the adapter is gone: its connection is closed"),
    ("can.bus", "errors"): Verb("error frames before each frame, 1 to 20", 1, 20, "error frames arrive"),
    ("can.bus", "babble"): Verb(
        "foreign frames with each SYNC, 1 to 50", 1, 50, "frames with unknown CAN identifiers arrive"
    ),
    ("can.bus", "command"): _plain("with each SYNC the controller hears a set-point that it has not sent"),
    ("drive.statusword", "stuck"): _plain("the status word keeps its value"),
    ("drive.controlword", "ignore"): _plain("transitions are refused: control words change nothing"),
    ("drive.setpoint", "ignore"): _plain("set-points are ignored, and bit 12 of the status word says so"),
    ("drive.setpoint", "scale"): Verb(
        "factor on the set-point", -1000.0, 1000.0, "the drive scales set-points wrongly"
    ),
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
    ("unit", "crack"): Verb("share of the stiffness that is left, positive torque", 0.0, 1.0, "the unit is softer"),
    ("unit", "jam"): Verb("factor on the input friction, at least 1", 1.0, 1000.0, "the unit turns heavily"),
    ("io.estop", "trip"): _plain("contact open, safe torque off"),
    ("io.guard", "open"): _plain("contact open"),
    ("io.enabling_device", "press"): _plain("contact closed"),
    ("io.housing_temp", "offset"): Verb("K added to the housing's temperature", -INF, INF, "the housing is warmer"),
    ("clock", "step"): Verb("s by which the bench's wall clock jumps", -1e9, 1e9, "time stamps of frames jump"),
    ("scan.overrun", "miss"): Verb("whole periods that are missed at once", 1, 1_000_000, "periods are missing"),
    ("process.scan", "stop"): Verb("ms for which the scan process stands still", 1.0, 60_000.0, "periods are missing"),
    ("process.scan", "kill"): _plain("SIGKILL of the scan process: no set-points, no heartbeat, no record"),
    ("process.desk", "kill"): _plain(
        "SIGKILL of the supervisor: records are not stored, the scan gets no sign of life"
    ),
    ("machine.disk", "full"): _plain("the supervisor can write no byte to any file"),
    ("machine.clock", "step"): Verb("s by which the supervisor's wall clock jumps", -1e9, 1e9, "times of day jump"),
}

NOT_BY_WALL_CLOCK = frozenset({("scan.overrun", "miss")})
"""By the wall clock the period belongs to the controller's process, which the virtual bench cannot hold up."""

ONCE = frozenset({("process.scan", "stop"), ("process.scan", "kill"), ("process.desk", "kill")})
"""Done once and not taken back: `for_ms` says nothing of them."""

BY_STATION = ONCE | {("machine.disk", "full"), ("machine.clock", "step")}
"""Over wires done by the station to its own processes, for no bench can."""

ONLY_OVER_WIRES = (
    BY_STATION
    | {("can.drive.sdo", verb) for verb in ("off", "lie", "abort")}
    | {("can.bus", "errors"), ("can.bus", "babble"), ("clock", "step")}
    | {("modbus.amplifier", verb) for verb in ("jitter", "split", "garbage", "swap")}
    | {(f"modbus.{register}", "freeze") for register in REGISTERS}
)
"""Needs bytes, a set-up, or a process of its own: what virtual time has none of."""


BY_NAME = faults_of_devices({"NAME": ("FIELD",)}, {"NAME": True})
"""The same with NAME and FIELD in place of what a bench file and a profile say: for pages and lists."""


def vocabulary_of(devices: Mapping[str, ModbusProfile], sensors: Mapping[str, bool]) -> dict[tuple[str, str], Verb]:
    """Return all that can be made wrong on a bench with these devices on Modbus and these sensors on CAN, by name."""
    fields = {
        name: [field.name for block in (profile.read, *profile.read_also) for field in block.fields]
        for name, profile in devices.items()
        if name not in DEVICES
    }
    lacking = () if "amplifier" in devices else ("modbus.amplifier",)
    everywhere = {key: row for key, row in FAULTS.items() if not key[0].startswith(lacking)}
    return everywhere | faults_of_devices(fields, sensors)


def only_over_wires(target: str, verb: str) -> bool:
    """Tell whether a fault needs wires; those of single devices do, for virtual time has none of these."""
    return (target, verb) in ONLY_OVER_WIRES or (target, verb) not in FAULTS


def on_the_wire(target: str, verb: str) -> bool:
    """Tell whether a fault acts on the wire alone, so that a gateway can bring it to a bench on a cable."""
    restarts = target.startswith("can.") and target.endswith(".node") and verb == "reset"
    return target.split(".", 1)[0] in ("can", "modbus") and not restarts
