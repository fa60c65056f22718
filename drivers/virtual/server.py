"""The virtual bench as a process: CAN and Modbus servers around one plant in real time.

Prints one JSON line with its ports when everything is compiled and listening, then JSON lines about what the drive and
the injected faults do on standard error, until SIGTERM or SIGINT. The plant is advanced to the present on every frame,
request and tick, so nobody ever sees an old value.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import signal
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from drivers.virtual.cia402_tables import HEARTBEAT_LOST
from drivers.virtual.config import CanBus, ModbusPort, ServerConfig, SlcanPort, Socketcand
from drivers.virtual.drive_node import DriveNode
from drivers.virtual.errors import VirtualBenchError
from drivers.virtual.frame_faults import FrameFaults
from drivers.virtual.modbus_faults import ModbusFaults
from drivers.virtual.modbus_rtu import RtuLine
from drivers.virtual.modbus_servers import Device, ModbusServer
from drivers.virtual.plant import Plant, warm_up
from drivers.virtual.process_lines import NOT_SEEN, LogLine, ParentInput, log_line, print_ready, tell_acted
from drivers.virtual.python_can_port import PythonCanPort
from drivers.virtual.scenario import Scenario
from drivers.virtual.slcan_server import SlcanServer
from drivers.virtual.socketcand_server import SocketcandServer

TICK_S = 0.002
STANDSTILL_NS = 10_000_000  # the computer held the process up: a drive's own timers would have gone on hearing frames
LARGEST_LAG_NS = 500_000_000  # after a longer stop of the process the plant does not make up for the time
DEVICE_CYCLE_NS = 1_000_000  # of the remote I/O, which counts its cycles


class VirtualBench:
    """Plant, drive node and Modbus devices on one clock, wired to the servers by `run`."""

    def __init__(self, config: ServerConfig, scenario: Scenario | None, log: LogLine) -> None:
        bench = config.bench
        self.log = log
        self.plant = Plant(bench)
        self._clock_ns = time.monotonic_ns()
        self._brake_on = 0
        self._frames: FrameFaults | None = None  # from when the drive is there: it says boot-up while it is made
        self._keep_truth = config.truth is not None
        self._truth: list[tuple[int, float]] = []
        self.can: SocketcandServer | SlcanServer | PythonCanPort
        if isinstance(config.can, Socketcand):
            self.can = SocketcandServer(config.can.channel, self._frame, log)
        elif isinstance(config.can, SlcanPort):
            self.can = SlcanServer(config.can.link, config.can.bitrate, self._frame, log)
        else:
            self.can = PythonCanPort(config.can, self._frame, log)
        self.drive = DriveNode(self.plant, bench.drive, self._send, scenario, partial(tell_acted, log))
        self._frames = self.drive.faults.frames
        ports = {"amplifier": config.amplifier, "brake": config.brake, "remote_io": config.remote_io}
        self.modbus_faults = ModbusFaults(self.drive.faults, {name: port.registers for name, port in ports.items()})
        self.servers = {
            "amplifier": self._serve("amplifier", Device(config.amplifier, self._read_amplifier)),
            "brake": self._serve("brake", Device(config.brake, self._read_brake, self._write_brake)),
            "remote_io": self._serve("remote_io", Device(config.remote_io, self._read_remote_io)),
        }
        self.serial_lines: dict[str, RtuLine] = {}

    def advance(self) -> None:
        """Bring the plant to the present."""
        now_ns = time.monotonic_ns()
        elapsed_ns = now_ns - self._clock_ns
        self._clock_ns = now_ns
        if elapsed_ns > LARGEST_LAG_NS:
            self.log("process_stopped", f"the process stood still for {elapsed_ns / 1e9:.2f} s")
            elapsed_ns = LARGEST_LAG_NS
        if elapsed_ns > STANDSTILL_NS:
            # what arrived meanwhile waits in the sockets and is read after this
            self.drive.axis.machine.excuse_silence(elapsed_ns)
        self.plant.advance(elapsed_ns)

    def tick(self) -> None:
        """Do what time alone makes due: supervision, ramps, faults."""
        self.advance()
        before = set(self.drive.faults.wires.cut)
        self.drive.tick()
        if self._keep_truth:
            self._truth.append((self._clock_ns, self.plant.reducer_torque_nm))
        for name, server in self.servers.items():
            if name in self.drive.faults.wires.cut - before or self.modbus_faults.takes_reset(name):
                server.cut()
                self.drive.faults.seen(f"modbus.{name}")
        self._disturb_bus()
        for event in self.drive.axis.machine.events:
            self.log(event.kind, event.text, code=event.code, plant_s=event.time_ns * 1e-9)
            if event.code == HEARTBEAT_LOST and event.kind == "controller_lost":
                self.log("controller_vanished", "the controller has vanished: the drive acts on its own")
        self.drive.axis.machine.events.clear()

    def _disturb_bus(self) -> None:
        """Do what faults do to the CAN port itself."""
        faults = self.drive.faults
        if not faults.active:
            return
        if faults.frames.port_is_cut():
            self.can.cut()
        step_s = faults.value("clock", "step")
        if step_s is not None and isinstance(self.can, SocketcandServer):
            self.can.clock_offset_s = step_s
            faults.seen("clock")

    def _serve(self, name: str, device: Device) -> ModbusServer:
        return ModbusServer(name, device, self.advance, self.modbus_faults)

    def _send(self, cob_id: int, data: bytes) -> None:
        if self._frames is not None and isinstance(self.can, SocketcandServer):
            for _ in range(self._frames.error_frames()):
                self.can.send_error()
        self.can.send(cob_id, data)

    def _frame(self, cob_id: int, data: bytes) -> None:
        self.advance()
        self.drive.receive(cob_id, data)

    def _read_amplifier(self) -> dict[str, float]:
        sample = self.plant.sample()
        return {
            "torque_in_nm": sample.torque_in_nm,
            "torque_out_nm": sample.torque_out_nm,
            "angle_in_rad": sample.angle_in_rad,
            "angle_out_rad": sample.angle_out_rad,
            "sample_counter": sample.counter,
            "sample_time_us": sample.time_us,
            "sample_status": sample.status,
        }

    def _read_brake(self) -> dict[str, float]:
        return {
            "brake_on": self._brake_on,
            "brake_current_a": self.plant.brake_current_a,
            "life_counter": self._life_counter(),
        }

    def _write_brake(self, values: dict[str, float]) -> None:
        self._brake_on = 1 if values["brake_on"] else 0
        self.plant.set_brake_current(values["brake_current_a"] if self._brake_on else 0.0)

    def _read_remote_io(self) -> dict[str, float]:
        wires = self.drive.faults.wires
        return {
            "estop_released": wires.estop_released,
            "guard_closed": wires.guard_closed,
            "housing_temp_c": self.plant.housing_temp_c + wires.housing_offset_k,
            "ambient_temp_c": self.plant.ambient_temp_c,
            "life_counter": self._life_counter(),
        }

    def _life_counter(self) -> int:
        return self.plant.now_ns // DEVICE_CYCLE_NS & 0xFFFF

    def write_truth(self, path: Path) -> None:
        """Write the torque in the reducer, one line per tick."""
        lines = [f"{time_ns},{torque_nm:.6g}\n" for time_ns, torque_nm in self._truth]
        path.write_text("monotonic_ns,reducer_torque_nm\n" + "".join(lines), encoding="ascii")


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
        if config.end_with_parent:
            loop.add_reader(sys.stdin.fileno(), ParentInput(loop, stop, bench.drive.faults, log).read)
        gc.collect()
        gc.freeze()
        bench.advance()
        (announce or print_ready)(ready)
        while not stop.is_set():
            bench.tick()
            await asyncio.sleep(TICK_S)
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
        await bench.can.stop()


async def _start(bench: VirtualBench, config: ServerConfig) -> dict[str, Any]:
    """Open all ports and return the ready message."""
    ready: dict[str, Any] = {"ready": True, "unit": config.bench.unit}
    devices = {"amplifier": config.amplifier, "brake": config.brake, "remote_io": config.remote_io}
    try:
        ready["can"] = await _start_can(bench, config)
        for name, where in devices.items():
            if not where.rtu:
                port = await bench.servers[name].start(where.host, where.port)
                ready[name] = {"host": where.host, "port": port, "unit_id": where.unit_id}
        for link, names in _serial_lines(devices).items():
            line = RtuLine([bench.servers[name] for name in names], devices[names[0]].serial_port, bench.log)
            bench.serial_lines[link] = line
            path = await line.start()
            ready |= {name: {"serial_port": path, "unit_id": devices[name].unit_id} for name in names}
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


def _serial_lines(devices: dict[str, ModbusPort]) -> dict[str, list[str]]:
    """Return the devices of each serial line, by the port's name; without a name a device has a line of its own."""
    lines: dict[str, list[str]] = {}
    for name, where in devices.items():
        if where.rtu:
            lines.setdefault(where.serial_port or name, []).append(name)
    return lines
