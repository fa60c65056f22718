"""What the CANopen nodes of the virtual bench share: durand's view of the bus, and a heartbeat by the bench's time."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from durand import Node
from durand.network import NetworkABC

from virtual_bench.bench_time import BenchTime

HEARTBEAT_COB, HEARTBEAT_TIME = 0x700, (0x1017, 0)

Receiver = Callable[[int, bytes], None]


class NodeNetwork(NetworkABC):  # type: ignore[misc]
    """The bus as durand sees it: subscriptions in a table, frames out through a function."""

    def __init__(self, send: Callable[[int, bytes], None]) -> None:
        self.subscriptions: dict[int, Receiver] = {}
        self._send = send

    def add_subscription(self, cob_id: int, callback: Receiver) -> None:
        """Have a function called with every frame of one identifier."""
        self.subscriptions[cob_id] = callback

    def remove_subscription(self, cob_id: int, callback: Receiver | None = None) -> None:
        """End a subscription; durand names the function in some places and not in others."""
        del callback
        self.subscriptions.pop(cob_id, None)

    def send(self, cob_id: int, msg: bytes) -> None:
        """Put a frame on the bus."""
        self._send(cob_id, bytes(msg))


class Heartbeat:
    """The heartbeat of a node, as often as its 0x1017 says; durand's own would run by the wall clock."""

    def __init__(self, node: Node, time: BenchTime) -> None:
        self._node, self._time = node, time
        self._every_s = 0.0
        self._begun = 0
        written = node.object_dictionary.update_callbacks[HEARTBEAT_TIME]
        written.remove(node.heartbeat_producer._update_interval)  # noqa: SLF001
        written.add(self._take_time)

    def begin(self) -> None:
        """Send heartbeats from now on, the first one with the next piece of time that passes."""
        self._begun += 1
        if self._every_s:
            self._time.after(0.0, partial(self._beat, self._begun))

    def _take_time(self, milliseconds: int) -> None:
        """Take 0x1017: the first heartbeat comes at once."""
        self._every_s = milliseconds * 1e-3
        self._begun += 1
        if milliseconds:
            self._beat(self._begun)

    def _beat(self, begun: int) -> None:
        if begun == self._begun:  # otherwise its time was written anew, and others are on their way
            self._node.network.send(HEARTBEAT_COB + self._node.node_id, bytes([self._node.nmt.state]))
            self._time.after(self._every_s, partial(self._beat, begun))
