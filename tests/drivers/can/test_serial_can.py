"""CAN over slcan on a pseudo-terminal: python-can's protocol at one end, the virtual bench's adapter at the other."""

from __future__ import annotations

import asyncio
import os
import select
import threading
import time
import tty
from collections.abc import Callable, Iterator

import can
import pytest
from can.interfaces.slcan import slcanBus

from drivers.can.bus import CanLink, open_can
from drivers.can.serial_bus import LONGEST_LINE, ScanSlcanBus
from drivers.config import CanConfig
from drivers.errors import BusError
from virtual_bench.wires.slcan_server import SlcanServer

FRAME = can.Message(arbitration_id=0x205, is_extended_id=False, data=b"\x0f\x00\x0a\xd4\xfe")


class Adapter:
    """An adapter that says what the test says."""

    def __init__(self) -> None:
        self.master, slave = os.openpty()
        tty.setraw(slave)
        self.path = os.ttyname(slave)
        self.link = open_can(CanConfig("slcan", serial_port=self.path, serial_settle_s=0.0))
        os.close(slave)

    def heard(self) -> bytes:
        return os.read(self.master, 4096)

    def heard_to(self, end: bytes) -> bytes:
        """What came until a line ends it: a read has what was written so far, which may be the half of it."""
        found = b""
        while not found.endswith(end):
            assert select.select([self.master], [], [], 10.0)[0], found
            found += self.heard()
        return found

    def say(self, text: bytes) -> None:
        os.write(self.master, text)
        select.select([self.link.bus.fileno()], [], [], 1.0)

    def unplug(self) -> None:
        if self.master >= 0:
            os.close(self.master)
            self.master = -1

    def close(self) -> None:
        self.link.close()
        self.unplug()


@pytest.fixture
def adapter() -> Iterator[Adapter]:
    one = Adapter()
    yield one
    one.close()


def drained(link: CanLink) -> list[tuple[int, bytes]]:
    """What one scan takes: frames until the link says that there are none."""
    found = []
    while (message := link.receive()) is not None:
        found.append((message.arbitration_id, bytes(message.data)))
    return found


def test_contract_python_can_reads_and_writes_through_what_is_replaced() -> None:
    assert {"_read", "_write", "_recv_internal", "shutdown"} <= set(vars(slcanBus))
    assert slcanBus.LINE_TERMINATOR == b"\r"


def test_opening_sets_the_bit_rate_and_opens_the_channel(adapter: Adapter) -> None:
    heard = adapter.heard_to(b"O\r").split(b"\r")
    assert heard.index(b"S8") < len(heard) - 1 - heard[::-1].index(b"O")


def test_a_frame_is_one_line(adapter: Adapter) -> None:
    line = b"t20550F000AD4FE\r"
    assert adapter.link.send(FRAME)
    adapter.heard_to(line)  # behind all that opening the channel has said, however late that comes
    assert adapter.link.send(FRAME)
    assert adapter.link.send(FRAME)
    assert adapter.heard_to(2 * line) == 2 * line


def test_acknowledgements_do_not_end_the_drain_of_a_scan(adapter: Adapter) -> None:
    """With python-can's own bus each of them ends it, so that values grow older with every frame that is sent."""
    adapter.say(b"z\rz\r\rt18523712\rz\rt705105\r\a")
    assert drained(adapter.link) == [(0x185, b"\x37\x12"), (0x705, b"\x05")]
    assert not adapter.link.lost
    bus = adapter.link.bus
    assert isinstance(bus, ScanSlcanBus)
    assert bus.refusals == 1


@pytest.mark.parametrize("cut", range(1, 10))
def test_a_frame_split_at_every_place(adapter: Adapter, cut: int) -> None:
    line = b"t18523712\r"
    adapter.say(line[:cut])
    assert drained(adapter.link) == []
    adapter.say(line[cut:])
    assert drained(adapter.link) == [(0x185, b"\x37\x12")]


def test_an_empty_port_holds_no_scan(adapter: Adapter) -> None:
    start = time.monotonic()
    for _ in range(1000):
        assert adapter.link.receive() is None
    assert time.monotonic() - start < 0.5


@pytest.mark.parametrize("garbage", [b"t1x5\r", b"t\r", b"t185\xff\xfe\r", b"T185\r", b"?" * (LONGEST_LINE + 1)])
def test_garbage_from_the_adapter_is_a_lost_bus(adapter: Adapter, garbage: bytes) -> None:
    adapter.say(garbage)
    assert drained(adapter.link) == []
    assert adapter.link.lost_because.startswith("receiving failed")
    assert not adapter.link.lost_because.endswith(": ")


def test_an_unplugged_adapter_is_a_lost_bus_and_its_port_is_closed(adapter: Adapter) -> None:
    bus = adapter.link.bus
    assert isinstance(bus, ScanSlcanBus)
    adapter.unplug()
    assert adapter.link.receive() is None
    assert (
        adapter.link.lost_because
        == "receiving failed: the CAN adapter is gone: its serial port was closed. Check its USB plug"
    )
    assert not adapter.link.send(FRAME)
    adapter.link.close()
    assert not bus.serialPortOrig.is_open


def test_an_unplugged_adapter_is_noticed_by_sending(adapter: Adapter) -> None:
    assert adapter.link.send(FRAME)
    adapter.unplug()
    assert not adapter.link.send(FRAME)
    assert adapter.link.lost_because.startswith("sending failed: the CAN adapter is gone")


def test_an_adapter_that_does_not_take_its_frames_holds_no_scan(adapter: Adapter) -> None:
    longest = 0.0
    for _ in range(100_000):
        start = time.monotonic()
        sent = adapter.link.send(FRAME)
        longest = max(longest, time.monotonic() - start)
        if not sent:
            break
    assert "does not accept frames" in adapter.link.lost_because
    assert longest < 0.5  # 2 ms asked for; a busy machine adds to it


def test_a_missing_adapter_is_told() -> None:
    with pytest.raises(BusError, match=r"slcan /dev/nothing: the CAN bus cannot be opened.*port name"):
        open_can(CanConfig("slcan", serial_port="/dev/nothing", serial_settle_s=0.0))


# --- the virtual bench's adapter ---


class Served:
    """The adapter of the virtual bench in a thread; what it heard from the controller, what it logged."""

    def __init__(self, bitrate: int = 1_000_000) -> None:
        self.frames: list[tuple[int, bytes]] = []
        self.events: list[str] = []
        self.path = ""
        self._loop = asyncio.new_event_loop()
        self.server = SlcanServer("", bitrate, self._heard, lambda kind, _text: self.events.append(kind))
        self._up = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        assert self._up.wait(5)

    def _heard(self, cob_id: int, data: bytes) -> None:
        self.frames.append((cob_id, data))

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self.path = self._loop.run_until_complete(self.server.start())
        self._loop.call_soon(self._up.set)
        self._loop.run_forever()
        self._loop.run_until_complete(self.server.stop())

    def send(self, cob_id: int, data: bytes) -> None:
        self._loop.call_soon_threadsafe(self.server.send, cob_id, data)

    def wait_for(self, kind: str) -> None:
        self.wait_until(lambda: kind in self.events)

    def wait_until(self, condition: Callable[[], bool]) -> None:
        end = time.monotonic() + 5.0
        while not condition():
            assert time.monotonic() < end, f"it did not come: {self.events} {self.frames}"
            time.sleep(0.001)

    def close(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(5)
        self._loop.close()


@pytest.fixture
def served() -> Iterator[Served]:
    one = Served()
    yield one
    one.close()


def soon(bus: can.BusABC) -> can.Message | None:
    return bus.recv(2.0)


def test_python_cans_own_bus_and_the_virtual_adapter_understand_each_other(served: Served) -> None:
    """python-can as it is, so that our two ends cannot share a mistake."""
    with slcanBus(served.path, bitrate=1_000_000, sleep_after_open=0) as bus:
        assert bus.get_version(2.0) == (10, 13)
        assert bus.get_serial_number(2.0) == "LM01"
        bus.send(FRAME)
        bus.send(can.Message(arbitration_id=0x80, is_extended_id=False))
        assert bus.get_version(2.0) == (10, 13)  # the frames before it have been taken
        assert served.frames == [(0x205, bytes(FRAME.data)), (0x80, b"")]
        served.send(0x185, b"\x37\x12")
        heard = None
        while heard is None:
            heard = bus.recv(1.0)
        assert (heard.arbitration_id, bytes(heard.data)) == (0x185, b"\x37\x12")


def test_frames_both_ways_with_the_links_bus(served: Served) -> None:
    link = open_can(CanConfig("slcan", serial_port=served.path, serial_settle_s=0.0))
    served.wait_for("can_client")
    try:
        for number in range(100):
            assert link.send(can.Message(arbitration_id=0x205, is_extended_id=False, data=bytes((number,))))
            served.send(0x185, bytes((number, 1)))
            heard = soon(link.bus)
            assert heard is not None
            assert bytes(heard.data) == bytes((number, 1))
        served.wait_until(lambda: len(served.frames) == 100)  # what it has not read is lost with the port
    finally:
        link.close()
    assert served.frames == [(0x205, bytes((number,))) for number in range(100)]


def test_another_bit_rate_reaches_nobody(served: Served) -> None:
    link = open_can(CanConfig("slcan", serial_port=served.path, bitrate=500_000, serial_settle_s=0.0))
    served.wait_for("can_bitrate")
    assert link.send(FRAME)
    served.send(0x185, b"\x37\x12")
    assert link.bus.recv(0.2) is None
    link.close()
    assert served.frames == []


REFUSED = {
    "no hex digits": b"t2x5",
    "too long": b"t20590000000000000000",
    "length does not fit": b"t20520F",
    "identifier beyond 11 bits": b"t8005",
    "no such command": b"Q",
}


@pytest.mark.parametrize("line", REFUSED.values(), ids=list(REFUSED))
def test_the_virtual_adapter_refuses_with_a_bell(served: Served, line: bytes) -> None:
    with slcanBus(served.path, bitrate=1_000_000, sleep_after_open=0) as bus:
        assert bus.get_version(2.0) == (10, 13)
        bus.serialPortOrig.write(line + b"\r")
        bus.serialPortOrig.timeout = 2.0
        assert bus.serialPortOrig.read(1) == b"\a"
    assert served.frames == []


def test_frames_are_refused_while_the_channel_is_closed(served: Served) -> None:
    bus = slcanBus(served.path, bitrate=1_000_000, sleep_after_open=0)
    bus.close()
    bus.send(FRAME)
    assert bus.get_version(2.0) == (10, 13)
    bus.shutdown()
    assert served.frames == []
