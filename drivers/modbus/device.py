"""One Modbus device in the scan: which request is next, what its reply means, how old its values are.

A device is read every n scans. An order is written when it changes, again until the device acknowledged it, and again
from time to time even when unchanged, so that neither a lost write nor a device that restarted keeps an old value.
Before the first value and after every resynchronisation of the line the identity is read; a read block that contains
the identity is checked at every reply. A device that has none is believed from the first reply that fits its request.
"""

from __future__ import annotations

from collections.abc import Mapping

from definitions.image import AGE_NEVER
from drivers.config import ModbusConfig
from drivers.modbus.frames import Outcome, Reply, Request
from drivers.modbus.line import ModbusLine
from drivers.modbus.registers import RegisterWriter, identity_registers, reader_of

EXCEPTIONS_IN_A_ROW = 3
"""Exception replies after which the connection counts as lost; one alone may be a device that is busy."""

NO_FIELD = -1
NEVER_ASKED = 1 << 30
"""Scans that a device is overdue which was never read."""

COUNTERS = ("sample_counter", "life_counter")
"""Fields in which a device counts its own samples or cycles: values are new only when the counter has moved."""


class ModbusDevice:
    """A device on a line. `values` holds the last trusted reply, with a zero at the end for fields it does not have."""

    def __init__(self, config: ModbusConfig, line: ModbusLine, poll_scans: int, reassert_scans: int) -> None:
        """Prepare all requests; times in scans: between two reads, and between writes of an unchanged order."""
        profile = config.profile
        self.config = config
        self.line = line
        self.reader = reader_of(profile)
        self.writer = RegisterWriter(profile)
        self.values: list[float] = [0] * (len(self.reader.names) + 1)
        self.requests = 0
        self.replies = 0
        self.exceptions = 0
        self.last_exception = 0
        self.identity_mismatches = 0
        self.malformed = 0
        self._poll_scans = poll_scans
        self._reassert_scans = reassert_scans
        self._exceptions_in_a_row = 0
        self._arrived_scan = -1
        counters = [self.place(name) for name in COUNTERS if name in self.reader.names]
        self._counter_place = counters[0] if counters else NO_FIELD
        identity = profile.identity
        block = profile.read
        self._read_request = line.frames.read_request(config.unit_id, block.table, block.address, block.count)
        self._identity_request: Request | None = None
        self._identity_place: slice | None = None
        self._identity = b""
        if identity is not None:
            self._identity_request = line.frames.read_request(
                config.unit_id, identity.table, identity.address, identity.count
            )
            first = identity.address - block.address
            if identity.table == block.table and 0 <= first <= block.count - identity.count:
                self._identity_place = slice(2 * first, 2 * (first + identity.count))
            self._identity = identity_registers(identity, profile.byte_order, profile.word_order)
        self._trusted_epoch = NO_FIELD
        self._pending: Request | None = None
        self._pending_is_write = False
        self._last_was_write = False
        self._read_scan: int | None = None
        self._orders: dict[str, float] = {}
        self._wanted: list[int] = []
        self._acknowledged: list[int] = []
        self._write_request: Request | None = None
        self._write_scan = 0
        self._written: list[int] = []

    @property
    def names(self) -> tuple[str, ...]:
        """Fields in `values`, in their order."""
        return self.reader.names

    def place(self, name: str) -> int:
        """Index of a field in `values`; NO_FIELD, which is the zero at the end, when the device has none."""
        return self.reader.names.index(name) if name in self.reader.names else NO_FIELD

    @property
    def trusted(self) -> bool:
        """True while the device's identity is proven for the line as it is now; always, when it has none."""
        return self._identity_request is None or self._trusted_epoch == self.line.epoch

    @property
    def lost(self) -> bool:
        """True while the connection is down or the device answers with exceptions only."""
        return self.line.lost or self._exceptions_in_a_row >= EXCEPTIONS_IN_A_ROW

    def age_scans(self, scan: int) -> int:
        """Age of the values; a counter that stands still (`COUNTERS`) makes them age although replies come."""
        came = self._arrived_scan
        return scan - came if came >= 0 and scan - came < AGE_NEVER else AGE_NEVER

    def measured_scan(self, scan: int, synced_scan: int) -> int:
        """Scan in which the values were asked for that came in `scan`: the earliest in which they can be measured."""
        del synced_scan
        return scan if self._read_scan is None else self._read_scan

    def ordered(self, name: str) -> float:
        """Return what was ordered last; 0 before."""
        return self._orders.get(name, 0.0)

    def order(self, orders: Mapping[str, float]) -> None:
        """Take the orders of this scan; they are written when the line has time."""
        if orders == self._orders:
            return
        self._orders = dict(orders)
        wanted = self.writer.registers(orders)
        if wanted != self._wanted:
            self._wanted = wanted
            block = self.config.profile.write
            if block is not None:
                self._write_request = self.line.frames.write_request(
                    self.config.unit_id, block.table, block.address, wanted, single=block.single
                )

    def poll(self, scan: int) -> bool:
        """Take the reply to this device's request, if it came; return whether the line was looked at for it."""
        request = self._pending
        if request is None:
            return False
        reply = self.line.poll(scan)
        if reply is None:
            return True
        self._pending = None
        if reply.outcome is Outcome.DATA:
            self._exceptions_in_a_row = 0
            self.replies += 1
            self._take(request, reply.data, scan)
        elif reply.outcome is Outcome.EXCEPTION:
            self.exceptions += 1
            self._exceptions_in_a_row += 1
            self.last_exception = reply.exception_code
        return True

    def _take(self, request: Request, registers: bytes, scan: int) -> None:
        place = self._identity_place
        if self._pending_is_write:
            self._acknowledged = self._written
        elif request is self._identity_request:
            if registers == self._identity:
                self._trusted_epoch = self.line.epoch
            else:
                self.identity_mismatches += 1
        elif place is not None and registers[place] != self._identity:
            self.identity_mismatches += 1
            self._trusted_epoch = NO_FIELD
        else:
            self._take_values(registers, scan)

    def _take_values(self, registers: bytes, scan: int) -> None:
        values = self.reader.values(registers)
        if values is None:
            self.malformed += 1
            return
        counter = self._counter_place
        if counter < 0 or values[counter] != self.values[counter] or self._arrived_scan < 0:
            self._arrived_scan = scan
        values.append(0)
        self.values = values

    def urgency(self, scan: int) -> int:
        """Tell how many scans the next request is overdue; negative when none is due."""
        if self._pending is not None:
            return -1
        overdue = self._read_overdue(scan)
        if self.trusted and self._write_due(scan):
            return max(overdue, 0)
        return overdue

    def send(self, scan: int) -> bool:
        """Send the next request, if one is due; return whether one went out. The line must be ready."""
        read_due = self._read_scan is None or scan - self._read_scan >= self._poll_scans
        if self._pending is not None or not (read_due or self._write_request):
            return False
        if not self.trusted:
            if read_due:
                self._read_scan = scan
                return self._start(self._identity_request, scan)
        elif self._write_due(scan) and not (read_due and self._last_was_write):
            self._written = self._wanted
            self._write_scan = scan
            return self._start(self._write_request, scan, is_write=True)
        elif read_due:
            self._read_scan = scan
            return self._start(self._read_request, scan)
        return False

    def _read_overdue(self, scan: int) -> int:
        # never asked: before one of its line that has been and is due again in every scan
        return NEVER_ASKED if self._read_scan is None else scan - self._read_scan - self._poll_scans

    def _write_due(self, scan: int) -> bool:
        if self._write_request is None:
            return False
        return self._wanted != self._acknowledged or scan - self._write_scan >= self._reassert_scans

    def _start(self, request: Request | None, scan: int, *, is_write: bool = False) -> bool:
        if request is None or not self.line.send(request, scan):
            return False
        self.requests += 1
        self._pending = request
        self._pending_is_write = is_write
        self._last_was_write = is_write
        return True

    def verify(self) -> Reply:
        """Blocking, before the scan: read the identity and trust the line when it fits.

        A device without an identity is asked for its values: it must answer.
        """
        reply = self.line.exchange(self._identity_request or self._read_request, self.config.connect_timeout_s)
        if reply.outcome is Outcome.DATA and reply.data == self._identity:
            self._trusted_epoch = self.line.epoch
        return reply
