"""Sensors on CAN before the scan: which they are, what they are set up with, that they send, and by which identifiers.

A CANopen node is asked for its identity, gets the objects that bench file and profile want of it, and is started. What
its frames are named by and hold is set in it once, with its maker's tool, and proven here by what comes.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import can

from definitions.image import NmtState
from drivers.can.bus import CanLink
from drivers.config import CanSensorConfig
from drivers.errors import DriveSetupError, Problem
from drivers.servo_drive.comparison import Compared, compare_objects
from drivers.servo_drive.object_setup import NODE_NEXT, ObjectSetup
from drivers.servo_drive.objects import SetupRow, Treatment, milliseconds, rows_to_start
from drivers.servo_drive.pdo import SYNC_COB_ID
from drivers.servo_drive.sdo import NMT_ENTER_PRE_OPERATIONAL, NMT_START, SdoFailure, SdoNode

SYNC_EVERY_S = 0.01
"""While the first frames are waited for: some sensors send with SYNC only."""

HEARTBEATS_WAITED = 5
"""Heartbeats within which a node that was started must have said that it is operational."""

_PROFILE_NEXT = "check that the profile belongs to this sensor"


def sensor_rows(sensor: CanSensorConfig) -> list[SetupRow]:
    """Return the objects of a sensor that are compared or written; those of its identity come first."""
    rows = []
    if sensor.identity is not None:
        for subindex, number, what in (
            (1, sensor.identity.vendor_id, "vendor id"),
            (2, sensor.identity.product_code, "product code"),
        ):
            rows.append(SetupRow(0x1018, subindex, "u32", number, what, Treatment.CHECK, _PROFILE_NEXT))
    rows += rows_to_start(sensor.startup)
    if sensor.heartbeat_s:
        rows.append(SetupRow(0x1017, 0, "u16", milliseconds(sensor.heartbeat_s), "heartbeat of the sensor (ms)"))
    return rows


def compare_sensor(link: CanLink, sensor: CanSensorConfig) -> list[Compared]:
    """Read every object of a sensor's set-up and compare it; nothing is written, and no command sent."""
    return [] if sensor.node_id is None else compare_objects(_node(link, sensor), sensor_rows(sensor))


def set_up_sensor(link: CanLink, sensor: CanSensorConfig, log: list[str]) -> list[Problem]:
    """Compare a sensor's identity, make it hold its objects, and start it (blocking, bounded).

    Returns what is wrong with it; `log` gets a line for each object that was verified. A sensor that is no CANopen node
    has nothing to be set up.
    """
    if sensor.node_id is None:
        return []
    setup = ObjectSetup(_node(link, sensor), sensor.where, sensor.setup_timeout_s)
    rows = sensor_rows(sensor)
    try:
        if rows:
            setup.node.command(NMT_ENTER_PRE_OPERATIONAL)
            setup.check([row for row in rows if row.treatment is Treatment.CHECK])
            setup.stop_on_problems()
            setup.hold([[row] for row in rows if row.treatment is not Treatment.CHECK])
            setup.stop_on_problems()
        setup.node.command(NMT_START)
        wait_s = HEARTBEATS_WAITED * sensor.heartbeat_s
        if sensor.heartbeat_s and not setup.node.wait_for(NmtState.OPERATIONAL, wait_s):
            found = f"NMT states {sorted(set(setup.node.heard))} heard within {wait_s:g} s"
            expected = "heartbeats with state 5, operational"
            return [Problem("the sensor does not become operational", sensor.where, found, expected, NODE_NEXT)]
    except SdoFailure as failure:  # of an NMT command: the bus itself failed
        setup.find("NMT command not sent", sensor.where, failure.cause, "sent", failure)
        return setup.problems
    except DriveSetupError as error:
        return list(error.problems)
    log += setup.log
    if sensor.heartbeat_s:
        log.append(f"{sensor.where}: started, heartbeat says operational")
    return []


def _node(link: CanLink, sensor: CanSensorConfig) -> SdoNode:
    assert sensor.node_id is not None  # noqa: S101 - the callers have looked
    return SdoNode(link, sensor.node_id, sensor.sdo_reply_timeout_s, sensor.sdo_tries)


def start_sensors(link: CanLink, sensors: Sequence[CanSensorConfig], log: list[str]) -> list[Problem]:
    """Set the sensors up, start them and wait for a frame of each identifier (blocking, bounded).

    SYNC is sent meanwhile. Returns what is not as it must be, does not come or has another length; `log` gets a line
    for each object that was verified and each frame that came.
    """
    if problems := [problem for sensor in sensors for problem in set_up_sensor(link, sensor, log)]:
        return problems
    missing = {frame.identifier: (sensor, frame) for sensor in sensors for frame in sensor.frames}
    until = time.monotonic() + max((sensor.first_frame_timeout_s for sensor in sensors), default=0.0)
    wrong: dict[int, Problem] = {}
    next_sync = 0.0
    while missing and not link.lost and (now := time.monotonic()) < until:
        if now >= next_sync:
            link.send(can.Message(arbitration_id=SYNC_COB_ID, is_extended_id=False, data=b""))
            next_sync = now + SYNC_EVERY_S
        message = link.receive()
        if message is None:
            time.sleep(1e-3)
            continue
        link.keep_emergency(message)
        if message.arbitration_id in missing and not (message.is_error_frame or message.is_extended_id):
            sensor, frame = missing.pop(message.arbitration_id)
            where = f"{sensor.where}, identifier 0x{frame.identifier:03X}"
            if len(message.data) == frame.size:
                log.append(f"{where}: {frame.size} bytes come. That they are this sensor's is not proven")
            else:
                what, expected = "sends frames of another length", f"{frame.size} bytes"
                hint = "correct the profile, or map the sensor's PDO as it says"
                wrong[frame.identifier] = Problem(what, where, f"{len(message.data)} bytes", expected, hint)
    hint = "check power, identifier, bit rate and that the sensor sends by itself or with SYNC"
    silent = [
        Problem("sends nothing", f"{sensor.where}, identifier 0x{frame.identifier:03X}", "silence", "a frame", hint)
        for sensor, frame in missing.values()
    ]
    return [*wrong.values(), *silent]
