"""Sensors on the CAN bus of the virtual bench: they send frames in their own time, or with every SYNC.

A CANopen node among them has an object dictionary, which durand serves, says its state where 0x1017 asks for that, and
sends no values until NMT has started it. What its frames hold is told by data: fields, and the channel that each shows.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from functools import partial

from durand import Node
from durand.datatypes import DatatypeEnum
from durand.node import NodeCapabilities
from durand.object_dictionary import ObjectDictionary, Record, Variable
from durand.services.nmt import StateEnum

from definitions.number_formats import IntegerType
from definitions.profiles.can import CanField, CanFrame
from definitions.profiles.drive import StartupObject
from virtual_bench.bench_time import BenchTime
from virtual_bench.config import CanSensorPort
from virtual_bench.devices.canopen_node import Heartbeat, NodeNetwork

SYNC_COB = 0x080

DATA_TYPES: Mapping[IntegerType, DatatypeEnum] = {
    "u8": DatatypeEnum.UNSIGNED8,
    "i8": DatatypeEnum.INTEGER8,
    "u16": DatatypeEnum.UNSIGNED16,
    "i16": DatatypeEnum.INTEGER16,
    "u32": DatatypeEnum.UNSIGNED32,
    "i32": DatatypeEnum.INTEGER32,
}


class CanSensor:
    """One sensor. Advance the plant before every call."""

    def __init__(
        self,
        config: CanSensorPort,
        read: Callable[[], Mapping[str, float]],
        send: Callable[[int, bytes], None],
        time: BenchTime,
    ) -> None:
        self._config, self._read, self._send, self._time = config, read, send, time
        self.name = config.name
        self._begun = 0
        self._node: Node | None = None
        self._heartbeat: Heartbeat | None = None
        if config.node_id is not None:
            self._network = NodeNetwork(send)
            self._node = Node(self._network, config.node_id, capabilities=NodeCapabilities(1, 0, 0))
            self._heartbeat = Heartbeat(self._node, time)
            self._add_objects(self._node.object_dictionary)
            self._node.nmt.set_state(StateEnum.PRE_OPERATIONAL)

    def _add_objects(self, dictionary: ObjectDictionary) -> None:
        identity = self._config.identity
        for subindex, number in enumerate((identity.vendor_id, identity.product_code) if identity else (), start=1):
            dictionary[0x1018][subindex].value = number
        for row in self._config.startup:
            _add_object(dictionary, row)

    def reset(self) -> None:
        """Start anew, as after a failure of its supply: what was set in it is gone, and it waits to be started."""
        if self._node is not None:
            self._node.nmt.reset()
            for index, subindex in ((0x1017, 0), *((row.index, row.subindex) for row in self._config.startup)):
                self._node.object_dictionary.write(index, subindex, 0)

    @property
    def _operational(self) -> bool:
        return self._node is None or self._node.nmt.state == StateEnum.OPERATIONAL

    def receive(self, cob_id: int, data: bytes) -> None:
        """Take a frame from the bus: SYNC means something to it, and to a node NMT and SDO."""
        if cob_id == SYNC_COB and self._config.every_s is None:
            self._send_frames()
        elif self._node is not None:
            receiver = self._network.subscriptions.get(cob_id)
            if receiver is not None:
                receiver(cob_id, data)

    def begin(self) -> None:
        """Send from now on, the first time with the next piece of time that passes."""
        self._begun += 1
        if self._heartbeat is not None:
            self._heartbeat.begin()
        if self._config.every_s is not None:
            self._time.after(0.0, partial(self._tick, self._begun, self._config.every_s))

    def _tick(self, begun: int, every_s: float) -> None:
        if begun == self._begun:  # otherwise it was begun anew
            self._send_frames()
            self._time.after(every_s, partial(self._tick, begun, every_s))

    def _send_frames(self) -> None:
        if self._operational:
            values = self._read()
            for frame in self._config.frames:
                self._send(frame.identifier, encode_frame(frame, values))


def _add_object(dictionary: ObjectDictionary, row: StartupObject) -> None:
    """Add an object that is written at start-up; as delivered it holds nothing."""
    variable = Variable(DATA_TYPES[row.type], "rw", 0, name=row.meaning)
    if not row.subindex:
        dictionary[row.index] = variable
        return
    if row.index not in dictionary:
        dictionary[row.index] = Record(name=row.meaning)
    dictionary[row.index][row.subindex] = variable


def encode_frame(frame: CanFrame, values: Mapping[str, float]) -> bytes:
    """Return the bytes of a frame; a signed number beyond its bits stops at their end, a counter begins anew."""
    little = big = 0
    for field in frame.fields:
        number = _number(field, (values[field.name] - field.zero) / field.scale) << field.shift
        if field.order == "big":
            big |= number
        else:
            little |= number
    both = little | int.from_bytes(big.to_bytes(frame.size, "big"), "little")
    return both.to_bytes(frame.size, "little")


def _number(field: CanField, value: float) -> int:
    if field.kind == "float":
        return int.from_bytes(struct.pack("<f" if field.bits == 32 else "<d", value), "little")
    if field.kind == "unsigned":
        return round(value) & (1 << field.bits) - 1
    low, high = -(1 << field.bits - 1), (1 << field.bits - 1) - 1
    # not a number becomes the lowest count, as measuring amplifiers show it
    count = low if value != value else min(max(round(value), low), high)  # noqa: PLR0124
    return count & (1 << field.bits) - 1
