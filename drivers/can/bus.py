"""The CAN bus: opened as a bus of python-can, then used by the scan through `CanLink`, which never raises or waits.

What one look at the bus and one send cost in the scan is the business of `can_wires`. Two buses are ours, for
python-can's need too much care: `socketcand_bus` and `slcan_bus`.

No Notifier: a second thread in this process costs milliseconds of jitter.
"""

from __future__ import annotations

import contextlib
import logging
import socket
from collections import deque
from collections.abc import Sequence

import can

from drivers.can.serial_bus import ScanSlcanBus
from drivers.can.socketcand_bus import SocketcandBus, open_socketcand
from drivers.can.wires import Frame, PeerClosedError, PythonCanWire, SocketcanWire, Wire, frame_of, message_of
from drivers.config import CanConfig
from drivers.errors import BusError, Problem
from drivers.pace import LONGEST_WAIT_S, readable
from drivers.servo_drive.pdo import EMCY_BASE

MANY = 1000
"""More frames than a scan leaves."""

SETTLE_S = 0.02
"""Silence after which nothing is on its way any more from a bench that waits."""

EMERGENCIES_KEPT = 32
"""Newest emergency messages of a node that are kept before the scan."""

_LARGEST_NODE_ID = 127
_STREAM_INTERFACES = frozenset({"socketcand", "slcan"})
"""A send that failed half-way leaves these without frame boundaries: nothing more can be sent."""

_NEXT_STEPS = {
    "socketcand": "check that the socketcand server or virtual bench runs at host, port and channel of the bench file",
    "socketcan": "check `ip -details link show`: the interface must exist, be up and have the bus's bit rate",
    "slcan": "check the adapter's plug, its port name, and your permission to open the port",
    "virtual": "install a release of python-can that has the interface 'virtual'",
}


class CanLink:
    """One open CAN bus for the scan.

    `lost` latches at the first failure and stays until the bus is opened anew. On SocketCAN frames are still tried
    after a failed send, because a full transmit queue may empty again and the drive should get its quick stop.
    """

    def __init__(self, bus: can.BusABC, config: CanConfig) -> None:
        self.bus = bus
        self.config = config
        self.lost = False
        self.lost_because = ""
        self.sends_failed = 0
        self.frames_sent = 0
        self.frames_received = 0
        self.frames_due = 0
        """Frames that a bench which waits for the scan says it has sent: they are on their way at least."""
        self.early: dict[int, deque[bytes]] = {}
        """Emergency messages that came while nodes were set up, by their identifiers, for who takes them in the scan.
        """
        self._sendable = True
        self._receivable = True
        self._stream = config.interface in _STREAM_INTERFACES
        self._wire = _wire_of(bus, config)
        self._arrived: list[Frame] = []

    def take(self, most: int) -> list[Frame]:
        """Take the oldest frames that have arrived, at most `most` of them; for what is due wait, bounded."""
        self._look(most)
        while self.frames_received < self.frames_due and self._receivable and len(self._arrived) <= most:
            if not readable(self.fileno(), LONGEST_WAIT_S):
                self.frames_due = self.frames_received
            self._look(most)
        frames = self._arrived
        self._arrived = frames[most:]
        return frames[:most] if self._arrived else frames

    def _look(self, most: int) -> None:
        wanted = most + 1 - len(self._arrived)
        if wanted <= 0 or not self._receivable:
            return
        try:
            frames = self._wire.receive(wanted)
        except PeerClosedError as error:
            self._receivable = self._sendable = False
            self._lose(str(error))
        except (can.CanError, OSError, ValueError, IndexError) as error:
            self._receivable = not self._stream
            self._lose(f"receiving failed: {error}")
        else:
            self.frames_received += len(frames)
            self._arrived = self._arrived + frames if self._arrived else frames

    @property
    def frames_wait(self) -> bool:
        """Whether frames are known to have arrived that were not taken."""
        return bool(self._arrived)

    def receive(self) -> can.Message | None:
        """Take the next frame that has already arrived, or None."""
        frames = self.take(1)
        return message_of(frames[0]) if frames else None

    def keep_emergency(self, message: can.Message) -> None:
        """Keep a message that came before the scan if it is an emergency message: its node says it only once."""
        cob_id, data = frame_of(message)
        if EMCY_BASE < cob_id <= EMCY_BASE + _LARGEST_NODE_ID:
            self.early.setdefault(cob_id, deque(maxlen=EMERGENCIES_KEPT)).append(data)

    def count_from_now(self) -> None:
        """Take and forget what is on its way, until nothing comes any more, and count frames from here (blocking)."""
        self._look(MANY)  # what python-can has received, although nothing is on its way
        while self._receivable and readable(self.fileno(), SETTLE_S):
            self._arrived.clear()
            self._look(MANY)
        self._arrived.clear()
        self.frames_sent = self.frames_received = self.frames_due = 0

    def send(self, message: can.Message) -> bool:
        """Send one frame; False, and the bus counts as lost, when that failed."""
        return self.send_frames(((message.arbitration_id, bytes(message.data)),))

    def send_frames(self, frames: Sequence[Frame]) -> bool:
        """Send the frames of a scan; False, and the bus counts as lost, when one failed.

        Where they go out one by one each is tried, because a full transmit queue may empty again.
        """
        if self._wire.at_once:
            return self._send(frames)
        sent = True
        for frame in frames:
            sent &= self._send((frame,))
        return sent

    def _send(self, frames: Sequence[Frame]) -> bool:
        if self._sendable:
            try:
                self._wire.transmit(frames)
            except (can.CanError, OSError, ValueError) as error:
                self._sendable = not self._stream
                self._lose(f"sending failed: {error}")
            else:
                self.frames_sent += len(frames)
                return True
        self.sends_failed += len(frames)
        return False

    def fileno(self) -> int:
        """Return the descriptor that is readable once frames have arrived, for a program that waits for them."""
        return int(self.bus.fileno())

    def close(self) -> None:
        """Close the bus once its last frames are out (bounded); safe twice and on a broken one."""
        if self._sendable:
            self._wire.finish()
        self._sendable = self._receivable = False
        with contextlib.suppress(can.CanError, OSError):
            self.bus.shutdown()

    def _lose(self, because: str) -> None:
        if not self.lost:
            self.lost = True
            self.lost_because = because


def _wire_of(bus: can.BusABC, config: CanConfig) -> Wire:
    """Return how the scan uses an open bus."""
    if isinstance(bus, SocketcandBus):
        return bus
    raw = getattr(bus, "socket", None)
    if config.interface == "socketcan" and isinstance(raw, socket.socket):
        return SocketcanWire(raw)
    return PythonCanWire(bus, config.send_timeout_s if config.interface == "slcan" else None)


def open_can(config: CanConfig) -> CanLink:
    """Open the bus (blocking, bounded by the connect time-out).

    Raises BusError with what to check next.
    """
    logging.getLogger("can").setLevel(logging.CRITICAL)  # its warnings would be formatted inside the scan
    try:
        bus = _open_bus(config)
    except (can.CanError, OSError, ValueError, ImportError, AttributeError) as error:
        raise BusError(
            Problem(
                "the CAN bus cannot be opened",
                config.where,
                str(error) or type(error).__name__,
                "an open bus",
                _NEXT_STEPS[config.interface],
            )
        ) from error
    return CanLink(bus, config)


def _open_bus(config: CanConfig) -> can.BusABC:
    if config.interface == "socketcand":
        return open_socketcand(config)
    if config.interface == "slcan":
        return ScanSlcanBus(
            config.serial_port,
            tty_baudrate=config.serial_baudrate,
            bitrate=config.bitrate,
            settle_s=config.serial_settle_s,
        )
    # A file or variable of python-can's own could add options, as that our own frames come back to us.
    return can.Bus(interface=config.interface, channel=config.channel, ignore_config=True)
