"""The virtual bench as a process: CAN and Modbus servers around one plant.

Prints one JSON line with its ports when everything is compiled and listening, then JSON lines about what the drive and
the injected faults do on standard error, until SIGTERM or SIGINT. By the wall clock the plant is advanced to the
present on every frame, request and tick, so nobody ever sees an old value. While a scan leads (`pace_port`), frames and
requests wait until that scan has ended; then they are taken in their order, CAN first, and exactly one period passes.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import signal
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from definitions.image import State
from drivers.config import DriveBrakeConfig
from drivers.pace import FromBench, ToBench
from virtual_bench.awaited import Awaited
from virtual_bench.bench_time import BenchTime
from virtual_bench.config import CanBus, CanSensorPort, ModbusPort, ServerConfig, Shown, SlcanPort, Socketcand
from virtual_bench.devices.can_sensors import CanSensor
from virtual_bench.devices.drive_node import DriveNode
from virtual_bench.devices.modbus_rtu import RtuLine
from virtual_bench.devices.modbus_servers import Device, ModbusServer
from virtual_bench.devices.process_lines import NOT_SEEN, Hands, LogLine, ParentInput, log_line, print_ready, tell_acted
from virtual_bench.drive.cia402_tables import HEARTBEAT_LOST
from virtual_bench.errors import VirtualBenchError
from virtual_bench.faults.frame_faults import FrameFaults
from virtual_bench.faults.modbus_faults import ModbusFaults
from virtual_bench.faults.names import Vocabulary
from virtual_bench.faults.scenario import Scenario
from virtual_bench.faults.schedule import LOST, Acted
from virtual_bench.faults.vocabulary import vocabulary_of
from virtual_bench.pace_port import PacePort
from virtual_bench.physics.plant import Plant, warm_up
from virtual_bench.slow_devices import remote_io_shows
from virtual_bench.wires.python_can_port import PythonCanPort
from virtual_bench.wires.slcan_server import SlcanServer
from virtual_bench.wires.socketcand_server import SocketcandServer

TICK_S = 0.002
LED_TICK_S = 0.008
"""While a scan leads there is nothing to do but to see whether it still does. Shorter than what counts as a standstill:
when the scan is gone, the bench goes on by the wall clock at the next tick."""
POWER_ON_NS = 100_000_000  # a bench that waits for its first scan has been on for a while
COUNTED = ("sample_counter", "sample_time_us")
"""What begins anew where it does not fit a register."""
CONTACT_CLOSES = 0.5
"""Share of its largest current from which the contact of a brake at the drive says that it is on."""
DEVICE_CYCLE_NS = 1_000_000  # of the remote I/O, which counts its cycles


class VirtualBench:
    """Plant, drive node and Modbus devices on one clock, wired to the servers by `run`."""

    def __init__(self, config: ServerConfig, scenario: Scenario | None, log: LogLine) -> None:
        bench = config.bench
        self.log = log
        self.plant = Plant(bench)
        self.time = BenchTime(self._let_pass, self._excuse)
        self._at_rest = config.pace is not None and config.pace.from_rest
        if self._at_rest:
            self.plant.advance(POWER_ON_NS)
        self.pace = None if config.pace is None else PacePort(self, log)
        self._period_ns = 0
        self._begun_ns: int | None = None
        self._frames_waiting: list[tuple[int, bytes]] = []
        self._frames_come = 0
        self._frames_sent_before = 0
        self._awaited = [Awaited() for _ in range(1 + len(config.devices))]
        self._brake_on = 0
        self._frames: FrameFaults | None = None  # from when the drive is there: it says boot-up while it is made
        self.unit = bench.unit
        self._keep_truth = config.truth is not None
        self._truth: list[tuple[int, float]] = []
        self.can: SocketcandServer | SlcanServer | PythonCanPort
        if isinstance(config.can, Socketcand):
            self.can = SocketcandServer(config.can.channel, self._frame, log)
        elif isinstance(config.can, SlcanPort):
            self.can = SlcanServer(config.can.link, config.can.bitrate, self._frame, log)
        else:
            self.can = PythonCanPort(config.can, self._frame, log)
        self.drive = DriveNode(
            self.plant, bench.drive, self._send, self.time, scenario=scenario, report=self._tell_acted
        )
        self._frames = self.drive.faults.frames
        self.modbus_faults = ModbusFaults(
            self.drive.faults, {name: port.registers for name, port in config.devices.items()}
        )
        self._brake_max_a = bench.brake.max_current_a
        self._output_brake = bench.drive_brake
        self.servers = {name: self._serve(name, self._device(name, port)) for name, port in config.devices.items()}
        self.sensors = [
            CanSensor(port, partial(self._read_sensor, port), self._send_of_sensor, self.time)
            for port in config.can_sensors
        ]
        for port in config.can_sensors:
            self._frames.add_sensor(port.name, [frame.identifier for frame in port.frames], port.node_id)
        self.serial_lines: dict[str, RtuLine] = {}

    def advance(self) -> None:
        """Bring the plant to the present, unless a scan leads."""
        stood_ns = self.time.advance()
        if stood_ns:
            self.log("process_stopped", f"the process stood still for {stood_ns / 1e9:.2f} s")

    def _let_pass(self, duration_ns: int) -> None:
        if not self._at_rest:
            self.plant.advance(duration_ns)

    def _excuse(self, standstill_ns: int) -> None:
        self.drive.axis.machine.excuse_silence(standstill_ns)

    def clock_ns(self) -> int:
        """Return the time of the clock on which scan n is due n + 1 periods after the start."""
        if self._begun_ns is None:
            return 0 if self._at_rest else time.monotonic_ns()
        return self.time.now_ns - self._begun_ns + self._period_ns

    def tick(self) -> None:
        """Bring the bench to the present and do what time alone makes due; while a scan leads, look after it."""
        if self.pace is not None:
            self.pace.look()
        if not self.time.led:
            self.advance()
            self._do_due()

    def _do_due(self) -> None:
        """Do what time alone makes due: supervision, ramps, faults, what is late."""
        before = set(self.drive.faults.wires.cut)
        self.drive.tick()
        if self._output_brake is not None:
            self._switch_output_brake(self._output_brake)
        self.time.do_due()
        if self._keep_truth and not self._at_rest:
            self._truth.append((self.clock_ns(), self.plant.reducer_torque_nm))
        for name, server in self.servers.items():
            if name in self.drive.faults.wires.cut - before or self.modbus_faults.takes_reset(name):
                server.cut()
                self.drive.faults.seen(f"modbus.{name}")
        for sensor in self.sensors:
            if self.drive.faults.frames.takes_reset(sensor.name):
                sensor.reset()
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

    def _device(self, name: str, port: ModbusPort) -> Device:
        match name:
            case "amplifier":
                return Device(port, self._read_amplifier)
            case "brake":
                return Device(port, self._read_brake, self._write_brake)
            case "remote_io":
                return Device(port, self._read_remote_io)
        return Device(port, partial(self._read_measuring, port))

    def _serve(self, name: str, device: Device) -> ModbusServer:
        server = ModbusServer(name, device, self.time, self.modbus_faults)
        if self.pace is not None:
            server.arrived = self.pace.arrived
        return server

    # --- led by a scan: see `pace_port`

    def begin(self, period_ns: int) -> None:
        """Begin to wait for a scan."""
        self._at_rest = False
        self._period_ns, self._begun_ns = period_ns, self.time.now_ns
        self._frames_come, self._frames_sent_before = 0, self.can.frames_sent
        self._awaited = [Awaited() for _ in self._awaited]
        for server in self.servers.values():
            server.requests = server.bytes_sent = 0
        self.time.lead()
        self.drive.heartbeat.begin()
        self.begin_sensors()
        self.can.flush()

    def wait_again(self) -> None:
        """Wait for a scan that had been given up, and is there again."""
        self.time.lead()

    def _come(self) -> tuple[int, ...]:
        return (self._frames_come, *(server.requests for server in self.servers.values()))

    def _sent(self, message: ToBench) -> tuple[int, ...]:
        """Return the frames and the requests of each device that were sent; the rest of a message is room."""
        return (message.frames, *message.requests[: len(self.servers)])

    def missing(self, message: ToBench) -> bool:
        """Tell whether something that was sent before a message is not there yet and may still come."""
        self._take_back()
        reachable = (self.can.connected, *(server.reachable for server in self.servers.values()))
        rows = zip(self._awaited, self._sent(message), self._come(), reachable, strict=True)
        return any(one.missing(sent, come) and there for one, sent, come, there in rows)

    def _take_back(self) -> None:
        """Answer a request that was given up and has come at once: its device may take no other one before that."""
        frames, *requests = zip(self._awaited, self._come(), strict=True)
        frames[0].take_back(frames[1])
        for (one, come), server in zip(requests, self.servers.values(), strict=True):
            if one.take_back(come):
                server.answer_waiting()

    def give_up(self, message: ToBench) -> None:
        """Do without what is missing."""
        for one, sent, come in zip(self._awaited, self._sent(message), self._come(), strict=True):
            one.give_up(sent, come)

    def let_scan_pass(self, message: ToBench) -> FromBench:
        """Take what has come, let the period pass and those that faults make the scan miss, and return the answer."""
        self._take_waiting()
        for one, sent in zip(self._awaited, self._sent(message), strict=True):
            one.acted(sent)
        faults = self.drive.faults
        faults.tell(State(message.state).name.lower(), message.number)
        missed = faults.take_missed()
        for _ in range(1 + missed):
            self.time.let_pass(self._period_ns)
            self._do_due()
        self.can.flush()
        frames = self.can.frames_sent - self._frames_sent_before
        answered = tuple(server.bytes_sent for server in self.servers.values())
        return FromBench(message.number, missed, frames, answered, b"")

    def go_on(self) -> None:
        """Go on by the wall clock."""
        self.time.release()
        self._take_waiting()

    def _take_waiting(self) -> None:
        waiting, self._frames_waiting = self._frames_waiting, []
        for cob_id, data in waiting:
            self._take_frame(cob_id, data)
        for server in self.servers.values():
            server.answer_waiting()

    def tell(self, state: str, scan: int, entered: int) -> None:
        """Take from the supervisor where the controller is; a scan that leads says it itself, and sooner."""
        if not self.time.led:
            self.drive.faults.tell(state, scan, entered)

    def _tell_acted(self, acted: Acted) -> None:
        tell_acted(self.log, acted, self.clock_ns)

    def _send(self, cob_id: int, data: bytes) -> None:
        if self._frames is not None and isinstance(self.can, SocketcandServer):
            for _ in range(self._frames.error_frames()):
                self.can.send_error()
        self.can.send(cob_id, data)

    def _send_of_sensor(self, cob_id: int, data: bytes) -> None:
        """Send a frame of a sensor as the faults on its way leave it."""
        for frame in self.drive.faults.frames.pass_on(cob_id, data):
            if frame.delay_ns:
                self.time.after(frame.delay_ns * 1e-9, partial(self._send, frame.cob_id, frame.data))
            else:
                self._send(frame.cob_id, frame.data)

    def _frame(self, cob_id: int, data: bytes) -> None:
        self._frames_come += 1
        if self.time.led and self.pace is not None:
            self._frames_waiting.append((cob_id, data))
            self.pace.arrived()
            return
        self.advance()
        self._take_frame(cob_id, data)

    def _take_frame(self, cob_id: int, data: bytes) -> None:
        self.drive.receive(cob_id, data)
        if self.drive.faults.frames.fate("") != LOST:
            for sensor in self.sensors:
                sensor.receive(cob_id, data)

    def begin_sensors(self) -> None:
        """Let the sensors on CAN send from now on."""
        for sensor in self.sensors:
            sensor.begin()

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

    def _read_measuring(self, port: ModbusPort) -> dict[str, float]:
        blocks = (port.registers.read, *port.registers.read_also)
        types = {field.name: field.type for block in blocks for field in block.fields}
        values = self._shown(types, port.shows)
        for one in port.shows:
            if one.channel in COUNTED and types[one.field] == "u16":
                values[one.field] = int(values[one.field]) & 0xFFFF
        return values

    def _read_sensor(self, port: CanSensorPort) -> dict[str, float]:
        return self._shown([field.name for frame in port.frames for field in frame.fields], port.shows)

    def _shown(self, names: Iterable[str], shows: Iterable[Shown]) -> dict[str, float]:
        """Return what the fields of a device show; 0 in those that nobody names."""
        sample = self._read_amplifier()
        shown = {one.field: (sample[one.channel] - one.zero) / one.scale for one in shows}
        return dict.fromkeys(names, 0.0) | sample | shown

    def _read_brake(self) -> dict[str, float]:
        return {
            "brake_on": self._brake_on,
            "brake_current_a": self.plant.brake_current_a,
            "life_counter": self._life_counter(),
        }

    def _write_brake(self, values: dict[str, float]) -> None:
        ordered_a = values.get("brake_current_a", self._brake_max_a)  # a supply without set-point gives what it can
        self._brake_on = 1 if values.get("brake_on", ordered_a) else 0
        self.plant.set_brake_current(ordered_a if self._brake_on else 0.0)

    def _switch_output_brake(self, brake: DriveBrakeConfig) -> None:
        """Let the output of the drive switch the brake, and the brake's contact the input."""
        machine = self.drive.axis.machine
        on = machine.objects.digital_outputs & machine.objects.output_mask & 1 << brake.output_bit
        if bool(on) != bool(self._brake_on):
            self._brake_on = 1 if on else 0
            self.plant.set_brake_current(self._brake_max_a if on else 0.0)
        if brake.input_bit is not None:
            closed = self.plant.brake_current_a > CONTACT_CLOSES * self._brake_max_a
            machine.digital_inputs = 1 << brake.input_bit if closed else 0

    def _read_remote_io(self) -> dict[str, float]:
        return {**remote_io_shows(self.plant, self.drive.faults), "life_counter": self._life_counter()}

    def _life_counter(self) -> int:
        return self.plant.now_ns // DEVICE_CYCLE_NS & 0xFFFF

    def write_truth(self, path: Path) -> None:
        """Write the torque in the reducer, one line per tick."""
        lines = [f"{time_ns},{torque_nm:.6g}\n" for time_ns, torque_nm in self._truth]
        path.write_text("clock_ns,reducer_torque_nm\n" + "".join(lines), encoding="ascii")


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
