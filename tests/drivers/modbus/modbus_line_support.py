"""What the tests of a Modbus line share, over TCP and RTU: its figures, a request, and the replies to it."""

from __future__ import annotations

from drivers.modbus.frames import Outcome, Reply, Request
from drivers.modbus.line import ModbusLine

UNIT = 1
TIMEOUT, DRAIN = 5, 15
"""In scans."""


def registers(function: int, *values: int) -> bytes:
    data = b"".join(value.to_bytes(2, "big") for value in values)
    return bytes((UNIT, function, len(data))) + data


def read3(line: ModbusLine) -> Request:
    return line.frames.read_request(UNIT, "input", 0, 3)


def data(*values: int) -> Reply:
    return Reply(Outcome.DATA, b"".join(value.to_bytes(2, "big") for value in values))
