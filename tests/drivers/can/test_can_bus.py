"""The CAN link: bounded opening, bounded sends, a peer that goes away; against a scripted socketcand server."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
import time
from collections.abc import Iterator

import can
import pytest

from drivers.can.bus import CanLink, open_can
from drivers.can.socketcand_bus import PIECE, SocketcandBus
from drivers.can.wires import FOREIGN
from drivers.config import CanConfig
from drivers.errors import BusError
from drivers.pace import readable
from drivers.servo_drive.drive import FRAMES_AFTER_GAP

FRAME = can.Message(arbitration_id=0x205, is_extended_id=False, data=b"\x0f\x00\x0a\xd4\xfe")


class Server:
    """Speaks the socketcand handshake to one client, then does what the test says."""

    def __init__(self, *answers: bytes) -> None:
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.answers = answers
        self.peer: socket.socket | None = None
        self.thread = threading.Thread(target=self._shake_hands, daemon=True)
        self.thread.start()

    def _shake_hands(self) -> None:
        self.peer, _ = self.listener.accept()
        self.peer.sendall(self.answers[0])
        for answer in self.answers[1:]:
            self.peer.recv(100)
            self.peer.sendall(answer)

    def client(self, **changes: float) -> CanConfig:
        return CanConfig("socketcand", "vcan0", port=self.port, **({"connect_timeout_s": 0.3} | changes))  # type: ignore[arg-type]

    def connected(self) -> socket.socket:
        self.thread.join(1)
        assert self.peer is not None
        return self.peer

    def close(self) -> None:
        self.listener.close()
        if self.peer is not None:
            self.peer.close()


@pytest.fixture
def server() -> Iterator[Server]:
    one = Server(b"< hi >", b"< ok >", b"< ok >")
    yield one
    one.close()


@pytest.fixture
def link(server: Server) -> Iterator[CanLink]:
    one = open_can(server.client())
    yield one
    server.close()  # first, so that the link need not wait for it
    one.close()


def arrive(link: CanLink) -> can.Message | None:
    for _ in range(200):
        message = link.receive()
        if message is not None:
            return message
        time.sleep(0.001)
    return None


def client_of(link: CanLink) -> socket.socket:
    assert isinstance(link.bus, SocketcandBus)
    return link.bus._client


def test_a_send_is_bounded_and_goes_out_at_once(link: CanLink) -> None:
    client = client_of(link)
    seconds, microseconds = struct.unpack("ll", client.getsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, 16))
    assert seconds == 0
    assert 2000 <= microseconds <= 20_000  # the kernel rounds up to its tick
    assert client.gettimeout() is None
    assert client.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


def test_a_frame_in_the_packet_of_an_answer_is_a_frame() -> None:
    server = Server(b"< hi >", b"< ok >", b"< ok >< frame 705 1.5 05 >< fra")
    try:
        link = open_can(server.client())
        server.connected().sendall(b"me 185 1.5 3712 >")
        first, second = arrive(link), arrive(link)
        assert first is not None
        assert second is not None
        assert (first.arbitration_id, bytes(first.data)) == (0x705, b"\x05")
        assert (second.arbitration_id, bytes(second.data)) == (0x185, b"\x37\x12")
        server.close()
        link.close()
    finally:
        server.close()


def test_a_frame_in_the_packet_of_an_answer_waits_for_no_other() -> None:
    server = Server(b"< hi >", b"< ok >", b"< ok >< frame 705 1.5 05 >")
    try:
        link = open_can(server.client())
        server.connected()
        assert link.take(64) == [(0x705, b"\x05")]
        server.close()
        link.close()
    finally:
        server.close()


def test_what_was_received_before_the_scan_is_not_lost(server: Server, link: CanLink) -> None:
    server.connected().sendall(b"< frame 185 1.5 3712 >< frame 285 1.5 01 >< frame 705 1.")
    first = link.bus.recv(1.0)
    assert first is not None
    server.connected().sendall(b"5 05 >")
    found = [arrive(link), arrive(link)]
    assert [message and message.arbitration_id for message in found] == [0x285, 0x705]


def test_counting_anew_forgets_what_came_before_also_behind_what_was_received(server: Server, link: CanLink) -> None:
    server.connected().sendall(b"< frame 185 1.5 3712 >< frame 705 1.5 05 >")
    assert link.bus.recv(1.0) is not None
    link.count_from_now()
    assert link.receive() is None
    assert (link.frames_received, link.frames_sent) == (0, 0)


def test_all_frames_of_a_scan_are_one_packet_and_what_is_no_data_frame_is_foreign(
    server: Server, link: CanLink
) -> None:
    assert link.send_frames([(0x205, b"\x0f\x00"), (0x80, b"")])
    assert server.connected().recv(100) == b"< send 205 2 f 0 >< send 080 0  >"
    server.connected().sendall(b"< error 004 1.5 >< frame 00000185 1.5 01 >< frame 185 1.5  >")
    frames = link.take(64)
    for _ in range(200):
        if link.frames_received == 3:
            break
        time.sleep(0.001)
        frames += link.take(64)
    assert [cob_id for cob_id, _ in frames] == [FOREIGN, FOREIGN, 0x185]
    assert not link.lost


def test_what_a_scan_takes_after_missed_periods_is_received_in_one_call(server: Server, link: CanLink) -> None:
    longest = b"< frame 185 1700000000.123456 0011223344556677 >"
    assert (FRAMES_AFTER_GAP + 1) * len(longest) < PIECE
    server.connected().sendall(longest * (FRAMES_AFTER_GAP + 1))
    for _ in range(1000):
        if len(client_of(link).recv(PIECE, socket.MSG_PEEK)) == (FRAMES_AFTER_GAP + 1) * len(longest):
            break
        time.sleep(0.001)
    assert len(link.take(FRAMES_AFTER_GAP)) == FRAMES_AFTER_GAP
    assert link.frames_wait
    assert link.take(FRAMES_AFTER_GAP) == [(0x185, bytes.fromhex("0011223344556677"))]


@pytest.mark.parametrize("cut", range(1, 22))
def test_a_frame_split_at_every_place(server: Server, link: CanLink, cut: int) -> None:
    text = b"< frame 185 1.5 3712 >"
    assert len(text) == 22
    server.connected().sendall(text[:cut])
    readable(link.fileno(), 1.0)
    assert link.take(64) == []
    server.connected().sendall(text[cut:])
    readable(link.fileno(), 1.0)
    assert link.take(64) == [(0x185, b"\x37\x12")]


def test_frames_both_ways(server: Server, link: CanLink) -> None:
    assert link.send(FRAME)
    assert server.connected().recv(100) == b"< send 205 5 f 0 a d4 fe >"
    server.connected().sendall(b"< frame 185 1.5 3712 >< frame 705 1.5 05 >")
    first, second = arrive(link), arrive(link)
    assert first is not None
    assert second is not None
    assert (first.arbitration_id, bytes(first.data)) == (0x185, b"\x37\x12")
    assert (second.arbitration_id, bytes(second.data)) == (0x705, b"\x05")
    assert not link.lost


def test_nothing_arrived_is_not_lost(link: CanLink) -> None:
    assert link.receive() is None
    assert not link.lost


def test_a_peer_that_closes_is_noticed(server: Server, link: CanLink) -> None:
    server.connected().close()
    for _ in range(200):
        assert link.receive() is None
        if link.lost:
            break
        time.sleep(0.001)
    assert link.lost_because.startswith("the socketcand server closed the connection")
    assert link.receive() is None
    assert not link.send(FRAME)
    assert link.sends_failed == 1


def test_a_peer_that_does_not_read_holds_no_scan(server: Server, link: CanLink) -> None:
    client_of(link).setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1)
    server.connected()
    longest = 0.0
    for _ in range(1_000_000):
        start = time.monotonic()
        sent = link.send(FRAME)
        longest = max(longest, time.monotonic() - start)
        if not sent:
            break
    assert link.lost
    assert link.lost_because.startswith("sending failed")
    assert longest < 0.5  # 2 ms asked for; the kernel's tick and a busy machine add to it
    assert not link._sendable
    assert not link.send(FRAME)
    assert link.sends_failed == 2


def test_the_last_frames_arrive_although_others_are_unread(server: Server, link: CanLink) -> None:
    peer = server.connected()
    for _ in range(100):
        peer.sendall(b"< frame 185 1.5 3712 >")
    link.send(FRAME)
    closing = threading.Thread(target=link.close)
    closing.start()
    time.sleep(0.02)
    received = b""
    with contextlib.suppress(ConnectionError):  # a server that finds the connection reset gives it up
        while True:
            peer.sendall(b"< frame 185 1.5 3712 >")
            piece = peer.recv(100)
            if not piece:
                break
            received += piece
    peer.close()
    closing.join(1)
    assert received == b"< send 205 5 f 0 a d4 fe >"


@pytest.mark.parametrize(
    "garbage",
    [
        b"< frame xyz 1 00 >",
        b"< frame 185 1.0 0 >",
        b"< frame 185 one 00 >",
        b"< frame 185 1.2.3 00 >",
        b"< frame 185 1.5 00 >x< frame 185 1.5 00 >",
        b"\xff\xfe",
        b"< frame >",
        b">",
        b"x< frame 185 1.5 00 >",
        b"< frame 185 1.5 " + b"0" * 200,
    ],
)
def test_garbage_from_the_server_is_a_lost_bus(server: Server, link: CanLink, garbage: bytes) -> None:
    server.connected().sendall(garbage)
    for _ in range(100):
        link.receive()
        time.sleep(0.001)
        if link.lost:
            break
    assert link.lost_because.startswith("receiving failed")
    assert link.receive() is None


def test_refused_at_once() -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    start = time.monotonic()
    with pytest.raises(BusError, match=rf"socketcand 127.0.0.1:{port} channel vcan0: the CAN bus cannot be opened"):
        open_can(CanConfig("socketcand", "vcan0", port=port))
    assert time.monotonic() - start < 1.0


@pytest.mark.parametrize("answers", [(b"",), (b"< hi >", b""), (b"< hi >", b"< error could not open bus >")])
def test_a_server_that_does_not_answer_right(answers: tuple[bytes, ...]) -> None:
    server = Server(*answers)
    try:
        with pytest.raises(BusError, match="check that the socketcand server"):
            open_can(server.client())
    finally:
        server.close()


def test_a_missing_interface_is_told() -> None:
    with pytest.raises(BusError, match=r"socketcan nocan7: the CAN bus cannot be opened.*ip -details link show"):
        open_can(CanConfig("socketcan", "nocan7"))


def test_a_missing_adapter_is_told() -> None:
    with pytest.raises(BusError, match="slcan /dev/nothing"):
        open_can(CanConfig("slcan", serial_port="/dev/nothing"))


class FailingBus:
    """A SocketCAN bus whose transmit queue is full once."""

    def __init__(self) -> None:
        self.sends = 0

    def send(self, _message: can.Message, _timeout: float | None) -> None:
        self.sends += 1
        if self.sends == 1:
            raise can.CanOperationError("Transmit buffer full")

    def recv(self, _timeout: float) -> can.Message | None:
        raise OSError(100, "Network is down")

    def shutdown(self) -> None:
        raise OSError(9, "Bad file descriptor")


def test_socketcan_stays_lost_but_goes_on_trying() -> None:
    link = CanLink(FailingBus(), CanConfig("socketcan", "can0"))  # type: ignore[arg-type]
    assert not link.send(FRAME)
    assert link.send(FRAME), "the quick stop must still get through when the queue empties"
    assert link.lost
    assert link.lost_because == "sending failed: Transmit buffer full"
    assert link.receive() is None
    link.close()


def test_what_somebody_set_for_python_can_makes_no_bus_of_ours_another_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Our own frames would come back, and be taken for those of another controller."""
    monkeypatch.setenv("CAN_CONFIG", '{"receive_own_messages": true}')
    link = open_can(CanConfig("virtual", "own-frames"))
    link.send_frames([(0x080, b"")])
    assert link.take(10) == []
    link.close()
