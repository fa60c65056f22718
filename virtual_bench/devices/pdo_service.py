"""Process data objects of the virtual drive: their cyclic exchange, by SYNC and by events.

Takes the place of durand's PDO classes, which send a divided SYNC on every SYNC after the first, have no event timer
and move each object through the dictionary by callbacks. Here a PDO is one `struct` and a list of functions, and the
dictionary asks the same functions.
"""

from __future__ import annotations

from collections.abc import Callable

from durand import Node
from durand.services.nmt import StateEnum

from definitions.profiles.drive import ReceivePdo, TransmitPdo
from virtual_bench.devices.pdo_parameters import SYNCHRONOUS, TRANSMIT_COMMUNICATION, Channel, Mappable, PdoParameters

COB_MASK = 0x7FF
LENGTH_SHORT, LENGTH_LONG = 0x8210, 0x8220


class PdoService:
    """The PDOs of one node. `send` puts a frame on the bus, `emcy` reports a wrong length."""

    def __init__(
        self,
        node: Node,
        mappable: dict[tuple[int, int], Mappable],
        send: Callable[[int, int, bytes], None],
        emcy: Callable[[int], None],
    ) -> None:
        self._node = node
        self._send = send
        self._emcy = emcy
        self.receive: dict[int, Channel] = {}  # by COB id, only while valid
        self.transmit: list[Channel] = []
        self._parameters = PdoParameters(node, mappable, self.refresh)

    def restore(self, receive: tuple[ReceivePdo, ...], transmit: tuple[TransmitPdo, ...]) -> None:
        """Set all PDOs to their defaults, as a reset of the communication does."""
        self._parameters.restore(receive, transmit)

    def received(self, channel: Channel, data: bytes) -> None:
        """Take a frame of a receive PDO: at once, or at the next SYNC."""
        if channel.transmission_type <= SYNCHRONOUS:
            channel.buffered = data
        else:
            self._distribute(channel, data)

    def actuate(self) -> None:
        """Let the synchronous receive PDOs act: first half of a SYNC."""
        for channel in self.receive.values():
            if channel.buffered is not None:
                data, channel.buffered = channel.buffered, None
                self._distribute(channel, data)

    def sample(self) -> None:
        """Send the synchronous transmit PDOs that are due: second half of a SYNC."""
        for channel in self.transmit:
            divider = channel.transmission_type
            if divider > SYNCHRONOUS:
                continue
            channel.syncs += 1
            data = self._pack(channel)
            if channel.syncs >= divider if divider else data != channel.sent:
                channel.syncs = 0
                channel.sent = data
                self._send(channel.number, channel.cob_id & COB_MASK, data)

    def tick(self, now_ns: int) -> None:
        """Send the event-driven transmit PDOs that changed or whose event timer ran out."""
        for channel in self.transmit:
            if channel.transmission_type <= SYNCHRONOUS:
                continue
            waited_ns = now_ns - channel.sent_ns
            if channel.sent_ns >= 0 and waited_ns < channel.inhibit_ns:
                continue
            data = self._pack(channel)
            timer_ran_out = channel.event_timer_ns and waited_ns >= channel.event_timer_ns
            if data != channel.sent or timer_ran_out:
                channel.sent, channel.sent_ns = data, now_ns
                self._send(channel.number, channel.cob_id & COB_MASK, data)

    def refresh(self) -> None:
        """Collect the PDOs that are at work in the present NMT state."""
        running = self._node.nmt.state == StateEnum.OPERATIONAL
        self.receive, self.transmit = {}, []
        for index, channel in sorted(self._parameters.channels.items()):
            if not (running and channel.valid):
                continue
            if index >= TRANSMIT_COMMUNICATION:
                self.transmit.append(channel)
            else:
                self.receive[channel.cob_id & COB_MASK] = channel

    def _pack(self, channel: Channel) -> bytes:
        return channel.codec.pack(*[read() for read in channel.readers])

    def _distribute(self, channel: Channel, data: bytes) -> None:
        size = channel.codec.size
        if len(data) < size:
            self._emcy(LENGTH_SHORT)
            return
        if len(data) > size:
            self._emcy(LENGTH_LONG)
        for write, value in zip(channel.writers, channel.codec.unpack_from(data), strict=True):
            write(value)
