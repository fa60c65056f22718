"""Split transactions over TCP, byte by byte: a scripted peer on a socket pair."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import pytest
from drivers_support import modbus_config
from hypothesis import given, settings
from hypothesis import strategies as st
from modbus_line_support import DRAIN, TIMEOUT, UNIT, data, read3, registers

from drivers.errors import ModbusError
from drivers.modbus.frames import Outcome, Reply
from drivers.modbus.line import ModbusLine


class Tcp:
    """A line and its scripted peer."""

    def __init__(self) -> None:
        ours, self.peer = socket.socketpair()
        ours.setblocking(False)  # noqa: FBT003
        self.line = ModbusLine(modbus_config("virtual-amplifier", UNIT), TIMEOUT, DRAIN)
        self.line.attach(ours)
        self.ours = ours

    def asked(self) -> bytes:
        return self.peer.recv(300)

    def say(self, transaction_id: int, body: bytes) -> None:
        self.peer.sendall(transaction_id.to_bytes(2, "big") + b"\0\0" + len(body).to_bytes(2, "big") + body)

    def close(self) -> None:
        self.peer.close()
        self.line.close()


@pytest.fixture
def tcp() -> Iterator[Tcp]:
    bench = Tcp()
    yield bench
    bench.close()


def test_request_in_one_scan_reply_in_a_later_one(tcp: Tcp) -> None:
    assert tcp.line.send(read3(tcp.line), 0)
    assert tcp.asked() == bytes.fromhex("0001 0000 0006 01 04 0000 0003")
    assert tcp.line.poll(1) is None
    tcp.say(1, registers(4, 0x1234, 0, 0xFFFF))
    assert tcp.line.poll(2) == data(0x1234, 0, 0xFFFF)
    assert tcp.line.poll(3) is None


def test_one_request_in_flight(tcp: Tcp) -> None:
    assert tcp.line.send(read3(tcp.line), 0)
    assert not tcp.line.send(read3(tcp.line), 0)
    assert len(tcp.asked()) == 12


def test_write_is_acknowledged_by_its_own_address_and_count_only(tcp: Tcp) -> None:
    request = tcp.line.frames.write_request(UNIT, "holding", 0x10, [1, 2500])
    tcp.line.send(request, 0)
    assert tcp.asked() == bytes.fromhex("0001 0000 000b 01 10 0010 0002 04 0001 09c4")
    tcp.say(1, bytes.fromhex("01 10 0010 0002"))
    assert tcp.line.poll(1) == data()
    tcp.line.send(request, 1)
    tcp.say(2, bytes.fromhex("01 10 0011 0002"))
    assert tcp.line.poll(2) == Reply(Outcome.GARBAGE)


def test_a_frame_split_at_every_place(tcp: Tcp) -> None:
    body = registers(4, 1, 2, 3)
    for cut in range(1, 6 + len(body)):
        tcp.line.send(read3(tcp.line), 0)
        frame = tcp.asked()[:2] + b"\0\0" + len(body).to_bytes(2, "big") + body
        tcp.peer.sendall(frame[:cut])
        assert tcp.line.poll(1) is None
        tcp.peer.sendall(frame[cut:])
        assert tcp.line.poll(2) == data(1, 2, 3)


def test_silence_is_counted_in_scans(tcp: Tcp) -> None:
    tcp.line.send(read3(tcp.line), 10)
    assert [tcp.line.poll(scan) for scan in range(11, 15)] == [None] * 4
    assert tcp.line.poll(10 + TIMEOUT) == Reply(Outcome.TIMEOUT)
    assert tcp.line.timeouts == 1
    assert not tcp.line.lost


def test_a_late_reply_is_not_taken_for_the_next(tcp: Tcp) -> None:
    tcp.line.send(read3(tcp.line), 0)
    tcp.line.poll(TIMEOUT)
    tcp.line.send(read3(tcp.line), 6)
    tcp.say(1, registers(4, 7, 7, 7))
    assert tcp.line.poll(7) is None
    tcp.say(2, registers(4, 8, 8, 8))
    assert tcp.line.poll(8) == data(8, 8, 8)
    assert tcp.line.strangers == 1


def test_late_and_right_reply_in_one_piece(tcp: Tcp) -> None:
    tcp.line.send(read3(tcp.line), 0)
    tcp.line.poll(TIMEOUT)
    tcp.line.send(read3(tcp.line), 6)
    tcp.say(1, registers(4, 7, 7, 7))
    tcp.say(2, registers(4, 8, 8, 8))
    assert tcp.line.poll(7) == data(8, 8, 8)


def test_transaction_id_is_never_zero(tcp: Tcp) -> None:
    tcp.line._transaction_id = 0xFFFF
    tcp.line.send(read3(tcp.line), 0)
    assert tcp.asked()[:2] == b"\0\1"
    tcp.say(0, registers(4, 1, 2, 3))  # pymodbus itself takes 0 for any
    assert tcp.line.poll(1) is None


def test_exception_reply(tcp: Tcp) -> None:
    tcp.line.send(read3(tcp.line), 0)
    tcp.say(1, bytes((UNIT, 0x84, 0x02)))
    assert tcp.line.poll(1) == Reply(Outcome.EXCEPTION, b"", 2)


WRONG_BODIES = {
    "another unit": b"\x02" + registers(4, 1, 2, 3)[1:],
    "another function": registers(3, 1, 2, 3),
    "too few registers": registers(4, 1, 2),
    "too many registers": registers(4, 1, 2, 3, 4),
    "byte count too large": b"\x01\x04\x08" + bytes(6),
    "byte count too small": b"\x01\x04\x04" + bytes(6),
    "byte count odd": b"\x01\x04\x05" + bytes(6),
    "exception of another function": b"\x01\x83\x02",
    "function unknown": b"\x01\x63\x02\x00",
}


@pytest.mark.parametrize("body", WRONG_BODIES.values(), ids=list(WRONG_BODIES))
def test_a_reply_that_does_not_fit_its_request_is_garbage(tcp: Tcp, body: bytes) -> None:
    tcp.line.send(read3(tcp.line), 0)
    tcp.say(1, body)
    assert tcp.line.poll(1) == Reply(Outcome.GARBAGE)
    assert tcp.line.garbage == 1


def test_after_garbage_the_next_transaction_works(tcp: Tcp) -> None:
    tcp.line.send(read3(tcp.line), 0)
    tcp.peer.sendall(bytes(range(200)))
    assert tcp.line.poll(1) == Reply(Outcome.GARBAGE)
    tcp.line.send(read3(tcp.line), 1)
    tcp.say(2, registers(4, 1, 2, 3))
    assert tcp.line.poll(2) == data(1, 2, 3)


def test_a_closed_connection_is_lost_until_opened_anew(tcp: Tcp) -> None:
    tcp.line.send(read3(tcp.line), 0)
    tcp.asked()
    tcp.peer.close()
    assert tcp.line.poll(1) == Reply(Outcome.LOST)
    assert tcp.line.lost_because.startswith("the device closed the connection")
    assert not tcp.line.send(read3(tcp.line), 2)
    assert tcp.line.poll(3) is None


def test_a_closed_connection_is_noticed_by_sending(tcp: Tcp) -> None:
    tcp.peer.close()
    assert not tcp.line.send(read3(tcp.line), 0)
    assert tcp.line.lost


def test_a_device_that_does_not_read_cannot_hold_the_scan(tcp: Tcp) -> None:
    tcp.ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1)
    for scan in range(100_000):
        if not tcp.line.send(read3(tcp.line), scan * TIMEOUT):
            break
        tcp.line.poll((scan + 1) * TIMEOUT)
    assert tcp.line.lost
    assert tcp.line.lost_because.startswith("sending failed")


@settings(max_examples=200, deadline=None)
@given(st.lists(st.binary(max_size=40), max_size=6), st.booleans())
def test_no_bytes_raise_out_of_poll_tcp(pieces: list[bytes], right_head: bool) -> None:  # noqa: FBT001
    tcp = Tcp()
    try:
        tcp.line.send(read3(tcp.line), 0)
        for scan, piece in enumerate(pieces, start=1):
            head = bytes((0, 1, 0, 0, 0, max(3, len(piece)), UNIT)) if right_head else b""
            tcp.peer.sendall(head + piece)
            reply = tcp.line.poll(scan)
            assert reply is None or reply.outcome in Outcome
            tcp.line.send(read3(tcp.line), scan)
    finally:
        tcp.close()


def test_connection_refused_tells_where() -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    line = ModbusLine(modbus_config("virtual-brake", 2, port=port), TIMEOUT, DRAIN)
    with pytest.raises(ModbusError, match=rf"virtual-brake at 127.0.0.1:{port} unit 2: no connection"):
        line.open()
