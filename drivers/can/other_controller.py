"""Whether somebody else commands the drive: which frames say so, and the listening before the first frame of ours.

Two controllers on one bus would mix their set-points, and our reset would take the drive away from a running test. What
somebody writes into the drive or a sensor by SDO undoes what was read back before the run.
"""

from __future__ import annotations

import time
from collections.abc import Iterable

import can

from definitions.image import DriveState
from drivers.can.bus import CanLink
from drivers.config import DriveConfig
from drivers.errors import DriveSetupError, Problem
from drivers.servo_drive.cia402 import decode_state
from drivers.servo_drive.pdo import (
    HEARTBEAT_BASE,
    NMT_COB_ID,
    SDO_REQUEST_BASE,
    SYNC_COB_ID,
    PdoCodec,
    rpdo_cob_id,
    tpdo_cob_id,
)

_WHAT = "another controller is active on this bus"
_NEXT = "end the other program or disconnect the other controller. If it has just ended, wait for the drive to stop"

_SDO_WRITES = frozenset({0, 1, 6})
"""Client command specifiers of a download: of a segment, of its beginning, of a block (CiA 301)."""


class OurFrames:
    """The frames that only the controller of a drive may send."""

    def __init__(self, config: DriveConfig, sensor_nodes: Iterable[int] = ()) -> None:
        """Prepare their identifiers; `sensor_nodes`: the sensors on the bus that have a node id."""
        self._named = {rpdo_cob_id(pdo, config.node_id): "a set-point" for pdo in config.profile.receive_pdos}
        self._named |= {
            NMT_COB_ID: "an NMT command",
            SYNC_COB_ID: "SYNC",
            HEARTBEAT_BASE + config.controller_node_id: "a heartbeat",
        }
        self._requests = {SDO_REQUEST_BASE + node for node in (config.node_id, *sensor_nodes)}

    def name_of(self, cob_id: int, data: bytes) -> str:
        """Return what a frame is if only we may send it, else ''. Who only reads by SDO commands nobody."""
        if cob_id in self._requests:
            return "an SDO request that writes" if data and data[0] >> 5 in _SDO_WRITES else ""
        return self._named.get(cob_id, "")


def refuse_other_controller(link: CanLink, config: DriveConfig) -> None:
    """Listen for `config.listen_before_reset_s` and send nothing.

    Raises DriveSetupError when a frame comes that only we may send or the drive says that it is enabled, and when the
    bus fails. SYNC may be the drive's own until it is set up.
    """
    ours = OurFrames(config)
    codecs = {
        tpdo_cob_id(pdo, config.node_id): PdoCodec(pdo.objects)
        for pdo in config.profile.transmit_pdos
        if any(item.name == "statusword" for item in pdo.objects)
    }
    deadline = time.monotonic() + config.listen_before_reset_s
    while (left := deadline - time.monotonic()) > 0:
        message = _receive(link, left)
        if message is None or message.is_extended_id or message.is_remote_frame or message.is_error_frame:
            continue
        cob_id = message.arbitration_id
        name = ours.name_of(cob_id, bytes(message.data))
        if name and cob_id != SYNC_COB_ID:
            found = f"{name} 0x{cob_id:03X}, which is ours to send"
            raise DriveSetupError(Problem(_WHAT, link.config.where, found, "a bus without another controller", _NEXT))
        codec = codecs.get(cob_id)
        if codec is not None and len(message.data) == codec.size:
            statusword = codec.unpack(message.data)[codec.names.index("statusword")]
            if decode_state(statusword) is DriveState.OPERATION_ENABLED:
                where = f"{link.config.where} node {config.node_id}"
                found = f"a drive that is enabled (status word 0x{statusword:04X})"
                raise DriveSetupError(Problem(_WHAT, where, found, "a drive without power", _NEXT))


def _receive(link: CanLink, timeout_s: float) -> can.Message | None:
    try:
        return link.bus.recv(timeout_s)
    except (can.CanError, OSError, ValueError, IndexError) as error:
        problem = Problem(
            "listening failed", link.config.where, str(error), "an open bus", "check the CAN interface and its cable"
        )
        raise DriveSetupError(problem) from error
