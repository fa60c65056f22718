"""The virtual drive as a CANopen node: durand's SDO server, NMT, EMCY and heartbeat around the CiA 402 machine.

No thread and no clock of its own: frames come by `receive`, time by `tick`, and what happens later is asked of the
bench's time. That is why the heartbeat is sent from here: durand's own runs by the wall clock.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from durand import Node
from durand.node import NodeCapabilities
from durand.services.nmt import StateEnum

from drivers.config import DriveConfig
from virtual_bench.bench_time import BenchTime
from virtual_bench.devices.canopen_node import Heartbeat, NodeNetwork, Receiver
from virtual_bench.devices.drive_dictionary import DriveDictionary
from virtual_bench.devices.pdo_parameters import SETPOINT_PDO
from virtual_bench.devices.pdo_service import PdoService
from virtual_bench.drive.axis import DriveAxis
from virtual_bench.faults.injector import FaultInjector
from virtual_bench.faults.scenario import Scenario
from virtual_bench.physics.plant import Plant

SYNC_COB = 0x080
NMT_COB, NMT_RESET_COMMUNICATION = 0x000, 0x82


class DriveNode:
    """One drive on the bus. Advance the plant before every call."""

    def __init__(
        self,
        plant: Plant,
        config: DriveConfig,
        send: Callable[[int, bytes], None],
        time: BenchTime,
        *,
        scenario: Scenario | None = None,
        report: Callable[[Any], None] | None = None,
    ) -> None:
        self._config = config
        self._plant = plant
        self._bus_send = send
        self._time = time
        self._ready = False
        self._booted = False
        self.axis = DriveAxis(plant, config, self._emcy)
        self.faults = FaultInjector(scenario, plant, self.axis, (config.node_id, config.controller_node_id), report)
        self._network = NodeNetwork(self._send)
        self.node = Node(self._network, config.node_id, capabilities=NodeCapabilities(1, 0, 0))
        self._dictionary = DriveDictionary(self.node, self.axis, self.faults, plant, config)
        self._pdo = PdoService(self.node, self._dictionary.mappable(), self._send_pdo, self._pdo_length)
        self.heartbeat = Heartbeat(self.node, time)
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

    def _take(self, cob_id: int, data: bytes) -> None:
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
            if frame.of_another:
                self._bus_send(frame.cob_id, frame.data)
            elif frame.delay_ns:
                self._time.after(frame.delay_ns * 1e-9, partial(way, frame.cob_id, frame.data))
            else:
                way(frame.cob_id, frame.data)

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
        self._dictionary.restore()
        profile = self._config.profile
        self._pdo.restore(profile.receive_pdos, profile.transmit_pdos)
