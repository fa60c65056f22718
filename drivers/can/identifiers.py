"""Identifiers on a CAN bus: who has which, before anything is opened."""

from __future__ import annotations

from collections.abc import Iterable

from definitions.profiles.drive import DriveProfile
from drivers.config import CanSensorConfig
from drivers.errors import Problem
from drivers.servo_drive.pdo import (
    EMCY_BASE,
    HEARTBEAT_BASE,
    SDO_ANSWER_BASE,
    SDO_REQUEST_BASE,
    SYNC_COB_ID,
    rpdo_cob_id,
    tpdo_cob_id,
)


def identifier_problems(
    sensors: Iterable[CanSensorConfig], profile: DriveProfile, node_id: int, controller_node_id: int
) -> list[Problem]:
    """Return the identifiers of sensors that somebody else on the bus has: two senders of one destroy each other."""
    taken = {
        0x000: "NMT",
        SYNC_COB_ID: "SYNC",
        EMCY_BASE + node_id: "emergencies of the drive",
        HEARTBEAT_BASE + node_id: "heartbeat of the drive",
        HEARTBEAT_BASE + controller_node_id: "heartbeat of the controller",
        SDO_ANSWER_BASE + node_id: "SDO of the drive",
        SDO_REQUEST_BASE + node_id: "SDO of the drive",
    }
    taken |= {tpdo_cob_id(pdo, node_id): f"TPDO {pdo.number} of the drive" for pdo in profile.transmit_pdos}
    taken |= {rpdo_cob_id(pdo, node_id): f"RPDO {pdo.number} of the drive" for pdo in profile.receive_pdos}
    problems = []
    for sensor in sensors:
        if sensor.node_id in (node_id, controller_node_id):
            owner = "the drive" if sensor.node_id == node_id else "the controller"
            hint = "give each node on the bus another id"
            problems.append(Problem("uses a node id that is taken", sensor.where, owner, "a free one", hint))
        for frame in sensor.frames:
            if frame.identifier in taken:
                where = f"{sensor.where}, identifier 0x{frame.identifier:03X}"
                hint = "give the sensor another identifier, or another node id"
                owner = taken[frame.identifier]
                problems.append(Problem("uses an identifier that is taken", where, owner, "a free one", hint))
            taken.setdefault(frame.identifier, sensor.where)
    return problems
