"""The CAN link on a SocketCAN bus with another node beside it; only where there is a vcan0."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from drivers.can.bus import CanLink, open_can
from drivers.config import CanConfig
from virtual_bench.config import CanBus
from virtual_bench.wires.python_can_port import PythonCanPort

pytestmark = pytest.mark.skipif(
    not Path("/sys/class/net/vcan0").exists(),
    reason="there is no vcan0 here: make test-socketcan boots a guest that has one",
)


@pytest.fixture
def other() -> Iterator[can.BusABC]:
    with can.Bus(interface="socketcan", channel="vcan0") as bus:
        yield bus


@pytest.fixture
def link() -> Iterator[CanLink]:
    one = open_can(CanConfig("socketcan", "vcan0"))
    yield one
    one.close()


def received(link: CanLink, count: int, most_s: float = 5.0) -> list[can.Message]:
    """Drain the link, as the scan does, until so many frames have come."""
    found: list[can.Message] = []
    end = time.monotonic() + most_s
    while len(found) < count and time.monotonic() < end:
        message = link.receive()
        if message is not None:
            found.append(message)
    return found


def test_frames_arrive_in_order_and_unchanged(link: CanLink, other: can.BusABC) -> None:
    sent = [
        can.Message(arbitration_id=0x185 + n % 3, data=bytes([n, 255 - n]), is_extended_id=False) for n in range(64)
    ]
    for message in sent:
        other.send(message)
    found = received(link, len(sent))
    assert [(m.arbitration_id, bytes(m.data)) for m in found] == [(m.arbitration_id, bytes(m.data)) for m in sent]
    assert link.receive() is None


def test_what_the_link_sends_is_on_the_bus_and_not_its_own_answer(link: CanLink, other: can.BusABC) -> None:
    sync = can.Message(arbitration_id=0x80, is_extended_id=False, data=b"")
    assert link.send(sync)
    heard = other.recv(5.0)
    assert heard is not None
    assert (heard.arbitration_id, heard.dlc) == (0x80, 0)
    assert link.receive() is None


def test_an_empty_bus_never_makes_the_scan_wait(link: CanLink) -> None:
    start = time.monotonic()
    for _ in range(100):
        assert link.receive() is None
    assert time.monotonic() - start < 2.0


def test_the_virtual_drives_port_says_nothing_more_once_it_is_closed(other: can.BusABC) -> None:
    """The drive still had something to say when its bus was closed: ValueError, file descriptor -1."""
    told: list[str] = []

    async def use() -> None:
        port = PythonCanPort(
            CanBus("socketcan", "vcan0"), lambda _id, _data: None, lambda kind, _text: told.append(kind)
        )
        await port.start()
        port.send(0x185, b"\x37\x12")
        await port.stop()
        port.send(0x185, b"\x37\x13")

    asyncio.run(use())
    heard = other.recv(5.0)
    assert heard is not None
    assert bytes(heard.data) == b"\x37\x12"
    assert other.recv(0.2) is None
    assert told == []
