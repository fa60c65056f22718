"""A serial cable between two pseudo-terminals, in a thread, which a test can make late, noisy, broken or pull out."""

from __future__ import annotations

import contextlib
import os
import select
import threading
import time
import tty
from collections import deque
from collections.abc import Callable

Pieces = list[tuple[float, bytes]]
"""What becomes of bytes that were sent: delays [s] and the bytes that then arrive."""


def whole(data: bytes) -> Pieces:
    return [(0.0, data)]


class SerialCable:
    """Ends `controller` and `device` are paths of ports; `on_reply` says what becomes of the device's bytes."""

    def __init__(self) -> None:
        self.on_reply: Callable[[bytes], Pieces] = whole
        self.requests: deque[bytes] = deque(maxlen=1000)
        self._masters = []
        self._slaves = []
        for _ in range(2):
            master, slave = os.openpty()
            tty.setraw(slave)
            self._masters.append(master)
            self._slaves.append(slave)
        self.controller, self.device = (os.ttyname(slave) for slave in self._slaves)
        self._wake, self._woken = os.pipe()
        self._ended = False
        self._thread = threading.Thread(target=self._carry, daemon=True)
        self._thread.start()

    def _carry(self) -> None:
        to_controller, to_device = self._masters
        due: list[tuple[float, bytes]] = []
        while not self._ended:
            now = time.monotonic()
            for item in [item for item in due if item[0] <= now]:
                due.remove(item)
                os.write(to_controller, item[1])
            wait_s = max(min((at for at, _ in due), default=now + 1.0) - now, 0.0)
            readable = select.select([to_controller, to_device, self._wake], [], [], wait_s)[0]
            if to_controller in readable:
                data = os.read(to_controller, 4096)
                self.requests.append(data)
                os.write(to_device, data)
            if to_device in readable:
                now = time.monotonic()
                due += [(now + delay, piece) for delay, piece in self.on_reply(os.read(to_device, 4096))]

    def babble(self, data: bytes) -> None:
        """Put bytes on the controller's side that nobody sent."""
        os.write(self._masters[0], data)

    def pull_out(self) -> None:
        """Unplug the controller's adapter: its port is hung up."""
        self.close()

    def close(self) -> None:
        if self._ended:
            return
        self._ended = True
        os.write(self._woken, b".")
        self._thread.join(2)
        for handle in (*self._masters, *self._slaves, self._wake, self._woken):
            with contextlib.suppress(OSError):
                os.close(handle)
