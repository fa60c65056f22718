"""A gateway between a controller and a bench on a cable, which brings wire faults to a bench that has none of its own.

The controller connects to the gateway as it would to the virtual bench: socketcand and Modbus TCP on loopback. The
gateway passes frames, requests and answers on to the bench's own bus and devices, through the same `FrameFaults` and
`ModbusFaults` as the virtual bench's wires.
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import can

from drivers.can.bus import CanLink, open_can
from drivers.config import CanConfig, CanSensorConfig
from virtual_bench.devices.modbus_gateway import HOST, ModbusGateway, ModbusTarget
from virtual_bench.devices.process_lines import NOT_SEEN, LogLine, ParentInput, log_line, print_ready, tell_acted
from virtual_bench.errors import VirtualBenchError
from virtual_bench.faults.frame_faults import FrameFaults
from virtual_bench.faults.modbus_faults import ModbusFaults
from virtual_bench.faults.scenario import Scenario
from virtual_bench.faults.schedule import FaultSchedule
from virtual_bench.faults.vocabulary import on_the_wire
from virtual_bench.wires.socketcand_server import SocketcandServer

TICK_S = 0.002
Way = Callable[[int, bytes], None]


@dataclass(frozen=True)
class GatewayConfig:
    """The bench behind the gateway, and the controller's and the drive's node ids."""

    can: CanConfig
    node_id: int
    controller_node_id: int
    devices: dict[str, ModbusTarget]  # by their names in the bench file
    can_sensors: tuple[CanSensorConfig, ...] = ()
    end_with_parent: bool = False


def check_scenario(scenario: Scenario) -> None:
    """Refuse what a gateway cannot do; VirtualBenchError names the first of it and what is possible."""
    for fault in scenario.faults:
        if not on_the_wire(fault.target, fault.verb):
            raise VirtualBenchError(
                f"gateway: found {fault.target} {fault.verb}, allowed are faults on the wire: targets can.… and "
                "modbus.…. Other faults need the virtual bench, or must be made by hand at the real bench"
            )
        if fault.when.torque_out_above_nm is not None:
            raise VirtualBenchError(
                f"gateway: {fault.target} {fault.verb}: found 'when' with a torque, but a gateway does not measure the "
                "torque. Start the fault by state, scan or time_s"
            )


class CanGateway:
    """The controller's CAN port on one side, the bench's bus on the other."""

    def __init__(self, config: GatewayConfig, schedule: FaultSchedule, log: LogLine) -> None:
        self.frames = FrameFaults(schedule, config.node_id, config.controller_node_id)
        for sensor in config.can_sensors:
            self.frames.add_sensor(sensor.name, [frame.identifier for frame in sensor.frames], sensor.node_id)
        self.server = SocketcandServer(config.can.channel, self._from_controller, log)
        self._config = config
        self._log = log
        self._link: CanLink | None = None

    async def start(self) -> int:
        """Open the bench's bus and the controller's port, and return the port; raises DriverError or OSError."""
        self._link = open_can(self._config.can)
        asyncio.get_running_loop().add_reader(self._link.fileno(), self._read)
        return await self.server.start(HOST, 0)

    async def stop(self) -> None:
        """Close both sides."""
        if self._link is not None:
            asyncio.get_running_loop().remove_reader(self._link.fileno())
            self._link.close()
            self._link = None
        await self.server.stop()

    def _from_controller(self, cob_id: int, data: bytes) -> None:
        answer = self.frames.answered(cob_id, data)
        if answer is not None:
            self._to_controller(self.frames.answer_id(), answer)
            return
        self._pass_on(cob_id, data, self._to_bench)

    def _read(self) -> None:
        link = self._link
        if link is None:
            return
        while (message := link.receive()) is not None:
            if not (message.is_error_frame or message.is_remote_frame or message.is_extended_id):
                self._pass_on(message.arbitration_id, bytes(message.data), self._to_controller)
        if link.lost:
            self._log("bus_lost", f"the bench's bus is lost: {link.lost_because}")
            asyncio.get_running_loop().remove_reader(link.fileno())
            self.server.cut()

    def _pass_on(self, cob_id: int, data: bytes, way: Way) -> None:
        for frame in self.frames.pass_on(cob_id, data):
            if frame.of_another:
                self._to_controller(frame.cob_id, frame.data)
            elif frame.delay_ns:
                asyncio.get_running_loop().call_later(frame.delay_ns * 1e-9, way, frame.cob_id, frame.data)
            else:
                way(frame.cob_id, frame.data)

    def _to_bench(self, cob_id: int, data: bytes) -> None:
        if self._link is not None:
            self._link.send(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))

    def _to_controller(self, cob_id: int, data: bytes) -> None:
        for _ in range(self.frames.error_frames()):
            self.server.send_error()
        self.server.send(cob_id, data)


async def run_gateway(
    config: GatewayConfig,
    scenario: Scenario,
    *,
    announce: Callable[[dict[str, Any]], None] = print_ready,
    stop: asyncio.Event | None = None,
    log: LogLine = log_line,
) -> None:
    """Pass everything on until `stop` is set, a signal comes, or (`end_with_parent`) standard input closes.

    Raises:
        VirtualBenchError: the scenario has faults that are not of the wire.
        DriverError: the bench's bus cannot be opened.

    """
    check_scenario(scenario)
    stop = stop or asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        with contextlib.suppress(ValueError, RuntimeError):  # only the main thread may
            loop.add_signal_handler(number, stop.set)
    schedule = FaultSchedule(scenario, partial(tell_acted, log))
    bus = CanGateway(config, schedule, log)
    faults = ModbusFaults(schedule, {name: target.registers for name, target in config.devices.items()})
    devices = {name: ModbusGateway(name, target, faults) for name, target in config.devices.items()}
    ready: dict[str, Any] = {"ready": True, "gateway": config.can.where}
    ready["can"] = {"interface": "socketcand", "host": HOST, "port": await bus.start(), "channel": config.can.channel}
    for name, device in devices.items():
        ready[name] = {"host": HOST, "port": await device.start(), "unit_id": config.devices[name].unit_id}
    if config.end_with_parent:
        loop.add_reader(sys.stdin.fileno(), ParentInput(loop, stop, schedule.tell, log).read)
    announce(ready)
    started_ns = time.monotonic_ns()
    try:
        while not stop.is_set():
            schedule.step(time.monotonic_ns() - started_ns)
            for name, device in devices.items():
                if faults.takes_reset(name) or faults.is_cut(name):
                    device.cut()
            if bus.frames.port_is_cut():
                bus.server.cut()
            await asyncio.sleep(TICK_S)
    finally:
        for text in schedule.why_unseen():
            log(NOT_SEEN, text)
        for device in devices.values():
            await device.stop()
        await bus.stop()
