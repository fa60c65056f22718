"""CAN over a serial adapter (slcan): python-can's bus, made fit for a scan that never waits.

python-can encodes and decodes the frames. Four things of its bus do not fit, and are done here instead:
- it reads byte by byte, two system calls each: here everything that has arrived is read at once;
- every frame that was sent is acknowledged by the adapter, and its `recv(0)` ends at such an acknowledgement although
  frames wait behind it, so that values grow older from scan to scan: here acknowledgements are passed over;
- after every send it waits until the serial port has drained: here a full port is waited for at most the time given;
- an adapter that was pulled out leaves its port open for good: here it is closed whatever happens.
"""

from __future__ import annotations

import contextlib
import os
import select
import time
from collections import deque

from can.exceptions import CanOperationError
from can.interfaces.slcan import slcanBus

from drivers.hung_up import hung_up

ENDS = (0x0D, 0x07)
"""Carriage return ends an answer or a frame; a bell is the adapter's refusal."""

FRAME_LETTERS = b"tTrR"
"""First letters of classical frames; everything else is an answer to a command."""

READ_SIZE = 4096
LONGEST_LINE = 64
"""Bytes; the longest frame has 27. More without an end is no slcan adapter."""

LONGEST_WRITE_S = 1.0
"""Longest wait for a full port before the scan starts, where no time is given."""


class ScanSlcanBus(slcanBus):
    """An slcan bus whose `recv(0)` takes every frame that has arrived and whose `send` is bounded."""

    def __init__(self, channel: str, *, tty_baudrate: int, bitrate: int, settle_s: float) -> None:
        """Open the adapter; `settle_s`: time that it needs after its port was opened, for some restart then.

        Raises can.CanError, OSError or ValueError.
        """
        self.refusals = 0
        """Bells so far: commands or frames that the adapter did not take."""
        self._lines: deque[bytes] = deque()
        self._part = b""
        super().__init__(channel, tty_baudrate=tty_baudrate, bitrate=bitrate, sleep_after_open=settle_s, timeout=0)

    def _write(self, string: str) -> None:
        port = self.serialPortOrig
        data = string.encode() + self.LINE_TERMINATOR
        most_s = LONGEST_WRITE_S if port.write_timeout is None else port.write_timeout
        try:
            descriptor = port.fileno()
            sent = _write_some(descriptor, data)
            while sent < len(data):
                if not select.select([], [descriptor], [], most_s)[1]:
                    raise CanOperationError(
                        "the CAN adapter does not accept frames. Check its bus connection and its status LED"
                    )
                sent += _write_some(descriptor, data[sent:])
        except OSError as error:
            raise CanOperationError(f"the CAN adapter is gone: {error}. Check its USB plug") from error

    def _read(self, timeout: float | None) -> str | None:
        deadline = None if timeout is None else time.monotonic() + timeout
        while True:
            self._gather()
            while self._lines:
                line = self._lines.popleft()
                if line[0] in FRAME_LETTERS:
                    return line.decode("ascii")
                self.refusals += line.endswith(b"\a")
            left = None if deadline is None else deadline - time.monotonic()
            if left is not None and left <= 0:
                return None
            select.select([self.serialPortOrig.fileno()], [], [], left)

    def _gather(self) -> None:
        """Read what has arrived and cut it into lines."""
        if self._lines:
            return
        descriptor = self.serialPortOrig.fileno()
        try:
            arrived = os.read(descriptor, READ_SIZE)
        except BlockingIOError:
            return
        except OSError as error:
            raise CanOperationError(f"the CAN adapter is gone: {error}. Check its USB plug") from error
        if not arrived:
            # A port reads empty both when nothing is there and when it was pulled out.
            if hung_up(descriptor):
                raise CanOperationError("the CAN adapter is gone: its serial port was closed. Check its USB plug")
            return
        start = 0
        text = self._part + arrived
        for at, byte in enumerate(text):
            if byte in ENDS:
                self._lines.append(text[start : at + 1])
                start = at + 1
        self._part = text[start:]
        if len(self._part) > LONGEST_LINE:
            raise CanOperationError(
                f"this is no slcan adapter: its answer {self._part[:16]!r}… is incomplete. Check the serial port in "
                f"the bench file"
            )

    def shutdown(self) -> None:
        """Close the channel and the port, also of an adapter that is gone."""
        try:
            with contextlib.suppress(CanOperationError, OSError, ValueError):
                super().shutdown()
        finally:
            self.serialPortOrig.close()


def _write_some(descriptor: int, data: bytes) -> int:
    try:
        return os.write(descriptor, data)
    except BlockingIOError:
        return 0
