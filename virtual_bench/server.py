"""The virtual bench as a process: CAN and Modbus servers around one plant.

Prints one JSON line with its ports when everything is compiled and listening, then JSON lines about what the drive and
the injected faults do on standard error, until SIGTERM or SIGINT.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import signal
import sys
from collections.abc import Callable, Mapping
from typing import Any

from virtual_bench.config import CanBus, ModbusPort, ServerConfig, Socketcand
from virtual_bench.devices.modbus_rtu import RtuLine
from virtual_bench.devices.process_lines import NOT_SEEN, Hands, LogLine, ParentInput, log_line, print_ready
from virtual_bench.errors import VirtualBenchError
from virtual_bench.faults.names import Vocabulary
from virtual_bench.faults.scenario import Scenario
from virtual_bench.faults.vocabulary import vocabulary_of
from virtual_bench.physics.plant import warm_up
from virtual_bench.wired_bench import VirtualBench
from virtual_bench.wires.python_can_port import PythonCanPort
from virtual_bench.wires.slcan_server import SlcanServer
from virtual_bench.wires.socketcand_server import SocketcandServer

TICK_S = 0.002
LED_TICK_S = 0.008
"""While a scan leads there is nothing to do but to see whether it still does. Shorter than what counts as a standstill:
when the scan is gone, the bench goes on by the wall clock at the next tick."""


def _vocabulary(config: ServerConfig) -> Vocabulary:
    """Return what hands may do at the devices of this bench."""
    sensors = {port.name: port.node_id is not None for port in config.can_sensors}
    return vocabulary_of({name: port.registers for name, port in config.devices.items()}, sensors)


async def run(
    config: ServerConfig,
    scenario: Scenario | None = None,
    *,
    announce: Callable[[dict[str, Any]], None] | None = None,
    stop: asyncio.Event | None = None,
    log: LogLine = log_line,
) -> None:
    """Serve the bench until `stop` is set, a signal comes, or (`end_with_parent`) standard input closes.

    `announce` gets the ready message; without it the message goes to standard output as one JSON line. Raises
    `VirtualBenchError` when the unit is unknown or a port cannot be had.
    """
    warm_up(config.bench)
    bench = VirtualBench(config, scenario, log)
    stop = stop or asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        with contextlib.suppress(ValueError, RuntimeError):  # only the main thread may
            loop.add_signal_handler(number, stop.set)
    try:
        ready = await _start(bench, config)
        hands = Hands(loop, bench.drive.faults, log, _vocabulary(config))
        if config.end_with_parent:
            loop.add_reader(sys.stdin.fileno(), ParentInput(loop, stop, bench.tell, log, hands).read)
        elif config.hands:
            loop.add_reader(sys.stdin.fileno(), hands.read)
        gc.collect()
        gc.freeze()
        bench.advance()
        bench.begin_sensors()
        (announce or print_ready)(ready)
        while not stop.is_set():
            bench.tick()
            await asyncio.sleep(LED_TICK_S if bench.time.led else TICK_S)
    finally:
        for text in bench.drive.faults.why_unseen():
            log(NOT_SEEN, text)
        log("stopping", "virtual bench stops")
        if config.truth is not None:
            bench.write_truth(config.truth)
        for server in bench.servers.values():
            await server.stop()
        for line in bench.serial_lines.values():
            await line.stop()
        if bench.pace is not None:
            await bench.pace.stop()
        await bench.can.stop()


async def _start(bench: VirtualBench, config: ServerConfig) -> dict[str, Any]:
    """Open all ports and return the ready message."""
    ready: dict[str, Any] = {"ready": True, "unit": config.bench.unit}
    devices = config.devices
    try:
        ready["can"] = await _start_can(bench, config)
        for names in _connections(devices):
            first, *others = (bench.servers[name] for name in names)
            where = devices[names[0]]
            port = await first.start(where.host, where.port, others)
            ready |= {name: {"host": where.host, "port": port, "unit_id": devices[name].unit_id} for name in names}
        for link, names in _serial_lines(devices).items():
            line = RtuLine(
                [bench.servers[name] for name in names], devices[names[0]].serial_port, bench.log, bench.time
            )
            bench.serial_lines[link] = line
            path = await line.start()
            ready |= {name: {"serial_port": path, "unit_id": devices[name].unit_id} for name in names}
        if bench.pace is not None and config.pace is not None:
            ready["pace"] = {
                "host": config.pace.host,
                "port": await bench.pace.start(config.pace.host, config.pace.port),
            }
    except OSError as error:
        raise VirtualBenchError(f"virtual bench: {error}. Choose another port, or 0 for a free one.") from error
    return ready


async def _start_can(bench: VirtualBench, config: ServerConfig) -> dict[str, Any]:
    if isinstance(bench.can, SocketcandServer) and isinstance(config.can, Socketcand):
        port = await bench.can.start(config.can.host, config.can.port)
        where = {"interface": "socketcand", "host": config.can.host, "port": port}
    elif isinstance(bench.can, SlcanServer):
        return {"interface": "slcan", "channel": await bench.can.start()}
    elif isinstance(bench.can, PythonCanPort) and isinstance(config.can, CanBus):
        await bench.can.start()
        where = {"interface": config.can.interface}
    return where | {"channel": config.can.channel}


def _connections(devices: Mapping[str, ModbusPort]) -> list[list[str]]:
    """Return the devices of each port of TCP; without a name of its connection a device has a port of its own."""
    found: dict[str, list[str]] = {}
    for name, where in devices.items():
        if not where.rtu:
            found.setdefault(where.connection or f"device {name}", []).append(name)
    return list(found.values())


def _serial_lines(devices: Mapping[str, ModbusPort]) -> dict[str, list[str]]:
    """Return the devices of each serial line, by the port's name; without a name a device has a line of its own."""
    lines: dict[str, list[str]] = {}
    for name, where in devices.items():
        if where.rtu:
            lines.setdefault(where.serial_port or name, []).append(name)
    return lines
