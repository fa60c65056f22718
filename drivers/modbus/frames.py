"""Frames of Modbus: a request built, and a reply compared with its request.

A request is built once and sent often: that is pymodbus' work (its framers and PDUs, without its client), and this is
the only module that uses it. A reply comes in every scan: what it must begin with and how long it must be is known with
the request, so it is compared byte by byte, in a twentieth of the time that a PDU takes (tests hold both together).
Nothing here knows a port or a time.
"""

from __future__ import annotations

import logging
from enum import IntEnum
from typing import NamedTuple

from pymodbus.framer import FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.pdu.bit_message import (
    ReadCoilsRequest,
    ReadDiscreteInputsRequest,
    WriteMultipleCoilsRequest,
    WriteSingleCoilRequest,
)
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadInputRegistersRequest,
    WriteMultipleRegistersRequest,
    WriteSingleRegisterRequest,
)

TCP_HEADER_BYTES = 6
TCP_LENGTH_RANGE = range(3, 255)
"""Bytes after the TCP header: unit, function and 1 to 252 bytes (Modbus application protocol 1.1b3)."""
RTU_CHECK_BYTES = 2
EXCEPTION_BIT = 0x80
EXCEPTION_BYTES = 3
"""Unit, function and code of an exception."""

_READ_REQUESTS: dict[str, type[ModbusPDU]] = {
    "coil": ReadCoilsRequest,
    "discrete": ReadDiscreteInputsRequest,
    "holding": ReadHoldingRegistersRequest,
    "input": ReadInputRegistersRequest,
}
_BITS = frozenset({"coil", "discrete"})
COIL_ON = 0xFF00
"""What the request for a single coil says for on; 0 is off."""


class Outcome(IntEnum):
    """What became of a request."""

    DATA = 0
    EXCEPTION = 1
    TIMEOUT = 2
    GARBAGE = 3
    LOST = 4


class Request(NamedTuple):
    """A request ready to send, and what must answer it: unit, function and data, without header or check sum."""

    unit_id: int
    function: int
    frame: bytes
    """On TCP its first two bytes are the transaction id."""
    reply_head: bytes
    """What the reply begins with; behind it come the registers or bits of a read, nothing of a write."""
    reply_bytes: int
    reply_start: bytes
    """On TCP: what the reply begins with behind its transaction id."""


class Reply(NamedTuple):
    """The end of a transaction; `data` with DATA of a read: the registers, as they were sent."""

    outcome: Outcome
    data: bytes = b""
    exception_code: int = 0


NOT_THE_REPLY = Reply(Outcome.GARBAGE)
"""The reply that stands for anything but the expected one."""


def silence_pymodbus() -> None:
    """Keep pymodbus from formatting a line of log for every bad frame."""
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL + 1)


class ModbusFrames:
    """Builds the requests of one line: with check sum (RTU) or with header (TCP)."""

    def __init__(self, *, rtu: bool) -> None:
        decoder = DecodePDU(is_server=False)
        self._framer = FramerRTU(decoder) if rtu else FramerSocket(decoder)

    def read_request(self, unit_id: int, table: str, address: int, count: int) -> Request:
        """Build a request for `count` registers of "input" or "holding", or bits of "coil" or "discrete"."""
        pdu = _READ_REQUESTS[table](dev_id=unit_id, transaction_id=0, address=address, count=count)
        size = (count + 7) // 8 if table in _BITS else 2 * count
        head = bytes((unit_id, pdu.function_code, size))
        return self._request(pdu, head, len(head) + size)

    def write_request(
        self, unit_id: int, table: str, address: int, values: list[int], *, single: bool = False
    ) -> Request:
        """Build a request to write adjoining registers of "holding", or bits of "coil"; `single`: the one there is."""
        pdu: ModbusPDU
        if table in _BITS:
            bits = [bool(value) for value in values]
            pdu = (WriteSingleCoilRequest if single else WriteMultipleCoilsRequest)(
                dev_id=unit_id, transaction_id=0, address=address, bits=bits
            )
        else:
            pdu = (WriteSingleRegisterRequest if single else WriteMultipleRegistersRequest)(
                dev_id=unit_id, transaction_id=0, address=address, registers=values
            )
        echo = len(values)
        if single:
            echo = values[0] if table not in _BITS else COIL_ON if values[0] else 0
        head = bytes((unit_id, pdu.function_code)) + address.to_bytes(2, "big") + echo.to_bytes(2, "big")
        return self._request(pdu, head, len(head))

    def _request(self, pdu: ModbusPDU, reply_head: bytes, reply_bytes: int) -> Request:
        start = b"\0\0" + reply_bytes.to_bytes(2, "big") + reply_head
        return Request(pdu.dev_id, pdu.function_code, self._framer.buildFrame(pdu), reply_head, reply_bytes, start)


def reply_to(request: Request, body: bytes) -> Reply:
    """Compare unit, function and data of a reply with its request; GARBAGE when it is not the reply to it."""
    head = request.reply_head
    if len(body) == request.reply_bytes and body.startswith(head):
        return Reply(Outcome.DATA, body[len(head) :])
    exception = bytes((request.unit_id, request.function | EXCEPTION_BIT))
    if len(body) >= EXCEPTION_BYTES and body.startswith(exception):
        return Reply(Outcome.EXCEPTION, b"", body[2])
    return NOT_THE_REPLY


def check_sum_fits(frame: bytes) -> bool:
    """Whether the last two bytes of a frame on RTU are the check sum of those before."""
    check = int.from_bytes(frame[-RTU_CHECK_BYTES:], "big")
    return bool(FramerRTU.compute_CRC(frame[:-RTU_CHECK_BYTES]) == check)
