"""Modbus as a split transaction: a request goes out in one scan, its reply is taken in a later one.

One line is one TCP connection or one serial port with one request in flight. A reply is believed only when unit,
function, length and, on TCP, the transaction id are those of the request.

RTU has no transaction id, so a late reply would be taken for the next request's answer and every later one would be
off by one. After a time-out, and after anything that is not the expected reply, the line therefore discards what comes
for the worst-case reply time, and `epoch` counts up: the devices on it then read their identity again before they
believe a value.

Once open, nothing here raises or waits: a line that broke is `lost` and stays so until it is opened anew.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import struct
import time

import serial

from drivers.config import ModbusConfig
from drivers.errors import ModbusError, Problem
from drivers.hung_up import hung_up
from drivers.modbus.frames import (
    EXCEPTION_BIT,
    EXCEPTION_BYTES,
    NOT_THE_REPLY,
    RTU_CHECK_BYTES,
    TCP_HEADER_BYTES,
    TCP_LENGTH_RANGE,
    ModbusFrames,
    Outcome,
    Reply,
    Request,
    check_sum_fits,
    reply_to,
    silence_pymodbus,
)
from drivers.modbus.port import open_port
from drivers.pace import LONGEST_WAIT_S, readable

READ_SIZE = 4096
TCP_HEADER = struct.Struct(">HHH")
"""Transaction, protocol (0), and how many bytes follow."""

QUIET_SCANS = 2
"""RTU: scans without a byte that end the discarding of a late reply."""

_CHECK_NEXT = "check cable, power, address and unit id of the device"


class ModbusLine:
    """Transactor over a non-blocking socket or serial port, given by its file descriptor."""

    def __init__(self, config: ModbusConfig, timeout_scans: int, drain_scans: int) -> None:
        """Prepare a closed line; times in scans: of a reply, and of the worst case reply after a request (RTU)."""
        self.config = config
        self.rtu = config.transport == "rtu"
        self.lost = True
        self.lost_because = "not opened"
        self.epoch = 0
        self.garbage = 0
        self.timeouts = 0
        self.strangers = 0
        self.bytes_received = 0
        self.bytes_due = 0
        """Bytes that a bench which waits for the scan says it has sent: they are on their way at least."""
        self.timeout_scans = timeout_scans
        self.drain_scans = drain_scans
        self.frames = ModbusFrames(rtu=self.rtu)
        self._port: socket.socket | serial.Serial | None = None
        self._descriptor = -1
        self._pending: Request | None = None
        self._sent_scan = 0
        self._transaction_id = 0
        self._received = b""
        self._expected = b""
        """TCP: what the reply to the request in flight begins with, transaction id and header included."""
        self._drain_until: int | None = None

    def attach(self, port: socket.socket | serial.Serial) -> None:
        """Use a connected, non-blocking port from now on, with nothing in flight."""
        self._port = port
        self._descriptor = port.fileno()
        self.lost = False
        self.lost_because = ""
        self.epoch += 1
        self._pending = None
        self._received = b""
        self._drain_until = None

    def open(self) -> None:
        """Connect (blocking, bounded by the connect time-out); raises ModbusError with what to check next."""
        silence_pymodbus()
        self.close()
        try:
            self.attach(open_port(self.config))
        except (OSError, ValueError) as error:
            raise ModbusError(
                Problem("no connection", self.config.where, str(error), "an open connection", _CHECK_NEXT)
            ) from error

    def close(self) -> None:
        """Close the connection; safe to call twice."""
        if self._port is not None:
            with contextlib.suppress(OSError):
                self._port.close()
        self._port = None
        self._descriptor = -1
        self._lose("closed")

    def ready(self, scan: int) -> bool:
        """Tell whether a request may be sent; while an RTU line discards late replies, go on with that."""
        if self._pending is not None or self.lost:
            return False
        if self.rtu:
            if self._arrived():
                # Nothing was asked: a reply later than the worst case, or another master on the line.
                if self._drain_until is None:
                    self.strangers += 1
                    self.epoch += 1
                self._drain_until = max(self._drain_until or 0, scan + QUIET_SCANS)
            elif self._drain_until is not None and scan >= self._drain_until:
                self._drain_until = None
        return self._drain_until is None and not self.lost

    def send(self, request: Request, scan: int) -> bool:
        """Send a request if the line is ready; False when it is not or when it broke."""
        if self._pending is not None or self.lost or (self.rtu and not self.ready(scan)):
            return False
        frame = request.frame
        if not self.rtu:
            self._transaction_id = self._transaction_id % 0xFFFF + 1  # never 0, which pymodbus takes for any
            transaction = self._transaction_id.to_bytes(2, "big")
            frame = transaction + frame[2:]
            self._expected = transaction + request.reply_start
        try:
            sent = os.write(self._descriptor, frame)
        except OSError as error:
            self._lose(f"sending failed: {error}")
            return False
        if sent != len(frame):
            self._lose("sending failed: the device does not read; restart the device")
            return False
        self._pending = request
        self._sent_scan = scan
        return True

    def poll(self, scan: int) -> Reply | None:
        """Take what has arrived; the reply when the transaction in flight ended, else None."""
        request = self._pending
        if request is None:
            return None
        arrived = self._arrived()
        if self.lost:
            return Reply(Outcome.LOST)
        if arrived:
            self._received += arrived
            reply = self._match_rtu(request) if self.rtu else self._match_tcp(request)
            if reply is not None:
                return self._end(reply, scan)
        if scan - self._sent_scan >= self.timeout_scans:
            self.timeouts += 1
            return self._end(Reply(Outcome.TIMEOUT), scan)
        return None

    def exchange(self, request: Request, timeout_s: float) -> Reply:
        """Blocking transaction for use before the scan; `timeout_s` bounds the wait."""
        if not self.send(request, 0):
            return Reply(Outcome.LOST)
        deadline = time.monotonic() + timeout_s
        while (left := deadline - time.monotonic()) > 0:
            select.select([self._descriptor], [], [], left)
            reply = self.poll(0)
            if reply is not None:
                return reply
        return self.poll(self.timeout_scans) or Reply(Outcome.TIMEOUT)

    def _arrived(self) -> bytes:
        """Take the bytes that are there, and those that are due; none when the line broke, which it then knows."""
        arrived = self._read()
        while self.bytes_received < self.bytes_due and not self.lost:
            if not readable(self._descriptor, LONGEST_WAIT_S):
                self.bytes_due = self.bytes_received
            arrived += self._read()
        return arrived

    def count_from_now(self) -> None:
        """Count bytes from here; nothing may be in flight."""
        self.bytes_received = self.bytes_due = 0

    def _read(self) -> bytes:
        try:
            arrived = os.read(self._descriptor, READ_SIZE)
        except BlockingIOError:
            return b""
        except OSError as error:
            self._lose(f"the connection broke: {error}")
            return b""
        if not arrived:  # a terminal reads empty when nothing is there too, a socket only when it was closed
            if not self.rtu:
                self._lose("the device closed the connection; check that it has power and no other master")
            elif hung_up(self._descriptor):
                self._lose("the serial port was hung up: its adapter was unplugged")
        self.bytes_received += len(arrived)
        return arrived

    def _match_tcp(self, request: Request) -> Reply | None:
        received = self._received
        if received.startswith(self._expected) and len(received) == TCP_HEADER_BYTES + request.reply_bytes:
            return Reply(Outcome.DATA, received[len(self._expected) :])  # the usual case, compared at once
        while len(received) >= TCP_HEADER_BYTES:
            transaction_id, protocol, length = TCP_HEADER.unpack_from(received)
            if protocol or length not in TCP_LENGTH_RANGE:
                return NOT_THE_REPLY
            end = TCP_HEADER_BYTES + length
            if len(received) < end:
                break
            if transaction_id == self._transaction_id:
                return reply_to(request, received[TCP_HEADER_BYTES:end])
            self.strangers += 1  # a late reply to a request given up before
            received = received[end:]
        self._received = received
        return None

    def _match_rtu(self, request: Request) -> Reply | None:
        received = self._received
        if received[0] != request.unit_id:
            return NOT_THE_REPLY
        if len(received) < 2:
            return None
        if received[1] & ~EXCEPTION_BIT != request.function:
            return NOT_THE_REPLY
        expected = (EXCEPTION_BYTES if received[1] & EXCEPTION_BIT else request.reply_bytes) + RTU_CHECK_BYTES
        if len(received) < expected:
            return None
        if len(received) > expected or not check_sum_fits(received):
            return NOT_THE_REPLY
        return reply_to(request, received[:-RTU_CHECK_BYTES])

    def _end(self, reply: Reply, scan: int) -> Reply:
        self._pending = None
        self._received = b""
        if reply.outcome is Outcome.GARBAGE:
            self.garbage += 1
        if self.rtu and reply.outcome in {Outcome.TIMEOUT, Outcome.GARBAGE}:
            self.epoch += 1
            self._drain_until = max(self._sent_scan + self.drain_scans, scan + QUIET_SCANS)
        return reply

    def _lose(self, because: str) -> None:
        self._pending = None
        self._received = b""
        self._drain_until = None
        if not self.lost:
            self.lost = True
            self.lost_because = because
