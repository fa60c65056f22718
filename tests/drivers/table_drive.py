"""A second CANopen drive that shares no code with the virtual one: the `canopen` package's LocalNode, made of an EDS.

Its CiA 402 machine is a table. Personalities make it one of the drives that are met: objects that can only be read, a
control word that is read every 5 ms, a supervised SYNC, SDO answers after 300 ms, foreign frames, storms of EMCY.
"""

from __future__ import annotations

import io
import logging
import struct
import threading
import time
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import can
import canopen
from canopen.sdo import SdoAbortedError
from eds_drives import Drive, eds_text

from station.bench.eds_profile import NOT_NEEDED

NODE_ID = 5
SYNC, NMT, EMCY, HEARTBEAT_BASE = 0x080, 0x000, 0x080 + NODE_ID, 0x700
HEARTBEAT = HEARTBEAT_BASE + NODE_ID
RESET_COMMUNICATION, PRE_OPERATIONAL, OPERATIONAL = 0x82, 127, 5
READ_ONLY = 0x06010002
SDO_ANSWER = 0x580 + NODE_ID
LETTERS = {0x02: "b", 0x03: "h", 0x04: "i", 0x05: "B", 0x06: "H", 0x07: "I"}


class Step(NamedTuple):
    """A transition: from a state, when (control word & mask) == value, to a state. `edge`: on a rising bit 7."""

    state: str
    mask: int
    value: int
    to: str
    edge: bool = False


STATUS = {"disabled": 0x40, "ready": 0x21, "on": 0x23, "enabled": 0x27, "quick stop": 0x07, "fault": 0x08}
MACHINE = (
    Step("fault", 0x80, 0x80, "disabled", edge=True),
    Step("disabled", 0x87, 0x06, "ready"),
    *(Step(state, 0x82, 0x00, "disabled") for state in ("ready", "on", "enabled", "quick stop")),
    *(Step(state, 0x86, 0x02, "disabled") for state in ("ready", "on")),
    Step("enabled", 0x86, 0x02, "quick stop"),
    Step("ready", 0x87, 0x07, "on"),
    *(Step(state, 0x87, 0x06, "ready") for state in ("on", "enabled")),
    Step("on", 0x8F, 0x0F, "enabled"),
    Step("enabled", 0x8F, 0x07, "on"),
)


@dataclass(frozen=True)
class Personality:
    """How a drive differs from what one would like. `read_only`: objects that hold a value and cannot be written.

    setpoints_watched: whether 0x1400:5 guards synchronous PDOs, or only where a SYNC comes, as of stacks that look at
    them after SYNC alone. heartbeat_watched: whether the drive acts on 0x1016.
    """

    read_only: tuple[tuple[int, int, int], ...] = ()
    sdo_delay_s: float = 0.0
    control_word_every_s: float = 0.0
    supervises_sync: bool = False
    has_bit_12: bool = True
    foreign_frames: int = 0
    emcy_per_sync: int = 0
    heartbeat_watched: bool = True
    setpoints_watched: Literal["always", "with SYNC", "never"] = "always"


class TableDrive:
    """The node on a virtual CAN channel, in a thread of its own."""

    def __init__(self, channel: str, drive: Drive, personality: Personality | None = None) -> None:
        logging.getLogger("canopen").setLevel(logging.CRITICAL)
        self.personality = personality or Personality()
        self.state, self.written = "disabled", set[tuple[int, int]]()
        self.quick_stops = 0
        self._held = {(index, subindex): value for index, subindex, value in self.personality.read_only}
        self._bus = can.Bus(interface="virtual", channel=channel)
        self._network = canopen.Network(self._bus)
        file = io.StringIO(NOT_NEEDED.sub("", eds_text(drive)))
        file.name = "drive.eds"
        self.node = canopen.LocalNode(NODE_ID, canopen.import_od(file, NODE_ID))
        self.node.add_write_callback(self._refuse_read_only)
        self.node.add_read_callback(self._hold)
        self.node.associate_network(self._network)
        self._network.unsubscribe(NMT)
        self._running = False
        self._buffered: dict[int, bytes] = {}
        self._beat_s = self._word_s = self._sync_s = 0.0
        self._setpoint_s = self._controller_s = 0.0
        self._word = 0
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._live, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._stopped.set()
        self._thread.join()
        self._bus.shutdown()

    def value(self, index: int, subindex: int = 0) -> int:
        variable = self.node.object_dictionary.get_variable(index, subindex)
        data = self.node.get_data(index, subindex)
        return int(struct.unpack("<" + LETTERS[variable.data_type], data)[0])

    def count_transfers(self) -> list[int]:
        """Return a list that grows by one with every SDO request."""
        asked: list[int] = []
        self._network.subscribe(0x600 + NODE_ID, lambda *frame: asked.append(frame[0]))
        return asked

    def tell_emergency(self, code: int, register: int = 1) -> None:
        self._send(EMCY, struct.pack("<HB5s", code, register, b""))

    def tell_emergency_when_written(self, index: int, code: int, register: int = 1) -> None:
        def written(*, index: int, **_: Any) -> None:
            if index == place:
                self.tell_emergency(code, register)

        place = index
        self.node.add_write_callback(written)

    def fail(self) -> None:
        self.state = "fault"

    def _hold(self, *, index: int, subindex: int, **_: Any) -> int | None:
        return self._held.get((index, subindex))

    def _refuse_read_only(self, *, index: int, subindex: int, **_: Any) -> None:
        if (index, subindex) in self._held:
            raise SdoAbortedError(READ_ONLY)
        self.written.add((index, subindex))

    def _live(self) -> None:
        while not self._stopped.is_set():
            message = self._bus.recv(0.001)
            now = time.monotonic()
            if message is not None:
                self._take(message, now)
            beat_s = self.value(0x1017) / 1000
            if beat_s and now - self._beat_s >= beat_s:
                self._beat_s = now
                self._send(HEARTBEAT, bytes([OPERATIONAL if self._running else PRE_OPERATIONAL]))
            self._watch_sync(now)
            self._watch_heartbeat(now)
            if self.personality.setpoints_watched == "always":
                self._watch_setpoints(now)

    def _take(self, message: can.Message, now: float) -> None:
        cob_id, data = message.arbitration_id, bytes(message.data)
        if cob_id == NMT and data[1] in (0, NODE_ID):
            self._nmt(data[0])
        elif cob_id == SYNC:
            self._sync(now)
        elif cob_id == 0x600 + NODE_ID:
            time.sleep(self.personality.sdo_delay_s)
            self._network.notify(cob_id, bytearray(data), message.timestamp)
        elif cob_id == HEARTBEAT_BASE + (self._consumed >> 16 & 0x7F):
            self._controller_s = now
        elif self._running:
            for index in range(0x1400, 0x1408):
                if index in self.node.object_dictionary and self.value(index, 1) == cob_id:
                    self._buffered[index] = data
                    self._setpoint_s = now if index == 0x1400 else self._setpoint_s
                    if self.value(index, 2) >= 254:
                        self._actuate(index)

    def _nmt(self, command: int) -> None:
        self._running = command == 1
        if command == RESET_COMMUNICATION:
            self._sync_s = self._setpoint_s = self._controller_s = 0.0
            for index in [place for place in self.node.data_store if 0x1000 <= place < 0x2000]:
                del self.node.data_store[index]
            self._send(HEARTBEAT, b"\x00")

    def _mapped(self, index: int) -> list[tuple[int, int, str]]:
        found = []
        for place in range(1, self.value(index + 0x200, 0) + 1):
            entry = self.value(index + 0x200, place)
            variable = self.node.object_dictionary.get_variable(entry >> 16, entry >> 8 & 0xFF)
            found.append((entry >> 16, entry >> 8 & 0xFF, LETTERS[variable.data_type]))
        return found

    def _actuate(self, index: int) -> None:
        data, mapped = self._buffered.pop(index), self._mapped(index)
        values = struct.unpack("<" + "".join(letter for _, _, letter in mapped), data)
        for (place, subindex, letter), value in zip(mapped, values, strict=True):
            self.node.data_store.setdefault(place, {})[subindex] = struct.pack("<" + letter, value)

    def _sync(self, now: float) -> None:
        if not self._running:
            return
        self._sync_s = now
        if self.personality.setpoints_watched == "with SYNC":
            self._watch_setpoints(now)
        for index in list(self._buffered):
            self._actuate(index)
        if now - self._word_s >= self.personality.control_word_every_s:
            self._word_s = now
            self._step(self.value(0x6040))
        self._show()
        for index in range(0x1800, 0x1808):
            if index in self.node.object_dictionary and not self.value(index, 1) >> 31:
                mapped = self._mapped(index)
                letters = "<" + "".join(letter for _, _, letter in mapped)
                values = [self.value(place, subindex) for place, subindex, _ in mapped]
                self._send(self.value(index, 1) & 0x7FF, struct.pack(letters, *values))
        for number in range(self.personality.foreign_frames):
            self._send(0x280 + 40 + number, b"foreign!")
        for _ in range(self.personality.emcy_per_sync):
            self._send(EMCY, struct.pack("<HB5s", 0x4210, 1, b""))

    def _step(self, word: int) -> None:
        rising = word & 0x80 and not self._word & 0x80
        self._word = word
        for row in MACHINE:
            if row.state == self.state and word & row.mask == row.value and (rising or not row.edge):
                self.state = row.to
                return

    def _show(self) -> None:
        mode = self.value(0x6060)
        follows = self.personality.has_bit_12 and self.state == "enabled" and mode in (9, 10)
        word = STATUS[self.state] | 0x0210 | (0x1000 if follows else 0)
        store = self.node.data_store
        store.setdefault(0x6041, {})[0] = struct.pack("<H", word)
        store.setdefault(0x6061, {})[0] = struct.pack("<b", mode)

    def _watch_sync(self, now: float) -> None:
        """Be a stack that supervises SYNC at one and a half times 0x1006, where that is set."""
        if not (self.personality.supervises_sync and self._running and self._sync_s) or 0x1006 not in self._objects:
            return
        longest_s = 1.5e-6 * self.value(0x1006)
        if longest_s and now - self._sync_s > longest_s and self.state == "enabled":
            self.state = "quick stop"
            self.quick_stops += 1
            self._send(EMCY, struct.pack("<HB5s", 0x8100, 0x10, b""))

    @property
    def _consumed(self) -> int:
        return self.value(0x1016, 1) if 0x1016 in self._objects else 0

    def _watch_heartbeat(self, now: float) -> None:
        """Supervise the controller's heartbeat (0x1016) from its first one on."""
        longest_s = 1e-3 * (self._consumed & 0xFFFF)
        if self.personality.heartbeat_watched and longest_s and now - self._controller_s > longest_s:
            self._lose_controller(self._controller_s, 0x8130)
            self._controller_s = 0.0

    def _watch_setpoints(self, now: float) -> None:
        """Supervise the arrival of set-points (0x1400:5) from the first one on."""
        longest_s = 1e-3 * self.value(0x1400, 5) if 5 in self._objects[0x1400] else 0.0
        if longest_s and now - self._setpoint_s > longest_s:
            self._lose_controller(self._setpoint_s, 0x8250)
            self._setpoint_s = 0.0

    def _lose_controller(self, heard_s: float, code: int) -> None:
        if heard_s and self.state == "enabled":
            self.state = "fault"
            self._show()
            self._send(EMCY, struct.pack("<HB5s", code, 0x10, b""))

    @property
    def _objects(self) -> Any:
        return self.node.object_dictionary

    def _send(self, cob_id: int, data: bytes) -> None:
        self._bus.send(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))
