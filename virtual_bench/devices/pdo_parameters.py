"""Parameters of the virtual drive's PDOs: communication (0x1400, 0x1800) and mapping (0x1600, 0x1A00).

Remapping follows CiA 301: PDO off (bit 31), number of entries 0, entries, number, PDO on; anything else is aborted.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

from durand import Node
from durand.datatypes import DatatypeEnum
from durand.object_dictionary import Array, Record, Variable
from durand.services.sdo.server import SDODomainAbort

from definitions.profiles.drive import ReceivePdo, TransmitPdo

INVALID = 1 << 31
NO_RTR = 1 << 30
RECEIVE_COMMUNICATION, RECEIVE_MAPPING, RECEIVE_COB = 0x1400, 0x1600, 0x200
TRANSMIT_COMMUNICATION, TRANSMIT_MAPPING, TRANSMIT_COB = 0x1800, 0x1A00, 0x180
PDO_COUNT = 4
SETPOINT_PDO = 1  # the receive PDO whose time-out (0x1400:5) this drive supervises
MAX_ENTRIES = 8
MAX_BITS = 64
EVENT_DRIVEN = 254  # and above
SYNCHRONOUS = 240  # transmission types up to this one follow SYNC
ABORT_NOT_NOW = 0x08000022
ABORT_NOT_MAPPABLE = 0x06040041
ABORT_TOO_LONG = 0x06040042
ABORT_VALUE = 0x06090030


class Refused(Exception):  # noqa: N818 - not an error of the program
    """A value that an object does not take, with the SDO abort code that says why."""

    def __init__(self, code: int) -> None:
        super().__init__(f"SDO abort {code:08X}")
        self.code = code


class Mappable(NamedTuple):
    """An object that may travel in a PDO."""

    letter: str  # of struct
    read: Callable[[], int]
    write: Callable[[int], None] | None


@dataclass
class Channel:
    """One PDO at work."""

    number: int
    cob_id: int
    transmission_type: int
    codec: struct.Struct = field(default_factory=lambda: struct.Struct("<"))
    readers: list[Callable[[], int]] = field(default_factory=list)
    writers: list[Callable[[int], None]] = field(default_factory=list)
    buffered: bytes | None = None
    syncs: int = 0
    inhibit_ns: int = 0
    event_timer_ns: int = 0
    sent_ns: int = -1
    sent: bytes = b""

    @property
    def valid(self) -> bool:
        """Whether the PDO is switched on and carries something."""
        return not self.cob_id & INVALID and bool(self.readers or self.writers)


class PdoParameters:
    """The parameter objects of one node's PDOs in its dictionary, and the channels that they make.

    `changed` is called when a PDO was switched or mapped anew.
    """

    def __init__(self, node: Node, mappable: dict[tuple[int, int], Mappable], changed: Callable[[], None]) -> None:
        self.channels: dict[int, Channel] = {}  # by index of the communication parameters
        self._node = node
        self._od = node.object_dictionary
        self._mappable = mappable
        self._changed = changed
        for number in range(1, PDO_COUNT + 1):
            self._build(number, transmit=False)
            self._build(number, transmit=True)

    def restore(self, receive: tuple[ReceivePdo, ...], transmit: tuple[TransmitPdo, ...]) -> None:
        """Set all PDOs to their defaults, as a reset of the communication does."""
        node_id = self._node.node_id
        for base, first_cob, flags, defaults in (
            (RECEIVE_COMMUNICATION, RECEIVE_COB, 0, {pdo.number: pdo for pdo in receive}),
            (TRANSMIT_COMMUNICATION, TRANSMIT_COB, NO_RTR, {pdo.number: pdo for pdo in transmit}),
        ):
            for number in range(1, PDO_COUNT + 1):
                index = base + number - 1
                pdo = defaults.get(number)
                cob_id = (first_cob + 0x100 * (number - 1) + node_id) | flags | (0 if pdo else INVALID)
                channel = self.channels[index]
                channel.cob_id, channel.transmission_type = cob_id, pdo.transmission_type if pdo else 255
                channel.inhibit_ns = channel.event_timer_ns = channel.syncs = 0
                channel.buffered = None
                self._store(index, {1: cob_id, 2: channel.transmission_type, 3: 0, 5: 0})
                objects = pdo.objects if pdo else ()
                entries = [self._entry(entry.index, entry.subindex) for entry in objects]
                self._store(index + 0x200, {0: len(entries), **dict(enumerate(entries, start=1))})
                self._remap(channel, entries, transmit=base == TRANSMIT_COMMUNICATION)

    def _build(self, number: int, *, transmit: bool) -> None:
        """Put the parameter records of one PDO into the dictionary."""
        od = self._od
        index = (TRANSMIT_COMMUNICATION if transmit else RECEIVE_COMMUNICATION) + number - 1
        mapping = index + 0x200
        channel = self.channels[index] = Channel(number, INVALID, 255)
        word = "Transmit" if transmit else "Receive"
        record = Record(name=f"{word} PDO {number} communication parameter")
        record[1] = Variable(DatatypeEnum.UNSIGNED32, "rw", INVALID, name="COB-ID")
        record[2] = Variable(DatatypeEnum.UNSIGNED8, "rw", 255, name="Transmission type")
        record[3] = Variable(DatatypeEnum.UNSIGNED16, "rw", 0, name="Inhibit time")
        record[5] = Variable(DatatypeEnum.UNSIGNED16, "rw", 0, name="Event timer")
        od[index] = record
        entry = Variable(DatatypeEnum.UNSIGNED32, "rw", 0, name="Mapped object")
        od[mapping] = Array(entry, length=MAX_ENTRIES, mutable=True, name=f"{word} PDO {number} mapping parameter")

        for subindex, take in (
            (1, self._take_cob_id),
            (2, self._take_transmission_type),
            (3, self._take_inhibit_time),
            (5, self._take_event_timer if transmit else self._take_timeout),
        ):
            self._check_write(index, subindex, partial(take, channel))
        self._check_write(mapping, 0, partial(self._take_count, channel, mapping))
        for subindex in range(1, MAX_ENTRIES + 1):
            self._check_write(mapping, subindex, partial(self._check_entry, channel, mapping))

    def _check_write(self, index: int, subindex: int, take: Callable[[int], None]) -> None:
        """Have `take` called with every value written to an object; what it refuses becomes an SDO abort."""

        def check(value: int) -> None:
            try:
                take(value)
            except Refused as refused:
                raise SDODomainAbort(refused.code, (index, subindex)) from refused

        self._od.validate_callbacks[index, subindex].add(check)

    def _take_cob_id(self, channel: Channel, value: int) -> None:
        channel.cob_id = value
        self._changed()

    def _take_transmission_type(self, channel: Channel, value: int) -> None:
        if SYNCHRONOUS < value < EVENT_DRIVEN:
            raise Refused(ABORT_VALUE)
        channel.transmission_type = value
        channel.syncs = 0

    def _take_inhibit_time(self, channel: Channel, value: int) -> None:
        channel.inhibit_ns = value * 100_000

    def _take_event_timer(self, channel: Channel, value: int) -> None:
        channel.event_timer_ns = value * 1_000_000

    def _take_timeout(self, channel: Channel, value: int) -> None:
        if channel.number != SETPOINT_PDO and value:
            raise Refused(ABORT_VALUE)

    def _check_entry(self, channel: Channel, mapping: int, _value: int) -> None:
        if self._od.read(mapping, 0) != 0 or not channel.cob_id & INVALID:
            raise Refused(ABORT_NOT_NOW)

    def _take_count(self, channel: Channel, mapping: int, value: int) -> None:
        if not channel.cob_id & INVALID:
            raise Refused(ABORT_NOT_NOW)
        if value > MAX_ENTRIES:
            raise Refused(ABORT_TOO_LONG)
        entries = [self._od.read(mapping, subindex) for subindex in range(1, value + 1)]
        self._remap(channel, entries, transmit=mapping >= TRANSMIT_MAPPING)

    def _remap(self, channel: Channel, entries: list[int], *, transmit: bool) -> None:
        """Compile a mapping; raises `Refused` for what cannot be mapped."""
        letters, rows, bits = "", [], 0
        for entry in entries:
            row = self._mappable.get((entry >> 16, entry >> 8 & 0xFF))
            if row is None or 8 * struct.calcsize(row.letter) != entry & 0xFF or not (transmit or row.write):
                raise Refused(ABORT_NOT_MAPPABLE)
            letters += row.letter
            bits += entry & 0xFF
            rows.append(row)
        if bits > MAX_BITS:
            raise Refused(ABORT_TOO_LONG)
        channel.codec = struct.Struct("<" + letters)
        channel.readers = [row.read for row in rows] if transmit else []
        channel.writers = [] if transmit else [row.write for row in rows if row.write is not None]
        self._changed()

    def _entry(self, index: int, subindex: int) -> int:
        bits = 8 * struct.calcsize(self._mappable[index, subindex].letter)
        return index << 16 | subindex << 8 | bits

    def _store(self, index: int, values: dict[int, int]) -> None:
        """Write defaults past the checks, which are for a controller's writes."""
        for subindex, value in values.items():
            self._od._data[index, subindex] = value  # noqa: SLF001 - durand's write would run those checks
