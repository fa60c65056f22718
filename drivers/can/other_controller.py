"""Whether somebody else already commands the drive: listened for before the first frame of ours is sent.

Two controllers on one bus would mix their set-points, and our reset would take the drive away from a running test.
"""

from __future__ import annotations

import time

import can

from definitions.image import DriveState
from drivers.can.bus import CanLink
from drivers.config import DriveConfig
from drivers.errors import DriveSetupError, Problem
from drivers.servo_drive.cia402 import decode_state
from drivers.servo_drive.pdo import HEARTBEAT_BASE, PdoCodec, tpdo_cob_id

_WHAT = "another controller is active on this bus"
_NEXT = "end the other program or disconnect the other controller. If it has just ended, wait for the drive to stop"


def refuse_other_controller(link: CanLink, config: DriveConfig) -> None:
    """Listen for `config.listen_before_reset_s` and send nothing.

    Raises DriveSetupError when a heartbeat with our own node id comes or the drive says that it is enabled, and when
    the bus fails.
    """
    heartbeat = HEARTBEAT_BASE + config.controller_node_id
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
        if cob_id == heartbeat:
            where = f"{link.config.where} node {config.controller_node_id}"
            found = f"a heartbeat 0x{cob_id:03X}, which is ours to send"
            raise DriveSetupError(Problem(_WHAT, where, found, "no heartbeat of this node", _NEXT))
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
