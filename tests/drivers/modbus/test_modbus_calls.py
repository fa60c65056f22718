"""Modbus of one scan: never more system calls than a scan may make, and whoever had to wait is not forgotten."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import pytest
from can_drive_support import DriveOnBus, orders
from drivers_support import PERIOD_NS, drive_config, modbus_config

from definitions.image import Command
from drivers.config import CanConfig, WireBenchConfig
from drivers.wire_bench import WireBench

EVERY_SCAN_S = PERIOD_NS * 1e-9


class ThreeLines:
    """A bench whose three Modbus devices have a line each and are due in every scan; the test answers them."""

    def __init__(self) -> None:
        self.bus = DriveOnBus("modbus-calls")
        parts = {
            part: modbus_config(f"virtual-{part.replace('_', '-')}", unit, port=unit, poll_every_s=EVERY_SCAN_S)
            for unit, part in enumerate(("amplifier", "brake", "remote_io"), start=1)
        }
        self.bench = WireBench(
            WireBenchConfig(PERIOD_NS, CanConfig("virtual", "modbus-calls"), drive_config(), **parts)
        )
        self.bench._link, self.bench._drive = self.bus.link, self.bus.drive
        self.peers: list[socket.socket] = []
        for line in self.bench._lines.values():
            ours, peer = socket.socketpair()
            ours.setblocking(False)  # noqa: FBT003
            peer.setblocking(False)  # noqa: FBT003
            line.attach(ours)
            self.peers.append(peer)
        for device in self.bench._devices:
            device._trusted_epoch = device.line.epoch
        self.waiting: dict[int, bytes] = {}

    def scan(self, number: int) -> tuple[int, list[int]]:
        """Run one scan; return how many requests were in flight when it began, and whose went out in it."""
        in_flight = sum(device._pending is not None for device in self.bench._devices)
        self.bench.read(number, 0, Command.NONE)
        self.bench.write(orders(), number)
        sent = []
        for unit, peer in enumerate(self.peers, start=1):
            try:
                self.waiting[unit] = peer.recv(300)
                sent.append(unit)
            except BlockingIOError:
                continue
        return in_flight, sent

    def answer(self, *units: int) -> None:
        """Let these devices answer what they were asked."""
        for unit in units:
            request = self.waiting.pop(unit, b"")
            if not request:
                continue
            count = request[11]
            body = request[6:8] + bytes((2 * count,)) + bytes((0x4C, 0x40 + unit)) + bytes(2 * count - 2)
            if request[7] == 16:
                body = request[6:12]
            self.peers[unit - 1].sendall(request[:4] + len(body).to_bytes(2, "big") + body)

    def close(self) -> None:
        for peer in self.peers:
            peer.close()
        self.bench.close()
        self.bus.other.shutdown()


@pytest.fixture
def lines() -> Iterator[ThreeLines]:
    one = ThreeLines()
    yield one
    one.close()


def test_a_scan_looks_and_asks_no_more_often_than_it_may(lines: ThreeLines) -> None:
    asked = []
    for number in range(60):
        in_flight, sent = lines.scan(number)
        assert in_flight + len(sent) <= lines.bench._most_calls == 4
        asked += sent
        lines.answer(1, 2, 3)
    counts = [asked.count(unit) for unit in (1, 2, 3)]
    assert counts[0] == 60, "the amplifier is asked in every scan"
    assert abs(counts[1] - counts[2]) <= 1, "the slow devices take turns"
    assert min(counts) >= 25


def test_a_slow_device_that_waits_is_asked_before_the_other_is_asked_again(lines: ThreeLines) -> None:
    lines.scan(0)
    lines.answer(1, 2)  # the remote I/O takes its time
    for number in range(1, 8):
        _, sent = lines.scan(number)
        assert 1 in sent
        lines.answer(1, 2)
    lines.answer(3)
    seen = []
    for number in range(8, 14):
        seen += [unit for unit in lines.scan(number)[1] if unit != 1]
        lines.answer(1, 2, 3)
    assert 3 in seen[:3]
    assert abs(seen.count(2) - seen.count(3)) <= 1
