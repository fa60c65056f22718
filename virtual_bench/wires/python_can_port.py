"""The virtual drive on a bus that python-can opens: `can0` opposite a real controller, `vcan0`, or slcan.

Reads whenever the bus's file descriptor is readable, never waiting; buses without a descriptor are not served.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import can

from virtual_bench.config import CanBus

Listener = Callable[[int, bytes], None]


class PythonCanPort:
    """One bus. `on_frame` gets what others send; `send` is the local node's way out."""

    def __init__(self, config: CanBus, on_frame: Listener, log: Callable[[str, str], None]) -> None:
        self._config = config
        self._on_frame = on_frame
        self._log = log
        self._failing = False
        self._bus: can.BusABC | None = None
        self.frames_sent = 0

    @property
    def connected(self) -> bool:
        """Whether frames of others can come."""
        return self._bus is not None

    def flush(self) -> None:
        """Do nothing: frames are written at once."""

    async def start(self) -> None:
        """Open the bus; raises `OSError` when it cannot be had."""
        config = self._config
        try:
            self._bus = can.Bus(interface=config.interface, channel=config.channel, bitrate=config.bitrate)
            descriptor = self._bus.fileno()
        except (can.CanError, NotImplementedError, ValueError) as error:
            raise OSError(f"CAN interface {config.interface}, channel {config.channel}: {error}") from error
        asyncio.get_running_loop().add_reader(descriptor, self._read)

    async def stop(self) -> None:
        """Leave the bus."""
        self.cut()

    def cut(self) -> None:
        """Leave the bus at once: nothing is received or sent any more."""
        if self._bus is not None:
            bus, self._bus = self._bus, None  # what is sent from now on reaches nobody, and a closed bus raises
            asyncio.get_running_loop().remove_reader(bus.fileno())
            bus.shutdown()

    def send(self, cob_id: int, data: bytes) -> None:
        """Put a frame on the bus; a full queue or a bus that is off loses it and is reported once."""
        if self._bus is None:
            return
        try:
            self._bus.send(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))
            self._failing = False
            self.frames_sent += 1
        except (can.CanError, OSError, ValueError) as error:  # ValueError: the bus was closed under it
            if not self._failing:
                self._failing = True
                self._log("can_send_failed", f"{self._config.channel}: {error}")

    def _read(self) -> None:
        if self._bus is None:
            return
        while (message := self._bus.recv(0)) is not None:
            if not (message.is_error_frame or message.is_remote_frame or message.is_extended_id):
                self._on_frame(message.arbitration_id, bytes(message.data))
