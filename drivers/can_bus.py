"""The CAN bus: opened by python-can, then used by the scan through `CanLink`, which never raises and never waits.

Its slcan bus needs care in four places (`slcan_bus`), its socketcand client in three, which are all here:
- connecting spins for 10 s on a refused port and then waits for ever for a greeting: both are bounded;
- a send is a blocking `sendall`: the kernel bounds it (SO_SNDTIMEO), a peer that stopped reading is a lost bus;
- after the peer closed, `recv` returns None for ever: a silent scan peeks at the socket.

No Notifier: a second thread in this process costs milliseconds of jitter.
"""

from __future__ import annotations

import contextlib
import logging
import socket
import struct
import time
from collections.abc import Iterator

import can
from can.interfaces.socketcand import socketcand

from drivers.config import CanConfig
from drivers.errors import BusError, Problem
from drivers.slcan_bus import ScanSlcanBus

SOCKETCAND_SOCKET = "_SocketCanDaemonBus__socket"
"""The client's private socket; a contract test holds python-can to it."""

CLOSE_TIMEOUT_S = 0.3
"""Longest wait for the peer to take the last frames before the connection is closed."""

_CLOSED_BY_PEER = "the peer closed the connection"
_STREAM_INTERFACES = frozenset({"socketcand", "slcan"})
"""A send that failed half-way leaves these without frame boundaries: nothing more can be sent."""

_NEXT_STEPS = {
    "socketcand": "check that the socketcand server (or the virtual bench) runs and that host, port and channel fit",
    "socketcan": "check `ip -details link show`: the interface must exist, be up and have the bus's bit rate",
    "slcan": "check that the adapter is plugged in, its port name, and that you may open it",
    "virtual": "use a python-can release with the virtual interface",
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
        self._send_timeout_s = config.send_timeout_s if config.interface == "slcan" else None
        self._sendable = True
        self._receivable = True
        self._stream = config.interface in _STREAM_INTERFACES
        self._socket: socket.socket | None = getattr(bus, SOCKETCAND_SOCKET, None)

    def receive(self) -> can.Message | None:
        """Take the next frame that has already arrived, or None."""
        if not self._receivable:
            return None
        try:
            return self.bus.recv(0)
        except (can.CanError, OSError, ValueError, IndexError) as error:
            self._receivable = not self._stream
            self._lose(f"receiving failed: {error}")
            return None

    def check_peer(self) -> None:
        """Notice that a socketcand peer closed the connection; call it in scans that received nothing."""
        if self._socket is None or not self._receivable:
            return
        try:
            if self._socket.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT):
                return
        except BlockingIOError:
            return
        except OSError as error:
            self._receivable = self._sendable = False
            self._lose(f"the connection broke: {error}")
            return
        self._receivable = self._sendable = False
        self._lose(_CLOSED_BY_PEER)

    def send(self, message: can.Message) -> bool:
        """Send one frame; False, and the bus counts as lost, when that failed."""
        if self._sendable:
            try:
                self.bus.send(message, self._send_timeout_s)
            except (can.CanError, OSError, ValueError) as error:
                self._sendable = not self._stream
                self._lose(f"sending failed: {error}")
            else:
                return True
        self.sends_failed += 1
        return False

    def fileno(self) -> int:
        """Return the descriptor that is readable once frames have arrived, for a program that waits for them."""
        return self._socket.fileno() if self._socket is not None else int(self.bus.fileno())

    def close(self) -> None:
        """Close the bus once its last frames are out (at most `CLOSE_TIMEOUT_S`); safe twice and on a broken one."""
        if self._socket is not None and self._sendable:
            _finish_stream(self._socket)
        self._sendable = self._receivable = False
        with contextlib.suppress(can.CanError, OSError):
            self.bus.shutdown()

    def _lose(self, because: str) -> None:
        if not self.lost:
            self.lost = True
            self.lost_because = because


def _finish_stream(client: socket.socket) -> None:
    """End our half of a connection and wait for the peer's end.

    Closing with unread frames in the buffer resets the connection. A server that notices this while it sends gives the
    connection up with all it had not yet read: the very frames that take the power away.
    """
    deadline = time.monotonic() + CLOSE_TIMEOUT_S
    with contextlib.suppress(OSError):
        client.shutdown(socket.SHUT_WR)
        client.settimeout(CLOSE_TIMEOUT_S)
        while client.recv(4096) and time.monotonic() < deadline:
            pass


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
        return _open_socketcand(config)
    if config.interface == "slcan":
        return ScanSlcanBus(
            config.serial_port,
            tty_baudrate=config.serial_baudrate,
            bitrate=config.bitrate,
            settle_s=config.serial_settle_s,
        )
    return can.Bus(interface=config.interface, channel=config.channel)


def _open_socketcand(config: CanConfig) -> can.BusABC:
    with _connecting_within(config.connect_timeout_s):
        bus = can.Bus(interface="socketcand", channel=config.channel, host=config.host, port=config.port, tcp_tune=True)
    client: socket.socket = getattr(bus, SOCKETCAND_SOCKET)
    client.settimeout(None)
    seconds = int(config.send_timeout_s)
    microseconds = int((config.send_timeout_s - seconds) * 1e6)
    client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("ll", seconds, microseconds))
    return bus


@contextlib.contextmanager
def _connecting_within(timeout_s: float) -> Iterator[None]:
    """Make the socketcand client try once, and bound its handshake, while it is being constructed."""

    def connect_once(client: socket.socket, host: str, port: int) -> None:
        client.settimeout(timeout_s)
        try:
            client.connect((host, port))
        except OSError:
            client.close()
            raise

    original = socketcand.connect_to_server
    socketcand.connect_to_server = connect_once
    try:
        yield
    finally:
        socketcand.connect_to_server = original
