"""The servo drive inside the scan: process data, heartbeat and emergency messages, by struct and by hand.

`poll` drains what has arrived, `send` sends set-points, SYNC and our heartbeat once each. Nothing waits, nothing
raises: a frame of the wrong length is counted and its value keeps ageing, a set-point that does not fit its object is
clamped, counted, and shows as an internal limit in the next image.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from math import ceil
from operator import attrgetter
from types import MappingProxyType
from typing import NamedTuple, Protocol

from definitions.image import AGE_NEVER, DriveCommand, DriveMode, DriveState, NmtState, Orders
from definitions.number_formats import IGNORED
from definitions.profiles.drive import ReceivePdo
from definitions.protections import NONE
from drivers.can.bus import CanLink
from drivers.can.other_controller import OurFrames
from drivers.can.wires import Frame
from drivers.config import DriveConfig
from drivers.servo_drive.cia402 import control_word, decode_state
from drivers.servo_drive.data_types import picker, to_integer
from drivers.servo_drive.pdo import (
    EMCY_BASE,
    HEARTBEAT_BASE,
    SYNC_COB_ID,
    PdoCodec,
    rpdo_cob_id,
    tpdo_cob_id,
)
from drivers.servo_drive.units import drive_units

FRAMES_PER_POLL = 64
"""Frames that a scan takes at least, where so many have come; see `frames_per_poll`."""

MOST_FRAMES_PER_POLL = 1024
"""Frames that a scan takes at most, whatever period and bus: more than any CAN bus delivers in 20 ms."""

BUSES_PER_POLL = 2
"""How many full buses a scan keeps up with, so that a queue that has formed becomes shorter."""

SHORTEST_FRAME_BITS = 47
"""Bits on the bus of a frame without data and stuffed bits, with the gap behind it (ISO 11898-1)."""

POLLS_AFTER_GAP = 8
"""After missed periods the queue is long and the scan is late anyway: drain to the newest frames at once."""

FRAMES_AFTER_GAP = POLLS_AFTER_GAP * FRAMES_PER_POLL
"""Frames that a scan after missed periods takes at least, where so many have come."""

VELOCITY_SCANS_AFTER_CSV = 10
"""Zero velocity is sent this long after the velocity mode was left, so that no old set-point waits in the drive."""

OTHER_HEARD_FOR_S = 3.0
"""Another controller counts as there for so long after its last frame: it may send a heartbeat each second only."""

SILENT_AFTER_SCANS = 50
"""Age of the process data from which on a drive that is to be off gets no set-points any more.

Whether it obeyed cannot be seen, and one that misses SYNC never does, for it waits with what it was sent. Without
set-points its own time-out (0x1400:5, read back before the scan) takes the torque away, where its stack watches that
without SYNC; elsewhere nothing but its power being cut does.
"""

SCAN_VALUES = (
    "statusword",
    "mode_display",
    "actual_torque",
    "actual_position",
    "actual_velocity",
    "error_register",
)
"""What every scan looks at."""

# Asked in every scan: a member looked up by its class costs twenty times as much.
_DISABLE_VOLTAGE, _FAULT_RESET = DriveCommand.DISABLE_VOLTAGE, DriveCommand.FAULT_RESET
_START_HOMING, _ENABLE_OPERATION = DriveCommand.START_HOMING, DriveCommand.ENABLE_OPERATION
_VELOCITY, _TORQUE, _HOMING = DriveMode.CYCLIC_SYNC_VELOCITY, DriveMode.CYCLIC_SYNC_TORQUE, DriveMode.HOMING
_BEFORE_THE_SCAN = -1
_SCAN_OF = attrgetter("scan")
_EMCY_BYTES = 8
_FAULTED = frozenset({DriveState.FAULT, DriveState.FAULT_REACTION_ACTIVE})


def frames_per_poll(period_ns: int, bitrate: int) -> int:
    """Return how many frames a scan takes at most: `BUSES_PER_POLL` times what a full bus delivers in a period.

    A babbling bus must not hold a scan. What is left is drained in the next one, and data count as old until then; so
    no bus that works may deliver more than this for long. `bitrate`: of the bus [bit/s].
    """
    full = period_ns * 1e-9 * bitrate / SHORTEST_FRAME_BITS
    return min(max(FRAMES_PER_POLL, ceil(BUSES_PER_POLL * full)), MOST_FRAMES_PER_POLL)


class Listener(Protocol):
    """Who takes frames of another node than the drive."""

    def take(self, data: bytes, scan: int) -> None:
        """Take a frame that has arrived for this scan."""


_NO_LISTENERS: Mapping[int, Listener] = MappingProxyType({})


class Emergency(NamedTuple):
    """One emergency message as received."""

    scan: int
    code: int
    error_register: int
    vendor: bytes


class _Receiver:
    """One transmit PDO of the drive: where its values go in `CanDrive._numbers`, and the scan they came in."""

    __slots__ = ("places", "scan", "size", "unpack")

    def __init__(self, codec: PdoCodec, first: int) -> None:
        self.size, self.unpack = codec.size, codec.unpack
        self.places = slice(first, first + len(codec.names))
        self.scan = -1


class _Sender:
    """One receive PDO of the drive: its identifier, its codec, which set-points it takes, and what else is in it."""

    __slots__ = ("cob_id", "constants", "only_velocity", "pack", "picked")

    def __init__(self, pdo: ReceivePdo, node_id: int, names: tuple[str, ...]) -> None:
        codec = PdoCodec(pdo.objects)
        self.pack = codec.pack
        self.cob_id = rpdo_cob_id(pdo, node_id)
        self.constants = tuple(item.value for item in pdo.objects if item.name == IGNORED)
        constants = iter(range(len(names), len(names) + len(self.constants)))
        self.picked = picker([next(constants) if name == IGNORED else names.index(name) for name in codec.names])
        self.only_velocity = codec.names == ("target_velocity",)


class CanDrive:
    """The drive as the scan sees it. Attributes hold what was last received, in the drive's own numbers."""

    def __init__(
        self,
        link: CanLink,
        config: DriveConfig,
        heartbeat_scans: int,
        listeners: Mapping[int, Listener] = _NO_LISTENERS,
        sensor_nodes: Iterable[int] = (),
        *,
        most_frames: int = FRAMES_PER_POLL,
    ) -> None:
        """Prepare every frame and table; `heartbeat_scans`: scans between two of our heartbeats.

        Emergencies of the drive that came while the bench was set up count from the first scan on.
        `listeners`: who takes the frames of other nodes, by their identifiers. `sensor_nodes`: the sensors that have a
        node id, which nobody else may write to. `most_frames`: that a scan takes, as `frames_per_poll` has it.
        """
        self._most_frames, self._listeners = most_frames, dict(listeners)
        self.link = link
        self.units = drive_units(config)
        self.homes = bool(config.profile.homing_method)
        """Whether the drive has a homing mode. Without one it stays in torque mode and gets none, and the present
        position is taken as the reference here (`homing_ordered`, `reference_ordered`)."""
        self.says_it_follows = config.profile.protections.follows_command != NONE
        self.homing_ordered = self.reference_ordered = False
        self.digital_outputs = 0
        """Outputs that go out with the set-points, as bits of 0x60FE:1."""
        self.nmt_state = int(NmtState.NEVER_HEARD)
        self.emcy_code = 0
        self.emergencies: deque[Emergency] = deque(maxlen=32)
        self.frames_malformed = self.frames_foreign = 0
        self._ours = OurFrames(config, sensor_nodes)
        self._other_until_scan = -1
        self._other_heard_for_scans = ceil(OTHER_HEARD_FOR_S * heartbeat_scans / config.controller_heartbeat_s)
        self.setpoints_clamped = 0
        self.setpoint_is_clamped = False
        self._polls_with_frames_left = 0
        self._emcy_withdrawn = self._reset_asked = False
        self._emcy_scan = self._heartbeat_scan = -1
        """Scans in which the last emergency with a code came, and the last heartbeat."""
        self._heartbeat_sent_scan = -heartbeat_scans
        self._heartbeat_scans = heartbeat_scans
        self._velocity_scans_left = 0
        self._mode = self._mode_number = 0
        self._mode_clamped = False
        self._receivers: dict[int, _Receiver] = {}
        self._places: dict[str, int] = {}
        count = 0
        for pdo in config.profile.transmit_pdos:
            codec = PdoCodec(pdo.objects)
            self._receivers[tpdo_cob_id(pdo, config.node_id)] = _Receiver(codec, count)
            self._places |= {name: count + position for position, name in enumerate(codec.names)}
            count += len(codec.names)
        self._all_receivers = tuple(self._receivers.values())
        self._process_data_scan = -1
        """Scan in which the oldest of the process data came; -1 while one of them has never come."""
        self._unmapped, self._emcy_register = count, count + 1
        self._places.setdefault("error_register", self._emcy_register)
        self._numbers = [0] * (count + 2)
        """Last received numbers of the mapped objects, a zero, and the error register of the last emergency message."""
        self._picked = picker([self._places.get(name, self._unmapped) for name in SCAN_VALUES])
        names = ("controlword", "mode", "target_torque", "target_velocity", "digital_outputs")
        self._senders = tuple(_Sender(pdo, config.node_id, names) for pdo in config.profile.receive_pdos)
        self._heartbeat_cob_id = HEARTBEAT_BASE + config.node_id
        self._emcy_cob_id = EMCY_BASE + config.node_id
        for data in link.early.pop(self._emcy_cob_id, ()):
            self._take_emergency(data, _BEFORE_THE_SCAN)
        self._sync: Frame = (SYNC_COB_ID, b"")
        self._heartbeat: Frame = (HEARTBEAT_BASE + config.controller_node_id, bytes((NmtState.OPERATIONAL,)))

    def poll(self, scan: int, missed_periods: int = 0) -> None:
        """Take everything that has arrived for scan number `scan`, which comes `missed_periods` late."""
        if self._emcy_withdrawn:  # an emergency and its reset in one scan: the emergency was seen for that scan
            self._emcy_withdrawn = False
            self.emcy_code = 0
        link, receivers, numbers = self.link, self._receivers, self._numbers
        frames = link.take(self._most_frames * (POLLS_AFTER_GAP if missed_periods else 1))
        for cob_id, data in frames:
            receiver = receivers.get(cob_id)
            if receiver is None:
                self._take_other(cob_id, data, scan)
            elif len(data) == receiver.size:
                numbers[receiver.places] = receiver.unpack(data)
                receiver.scan = scan
            else:
                self.frames_malformed += 1
        if frames:
            self._process_data_scan = min(map(_SCAN_OF, self._all_receivers))
        self._polls_with_frames_left = self._polls_with_frames_left + 1 if link.frames_wait else 0
        if self._reset_asked and self.age_scans(scan) == 0:
            self._after_reset(scan)

    def _take_other(self, cob_id: int, data: bytes, scan: int) -> None:
        """Take a frame that is no process data."""
        if cob_id == self._heartbeat_cob_id:
            if len(data) == 1:
                self.nmt_state = data[0] & 0x7F
                self._heartbeat_scan = scan
            else:
                self.frames_malformed += 1
        elif cob_id == self._emcy_cob_id:
            self._take_emergency(data, scan)
        else:
            listener = self._listeners.get(cob_id)
            if listener is None:
                self.frames_foreign += 1
                if self._ours.name_of(cob_id, data):  # no bus gives us our own frames back: somebody else has sent it
                    self._other_until_scan = scan + self._other_heard_for_scans
            else:
                listener.take(data, scan)

    def _take_emergency(self, data: bytes, scan: int) -> None:
        if len(data) != _EMCY_BYTES:
            self.frames_malformed += 1
            return
        code = data[0] | data[1] << 8
        self._numbers[self._emcy_register] = data[2]
        self.emergencies.append(Emergency(scan, code, data[2], data[3:]))
        if code:
            self.emcy_code, self._emcy_scan = code, scan
            self._emcy_withdrawn = False
        elif data[2]:  # one of several errors is gone; the register says that others remain (CiA 301, 7.2.7.1)
            self._emcy_withdrawn = False
        elif self._emcy_scan == scan:
            self._emcy_withdrawn = True
        else:
            self.emcy_code = 0

    def other_commands(self, scan: int) -> bool:
        """Tell whether another controller was heard lately: a frame that only we may send has come.

        It stays so for `OTHER_HEARD_FOR_S`, so that one that sends now and then is not gone between two of its frames.
        """
        return scan <= self._other_until_scan

    def _after_reset(self, scan: int) -> None:
        # Some drives never send the "error reset" message: leaving the fault state after our reset says the same of
        # what was told before. An emergency of this very scan is a new one.
        if decode_state(self.value("statusword")) not in _FAULTED:
            self._reset_asked = False
            if self._emcy_scan != scan:
                self.emcy_code = 0

    def value(self, name: str) -> int:
        """Return the last received number of a mapped object; 0 before the first and for an unmapped one.

        The error register 0x1001 comes from process data where it is mapped, else from the last emergency message.
        """
        return self._numbers[self._places.get(name, self._unmapped)]

    def scan_values(self) -> tuple[int, ...]:
        """Return the values of `SCAN_VALUES`, in their order."""
        return self._picked(self._numbers)

    def age_scans(self, scan: int) -> int:
        """Age of the oldest process data at scan number `scan`; frames left in the queue make it older."""
        came = self._process_data_scan
        age = scan - came + self._polls_with_frames_left
        return age if came >= 0 and age < AGE_NEVER else AGE_NEVER

    def heartbeat_age_scans(self, scan: int) -> int:
        """Age of the last heartbeat at scan number `scan`."""
        came = self._heartbeat_scan
        age = scan - came + self._polls_with_frames_left
        return age if came >= 0 and age < AGE_NEVER else AGE_NEVER

    def _without_homing(self, orders: Orders) -> Orders:
        """Return orders for a drive that does not home: while it should, it is in torque mode with no torque."""
        self.homing_ordered = orders.drive_mode == _HOMING
        self.reference_ordered = orders.drive_command == _START_HOMING
        if self.homing_ordered:
            orders = orders._replace(drive_mode=_TORQUE, drive_target_torque_nm=0.0)
        return orders._replace(drive_command=_ENABLE_OPERATION) if self.reference_ordered else orders

    def send(self, orders: Orders, scan: int) -> None:
        """Send the set-points of one scan (see `SILENT_AFTER_SCANS`), then SYNC, then our heartbeat when it is due."""
        if not self.homes:
            orders = self._without_homing(orders)
        command, mode, torque_nm = orders.drive_command, orders.drive_mode, orders.drive_target_torque_nm
        torque, torque_clamped = to_integer(torque_nm / self.units.torque_nm_per_count, "i16")
        velocity, velocity_clamped = 0, False
        if mode == _VELOCITY:
            counts = orders.drive_target_velocity_rad_s / self.units.velocity_rad_s_per_count
            velocity, velocity_clamped = to_integer(counts, "i32")
            self._velocity_scans_left = VELOCITY_SCANS_AFTER_CSV
        if mode != self._mode:
            self._mode = mode
            self._mode_number, self._mode_clamped = to_integer(mode, "i8")
        self.setpoint_is_clamped = torque_clamped or velocity_clamped or self._mode_clamped
        if self.setpoint_is_clamped:
            self.setpoints_clamped += 1
        if command == _FAULT_RESET:
            self._reset_asked = True
        numbers = (control_word(command), self._mode_number, torque, velocity, self.digital_outputs)
        frames: list[Frame] = []
        silent = command == _DISABLE_VOLTAGE and SILENT_AFTER_SCANS <= self.age_scans(scan) < AGE_NEVER
        for sender in () if silent else self._senders:
            if sender.only_velocity and not self._velocity_scans_left:
                continue
            frames.append((sender.cob_id, sender.pack(*sender.picked(numbers + sender.constants))))
        if mode != _VELOCITY and self._velocity_scans_left:
            self._velocity_scans_left -= 1
        frames.append(self._sync)
        if scan - self._heartbeat_sent_scan >= self._heartbeat_scans:
            self._heartbeat_sent_scan = scan
            frames.append(self._heartbeat)
        self.link.send_frames(frames)
