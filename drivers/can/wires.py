"""How the scan receives and sends CAN frames: one system call each way where the bus allows it, and none that waits.

A bus is opened as one of python-can and serves SDO and NMT as such until the scan starts. In the scan python-can would
cost a select for every receive, so the frames of SocketCAN are read and written here, on the same socket. The text of
socketcand is the business of `socketcand_bus`; any other interface is left to python-can.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Sequence
from typing import Protocol

import can

Frame = tuple[int, bytes]
"""Identifier and data of a frame."""

FOREIGN = -1
"""Identifier of what is no classical data frame with 11 bits: error frames, remote frames, 29 bits."""


class PeerClosedError(OSError):
    """The other side closed the connection."""


class Wire(Protocol):
    """What `CanLink` needs of a bus. Both calls raise can.CanError, OSError, ValueError or IndexError."""

    at_once: bool
    """Whether all frames of a scan go out together: then a failure leaves nothing of the rest to be tried."""

    def receive(self, most: int) -> list[Frame]:
        """Return frames that have arrived, about `most` of them; none is left where fewer come."""

    def transmit(self, frames: Sequence[Frame]) -> None:
        """Send frames."""

    def finish(self) -> None:
        """Wait, bounded, until the last frames are out, where closing would lose them."""


class PythonCanWire:
    """A bus as python-can serves it, frame by frame."""

    at_once = False

    def __init__(self, bus: can.BusABC, send_timeout_s: float | None) -> None:
        self._bus = bus
        self._send_timeout_s = send_timeout_s

    def receive(self, most: int) -> list[Frame]:
        """Return frames that have arrived."""
        frames: list[Frame] = []
        while len(frames) < most and (message := self._bus.recv(0)) is not None:
            frames.append(frame_of(message))
        return frames

    def transmit(self, frames: Sequence[Frame]) -> None:
        """Send frames."""
        for cob_id, data in frames:
            self._bus.send(message_of((cob_id, data)), self._send_timeout_s)

    def finish(self) -> None:
        """Do nothing: what was sent is out, or was refused."""


CAN_FRAME = struct.Struct("=IB3x8s")
"""Identifier with flags, length, data: `struct can_frame` of linux/can.h."""

NO_DATA_FRAME = 0x8000_0000 | 0x4000_0000 | 0x2000_0000
"""Flags of 29 bits, of a remote frame and of an error frame."""


class SocketcanWire:
    """The raw socket of a SocketCAN interface: one frame a call, as the kernel has it."""

    at_once = False

    def __init__(self, raw: socket.socket) -> None:
        self._raw = raw

    def receive(self, most: int) -> list[Frame]:
        """Return frames that have arrived."""
        frames: list[Frame] = []
        while len(frames) < most:
            try:
                received = self._raw.recv(CAN_FRAME.size, socket.MSG_DONTWAIT)
            except BlockingIOError:
                break
            cob_id, size, data = CAN_FRAME.unpack(received)
            frames.append((FOREIGN if cob_id & NO_DATA_FRAME else cob_id, data[:size]))
        return frames

    def transmit(self, frames: Sequence[Frame]) -> None:
        """Send frames; OSError when the kernel's queue is full."""
        for cob_id, data in frames:
            self._raw.send(CAN_FRAME.pack(cob_id, len(data), data), socket.MSG_DONTWAIT)

    def finish(self) -> None:
        """Do nothing: the kernel has them."""


def frame_of(message: can.Message) -> Frame:
    """Return the frame in a message of python-can."""
    plain = not (message.is_extended_id or message.is_remote_frame or message.is_error_frame)
    return (message.arbitration_id if plain else FOREIGN), bytes(message.data)


def message_of(frame: Frame) -> can.Message:
    """Return a frame as a message of python-can; what is foreign as an error frame, which nobody takes for data."""
    cob_id, data = frame
    if cob_id == FOREIGN:
        return can.Message(arbitration_id=0, is_extended_id=True, is_error_frame=True)
    return can.Message(arbitration_id=cob_id, is_extended_id=False, data=data)
