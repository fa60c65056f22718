"""Modbus RTU against pymodbus' serial server over pseudo-terminals, with a cable that spoils what it carries."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import pytest
from drivers_support import PERIOD_NS, modbus_config
from pymodbus_bench import AMPLIFIER, BRAKE, PymodbusBench
from serial_cable import Pieces, SerialCable

from drivers.errors import ModbusError
from drivers.modbus.device import ModbusDevice
from drivers.modbus.frames import Outcome
from drivers.modbus.line import ModbusLine

pytestmark = [pytest.mark.wires, pytest.mark.wall_clock]

TIMEOUT, DRAIN = 400, 600
"""In scans of a millisecond: longer than a machine holds the server or the cable up."""


class Stand:
    """The amplifier on a serial line, scanned every millisecond."""

    def __init__(self) -> None:
        self.cable = SerialCable()
        self.server = PymodbusBench(serial_port=self.cable.device)
        config = modbus_config("virtual-amplifier", AMPLIFIER, transport="rtu", serial_port=self.cable.controller)
        self.line = ModbusLine(config, TIMEOUT, DRAIN)
        self.amplifier = ModbusDevice(config, self.line, 1, 250)
        self.line.open()
        self.scan = 0
        self.counters: list[float] = []

    @property
    def counter(self) -> float:
        return self.amplifier.values[self.amplifier.place("sample_counter")]

    def run(self, until: Callable[[], bool], most_scans: int = 3000) -> None:
        """Scan until it is so; notes the sample counter of every scan."""
        for _ in range(most_scans):
            self.scan += 1
            self.amplifier.poll(self.scan)
            if self.line.ready(self.scan):
                self.amplifier.send(self.scan)
            self.counters.append(self.counter)
            if until():
                return
            time.sleep(PERIOD_NS * 1e-9)
        pytest.fail(f"not reached in {most_scans} scans: {self.line.timeouts=} {self.line.garbage=}")

    def scans(self, more: int) -> None:
        wanted = self.scan + more
        self.run(lambda: self.scan >= wanted)

    def replies(self, more: int) -> None:
        wanted = self.amplifier.replies + more
        self.run(lambda: self.amplifier.replies >= wanted)

    def close(self) -> None:
        self.line.close()
        self.server.close()
        self.cable.close()


@pytest.fixture
def stand() -> Iterator[Stand]:
    one = Stand()
    yield one
    one.close()


@pytest.fixture
def running(stand: Stand) -> Stand:
    stand.replies(5)
    assert stand.amplifier.trusted
    return stand


class Held:
    """Replies that are under way until the test lets them arrive."""

    def __init__(self) -> None:
        self._held: list[bytes] = []

    def hold(self, data: bytes) -> Pieces:
        self._held.append(data)
        return []

    def pop(self) -> bytes:
        """Take the oldest; waits for it."""
        end = time.monotonic() + 10.0
        while not self._held:
            assert time.monotonic() < end, "nothing was held"
            time.sleep(0.001)
        return self._held.pop(0)


def once(what: Callable[[bytes], Pieces]) -> Callable[[bytes], Pieces]:
    """Spoil the next reply and leave the others."""
    left = [what]

    def reply(data: bytes) -> Pieces:
        return left.pop()(data) if left else [(0.0, data)]

    return reply


def test_identity_then_values(running: Stand) -> None:
    first = running.cable.requests[0]
    assert first[:6] == bytes((AMPLIFIER, 4, 0, 0, 0, 1)), "the identity register is asked first"
    assert running.amplifier.values[running.amplifier.place("torque_out_nm")] == pytest.approx(123.4567)
    assert (running.line.garbage, running.line.timeouts, running.line.strangers) == (0, 0, 0)


def test_a_reply_after_the_time_out_is_not_the_next_answer(running: Stand) -> None:
    """The published trap. The counter in a late reply is old: taken for the next answer, every one would be."""
    held = Held()
    running.cable.on_reply = once(held.hold)
    epoch = running.line.epoch
    running.run(lambda: running.line.timeouts == 1)
    assert not running.amplifier.trusted
    asked, sampled, before = len(running.cable.requests), running.server.sample_counter, running.counter
    running.scans(30)
    running.cable.babble(held.pop())
    running.run(lambda: len(running.cable.requests) > asked)
    assert running.cable.requests[asked][:6] == bytes((AMPLIFIER, 4, 0, 0, 0, 1)), "the identity comes before the data"
    assert running.counter == before, "the late reply was taken for an answer"
    further = len(running.cable.requests) - asked - 1
    assert running.server.sample_counter <= sampled + 1 + further, "nobody was asked for data in between"
    running.replies(20)
    assert running.line.epoch == epoch + 1
    assert running.amplifier.trusted
    assert running.counters == sorted(running.counters)
    assert running.server.sample_counter - running.counter <= 1, "each answer is that of its own request"


def test_every_reply_late_never_gives_a_value(running: Stand) -> None:
    held = Held()
    running.cable.on_reply = held.hold
    running.run(lambda: running.line.timeouts == 1)
    before = running.counter
    for late in (2, 3):
        running.scans(20)
        running.cable.babble(held.pop())
        running.run(lambda late=late: running.line.timeouts == late)
    running.cable.babble(held.pop())
    assert running.counter == before
    assert running.amplifier.age_scans(running.scan) > 2 * TIMEOUT
    running.cable.on_reply = lambda data: [(0.0, data)]
    running.replies(3)
    assert running.counter > before


def flipped(data: bytes) -> Pieces:
    return [(0.0, data[:7] + bytes((data[7] ^ 0x10,)) + data[8:])]


SPOILT: dict[str, Callable[[bytes], Pieces]] = {
    "a bit flipped": lambda data: flipped(data) if len(data) > 8 else [(0.0, data[::-1])],
    "wrong check sum": lambda data: [(0.0, data[:-1] + bytes((data[-1] ^ 1,)))],
    "noise before the frame": lambda data: [(0.0, b"\xff\x00\x55" + data)],
    "noise after the frame": lambda data: [(0.0, data + b"\x00")],
    "last bytes missing": lambda data: [(0.0, data[:-3])],
    "nothing": lambda _data: [],
    "twice": lambda data: [(0.0, data + data)],
}


@pytest.mark.parametrize("spoil", SPOILT.values(), ids=list(SPOILT))
def test_a_spoilt_reply_costs_a_value_and_nothing_else(running: Stand, spoil: Callable[[bytes], Pieces]) -> None:
    epoch = running.line.epoch
    running.cable.on_reply = once(spoil)
    running.run(lambda: running.line.garbage + running.line.timeouts == 1)
    before = running.counter
    assert running.line.epoch > epoch, "the identity is read again"
    running.replies(5)
    assert running.counter > before
    assert running.amplifier.trusted
    assert not running.line.lost


def test_a_reply_in_single_bytes_is_a_reply(running: Stand) -> None:
    running.cable.on_reply = lambda data: [(0.0005 * at, data[at : at + 1]) for at in range(len(data))]
    before = running.counter
    running.replies(5)
    assert running.counter > before
    assert (running.line.garbage, running.line.timeouts) == (0, 0)


def test_noise_between_transactions_is_thrown_away(running: Stand) -> None:
    while running.amplifier._pending is not None:
        running.scan += 1
        running.amplifier.poll(running.scan)
        time.sleep(0.001)
    strangers = running.line.strangers
    for _ in range(3):
        running.cable.babble(b"\x00\xff\x01\x04")
        time.sleep(0.002)
    running.replies(5)
    assert running.line.strangers == strangers + 1
    assert running.amplifier.trusted


def test_an_unplugged_adapter_is_a_lost_line_at_once(running: Stand) -> None:
    running.cable.pull_out()
    start = running.scan
    running.run(lambda: running.line.lost, most_scans=TIMEOUT)
    assert running.scan - start <= 3
    assert "unplugged" in running.line.lost_because or "Input/output" in running.line.lost_because
    assert running.amplifier.lost
    for scan in range(running.scan + 1, running.scan + 20):
        running.amplifier.poll(scan)
        running.amplifier.send(scan)
    with pytest.raises(ModbusError, match=r"no connection.*check cable, power"):
        running.line.open()


def test_another_device_on_the_line_is_not_believed(stand: Stand) -> None:
    config = modbus_config("virtual-amplifier", BRAKE, transport="rtu", serial_port=stand.cable.controller)
    wrong = ModbusDevice(config, stand.line, 1, 250)
    reply = wrong.verify()
    assert reply.outcome is Outcome.DATA
    assert reply.data == b"\x4c\x42"
    assert not wrong.trusted
