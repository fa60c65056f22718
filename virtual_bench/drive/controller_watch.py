"""The virtual drive's watch over its controller: heartbeats of nodes (0x1016) and set-points (0x1400:5) in time.

It only tells what is missing; what the drive does about it is the machine's business.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from virtual_bench.drive import cia402_tables as tables
from virtual_bench.drive.settings import DriveObjects

NEVER_NS = 1 << 63


class Loss(NamedTuple):
    """Something that did not come in time."""

    code: int  # error code of its EMCY
    text: str


class ControllerWatch:
    """Time-outs of a controller. Each loss is told once; supervision starts again with the next one that arrives.

    `on_start` is called with the time when the supervision of a node starts, first or again.
    """

    def __init__(self, objects: DriveObjects, on_start: Callable[[int], None]) -> None:
        self._objects = objects
        self._on_start = on_start
        self._timeouts_ns: dict[int, int] = {}  # by node
        self._due_ns: dict[int, int] = {}  # node -> last moment for its next heartbeat; never: not heard yet
        self._look_ns = NEVER_NS  # never after the first that is due; moved on when it has come
        self._setpoint_ns: int | None = None

    def consume_heartbeats_of(self, node_id: int, timeout_ms: int) -> None:
        """Supervise a node's heartbeat (0x1016); 0 ms ends it. Supervision starts with the first heartbeat."""
        if timeout_ms:
            self._timeouts_ns[node_id] = timeout_ms * 1_000_000
            self._due_ns[node_id] = NEVER_NS
        else:
            self._timeouts_ns.pop(node_id, None)
            self._due_ns.pop(node_id, None)

    def heartbeat(self, node_id: int, now_ns: int) -> None:
        """Note a heartbeat of another node."""
        if node_id in self._due_ns:
            starts = self._due_ns[node_id] == NEVER_NS
            self._due_ns[node_id] = due_ns = now_ns + self._timeouts_ns[node_id]
            if due_ns < self._look_ns:  # noqa: PLR1730 - a call of min takes three times as long
                self._look_ns = due_ns
            if starts:
                self._on_start(now_ns)

    def setpoint_received(self, now_ns: int) -> None:
        """Note that the supervised receive PDO arrived."""
        self._setpoint_ns = now_ns

    def setpoints_ended(self) -> None:
        """Wait for no set-point until the next one has come."""
        self._setpoint_ns = None

    def excuse_silence(self, standstill_ns: int) -> None:
        """Let time pass in which nobody could be heard: time-outs of set-points and heartbeats end so much later."""
        if self._setpoint_ns is not None:
            self._setpoint_ns += standstill_ns
        for node_id, due_ns in self._due_ns.items():
            if due_ns != NEVER_NS:
                self._due_ns[node_id] = due_ns + standstill_ns

    def losses(self, now_ns: int) -> tuple[Loss, ...]:
        """What has been missing for too long at `now_ns`: at most one node's heartbeat, and the set-points."""
        losses = self._silent_node(now_ns) if now_ns > self._look_ns else ()
        timeout_ms, setpoint_ns = self._objects.setpoint_timeout_ms, self._setpoint_ns
        if timeout_ms and setpoint_ns is not None and now_ns - setpoint_ns > timeout_ms * 1_000_000:
            self._setpoint_ns = None
            losses += (Loss(tables.SETPOINT_TIMEOUT, f"no set-point for {timeout_ms} ms (0x1400:5)"),)
        return losses

    def _silent_node(self, now_ns: int) -> tuple[Loss, ...]:
        losses: tuple[Loss, ...] = ()
        for node_id, due_ns in self._due_ns.items():
            if now_ns > due_ns:
                self._due_ns[node_id] = NEVER_NS
                text = f"heartbeat of node {node_id} missing for {self._timeouts_ns[node_id] // 1_000_000} ms (0x1016)"
                losses = (Loss(tables.HEARTBEAT_LOST, text),)
                break
        self._look_ns = min(self._due_ns.values(), default=NEVER_NS)
        return losses
