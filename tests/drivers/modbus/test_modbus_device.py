"""A Modbus device in the scan: which request is next, how old its values are, and what is not believed."""

from __future__ import annotations

import os
import pty
import select
import socket
import struct
import tty
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise

import pytest
from drivers_support import modbus_config, modbus_profile, raw_profile
from hypothesis import given
from hypothesis import strategies as st
from pymodbus.framer import FramerRTU

from definitions.image import AGE_NEVER
from drivers.config import ModbusConfig
from drivers.modbus.device import EXCEPTIONS_IN_A_ROW, ModbusDevice
from drivers.modbus.line import ModbusLine

POLL, REASSERT, TIMEOUT = 4, 50, 3
BRAKE_ID = 0x4C42


class Brake:
    """A brake device on a socket pair; the test answers its requests."""

    def __init__(self, config: ModbusConfig | None = None) -> None:
        ours, self.peer = socket.socketpair()
        ours.setblocking(False)  # noqa: FBT003
        self.peer.setblocking(False)  # noqa: FBT003
        config = config or modbus_config("virtual-brake", 2)
        self.line = ModbusLine(config, TIMEOUT, 3 * TIMEOUT)
        self.line.attach(ours)
        self.device = ModbusDevice(config, self.line, POLL, REASSERT)
        self.registers = [BRAKE_ID, 0, 0]
        self.life, self.alive = 0, True
        self.exception = 0

    def asked(self) -> tuple[bytes, bytes]:
        """Transaction header and body of the request sent in this scan, empty when there was none."""
        try:
            frame = self.peer.recv(300)
        except BlockingIOError:
            return b"", b""
        return frame[:2], frame[6:]

    def answer(self) -> str:
        """Answer what was asked; tells what it was."""
        head, body = self.asked()
        if not body:
            return "-"
        kind = {4: "identity" if body[5] == 1 else "read", 16: "write"}[body[1]]
        if self.exception:
            reply = bytes((2, body[1] | 0x80, self.exception))
        elif kind == "write":
            reply = body[:6]
        else:
            self.life += self.alive
            data = b"".join(value.to_bytes(2, "big") for value in (*self.registers, self.life)[: body[5]])
            reply = bytes((2, 4, len(data))) + data
        self.peer.sendall(head + b"\0\0" + len(reply).to_bytes(2, "big") + reply)
        return kind

    def scan(self, number: int, answer: Callable[[], str] | None = None) -> str:
        self.device.poll(number)
        if self.line.ready(number):
            self.device.send(number)
        return (answer or self.answer)()

    def close(self) -> None:
        self.line.close()
        self.peer.close()


@pytest.fixture
def brake() -> Iterator[Brake]:
    one = Brake()
    yield one
    one.close()


ON = {"brake_on": 1, "brake_current_a": 2.0}
OFF = {"brake_on": 0, "brake_current_a": 0.0}


def test_identity_first_then_a_read_every_n_scans(brake: Brake) -> None:
    assert [brake.scan(n) for n in range(14)] == [
        "identity",
        *["-"] * 3,
        "read",
        *["-"] * 3,
        "read",
        *["-"] * 3,
        "read",
        "-",
    ]
    assert brake.device.age_scans(13) == 0
    assert brake.device.age_scans(15) == 2


def test_a_life_counter_that_stands_still_makes_values_age_although_replies_come(brake: Brake) -> None:
    for n in range(6):
        brake.scan(n)
    brake.alive = False
    replies = brake.device.replies
    for n in range(6, 60):
        brake.scan(n)
    assert brake.device.replies > replies + 5
    assert brake.device.age_scans(60) > 50
    brake.alive = True
    for n in range(60, 60 + 2 * POLL):
        brake.scan(n)
    assert brake.device.age_scans(60 + 2 * POLL) <= 2 * POLL


def test_a_device_without_a_life_counter_needs_none() -> None:
    raw = raw_profile("virtual-brake")
    raw["read"]["fields"] = [field for field in raw["read"]["fields"] if field["name"] != "life_counter"]
    one = Brake(replace(modbus_config("virtual-brake", 2), profile=modbus_profile(raw)))
    one.alive = False
    for n in range(60):
        one.scan(n)
    assert one.device.age_scans(60) <= 2 * POLL
    one.close()


def test_values_by_name_and_zero_for_what_the_device_has_not(brake: Brake) -> None:
    brake.registers = [BRAKE_ID, 1, 2500]
    assert brake.device.age_scans(0) == AGE_NEVER
    for n in range(6):
        brake.scan(n)
    values = brake.device.values
    assert values[brake.device.place("brake_current_a")] == 2.5
    assert values[brake.device.place("brake_on")] == 1
    assert values[brake.device.place("housing_temp_c")] == 0


def test_an_order_is_written_once_and_again_after_a_while(brake: Brake) -> None:
    writes = []
    for n in range(130):
        brake.device.order(ON)
        writes += [n] if brake.scan(n) == "write" else []
    assert writes[0] <= 2
    assert len(writes) == 3
    assert all(REASSERT <= later - earlier <= REASSERT + 2 for earlier, later in pairwise(writes))


def test_a_write_that_got_lost_is_repeated_at_once(brake: Brake) -> None:
    def silent() -> str:
        _, body = brake.asked()
        return "write" if body[1:2] == b"\x10" else "read" if body else "-"

    for n in range(4):
        brake.scan(n)
    brake.device.order(ON)
    seen = [brake.scan(n, silent) for n in range(4, 24)]
    assert seen.count("write") >= 2
    seen = [brake.scan(n) for n in range(24, 34)]
    assert seen.count("write") == 1


def test_orders_that_change_in_every_scan_do_not_starve_the_reads(brake: Brake) -> None:
    seen = []
    for n in range(100):
        brake.device.order({"brake_on": 1, "brake_current_a": n / 100})
        seen.append(brake.scan(n))
    assert seen.count("read") >= 100 // POLL - 2
    assert seen.count("write") >= 60
    assert brake.device.age_scans(99) <= POLL + 2


def test_orders_back_and_forth_end_with_the_last(brake: Brake) -> None:
    for n in range(4):
        brake.scan(n)
    brake.device.order(ON)
    brake.device.poll(4)
    brake.device.send(4)
    brake.device.order(OFF)  # while the first write is on its way
    bodies = []

    def note() -> str:
        head, body = brake.asked()
        if body[1:2] == b"\x10":
            bodies.append(body[7:])
            brake.peer.sendall(head + b"\0\0\0\6" + body[:6])
        elif body:
            brake.peer.sendall(head + b"\0\0\0\x09\2\4\6" + struct.pack(">3H", BRAKE_ID, 0, 0))
        return "-"

    note()
    for n in range(5, 15):
        brake.scan(n, note)
    assert bodies[0] == struct.pack(">HH", 1, 2000)
    assert bodies[-1] == struct.pack(">HH", 0, 0)


def test_exceptions_in_a_row_are_a_lost_link(brake: Brake) -> None:
    for n in range(6):
        brake.scan(n)
    brake.exception = 6
    lost = []
    for n in range(6, 6 + (EXCEPTIONS_IN_A_ROW + 1) * POLL):
        brake.scan(n)
        lost.append(brake.device.lost)
    assert lost.count(True) == pytest.approx(POLL, abs=3)
    assert not lost[POLL]
    assert brake.device.last_exception == 6
    assert brake.device.age_scans(30) > 20
    brake.exception = 0
    for n in range(30, 36):
        brake.scan(n)
    assert not brake.device.lost


def test_another_device_on_the_line_is_not_believed(brake: Brake) -> None:
    for n in range(6):
        brake.scan(n)
    brake.registers = [0x4C41, 1, 9999]
    for n in range(6, 30):
        brake.scan(n)
    assert brake.device.values[brake.device.place("brake_current_a")] == 0
    assert brake.device.identity_mismatches >= 4
    assert brake.device.age_scans(30) == 25
    brake.registers = [BRAKE_ID, 1, 1000]
    assert "identity" in [brake.scan(n) for n in range(30, 40)]
    assert brake.device.values[brake.device.place("brake_current_a")] == 1.0


def test_after_a_resynchronisation_the_identity_is_read_before_a_value_is_believed(brake: Brake) -> None:
    for n in range(6):
        brake.scan(n)
    brake.line.epoch += 1
    brake.device.order(ON)
    seen = [brake.scan(n) for n in range(6, 20)]
    assert [kind for kind in seen if kind != "-"][:2] == ["identity", "write"]


def test_a_sample_counter_that_stands_still_ages() -> None:
    config = modbus_config("virtual-amplifier", 1)
    device = ModbusDevice(config, ModbusLine(config, TIMEOUT, 9), 1, REASSERT)
    for scan, counter in enumerate([5, 6, 6, 6, 7]):
        device._take_values(struct.pack(">14H", 0x4C41, 0, 0, counter, *[0] * 10), scan)
        assert device.age_scans(scan) == {5: 0, 6: scan - 1, 7: 0}[counter]


def test_a_shared_line_serves_the_most_overdue_first(brake: Brake) -> None:
    other = ModbusDevice(modbus_config("virtual-remote-io", 3), brake.line, POLL, REASSERT)
    assert brake.device.urgency(0) == other.urgency(0) > POLL
    brake.device.send(0)
    assert brake.device.urgency(9) == -1
    assert other.urgency(9) > POLL, "never asked: also before a device that is due again in every scan"
    other.send(9)
    assert other.urgency(10) == 1 - POLL, "a line that is busy costs the device its turn, not its request"


LATE = {3: TIMEOUT + 2, 6: 2 * TIMEOUT}
"""Requests that are answered late, by so many scans; the others are answered at once."""


def test_a_late_reply_on_rtu_never_becomes_a_value() -> None:
    master, slave = pty.openpty()
    tty.setraw(master)
    config = modbus_config("virtual-brake", 2, transport="rtu", serial_port=os.ttyname(slave))
    line = ModbusLine(config, TIMEOUT, 3 * TIMEOUT)
    line.open()
    os.close(slave)
    device = ModbusDevice(config, line, POLL, REASSERT)
    current = device.place("brake_current_a")
    asked = 0
    on_the_way: dict[int, bytes] = {}
    try:
        for scan in range(120):
            device.poll(scan)
            if device.age_scans(scan) == 0:
                assert device.values[current] * 1000 == pytest.approx(scan - 1), "the current of another scan"
            if line.ready(scan):
                device.send(scan)
            if select.select([master], [], [], 0)[0]:
                asked += 1
                count = os.read(master, 100)[5]
                body = bytes((2, 4, 2 * count)) + struct.pack(">4H", BRAKE_ID, 1, scan, scan)[: 2 * count]
                on_the_way[scan + LATE.get(asked, 0)] = body + FramerRTU.compute_CRC(body).to_bytes(2, "big")
            if scan in on_the_way:
                os.write(master, on_the_way[scan])
                select.select([line._descriptor], [], [], 1.0)
    finally:
        line.close()
        os.close(master)
    assert line.timeouts == len(LATE)
    assert device.replies == asked - len(LATE) > 15


@given(st.lists(st.integers(0, 0xFFFF), min_size=14, max_size=14), st.integers(0, 100))
def test_no_registers_raise(registers: list[int], scan: int) -> None:
    config = modbus_config("virtual-amplifier", 1)
    device = ModbusDevice(config, ModbusLine(config, TIMEOUT, 9), 1, REASSERT)
    device._take(device._read_request, struct.pack(">14H", *registers), scan)
    assert (device.age_scans(scan) == 0) == (registers[0] == 0x4C41)


def test_a_device_without_identity_is_read_at_once_and_after_every_timeout() -> None:
    config = modbus_config("virtual-brake", 2)
    one = Brake(replace(config, profile=replace(config.profile, identity=None)))
    try:
        assert one.device.trusted
        seen = [one.scan(n) for n in range(8)]
        assert seen[0] == "read"
        assert "identity" not in seen
        assert one.device.age_scans(8) < POLL + 1
        for n in range(8, 16):
            one.scan(n, lambda: str(one.asked() and "-"))
        assert one.line.timeouts
        assert one.device.age_scans(16) > POLL, "values age, whoever the device is"
        assert "identity" not in [one.scan(n) for n in range(16, 24)]
    finally:
        one.close()
