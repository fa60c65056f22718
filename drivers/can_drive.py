"""The servo drive inside the scan: process data, heartbeat and emergency messages, by struct and by hand.

`poll` drains what has arrived, `send` sends set-points, SYNC and our heartbeat once each. Nothing waits, nothing
raises: a frame of the wrong length is counted and its value keeps ageing, a set-point that does not fit its object is
clamped, counted, and shows as an internal limit in the next image.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import can

from controller.image import AGE_NEVER, DriveCommand, DriveMode, DriveState, NmtState, Orders
from drivers.can_bus import CanLink
from drivers.cia402 import control_word, decode_state
from drivers.config import DriveConfig
from drivers.data_types import to_integer
from drivers.drive_units import drive_units
from drivers.pdo import EMCY_BASE, HEARTBEAT_BASE, SYNC_COB_ID, PdoCodec, rpdo_cob_id, tpdo_cob_id
from drivers.profile import ReceivePdo

FRAMES_PER_POLL = 64
"""A babbling bus must not hold a scan; what is left is drained in the next one, and data count as old until then."""

FRAMES_AFTER_GAP = 512
"""After missed periods the queue is long and the scan is late anyway: drain to the newest frames at once."""

VELOCITY_SCANS_AFTER_CSV = 10
"""Zero velocity is sent this long after the velocity mode was left, so that no old set-point waits in the drive."""

SILENT_AFTER_SCANS = 50
"""Age of the process data from which on a drive that is to be off gets no set-points any more.

Whether it obeyed cannot be seen, and one that misses SYNC never does, for it waits with what it was sent. Without
set-points its own time-out (0x1400:5, read back before the scan) takes the torque away.
"""

_EMCY_BYTES = 8
_FAULTED = frozenset({DriveState.FAULT, DriveState.FAULT_REACTION_ACTIVE})


class Emergency(NamedTuple):
    """One emergency message as received."""

    scan: int
    code: int
    error_register: int
    vendor: bytes


class _Receiver:
    """One transmit PDO of the drive: its codec, its last values, the scan they came in."""

    __slots__ = ("codec", "scan", "values")

    def __init__(self, codec: PdoCodec) -> None:
        self.codec = codec
        self.values: tuple[int, ...] = (0,) * len(codec.names)
        self.scan = -1


class _Sender:
    """One receive PDO of the drive: its codec and the frame that is filled anew for every send."""

    __slots__ = ("codec", "data", "message", "only_velocity", "sources")

    def __init__(self, pdo: ReceivePdo, node_id: int, names: tuple[str, ...]) -> None:
        self.codec = PdoCodec(pdo.objects)
        self.data = bytearray(self.codec.size)
        self.message = _message(rpdo_cob_id(pdo.number, node_id), self.data)
        self.sources = tuple(names.index(name) for name in self.codec.names)
        self.only_velocity = self.codec.names == ("target_velocity",)


def _message(cob_id: int, data: bytes | bytearray) -> can.Message:
    return can.Message(arbitration_id=cob_id, is_extended_id=False, data=data)


class CanDrive:
    """The drive as the scan sees it. Attributes hold what was last received, in the drive's own numbers."""

    def __init__(self, link: CanLink, config: DriveConfig, heartbeat_scans: int) -> None:
        """Prepare every frame and table; `heartbeat_scans`: scans between two of our heartbeats."""
        self.link = link
        self.units = drive_units(config)
        self.nmt_state = int(NmtState.NEVER_HEARD)
        self.emcy_code = 0
        self.emergencies: deque[Emergency] = deque(maxlen=32)
        self.frames_malformed = 0
        self.frames_foreign = 0
        self.setpoints_clamped = 0
        self.setpoint_is_clamped = False
        self._waiting: can.Message | None = None
        self._polls_with_frames_left = 0
        self._error_register = 0
        self._emcy_withdrawn = False
        self._reset_asked = False
        self._heartbeat_scan = -1
        self._heartbeat_sent_scan = -heartbeat_scans
        self._heartbeat_scans = heartbeat_scans
        self._velocity_scans_left = 0
        self._receivers = {
            tpdo_cob_id(pdo.number, config.node_id): _Receiver(PdoCodec(pdo.objects))
            for pdo in config.profile.transmit_pdos
        }
        self._all_receivers = tuple(self._receivers.values())
        self._places = {
            name: (receiver, position)
            for receiver in self._all_receivers
            for position, name in enumerate(receiver.codec.names)
        }
        names = ("controlword", "mode", "target_torque", "target_velocity")
        self._senders = tuple(_Sender(pdo, config.node_id, names) for pdo in config.profile.receive_pdos)
        self._heartbeat_cob_id = HEARTBEAT_BASE + config.node_id
        self._emcy_cob_id = EMCY_BASE + config.node_id
        self._sync = _message(SYNC_COB_ID, b"")
        self._heartbeat = _message(HEARTBEAT_BASE + config.controller_node_id, bytes((NmtState.OPERATIONAL,)))

    def poll(self, scan: int, missed_periods: int = 0) -> None:
        """Take everything that has arrived for scan number `scan`, which comes `missed_periods` late."""
        if self._emcy_withdrawn:  # an emergency and its reset in one scan: the emergency was seen for that scan
            self._emcy_withdrawn = False
            self.emcy_code = 0
        receive = self.link.receive
        if self._waiting is not None:
            self._take(self._waiting, scan)
            self._waiting = None
        for count in range(FRAMES_AFTER_GAP if missed_periods else FRAMES_PER_POLL):
            message = receive()
            if message is None:
                if count == 0:
                    self.link.check_peer()
                self._polls_with_frames_left = 0
                break
            self._take(message, scan)
        else:
            self._waiting = receive()  # python-can has no way to look without taking
            self._polls_with_frames_left = 0 if self._waiting is None else self._polls_with_frames_left + 1
        if self._reset_asked and self.age_scans(scan) == 0:
            self._after_reset()

    def _take(self, message: can.Message, scan: int) -> None:
        if message.is_extended_id or message.is_remote_frame or message.is_error_frame:
            self.frames_foreign += 1
            return
        cob_id = message.arbitration_id
        data = message.data
        receiver = self._receivers.get(cob_id)
        if receiver is not None:
            if len(data) == receiver.codec.size:
                receiver.values = receiver.codec.unpack(data)
                receiver.scan = scan
            else:
                self.frames_malformed += 1
        elif cob_id == self._heartbeat_cob_id:
            if len(data) == 1:
                self.nmt_state = data[0] & 0x7F
                self._heartbeat_scan = scan
            else:
                self.frames_malformed += 1
        elif cob_id == self._emcy_cob_id:
            self._take_emergency(data, scan)
        else:
            self.frames_foreign += 1

    def _take_emergency(self, data: bytearray, scan: int) -> None:
        if len(data) != _EMCY_BYTES:
            self.frames_malformed += 1
            return
        code = data[0] | data[1] << 8
        self._error_register = data[2]
        self.emergencies.append(Emergency(scan, code, data[2], bytes(data[3:])))
        if code:
            self.emcy_code = code
            self._emcy_withdrawn = False
        elif self.emergencies_in(scan):
            self._emcy_withdrawn = True
        else:
            self.emcy_code = 0

    def emergencies_in(self, scan: int) -> int:
        """Count the emergencies with a code that came in scan number `scan`."""
        return sum(1 for emergency in self.emergencies if emergency.scan == scan and emergency.code)

    def _after_reset(self) -> None:
        # Some drives never send the "error reset" message: leaving the fault state after our reset says the same.
        if decode_state(self.value("statusword")) not in _FAULTED:
            self._reset_asked = False
            self.emcy_code = 0

    def value(self, name: str) -> int:
        """Return the last received number of a mapped object; 0 before the first and for an unmapped one."""
        place = self._places.get(name)
        return place[0].values[place[1]] if place else 0

    @property
    def error_register(self) -> int:
        """Error register 0x1001, from process data where mapped, else from the last emergency message."""
        place = self._places.get("error_register")
        return place[0].values[place[1]] if place else self._error_register

    @property
    def scan_of_process_data(self) -> int:
        """Scan in which the oldest of the process data came; -1 while one of them has never come."""
        return min([receiver.scan for receiver in self._all_receivers])

    def age_scans(self, scan: int) -> int:
        """Age of the oldest process data at scan number `scan`; frames left in the queue make it older."""
        came = self.scan_of_process_data
        return AGE_NEVER if came < 0 else min(scan - came + self._polls_with_frames_left, AGE_NEVER)

    def heartbeat_age_scans(self, scan: int) -> int:
        """Age of the last heartbeat at scan number `scan`."""
        if self._heartbeat_scan < 0:
            return AGE_NEVER
        return min(scan - self._heartbeat_scan + self._polls_with_frames_left, AGE_NEVER)

    def send(self, orders: Orders, scan: int) -> None:
        """Send the set-points of one scan (see `SILENT_AFTER_SCANS`), then SYNC, then our heartbeat when it is due."""
        mode = orders.drive_mode
        torque, torque_clamped = to_integer(orders.drive_target_torque_nm / self.units.torque_nm_per_count, "i16")
        velocity, velocity_clamped = 0, False
        if mode == DriveMode.CYCLIC_SYNC_VELOCITY:
            counts = orders.drive_target_velocity_rad_s / self.units.velocity_rad_s_per_count
            velocity, velocity_clamped = to_integer(counts, "i32")
            self._velocity_scans_left = VELOCITY_SCANS_AFTER_CSV
        mode_number, mode_clamped = to_integer(mode, "i8")
        self.setpoint_is_clamped = torque_clamped or velocity_clamped or mode_clamped
        if self.setpoint_is_clamped:
            self.setpoints_clamped += 1
        if orders.drive_command == DriveCommand.FAULT_RESET:
            self._reset_asked = True
        numbers = (control_word(orders.drive_command), mode_number, torque, velocity)
        link_send = self.link.send
        unseen = SILENT_AFTER_SCANS <= self.age_scans(scan) < AGE_NEVER
        silent = unseen and orders.drive_command == DriveCommand.DISABLE_VOLTAGE
        for sender in () if silent else self._senders:
            if sender.only_velocity and not self._velocity_scans_left:
                continue
            sender.codec.pack_into(sender.data, 0, *[numbers[source] for source in sender.sources])
            link_send(sender.message)
        if mode != DriveMode.CYCLIC_SYNC_VELOCITY and self._velocity_scans_left:
            self._velocity_scans_left -= 1
        link_send(self._sync)
        if scan - self._heartbeat_sent_scan >= self._heartbeat_scans:
            self._heartbeat_sent_scan = scan
            link_send(self._heartbeat)
