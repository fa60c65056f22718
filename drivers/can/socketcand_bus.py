"""A bus that is served by socketcand: text over TCP, `< frame ID SECONDS HEX >` in, `< send ID LENGTH BYTES >` out.

The scan uses `receive` and `transmit`: one system call each, and none that waits. Before it, SDO and NMT use the same
connection as a bus of python-can (`recv`, `send`). python-can's own client does not fit: it tries to connect for 10 s,
waits for ever for a greeting, takes a frame in the packet of an answer for a wrong answer, and needs a select and two
`setsockopt` for every packet.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import time
from binascii import unhexlify
from collections.abc import Sequence
from functools import cache

import can

from drivers.can.wires import FOREIGN, Frame, PeerClosedError, frame_of, message_of
from drivers.config import CanConfig
from drivers.pace import readable

PIECE = 32 * 1024
"""Bytes that are received at once: at a period of 1 ms more frames than a scan takes, after missed periods as well."""

CHECK_SERVER = "check that host and port are those of the server"

LONGEST_TEXT = 200
"""Bytes without an end after which they are no message of socketcand."""

CLOSE_TIMEOUT_S = 0.3
"""Longest wait for the peer to take the last frames before the connection is closed."""

MANY_BYTES = 4096
_NO_FRAMES = (b"error", b"echo", b"ok", b"hi")


class SocketcandBus(can.BusABC):
    """A connection in raw mode."""

    at_once = True

    def __init__(self, client: socket.socket, channel: str = "", begun: bytes = b"") -> None:
        """Serve a connected socket; `begun` is what has been received of its frames. See `open_socketcand`."""
        self._client = client
        *texts, self._rest = begun.split(b">")
        self._waiting = [_decode(text) for text in texts]
        self._buffer = bytearray(PIECE)
        self._received = memoryview(self._buffer)
        super().__init__(channel=channel)

    def receive(self, most: int) -> list[Frame]:
        """Return frames that have arrived; PeerClosedError at the end of the connection, ValueError for other text."""
        frames, self._waiting = self._waiting, []
        while len(frames) < most:
            try:
                size = self._client.recv_into(self._buffer, PIECE, socket.MSG_DONTWAIT)
            except BlockingIOError:
                break
            if not size:
                if frames:
                    break  # these first: the end is found again
                raise PeerClosedError("the socketcand server closed the connection; check that it is still running")
            *texts, self._rest = (self._rest + self._received[:size]).split(b">")
            frames += map(_decode, texts)
            if self._rest:
                _check_begun(self._rest)
            if size < PIECE:
                break
        return frames

    def transmit(self, frames: Sequence[Frame]) -> None:
        """Send frames, all in one call."""
        self._client.sendall(b"".join([_template(cob_id, len(data)) % tuple(data) for cob_id, data in frames]))

    def finish(self) -> None:
        """End our half of the connection and wait, bounded, for the peer's end.

        Closing with unread frames in the buffer resets the connection. A server that notices this while it sends gives
        the connection up with all it had not yet read: the very frames that take the power away.
        """
        deadline = time.monotonic() + CLOSE_TIMEOUT_S
        with contextlib.suppress(OSError):
            self._client.shutdown(socket.SHUT_WR)
            self._client.settimeout(CLOSE_TIMEOUT_S)
            while self._client.recv(MANY_BYTES) and time.monotonic() < deadline:
                pass

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._waiting:
            if timeout is None or timeout > 0:
                readable(self.fileno(), timeout)
            self._waiting = self.receive(1)
        return (message_of(self._waiting.pop(0)) if self._waiting else None), False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a message; how long that may take is the socket's own bound."""
        del timeout
        self.transmit((frame_of(msg),))

    def fileno(self) -> int:
        """Return the descriptor of the connection."""
        return self._client.fileno()

    def shutdown(self) -> None:
        """Close the connection."""
        super().shutdown()
        self._client.close()


def open_socketcand(config: CanConfig) -> SocketcandBus:
    """Connect and enter raw mode, each step bounded by the connect time-out; OSError or can.CanError."""
    client = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        client.settimeout(config.connect_timeout_s)
        client.connect((config.host, config.port))
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        rest = _take_answer(client, b"", b"< hi >")
        for request in (f"< open {config.channel} >", "< rawmode >"):
            client.sendall(request.encode())
            rest = _take_answer(client, rest, b"< ok >")
        client.settimeout(None)
        seconds, microseconds = divmod(round(config.send_timeout_s * 1e6), 1_000_000)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("ll", seconds, microseconds))
        return SocketcandBus(client, config.channel, rest)
    except BaseException:
        client.close()
        raise


def _take_answer(client: socket.socket, received: bytes, expected: bytes) -> bytes:
    """Take one answer of the server; return what came behind it: frames may follow in the same packet."""
    while b">" not in received and len(received) < LONGEST_TEXT and (piece := client.recv(LONGEST_TEXT)):
        received += piece
    answer, end, rest = received.partition(b">")
    if answer + end != expected:
        found = (answer + end).decode("ascii", "replace")
        raise can.CanInitializationError(
            f"this is no socketcand server: expected {expected.decode()!r}, found {found!r}. Check host and port"
        )
    return rest


@cache
def _template(cob_id: int, size: int) -> bytes:
    """Return the text of a frame with a place for each of its bytes."""
    return b"< send %03X %X %s >" % (cob_id, size, b" ".join([b"%x"] * size))


def _decode(text: bytes) -> Frame:
    """Return the frame in one message without its `>`; ValueError or IndexError for what is none."""
    words = text.split()
    if words[0] == b"<" and words[1] == b"frame" and len(words) >= 4:
        float(words[3])
        data = unhexlify(b"".join(words[4:]))
        return (int(words[2], 16), data) if len(words[2]) == 3 else (FOREIGN, data)
    if words[0] == b"<" and words[1] in _NO_FRAMES:
        return FOREIGN, b""
    raise ValueError(f"{text[:40]!r} is not a message of socketcand; {CHECK_SERVER}")


def _check_begun(rest: bytes) -> None:
    """Refuse what is no beginning of a message."""
    begun = rest.lstrip()
    if (begun and not begun.startswith(b"<")) or len(rest) > LONGEST_TEXT:
        raise ValueError(f"{rest[:40]!r} is not a message of socketcand; {CHECK_SERVER}")
