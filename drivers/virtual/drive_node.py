"""The virtual drive as a CANopen node: durand's SDO server, NMT, EMCY and heartbeat around the CiA 402 machine.

No thread and no clock of its own: frames come by `receive`, time by `tick`, and durand's heartbeat timer runs on the
asyncio loop that the server runs on.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from functools import partial
from typing import Any

from durand import Node
from durand.network import NetworkABC
from durand.node import NodeCapabilities
from durand.object_dictionary import Array, Record, Variable
from durand.services.nmt import StateEnum
from durand.services.sdo.server import SDODomainAbort

from drivers.virtual.config import DriveConfig
from drivers.virtual.drive_axis import DriveAxis
from drivers.virtual.fault_injector import FaultInjector
from drivers.virtual.frame_faults import FOREIGN_COB
from drivers.virtual.object_table import SETTINGS, STRUCT_LETTERS, U8, U32, VALUES, Setting, Value
from drivers.virtual.pdo_parameters import ABORT_VALUE, SETPOINT_PDO, Mappable
from drivers.virtual.pdo_service import PdoService
from drivers.virtual.plant import Plant
from drivers.virtual.scenario import Scenario

DEVICE_TYPE = 0x00020192  # servo drive by CiA 402
REVISION, SERIAL = 0x00010000, 1
CONSUMERS = 2
HISTORY = 8
SYNC_COB = 0x080
NMT_COB, NMT_RESET_COMMUNICATION = 0x000, 0x82
HEARTBEAT_COB = 0x700

STATUS_PLACES = {0x6041: 0, 0x6061: 1, 0x6077: 2}
"""Objects that faults may change, by their place in what `FaultInjector.status` returns."""

CONTROLWORD, SETPOINTS = 0x6040, (0x6071, 0x60FF)

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


class DriveNode:
    """One drive on the bus. Advance the plant before every call."""

    def __init__(
        self,
        plant: Plant,
        config: DriveConfig,
        send: Callable[[int, bytes], None],
        scenario: Scenario | None = None,
        report: Callable[[Any], None] | None = None,
    ) -> None:
        self._config = config
        self._plant = plant
        self._bus_send = send
        self._ready = False
        self._booted = False
        self._late: list[tuple[int, int, Receiver, int, bytes]] = []  # arrival [ns], number, way, COB id, data
        self._frames_delayed = 0
        self.axis = DriveAxis(plant, config, self._emcy)
        self.faults = FaultInjector(scenario, plant, self.axis, (config.node_id, config.controller_node_id), report)
        self._network = NodeNetwork(self._send)
        self.node = Node(self._network, config.node_id, capabilities=NodeCapabilities(1, 0, 0))
        self._pdo = PdoService(self.node, self._mappable(), self._send_pdo, self._pdo_length)
        self._add_communication_objects()
        for setting in SETTINGS:
            self._add_setting(setting)
        for value in VALUES:
            self._add_value(value)
        self._restore()
        self.node.nmt.state_callbacks.add(self._nmt_changed)
        self._network.add_subscription(SYNC_COB, self._sync)
        self._ready = True

    def receive(self, cob_id: int, data: bytes) -> None:
        """Take a frame from the bus, as the faults on its way leave it."""
        frames = self.faults.frames
        answer = frames.answered(cob_id, data)
        if answer is not None:
            self._send(frames.answer_id(), answer)
            return
        self._pass_on(cob_id, data, self._take)
        self._release()

    def _take(self, cob_id: int, data: bytes) -> None:
        if cob_id == FOREIGN_COB:  # another node's, for everybody on the bus
            self._bus_send(cob_id, data)
            return
        channel = self._pdo.receive.get(cob_id)
        if channel is not None:
            if channel.number == SETPOINT_PDO:
                self.axis.machine.setpoint_received(self._plant.now_ns)
            self._pdo.received(channel, data)
            return
        receiver = self._network.subscriptions.get(cob_id)
        if receiver is not None:
            receiver(cob_id, data)
            self.axis.apply()

    def tick(self) -> None:
        """Let the machine look at the motor and at the time; send what time alone makes due."""
        now_ns = self._plant.now_ns
        self.faults.step(now_ns)
        self.axis.tick(now_ns)
        self._pdo.tick(now_ns)
        self._release()
        if not self._booted and self.faults.node_is_reset:
            self._booted = True
            self.receive(NMT_COB, bytes([NMT_RESET_COMMUNICATION, self._config.node_id]))
        if ("drive.emcy", "storm") in self.faults.active:
            self.node.emcy.set(self.faults.emergency(0), self.axis.machine.error_register)

    def _sync(self, _cob_id: int, _data: bytes) -> None:
        self._pdo.actuate()
        self.axis.tick(self._plant.now_ns)
        self._pdo.sample()

    def _send(self, cob_id: int, data: bytes) -> None:
        self._pass_on(cob_id, data, self._bus_send)

    def _send_pdo(self, _number: int, cob_id: int, data: bytes) -> None:
        self._send(cob_id, data)

    def _pass_on(self, cob_id: int, data: bytes, way: Receiver) -> None:
        """Let a frame through to `way` as the faults leave it, delayed ones when it is time."""
        for frame in self.faults.frames.pass_on(cob_id, data):
            if frame.delay_ns:
                self._frames_delayed += 1
                due_ns = self._plant.now_ns + frame.delay_ns
                heapq.heappush(self._late, (due_ns, self._frames_delayed, way, frame.cob_id, frame.data))
            else:
                way(frame.cob_id, frame.data)

    def _release(self) -> None:
        while self._late and self._late[0][0] <= self._plant.now_ns:
            _, _, way, cob_id, data = heapq.heappop(self._late)
            way(cob_id, data)

    def _emcy(self, code: int, register: int) -> None:
        if self._ready:
            self.node.emcy.set(code, register)

    def _pdo_length(self, code: int) -> None:
        self.node.emcy.set(code, self.axis.machine.error_register)

    def _nmt_changed(self, state: StateEnum) -> None:
        if state != StateEnum.OPERATIONAL:
            self.axis.machine.network_stopped(self._plant.now_ns)
        if state == StateEnum.INITIALISATION:
            self._restore()
        self._pdo.refresh()
        self.axis.apply()

    def _restore(self) -> None:
        """Bring the communication objects to their power-on values: nothing supervised, default mapping."""
        od, profile = self.node.object_dictionary, self._config.profile
        for subindex in range(1, CONSUMERS + 1):
            od.write(0x1016, subindex, 0)
        od.write(0x1017, 0, 0)
        self.axis.machine.objects.setpoint_timeout_ms = 0
        self._pdo.restore(profile.receive_pdos, profile.transmit_pdos)

    def _mappable(self) -> dict[tuple[int, int], Mappable]:
        machine = self.axis.machine
        table = {}
        for row in VALUES:
            write = None if row.write is None else self._writer(row)
            read = partial(self._shown, STATUS_PLACES[row.object_index]) if row.object_index in STATUS_PLACES else None
            table[row.object_index, 0] = Mappable(
                STRUCT_LETTERS[row.datatype], read or partial(row.read, machine), write
            )
        return table

    def _shown(self, place: int) -> int:
        """Status word, mode display or actual torque as it goes into a PDO, with the drive's faults."""
        machine = self.axis.machine
        torque = min(max(machine.motor.torque_permille, -0x8000), 0x7FFF)
        shown = self.faults.status(machine.statusword, int(machine.motion.mode_display), torque)[place]
        return min(max(shown, -0x8000), 0x7FFF) if place == 2 else shown

    def _writer(self, row: Value) -> Callable[[int], None]:
        machine, write, faults = self.axis.machine, row.write, self.faults
        assert write is not None  # noqa: S101 - the caller has looked

        def write_now(value: int) -> None:
            if row.object_index in SETPOINTS:
                value = faults.setpoint(value, row.read(machine))
            elif row.object_index == CONTROLWORD and not faults.takes_controlword(value, machine.controlword):
                return
            write(machine, value, self._plant.now_ns)

        return write_now

    def _add_communication_objects(self) -> None:
        od, machine = self.node.object_dictionary, self.axis.machine
        profile, config = self._config.profile, self._config
        od[0x1000] = Variable(U32, "ro", DEVICE_TYPE, name="Device type")
        od[0x1008].value = b"lostmotion virtual drive"
        identity = od[0x1018]
        for subindex, number in enumerate((profile.vendor_id, profile.product_code, REVISION, SERIAL), start=1):
            identity[subindex].value = number
        od[0x1003] = Array(Variable(U32, "ro", 0, name="Error"), length=HISTORY, name="Pre-defined error field")
        od.set_read_callback(0x1003, 0, lambda: len(machine.history))
        for subindex in range(1, HISTORY + 1):
            od.set_read_callback(0x1003, subindex, partial(_history, machine.history, subindex))
        od[0x1006] = Variable(U32, "rw", 0, name="Communication cycle period")
        od[0x1007] = Variable(U32, "rw", 0, name="Synchronous window length")
        consumers = Record(name="Consumer heartbeat time")
        for subindex in range(1, CONSUMERS + 1):
            consumers[subindex] = Variable(U32, "rw", 0, name="Consumer heartbeat")
            od.update_callbacks[0x1016, subindex].add(partial(self._consume, subindex))
        od[0x1016] = consumers
        self._consumed: dict[int, int] = {}
        behaviour = Record(name="Error behaviour")
        behaviour[1] = Variable(U8, "rw", 1, minimum=1, maximum=1, name="Communication error: no change of state")
        od[0x1029] = behaviour
        od[0x6076] = Variable(U32, "ro", round(config.rated_torque_nm * 1000), name="Motor rated torque")
        od.update_callbacks[0x1400, 5].add(self._setpoint_timeout)

    def _add_setting(self, row: Setting) -> None:
        od, objects = self.node.object_dictionary, self.axis.machine.objects
        variable = Variable(row.datatype, "rw", getattr(objects, row.attribute), name=row.name)
        variable.minimum = max(variable.minimum, row.low)
        od[row.object_index] = variable

        def check(value: int) -> None:
            if row.allowed is not None and value not in row.allowed:
                raise SDODomainAbort(ABORT_VALUE, (row.object_index, 0))

        def take(value: int) -> None:
            setattr(objects, row.attribute, value)
            self.axis.apply_limits()

        od.validate_callbacks[row.object_index, 0].add(check)
        od.update_callbacks[row.object_index, 0].add(take)

    def _add_value(self, row: Value) -> None:
        od, machine = self.node.object_dictionary, self.axis.machine
        od[row.object_index] = Variable(row.datatype, "ro" if row.write is None else "rw", 0, name=row.name)
        od.set_read_callback(row.object_index, 0, partial(row.read, machine))
        if row.write is not None:
            od.download_callbacks[row.object_index, 0].add(self._writer(row))

    def _consume(self, subindex: int, value: int) -> None:
        """Take 0x1016: node << 16 | time-out in ms."""
        before = self._consumed.pop(subindex, None)
        if before is not None:
            self.axis.machine.consume_heartbeats_of(before, 0)
            self._network.remove_subscription(HEARTBEAT_COB + before)
        node_id, timeout_ms = value >> 16 & 0x7F, value & 0xFFFF
        if node_id and timeout_ms:
            self._consumed[subindex] = node_id
            self.axis.machine.consume_heartbeats_of(node_id, timeout_ms)
            self._network.add_subscription(HEARTBEAT_COB + node_id, self._heartbeat)

    def _heartbeat(self, cob_id: int, _data: bytes) -> None:
        self.axis.machine.heartbeat(cob_id - HEARTBEAT_COB, self._plant.now_ns)

    def _setpoint_timeout(self, value: int) -> None:
        self.axis.machine.objects.setpoint_timeout_ms = value


def _history(codes: list[int], subindex: int) -> int:
    return codes[subindex - 1] if subindex <= len(codes) else 0
