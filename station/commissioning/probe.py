"""Step `probe`: who answers, what the objects of drive and sensors hold, and what is measured now.

Nothing is written or enabled; sensors on CAN are started by NMT, so that they say something.
"""

from __future__ import annotations

import time
from typing import NamedTuple

from definitions.image import AGE_NEVER, IMAGE_FIELDS, REMOTE_IO_FIELDS, DriveState
from drivers.can.bus import CanLink, open_can
from drivers.can.other_controller import refuse_other_controller
from drivers.can.sensor_setup import compare_sensor
from drivers.config import DriveConfig
from drivers.modbus.device import ModbusDevice
from drivers.servo_drive.cia402 import decode_state
from drivers.servo_drive.comparison import Compared, compare_drive
from drivers.servo_drive.emcy import EmcyText, explain_emcy
from drivers.servo_drive.sdo import SdoFailure, SdoNode
from drivers.servo_drive.units import drive_units
from drivers.servo_drive.unused import missing_on
from station.commissioning.can_looks import CanLooks, values_of
from station.commissioning.on_wires import PERIOD_NS, ByHand, OnWires, pause
from station.documents.commissioning import Figure, Finding

STEP_S = 0.001
REFUSED = ("refused", "no answer")
UNITS = {field.name: field.unit for field in IMAGE_FIELDS}
OLD_POLLS = 5.0
"""A value older than so many polls is not up to date: replies fail, or the device's counter stands still."""

SHOWN = {
    "amplifier": ("torque_in_nm", "torque_out_nm", "angle_in_rad", "angle_out_rad", "sample_counter"),
    "brake": ("brake_on", "brake_current_a"),
    "remote_io": tuple(field.name for field in REMOTE_IO_FIELDS),
}
"""Channels that are shown of each device, where its profile delivers them."""


class Live(NamedTuple):
    """A value as it is now: channel, text, unit, where it comes from, its age in ms (None: was never taken)."""

    channel: str
    value: str
    unit: str
    source: str
    age_ms: float | None


class Probed(NamedTuple):
    """What was found: the drive's objects, live values, what the drive lacks by its profile, and findings."""

    objects: list[Compared]
    live: list[Live]
    missing: list[str]
    findings: tuple[Finding, ...]
    figures: tuple[Figure, ...]


def probe(bench: OnWires, seconds: float) -> Probed:
    """Read everything once, and the Modbus devices for some seconds.

    Raises:
        DriverError: a device does not answer, is another one, or another controller is on the bus.

    """
    wires = bench.wires
    link = open_can(wires.can)
    try:
        refuse_other_controller(link, wires.drive)
        objects = compare_drive(link, wires.drive, PERIOD_NS)
        answers = not any(one.outcome == "no answer" for one in objects)
        missing = missing_on(link, wires.drive) if answers else []
        of_sensors = [(sensor, compare_sensor(link, sensor)) for sensor in wires.can_sensors]
        live = _drive_values(link, bench) if answers else []
        in_fault = drive_fault(link, wires.drive) if answers else []
    finally:
        link.close()
    by_hand, frames = ByHand(wires), CanLooks(wires)
    with by_hand.opened(), frames.opened():
        until = time.monotonic() + seconds
        oldest = dict.fromkeys(by_hand.devices, 0)
        while time.monotonic() < until:
            by_hand.step()
            frames.step()
            for name, device in by_hand.devices.items():
                if device.replies:
                    oldest[name] = max(oldest[name], device.age_scans(by_hand.scan))
            pause(STEP_S)
        for name, device in by_hand.devices.items():
            live += _modbus_values(name, device, by_hand.scan)
        live += _can_values(frames, time.monotonic())
    findings = [
        Finding(
            what=f"Drive, object {one.place} {one.meaning}: found {one.found}, expected {one.wanted}",
            cure=_sentence(one.next_step),
        )
        for one in objects
        if one.outcome in REFUSED
    ]
    findings += in_fault
    for name, device in by_hand.devices.items():
        findings += _of_device(name, device, oldest[name])
    for sensor, rows in of_sensors:
        findings += [
            Finding(
                what=f"{sensor.where}, {one.place} {one.meaning}: found {one.found}, expected {one.wanted}",
                cure=_sentence(one.next_step),
            )
            for one in rows
            if one.outcome in REFUSED
        ]
        objects += [one._replace(place=f"{sensor.name} {one.place}") for one in rows]
    for problem in frames.problems():
        what = f"{problem.where}: {problem.what}: found {problem.found}, expected {problem.expected}"
        findings.append(Finding(what=what, cure=_sentence(problem.next_step)))
    profile = wires.drive.profile.profile.name
    findings += [Finding(what=one.what, cure=one.cure(profile), refuses=False) for one in missing]
    lacking = [f"{one.protection.meaning} ({one.protection.objects})" for one in missing]
    counts = [
        Figure(name=f"objects {one}", value=sum(row.outcome == one for row in objects)) for one in _outcomes(objects)
    ]
    ages = [Figure(name=f"oldest value of {name}", value=age, unit="ms") for name, age in oldest.items()]
    return Probed(objects, live, lacking, tuple(findings), (*counts, *ages))


def _outcomes(objects: list[Compared]) -> list[str]:
    return list(dict.fromkeys(one.outcome for one in objects))


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}." if text else ""


def _drive_values(link: CanLink, bench: OnWires) -> list[Live]:
    """Read what the drive would send in its PDOs, by SDO: it is left in the NMT state in which it is."""
    config = bench.wires.drive
    node, units = SdoNode(link, config.node_id, config.sdo_reply_timeout_s, config.sdo_tries), drive_units(config)
    scales = {
        "actual_torque": (units.torque_nm_per_count, "N·m"),
        "actual_position": (units.angle_rad_per_count, "rad"),
        "actual_velocity": (units.velocity_rad_s_per_count, "rad/s"),
    }
    live = []
    for item in (item for pdo in config.profile.transmit_pdos for item in pdo.objects):
        place = f"drive {item.index:04X}:{item.subindex:02X}"
        try:
            number = node.read(item.index, item.subindex, item.type)
        except SdoFailure as failure:
            live.append(Live(item.name, failure.cause, "", place, None))
            continue
        scale, unit = scales.get(item.name, (1, ""))
        text = f"{number * scale:.5g}"
        if item.name == "statusword":
            text = f"0x{number:04X}, {DriveState(decode_state(number)).name.lower().replace('_', ' ')}"
        live.append(Live(item.name, text, unit, place, 0.0))
    return live


def drive_fault(link: CanLink, config: DriveConfig) -> list[Finding]:
    """Say why a drive is in fault: its emergency message was sent before anybody listened, 0x603F holds the code."""
    node = SdoNode(link, config.node_id, config.sdo_reply_timeout_s, config.sdo_tries)
    try:
        if decode_state(node.read(0x6041, 0, "u16")) is not DriveState.FAULT:
            return []
        code = node.read(0x603F, 0, "u16")
    except SdoFailure:  # its code is optional, and its state stands among the values
        return []
    told = explain_emcy(code) if code else EmcyText("no cause given", "read its error history with the maker's tool")
    what = f"The drive is in fault, error code 0x{code:04X} (0x603F): {told.cause}."
    cure = f"{_sentence(told.next_action)} Then switch the drive off and on, and repeat this step."
    return [Finding(what=what, cure=cure, refuses=False)]


def _modbus_values(name: str, device: ModbusDevice, scan: int) -> list[Live]:
    age = device.age_scans(scan)
    age_ms = None if age == AGE_NEVER else float(age)
    wanted = SHOWN.get(name, tuple(one for one in device.reader.names if one != "identity"))
    names = [channel for channel in wanted if channel in device.reader.names]
    return [
        Live(channel, f"{float(device.values[device.place(channel)]):.6g}", UNITS.get(channel, ""), name, age_ms)
        for channel in names
    ]


def _can_values(frames: CanLooks, now_s: float) -> list[Live]:
    """Return what the sensors on CAN said last, field by field, in the unit that their profile makes."""
    return [
        Live(field, f"{value:.6g}", "", name, (now_s - frames.came_s[name]) * 1e3)
        for name, data in frames.newest.items()
        for field, value in values_of(frames.frames[name], data).items()
    ]


def _of_device(name: str, device: ModbusDevice, oldest: int) -> list[Finding]:
    """Return what is wrong with the answers of a device over the whole look."""
    where, poll_ms = device.config.where, max(device.config.poll_every_s * 1e3, 1.0)
    if device.malformed:
        cure = (
            f"Correct types and word order in profile {device.config.profile.profile.name}: lostmotion bench registers."
        )
        return [Finding(what=f"{where}: {device.malformed} replies hold a value that is not a number.", cure=cure)]
    if not device.replies:
        return [
            Finding(
                what=f"{where}: no reply to the request for its registers.",
                cure="Compare table, address and count in the profile with the device's manual.",
            )
        ]
    allowed_ms = OLD_POLLS * max(poll_ms, device.config.timeout_s * 1e3)
    if oldest > allowed_ms:
        what = f"{name}: values up to {oldest} ms old, at most {allowed_ms:g} ms expected."
        cure = "Check the network, poll_every and timeout; a counter that stands still makes values old too."
        return [Finding(what=what, cure=cure)]
    return []
