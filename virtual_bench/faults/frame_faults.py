"""What faults make of CAN frames, one place for both: the virtual bench's own wire and the gateway on a cable's.

A frame is named by its identifier and goes through `pass_on`, which returns what arrives and how much later. Only bytes
are known here: no sockets, no clock.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from virtual_bench.faults.schedule import LOST, FaultSchedule

NMT_COB, SYNC_COB = 0x000, 0x080
EMCY_BASE, TPDO1_BASE, TPDO2_BASE, RPDO1_BASE = 0x080, 0x180, 0x280, 0x200
SDO_ANSWER_BASE, SDO_REQUEST_BASE, HEARTBEAT_BASE = 0x580, 0x600, 0x700
FOREIGN_COB = 0x7E5
"""Identifier of the frames of a node that babbles: nobody of ours listens to it."""

RESET_NODE = 0x81
SDO_DOWNLOAD, SDO_DOWNLOADED, SDO_ABORT = 1, 0x60, 0x80
BUS = "can.bus"
SDO = "can.drive.sdo"


class Frame(NamedTuple):
    """A frame that arrives `delay_ns` later; one `of_another` node is for the controller, wherever it was added."""

    delay_ns: int
    cob_id: int
    data: bytes
    of_another: bool = False


class FrameFaults:
    """Applies the active faults of a schedule to frames."""

    def __init__(self, schedule: FaultSchedule, node_id: int, controller_node_id: int) -> None:
        self._schedule = schedule
        self._node_id = node_id
        self._targets = {
            SYNC_COB: "can.sync",
            RPDO1_BASE + node_id: "can.setpoint",
            HEARTBEAT_BASE + controller_node_id: "can.controller.heartbeat",
            TPDO1_BASE + node_id: "can.drive.tpdo1",
            TPDO2_BASE + node_id: "can.drive.tpdo2",
            HEARTBEAT_BASE + node_id: "can.drive.heartbeat",
            EMCY_BASE + node_id: "can.drive.emcy",
            SDO_ANSWER_BASE + node_id: SDO,
        }
        self._nodes: set[str] = set()  # of sensors that have started anew
        self._held: dict[int, bytes] = {}  # of reordered frames, by identifier
        self._last: dict[int, bytes] = {}  # of stuck frames, by identifier

    def add_sensor(self, name: str, identifiers: Iterable[int], node_id: int | None) -> None:
        """Let the frames of a sensor on CAN be targets, by its name."""
        self._targets |= dict.fromkeys(identifiers, f"can.{name}")
        if node_id is not None:
            self._targets[HEARTBEAT_BASE + node_id] = f"can.{name}.heartbeat"

    def takes_reset(self, name: str) -> bool:
        """Tell, once, that a sensor starts anew."""
        target = f"can.{name}.node"
        if self._schedule.value(target, "reset") is None or name in self._nodes:
            return False
        self._nodes.add(name)
        self._schedule.seen(target)
        return True

    def fate(self, target: str) -> int:
        """Return what becomes of a frame whose bytes nobody changes: `LOST`, or the delay in ns."""
        schedule = self._schedule
        if target not in schedule.targets and BUS not in schedule.targets:
            return 0
        if schedule.value(BUS, "off") is not None or schedule.value(BUS, "cut") is not None:
            schedule.seen(BUS)
            return LOST
        for verb in ("off", "drop", "drop_next", "delay", "jitter"):
            value = schedule.value(target, verb)
            if value is None:
                continue
            if verb == "drop" and schedule.dice.random() >= value:
                continue
            if verb == "drop_next" and not schedule.count_down((target, verb), value):
                continue
            schedule.seen(target)
            if verb == "jitter":
                value *= schedule.dice.random()
            return round(value * 1e6) if verb in ("delay", "jitter") else LOST
        return 0

    def pass_on(self, cob_id: int, data: bytes) -> list[Frame]:
        """Return what arrives of a frame."""
        schedule = self._schedule
        target = self._targets.get(cob_id, "")
        if target not in schedule.targets and BUS not in schedule.targets:
            return [Frame(0, cob_id, data)]
        delay_ns = self.fate(target)
        if delay_ns == LOST:
            return []
        if target:
            data = self._changed(target, cob_id, data)
        frames = [Frame(delay_ns, cob_id, data)]
        if target and schedule.value(target, "duplicate") is not None:
            schedule.seen(target)
            frames *= 2
        if target and schedule.value(target, "reorder") is not None:
            held = self._held.pop(cob_id, None)
            if held is None:
                self._held[cob_id] = data
                return []
            schedule.seen(target)
            frames = [Frame(delay_ns, cob_id, data), Frame(delay_ns, cob_id, held)]
        if cob_id == SYNC_COB:
            frames += self._of_others()
        return frames

    def _of_others(self) -> list[Frame]:
        """Return what others on the bus send with each SYNC."""
        schedule = self._schedule
        babble, commands = schedule.value(BUS, "babble"), schedule.value(BUS, "command")
        frames = [Frame(0, FOREIGN_COB, bytes(8), of_another=True)] * round(babble or 0)
        if commands is not None:
            frames.append(Frame(0, RPDO1_BASE + self._node_id, bytes(8), of_another=True))
        if frames:
            schedule.seen(BUS)
        return frames

    def _changed(self, target: str, cob_id: int, data: bytes) -> bytes:
        schedule = self._schedule
        if schedule.value(target, "stuck") is not None:
            kept = self._last.setdefault(cob_id, data)
            if kept != data:
                schedule.seen(target)
            return kept
        truncated = schedule.value(target, "truncate")
        if truncated is not None and data:
            schedule.seen(target)
            return data[: -max(round(truncated), 1)]
        if schedule.value(target, "corrupt") is not None and data:
            schedule.seen(target)
            return bytes(byte ^ schedule.dice.randrange(256) for byte in data)
        return data

    def answered(self, cob_id: int, data: bytes) -> bytes | None:
        """Return what a faulty drive answers to a frame that it then ignores; None when it takes the frame.

        It accepts a write and keeps the old value, or aborts it.
        """
        schedule = self._schedule
        if not schedule.active or cob_id != SDO_REQUEST_BASE + self._node_id or len(data) != 8:
            return None
        lies, aborts = schedule.value(SDO, "lie"), schedule.value(SDO, "abort")
        index = data[1] | data[2] << 8
        if data[0] >> 5 != SDO_DOWNLOAD:
            return None
        if lies is not None and index == round(lies):
            schedule.seen(SDO)
            return bytes([SDO_DOWNLOADED]) + data[1:4] + bytes(4)
        if aborts is not None:
            schedule.seen(SDO)
            return bytes([SDO_ABORT]) + data[1:4] + round(aborts).to_bytes(4, "little")
        return None

    def answer_id(self) -> int:
        """Return the identifier of what `answered` returns."""
        return SDO_ANSWER_BASE + self._node_id

    def port_is_cut(self) -> bool:
        """Tell whether the connection of the bus is gone."""
        if self._schedule.value(BUS, "cut") is None:
            return False
        self._schedule.seen(BUS)
        return True

    def error_frames(self) -> int:
        """Return how many error frames go before the next frame."""
        errors = self._schedule.value(BUS, "errors") if self._schedule.active else None
        if errors is None:
            return 0
        self._schedule.seen(BUS)
        return round(errors)
