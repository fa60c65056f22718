"""The virtual bench on wires: plant, drive and devices on one clock, by the wall or led by a scan.

By the wall clock the plant is advanced to the present on every frame, request and tick, so nobody ever sees an old
value. While a scan leads (`pace_port`), frames and requests wait until that scan has ended; then they are taken in
their order, CAN first, and exactly one period passes.
"""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path

from definitions.image import State
from drivers.pace import FromBench, ToBench
from virtual_bench.awaited import Awaited
from virtual_bench.bench_time import BenchTime
from virtual_bench.config import ServerConfig, SlcanPort, Socketcand
from virtual_bench.device_values import DeviceValues
from virtual_bench.devices.can_sensors import CanSensor
from virtual_bench.devices.drive_node import DriveNode
from virtual_bench.devices.modbus_rtu import RtuLine
from virtual_bench.devices.modbus_servers import Device, ModbusServer
from virtual_bench.devices.process_lines import LogLine, tell_acted
from virtual_bench.drive.cia402_tables import HEARTBEAT_LOST
from virtual_bench.faults.frame_faults import FrameFaults
from virtual_bench.faults.modbus_faults import ModbusFaults
from virtual_bench.faults.scenario import Scenario
from virtual_bench.faults.schedule import LOST, Acted
from virtual_bench.pace_port import PacePort
from virtual_bench.physics.plant import Plant
from virtual_bench.wires.python_can_port import PythonCanPort
from virtual_bench.wires.slcan_server import SlcanServer
from virtual_bench.wires.socketcand_server import SocketcandServer

POWER_ON_NS = 100_000_000  # a bench that waits for its first scan has been on for a while


class VirtualBench:
    """Plant, drive node and Modbus devices on one clock, on ports that `server.run` opens."""

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
        self._given_up = False
        """Whether something was done without since the scan leads; before that nothing is late or lost."""
        self._let_go_ns = self._missed_alone = 0
        """When a silent scan was given up, and the periods that such a scan has missed and was not told yet."""
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
        self._values = DeviceValues(bench, self.plant, self.drive)
        self.servers = {
            name: self._serve(name, self._values.device(name, port)) for name, port in config.devices.items()
        }
        self.sensors = [
            CanSensor(port, partial(self._values.read_sensor, port), self._send_of_sensor, self.time)
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
        self._values.switch_output_brake()
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
        self._given_up = False
        self._missed_alone = 0
        for server in self.servers.values():
            server.requests = server.bytes_sent = 0
        self.time.lead()
        self.drive.heartbeat.begin()
        self.begin_sensors()
        self.can.flush()

    def wait_again(self) -> None:
        """Wait for a scan that had been given up, and is there again; the next answer tells what it has missed.

        Its time is whole periods: what is begun of one passes before it leads.
        """
        gone_ns = self.time.now_ns - self._let_go_ns
        periods = -(-gone_ns // self._period_ns)
        self.time.let_pass(periods * self._period_ns - gone_ns)
        self._missed_alone += periods
        self.time.lead()

    def _come(self) -> tuple[int, ...]:
        return (self._frames_come, *[server.requests for server in self.servers.values()])

    def _sent(self, message: ToBench) -> tuple[int, ...]:
        """Return the frames and the requests of each device that were sent; the rest of a message is room."""
        return (message.frames, *message.requests[: len(self.servers)])

    def missing(self, message: ToBench) -> bool:
        """Tell whether something that was sent before a message is not there yet and may still come."""
        sent, come = self._sent(message), self._come()
        if sent == come and not self._given_up:
            return False
        self._take_back()
        reachable = (self.can.connected, *(server.reachable for server in self.servers.values()))
        rows = zip(self._awaited, sent, come, reachable, strict=True)
        return any(one.missing(wanted, there) and can_come for one, wanted, there, can_come in rows)

    def _take_back(self) -> None:
        """Answer a request that was given up and has come at once: its device may take no other one before that."""
        frames, *requests = zip(self._awaited, self._come(), strict=True)
        frames[0].take_back(frames[1])
        for (one, come), server in zip(requests, self.servers.values(), strict=True):
            if one.take_back(come):
                server.answer_waiting()

    def give_up(self, message: ToBench) -> None:
        """Do without what is missing."""
        self._given_up = True
        for one, sent, come in zip(self._awaited, self._sent(message), self._come(), strict=True):
            one.give_up(sent, come)

    def let_scan_pass(self, message: ToBench) -> FromBench:
        """Take what has come, let the period pass and those that faults make the scan miss, and return the answer."""
        self._take_waiting()
        if self._given_up:
            for one, sent in zip(self._awaited, self._sent(message), strict=True):
                one.acted(sent)
        faults = self.drive.faults
        faults.tell(State(message.state).name.lower(), message.number)
        missed = faults.take_missed()
        for _ in range(1 + missed):
            self.time.let_pass(self._period_ns)
            self._do_due()
        missed, self._missed_alone = missed + self._missed_alone, 0
        self.can.flush()
        frames = self.can.frames_sent - self._frames_sent_before
        answered = tuple(server.bytes_sent for server in self.servers.values())
        return FromBench(message.number, missed, frames, answered, b"")

    def go_on(self) -> None:
        """Go on by the wall clock."""
        self.time.release()
        self._let_go_ns = self.time.now_ns
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

    def write_truth(self, path: Path) -> None:
        """Write the torque in the reducer, one line per tick."""
        lines = [f"{time_ns},{torque_nm:.6g}\n" for time_ns, torque_nm in self._truth]
        path.write_text("clock_ns,reducer_torque_nm\n" + "".join(lines), encoding="ascii")
