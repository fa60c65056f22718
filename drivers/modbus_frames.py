"""Frames of Modbus: a request built, and a reply decoded and compared with its request.

Frames and their checks are pymodbus' (its framers and PDUs, without its client); this is the only module that uses it.
Nothing here knows a port or a time.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadInputRegistersRequest,
    WriteMultipleRegistersRequest,
)

TCP_HEADER_BYTES = 6
TCP_LENGTH_RANGE = range(3, 255)
"""Bytes after the TCP header: unit, function and 1 to 252 bytes (Modbus application protocol 1.1b3)."""
RTU_CHECK_BYTES = 2
EXCEPTION_BIT = 0x80

_READ_REQUESTS: dict[str, type[ModbusPDU]] = {
    "holding": ReadHoldingRegistersRequest,
    "input": ReadInputRegistersRequest,
}
_NOT_A_FRAME = (ModbusException, ValueError, IndexError, KeyError, TypeError)


class Outcome(IntEnum):
    """What became of a request."""

    DATA = 0
    EXCEPTION = 1
    TIMEOUT = 2
    GARBAGE = 3
    LOST = 4


@dataclass(frozen=True, slots=True)
class Request:
    """A request ready to send: its frame (on TCP the first two bytes are the transaction id), what must answer it."""

    unit_id: int
    function: int
    address: int
    register_count: int
    frame: bytes
    reply_bytes: int
    """Length of the expected reply's unit, function and data, without header or check sum."""


class Reply(NamedTuple):
    """The end of a transaction; `registers` with DATA of a read, `exception_code` with EXCEPTION."""

    outcome: Outcome
    registers: list[int]
    exception_code: int = 0


def silence_pymodbus() -> None:
    """Keep pymodbus from formatting a line of log for every bad frame."""
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL + 1)


class ModbusFrames:
    """Frames of one line: with check sum (RTU) or with header (TCP)."""

    def __init__(self, *, rtu: bool) -> None:
        decoder = DecodePDU(is_server=False)
        self._framer = FramerRTU(decoder) if rtu else FramerSocket(decoder)
        self._overhead = RTU_CHECK_BYTES if rtu else TCP_HEADER_BYTES

    def read_request(self, unit_id: int, table: str, address: int, count: int) -> Request:
        """Build a request for `count` registers of the table "input" or "holding"."""
        pdu = _READ_REQUESTS[table](dev_id=unit_id, transaction_id=0, address=address, count=count)
        return Request(unit_id, pdu.function_code, address, count, self._framer.buildFrame(pdu), 3 + 2 * count)

    def write_request(self, unit_id: int, address: int, registers: list[int]) -> Request:
        """Build a request to write adjoining holding registers."""
        pdu = WriteMultipleRegistersRequest(dev_id=unit_id, transaction_id=0, address=address, registers=registers)
        return Request(unit_id, pdu.function_code, address, len(registers), self._framer.buildFrame(pdu), 6)

    def decode(self, request: Request, frame: bytes) -> Reply:
        """Decode exactly one frame and compare it with its request; GARBAGE when it is not the reply to it."""
        try:
            used, pdu = self._framer.handleFrame(frame, 0, 0)
        except _NOT_A_FRAME:
            return not_the_reply()
        if pdu is None or used != len(frame) or pdu.dev_id != request.unit_id:
            return not_the_reply()
        if pdu.function_code == request.function | EXCEPTION_BIT:
            return Reply(Outcome.EXCEPTION, [], pdu.exception_code)
        if pdu.function_code != request.function or len(frame) != request.reply_bytes + self._overhead:
            return not_the_reply()
        registers = list(pdu.registers)
        if request.function in {3, 4}:
            return Reply(Outcome.DATA, registers) if len(registers) == request.register_count else not_the_reply()
        same = pdu.address == request.address and pdu.count == request.register_count
        return Reply(Outcome.DATA, registers) if same else not_the_reply()


def not_the_reply() -> Reply:
    """Return the reply that stands for anything but the expected one."""
    return Reply(Outcome.GARBAGE, [])
