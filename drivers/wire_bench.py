"""The bench on real wires: opened before the scan, then read and written once per scan.

`open` connects everything, proves every device's identity and sets the drive up; it may block and may raise. `read` and
`write` never wait and never raise: they use what has arrived, and trouble is a state in the image. A lost link stays
lost until the bench is opened anew. There is no thread.
"""

from __future__ import annotations

from collections.abc import Iterator

import can

from definitions.image import AGE_NEVER, DriveCommand, DriveMode, Image, Orders
from drivers.can.bus import CanLink, open_can
from drivers.can.identifiers import identifier_problems
from drivers.can.other_controller import refuse_other_controller
from drivers.can.sensor_setup import start_sensors
from drivers.can.sensors import SensorFrame, SensorNode
from drivers.config import ModbusConfig, WireBenchConfig
from drivers.errors import DriverError, ModbusError, Problem, ProfileError
from drivers.modbus.device import ModbusDevice
from drivers.modbus.frames import Outcome, Reply
from drivers.modbus.line import ModbusLine
from drivers.modbus.part_fields import check_parts, source_problems
from drivers.pace import Pace
from drivers.sample import ComposedSample
from drivers.servo_drive.drive import CanDrive, Listener, frames_per_poll
from drivers.servo_drive.objects import output_brake_problems
from drivers.servo_drive.output_brake import OutputBrake, read_outputs
from drivers.servo_drive.pdo import HEARTBEAT_BASE, NMT_COB_ID
from drivers.servo_drive.sdo import NMT_ENTER_PRE_OPERATIONAL, NMT_RESET_COMMUNICATION
from drivers.servo_drive.setup import set_up_drive
from drivers.wire_image import WireImage

WORST_REPLY_TIMEOUTS = 3
"""RTU: a reply later than this many time-outs is taken for impossible, unless the bench file says otherwise."""

CALLS_A_LINE = 2
"""System calls for Modbus TCP in one scan: two for each line that measures and two for all that are slow.

A look for each reply that is due, and requests in what is left of them. Every scan shall cost the same: of the slow
devices a request may have to wait for the next scan when both their replies came in this one.
"""

_NO_ORDERS = Orders(*[0] * len(Orders._fields))


def in_scans(seconds: float, period_ns: int) -> int:
    """Duration as a number of scans, at least one, to the nearest."""
    return max(1, round(seconds * 1e9 / period_ns))


class WireBench:
    """The bench on wires; see the module's text for when each method may be called."""

    def __init__(self, config: WireBenchConfig) -> None:
        """Prepare everything that the scan needs; raises ProfileError when a profile does not fit its part."""
        self.config = config
        check_parts(config)
        self._lines: dict[str, ModbusLine] = {}
        self._link: CanLink | None = None
        self._drive: CanDrive | None = None
        self.pace = None if config.pace is None else Pace(config.pace)
        measuring = [(one.name, self._device(one.modbus)) for one in config.measuring]
        if config.amplifier is not None:
            measuring.append(("amplifier", self._device(config.amplifier)))
        self.amplifiers = tuple(device for _, device in measuring)
        """The Modbus devices that measure, with a device for each of their blocks."""
        self.output_brake = None if config.drive_brake is None else OutputBrake(config.drive_brake)
        named = [*measuring]
        if config.brake is not None:
            named.append(("brake", self._device(config.brake)))
        self.remote_io = self._device(config.remote_io)
        named.append(("remote_io", self.remote_io))
        devices = tuple(device for _, device in named)
        self._devices = devices
        self._named = {
            name: tuple(device for other, device in named if other == name) for name in config.modbus_devices
        }
        """Devices by their names in the bench file, in its order."""
        self._sharing = [
            (line, tuple(device for device in devices if device.line is line)) for line in self._lines.values()
        ]
        """Lines with their devices in the order of their turns: those that measure are always the first."""
        self._measuring_lines = len({id(device.line) for device in self.amplifiers})
        self._most_calls = CALLS_A_LINE * (self._measuring_lines + 1)
        if config.drive_brake is not None and (
            problems := output_brake_problems(config.drive_brake, config.drive.profile)
        ):
            raise ProfileError(*problems)
        if problems := identifier_problems(
            config.can_sensors, config.drive.profile, config.drive.node_id, config.drive.controller_node_id
        ):
            raise ProfileError(*problems)
        self._can_frames = [
            (sensor.name, SensorFrame(one, synchronous=sensor.synchronous))
            for sensor in config.can_sensors
            for one in sensor.frames
        ]
        self._can_nodes: dict[int, tuple[str, SensorNode]] = {}
        """Names and nodes of the sensors that have a heartbeat, by the identifier of that."""
        self._composed = self._compose(measuring) if config.sources else None
        self._image = WireImage(
            self._composed or self.amplifiers[0], self.brake, self.remote_io, config.brake_fixed_current_a
        )
        self._requests_left = 0

    @property
    def brake(self) -> ModbusDevice | OutputBrake:
        """The brake, on Modbus or at the drive."""
        return self.output_brake or self._named["brake"][0]

    def _compose(self, measuring: list[tuple[str, ModbusDevice]]) -> ComposedSample:
        """Return the sample of channels from several devices; ProfileError when one names a field that is not there."""
        config = self.config
        feeds: list[tuple[str, ModbusDevice | SensorFrame]] = [*measuring, *self._can_frames]
        if problems := source_problems(config.sources, [(name, feed.names) for name, feed in feeds]):
            raise ProfileError(*problems)
        sources = [
            (source, next(feed for name, feed in feeds if name == source.device and feed.place(source.field) >= 0))
            for source in config.sources
        ]
        return ComposedSample(sources, config.period_ns)

    def _device(self, config: ModbusConfig) -> ModbusDevice:
        period_ns = self.config.period_ns
        line = self._lines.get(config.line)
        timeout_scans = in_scans(config.timeout_s, period_ns)
        worst_s = WORST_REPLY_TIMEOUTS * config.timeout_s if config.worst_reply_s is None else config.worst_reply_s
        drain_scans = in_scans(worst_s, period_ns)
        if line is None:
            line = self._lines[config.line] = ModbusLine(config, timeout_scans, drain_scans)
        # devices that share a line share its patience
        line.timeout_scans = max(line.timeout_scans, timeout_scans)
        line.drain_scans = max(line.drain_scans, drain_scans)
        return ModbusDevice(
            config, line, in_scans(config.poll_every_s, period_ns), in_scans(config.reassert_s, period_ns)
        )

    @property
    def drive(self) -> CanDrive:
        """The drive, once the bench has been opened."""
        if self._drive is None:
            raise RuntimeError("the bench was never opened: call open() before read() and write()")
        return self._drive

    def open(self) -> list[str]:
        """Connect, identify and set up everything (blocking); returns what was verified, one line each.

        Raises DriverError with the findings of all devices at once; the bench is then closed again.
        """
        log: list[str] = []
        problems: list[Problem] = []
        self._drive = None
        for line in self._lines.values():
            try:
                line.open()
            except ModbusError as error:
                problems += error.problems
        for device in self._devices:
            if not device.line.lost:
                problems += _identify(device, log)
        try:
            log += self._open_drive()
        except DriverError as error:
            problems += error.problems
        if self.pace is not None and not problems:
            try:
                self.pace.open(self.config.can.connect_timeout_s)
            except DriverError as error:
                problems += error.problems
            log.append(
                f"{self.pace.config.where}: a virtual bench with unit {self.pace.unit}, which waits for the scan"
            )
        if problems:
            self.close()
            raise DriverError(*problems)
        return log

    def _open_drive(self) -> list[str]:
        link = open_can(self.config.can)
        try:
            refuse_other_controller(link, self.config.drive)
        except DriverError:
            link.close()  # here, because `close` would reset a drive that is not ours
            raise
        self._link = link
        verified = set_up_drive(link, self.config.drive, self.config.period_ns)
        if problems := start_sensors(link, self.config.can_sensors, verified):
            raise DriverError(*problems)
        outputs = 0 if self.output_brake is None else read_outputs(link, self.config.drive)
        heartbeat_scans = in_scans(self.config.drive.controller_heartbeat_s, self.config.period_ns)
        self._can_nodes = dict(self._nodes())
        listeners: dict[int, Listener] = {frame.identifier: frame for _, frame in self._can_frames}
        listeners |= {identifier: node for identifier, (_, node) in self._can_nodes.items()}
        nodes = [sensor.node_id for sensor in self.config.can_sensors if sensor.node_id is not None]
        most_frames = frames_per_poll(self.config.period_ns, self.config.can.bitrate)
        self._drive = CanDrive(link, self.config.drive, heartbeat_scans, listeners, nodes, most_frames=most_frames)
        if self.output_brake is not None:
            self.output_brake.opened(self._drive, outputs)
        self._image.opened()
        return [f"{self.config.can.where}: open", *verified]

    def _nodes(self) -> Iterator[tuple[int, tuple[str, SensorNode]]]:
        """Yield the sensors whose heartbeat is watched, from now."""
        for sensor in self.config.can_sensors:
            if sensor.node_id is not None and sensor.heartbeat_s:
                frames = [frame for name, frame in self._can_frames if name == sensor.name]
                for frame in frames:
                    frame.lost = False
                node = SensorNode(frames, in_scans(sensor.heartbeat_s, self.config.period_ns))
                yield HEARTBEAT_BASE + sensor.node_id, (sensor.name, node)

    def begin(self) -> None:
        """Before the first scan (blocking): let a bench that waits do so, and count from here what goes both ways.

        Raises DriverError when it does not answer. Nothing is done where the bench has a clock of its own.
        """
        if self.pace is None:
            return
        self.pace.begin(self.config.period_ns)
        self.drive.link.count_from_now()
        for line in self._lines.values():
            line.count_from_now()
        for device in self._devices:
            device.requests = 0

    @property
    def in_step(self) -> bool:
        """Whether the bench waits for the scan, and has answered in time."""
        return self.pace is not None and self.pace.in_step

    def wait(self) -> int:
        """Wait, bounded, until a bench that waits has let the period pass; return the periods that we have missed.

        A bench with a clock of its own is not waited for.
        """
        pace = self.pace
        if pace is None:
            return 0
        missed = pace.wait()
        answer = pace.answer
        self.drive.link.frames_due = answer.frames
        due = zip(self._named.values(), answer.answered, strict=False)  # a message has room for more devices
        for line in self._lines.values():
            line.bytes_due = 0
        for devices, sent in due:
            devices[0].line.bytes_due += sent
        return missed

    def read(self, scan: int, missed_periods: int, command: int) -> Image:
        """Take what has arrived and return the image of this scan."""
        drive = self.drive
        drive.poll(scan, missed_periods)
        looks = 0
        for device in self._devices:
            looks += device.poll(scan)
        self._requests_left = self._most_calls - looks
        for _, node in self._can_nodes.values():
            node.look(scan)
        if self.output_brake is not None:
            self.output_brake.look()
        if self._composed is not None:
            self._composed.take(scan)
        return self._image.take(drive, scan, missed_periods, command)

    def write(self, orders: Orders, scan: int) -> None:
        """Send the orders of this scan and the Modbus requests that are due."""
        self.drive.send(orders, scan)
        if self.brake.age_scans(scan) != AGE_NEVER:
            # a lock is ordered to nothing before it is known whether it is closed: it may hold a wound-up unit
            self.brake.order({"brake_on": orders.brake_on, "brake_current_a": orders.brake_current_a})
        self._request(scan)
        if self.pace is not None:
            requests = tuple([sum([one.requests for one in devices]) for devices in self._named.values()])
            self.pace.scan_ended(scan, orders.state, self.drive.link.frames_sent, requests)

    def _request(self, scan: int) -> None:
        """Send the Modbus requests that are due, as many as a scan may; who had to wait comes before others next."""
        left, waiting = self._requests_left, None
        for sharing in self._sharing:
            line, devices = sharing
            if line.ready(scan):
                device = devices[0] if len(devices) == 1 else max(devices, key=lambda one: one.urgency(scan))
                if left:
                    left -= device.send(scan)
                elif device.urgency(scan) >= 0:
                    waiting = sharing
        if waiting is not None:
            self._sharing.remove(waiting)
            self._sharing.insert(self._measuring_lines, waiting)

    def close(self) -> None:
        """Take the drive's power away, stop its process data, close everything; safe to call twice."""
        if self.pace is not None:
            self.pace.close()
        if self._link is not None:
            if self._drive is not None:
                off = _NO_ORDERS._replace(
                    drive_command=DriveCommand.DISABLE_VOLTAGE, drive_mode=DriveMode.CYCLIC_SYNC_TORQUE
                )
                self._drive.send(off, 0)
            # the reset ends the supervision of our heartbeat too: a regular end is not an emergency
            for nmt_command in (NMT_ENTER_PRE_OPERATIONAL, NMT_RESET_COMMUNICATION):
                data = bytes((nmt_command, self.config.drive.node_id))
                self._link.send(can.Message(arbitration_id=NMT_COB_ID, is_extended_id=False, data=data))
            self._link.close()
        self._link = None
        for line in self._lines.values():
            line.close()

    def counters(self) -> dict[str, int]:
        """Trouble on the wires since the start, by part, for the record and for diagnosis."""
        drive = self.drive
        counts = {
            "can.sends_failed": drive.link.sends_failed,
            "can.frames_malformed": drive.frames_malformed,
            "can.frames_foreign": drive.frames_foreign,
            "drive.setpoints_clamped": drive.setpoints_clamped,
        }
        for name, blocks in self._named.items():
            line = blocks[0].line
            counts |= {
                f"{name}.replies": sum(block.replies for block in blocks),
                f"{name}.timeouts": line.timeouts,
                f"{name}.garbage": line.garbage,
                f"{name}.strangers": line.strangers,
                f"{name}.exceptions": sum(block.exceptions for block in blocks),
                f"{name}.identity_mismatches": sum(block.identity_mismatches for block in blocks),
                f"{name}.malformed": sum(block.malformed for block in blocks),
                f"{name}.orders_clamped": sum(block.writer.clamped for block in blocks),
            }
        for name in dict.fromkeys(name for name, _ in self._can_frames):
            frames = [frame for other, frame in self._can_frames if other == name]
            counts[f"{name}.frames"] = sum(frame.frames for frame in frames)
            counts[f"{name}.malformed"] = sum(frame.malformed for frame in frames)
        for name, node in self._can_nodes.values():
            counts |= {f"{name}.heartbeats": node.heartbeats, f"{name}.nmt_state": node.state}
        return counts


def _identify(device: ModbusDevice, log: list[str]) -> list[Problem]:
    config = device.config
    identity = config.profile.identity
    reply = device.verify()
    check = "check power, address, unit id, baud rate"
    if identity is None:
        if reply.outcome is not Outcome.DATA:
            return [Problem("does not answer", config.where, _ended(reply), "its registers", check)]
        log.append(f"{config.where} answers; it has no identity: not checked")
        return []
    where = f"{config.where} {identity.table} register {identity.address}"
    if reply.outcome is not Outcome.DATA:
        return [Problem("identity cannot be read", where, _ended(reply), identity.shown, check)]
    if not device.trusted:
        found = f"0x{reply.data.hex().upper()}"
        return [Problem("another device answers", where, found, identity.shown, "check address, unit id and profile")]
    log.append(f"{where} identity = {identity.shown}: checked")
    return []


def _ended(reply: Reply) -> str:
    return f"{reply.outcome.name.lower()} {reply.exception_code or ''}".strip()
