"""Split transactions over RTU, byte by byte: a scripted peer on a pseudo terminal."""

from __future__ import annotations

import os
import pty
import select
import tty
from collections.abc import Iterator

import pytest
import serial
from drivers_support import modbus_config
from hypothesis import given, settings
from hypothesis import strategies as st
from modbus_line_support import DRAIN, TIMEOUT, UNIT, data, read3, registers
from pymodbus.framer import FramerRTU

from drivers.modbus.frames import Outcome, Reply
from drivers.modbus.line import ModbusLine


def crc(frame: bytes) -> bytes:
    return frame + FramerRTU.compute_CRC(frame).to_bytes(2, "big")


class Rtu:
    """A line and its scripted peer at the other end of a pseudo terminal."""

    def __init__(self) -> None:
        self.master, slave = pty.openpty()
        tty.setraw(self.master)
        self.slave_name = os.ttyname(slave)
        config = modbus_config("virtual-amplifier", UNIT, transport="rtu", serial_port=self.slave_name)
        self.line = ModbusLine(config, TIMEOUT, DRAIN)
        self.line.open()
        os.close(slave)

    def asked(self) -> bytes:
        return os.read(self.master, 300)

    def say(self, frame: bytes) -> None:
        os.write(self.master, frame)
        select.select([self.line._descriptor], [], [], 1.0)

    def close(self) -> None:
        self.line.close()
        os.close(self.master)


@pytest.fixture
def rtu() -> Iterator[Rtu]:
    bench = Rtu()
    yield bench
    bench.close()


def test_rtu_reply(rtu: Rtu) -> None:
    rtu.line.send(read3(rtu.line), 0)
    assert rtu.asked() == crc(bytes.fromhex("01 04 0000 0003"))
    frame = crc(registers(4, 1, 2, 3))
    rtu.say(frame[:4])
    assert rtu.line.poll(1) is None
    rtu.say(frame[4:])
    assert rtu.line.poll(2) == data(1, 2, 3)


def test_rtu_exception(rtu: Rtu) -> None:
    rtu.line.send(read3(rtu.line), 0)
    rtu.say(crc(bytes((UNIT, 0x84, 6))))
    assert rtu.line.poll(1) == Reply(Outcome.EXCEPTION, b"", 6)
    assert rtu.line.ready(1)


RTU_GARBAGE = {
    "wrong check sum": registers(4, 1, 2, 3) + b"\0\0",
    "another slave": crc(b"\x02" + registers(4, 1, 2, 3)[1:]),
    "another function": crc(registers(3, 1, 2, 3)),
    "trailing byte": crc(registers(4, 1, 2, 3)) + b"\x55",
    "noise": b"\xff\x00\xff",
}


@pytest.mark.parametrize("frame", RTU_GARBAGE.values(), ids=list(RTU_GARBAGE))
def test_rtu_garbage_makes_the_line_quieten_first(rtu: Rtu, frame: bytes) -> None:
    epoch = rtu.line.epoch
    rtu.line.send(read3(rtu.line), 0)
    rtu.say(frame)
    assert rtu.line.poll(1) == Reply(Outcome.GARBAGE)
    assert not rtu.line.ready(2)
    assert rtu.line.epoch == epoch + 1
    assert rtu.line.ready(DRAIN)


def test_rtu_late_reply_is_discarded(rtu: Rtu) -> None:
    """The published trap: without draining, the late reply is the next request's answer, for ever off by one."""
    epoch = rtu.line.epoch
    rtu.line.send(read3(rtu.line), 0)
    assert rtu.line.poll(TIMEOUT) == Reply(Outcome.TIMEOUT)
    assert not rtu.line.send(read3(rtu.line), TIMEOUT)
    rtu.say(crc(registers(4, 7, 7, 7)))
    assert not rtu.line.ready(DRAIN - 1)
    assert not rtu.line.ready(DRAIN)
    assert rtu.line.ready(DRAIN + 1)
    rtu.asked()
    rtu.line.send(read3(rtu.line), DRAIN + 1)
    rtu.say(crc(registers(4, 8, 8, 8)))
    assert rtu.line.poll(DRAIN + 2) == data(8, 8, 8)
    assert rtu.line.epoch == epoch + 1


def test_rtu_reply_later_than_the_worst_case_is_found_before_the_next_request(rtu: Rtu) -> None:
    rtu.line.send(read3(rtu.line), 0)
    rtu.line.poll(TIMEOUT)
    assert rtu.line.ready(DRAIN)
    epoch = rtu.line.epoch
    rtu.say(crc(registers(4, 7, 7, 7)))
    assert not rtu.line.send(read3(rtu.line), DRAIN + 5)
    assert rtu.line.strangers == 1
    assert rtu.line.epoch == epoch + 1
    assert rtu.line.ready(DRAIN + 7)


def test_rtu_line_that_babbles_never_becomes_ready(rtu: Rtu) -> None:
    for scan in range(50):
        rtu.say(b"\x00\x55")
        assert not rtu.line.ready(scan)
    assert rtu.line.strangers == 1


def test_rtu_unplugged_is_lost(rtu: Rtu) -> None:
    os.close(rtu.master)
    rtu.master = os.open(os.devnull, os.O_RDONLY)
    scan = 0
    while not rtu.line.lost and scan < 100:
        rtu.line.send(read3(rtu.line), scan)
        rtu.line.poll(scan)
        scan += 1
    assert rtu.line.lost


@settings(max_examples=60, deadline=None)
@given(st.lists(st.binary(min_size=1, max_size=30), max_size=5))
def test_no_bytes_raise_out_of_poll_rtu(pieces: list[bytes]) -> None:
    rtu = Rtu()
    try:
        for scan, piece in enumerate(pieces):
            rtu.line.send(read3(rtu.line), 20 * scan)
            rtu.say(piece)
            reply = rtu.line.poll(20 * scan + 1)
            assert reply is None or reply.outcome in Outcome
            rtu.line.poll(20 * scan + TIMEOUT)
    finally:
        rtu.close()


def test_contract_pyserial_opens_without_blocking(rtu: Rtu) -> None:
    port = rtu.line._port
    assert isinstance(port, serial.Serial)
    assert os.get_blocking(port.fileno()) is False
