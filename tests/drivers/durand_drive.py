"""A CANopen node by an independent stack (durand) with the objects of a CiA 402 drive, for the set-up tests.

It only stores what is written; a test bends single objects to be a drive that refuses, forgets or keeps silent.
durand's timers are one scheduler for the whole process; the heartbeat here is a thread of its own instead.
"""

from __future__ import annotations

import threading
from typing import Any

import can
from durand import CANBusNetwork, MinimalNode
from durand.datatypes import DatatypeEnum as Type
from durand.object_dictionary import Array, Variable

NODE_ID = 5

VARIABLES: dict[int, tuple[Any, str, int]] = {
    0x6007: (Type.INTEGER16, "rw", 1),
    0x6040: (Type.UNSIGNED16, "rw", 0),
    0x6041: (Type.UNSIGNED16, "ro", 0x0250),
    0x605A: (Type.INTEGER16, "rw", 2),
    0x605E: (Type.INTEGER16, "rw", 2),
    0x6060: (Type.INTEGER8, "rw", 0),
    0x6061: (Type.INTEGER8, "ro", 0),
    0x6064: (Type.INTEGER32, "ro", 0),
    0x606C: (Type.INTEGER32, "ro", 0),
    0x6071: (Type.INTEGER16, "rw", 0),
    0x6072: (Type.UNSIGNED16, "rw", 3000),
    0x6076: (Type.UNSIGNED32, "ro", 5000),
    0x6077: (Type.INTEGER16, "ro", 0),
    0x6080: (Type.UNSIGNED32, "rw", 6000),
    0x6087: (Type.UNSIGNED32, "rw", 0xFFFF_FFFF),
    0x6098: (Type.INTEGER8, "rw", 17),
    0x60FF: (Type.INTEGER32, "rw", 0),
    0x6502: (Type.UNSIGNED32, "ro", 0x3A0),
}


class DurandDrive:
    """The node on a virtual CAN channel, answering from a thread of its own."""

    def __init__(self, channel: str) -> None:
        self.bus = can.Bus(interface="virtual", channel=channel)
        self.network = CANBusNetwork(self.bus)
        self.network._notifier.timeout = 0.01  # its default of 1 s is how long stopping takes
        self._waker = can.Bus(interface="virtual", channel=channel)
        self.node = MinimalNode(self.network, NODE_ID)
        self.od = self.node.object_dictionary
        for index, (kind, access, value) in VARIABLES.items():
            self.od[index] = Variable(kind, access, value)
        self.od[0x1016] = Array(Variable(Type.UNSIGNED32, "rw", 0), length=1)
        for index in (0x1400, 0x1401, 0x1402, 0x1403):
            self.od[index][5] = Variable(Type.UNSIGNED16, "rw", 0)
        self.identify(0x4C4D0001, 0x402)
        self._waker.send(can.Message(arbitration_id=0x080, is_extended_id=False))  # ends the first wait of 1 s
        self.heartbeats = True
        self._stopped = threading.Event()
        self._heart = threading.Thread(target=self._beat, daemon=True)
        beats = self.od.update_callbacks[(0x1017, 0)]
        beats._callbacks.clear()
        beats.add(lambda _: self._heart.start() if not self._heart.is_alive() else None)

    def _beat(self) -> None:
        while not self._stopped.wait(self.od.read(0x1017, 0) / 1000):
            if self.heartbeats:
                self.network.send(0x700 + NODE_ID, bytes((self.node.nmt.state,)))

    def identify(self, vendor_id: int, product_code: int) -> None:
        self.od.set_read_callback(0x1018, 1, lambda: vendor_id)
        self.od.set_read_callback(0x1018, 2, lambda: product_code)

    def forgets(self, index: int, subindex: int, value: int) -> None:
        """Accept writes to this object and keep the old value."""
        self.od.set_read_callback(index, subindex, lambda: value)

    def close(self) -> None:
        self._stopped.set()
        if self._heart.is_alive():
            self._heart.join()
        self.network.stop()
        self._waker.shutdown()
        self.bus.shutdown()
