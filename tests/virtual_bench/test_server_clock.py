"""The virtual bench in real time: what a computer that holds the process up does to plant and drive."""

from __future__ import annotations

import pytest

from drivers.pace import Kind, ToBench
from virtual_bench import bench_time
from virtual_bench.awaited import LOST_AFTER
from virtual_bench.config import ServerConfig
from virtual_bench.devices.modbus_servers import ModbusServer
from virtual_bench.wired_bench import VirtualBench

MS = 1_000_000


@pytest.mark.parametrize(
    ("elapsed_ms", "plant_ms", "excused_ms", "said"),
    [(2, 2, None, []), (60, 60, 60, []), (3000, 500, 500, ["process_stopped"])],
)
def test_plant_and_drive_after_a_standstill(
    server_config: ServerConfig,
    monkeypatch: pytest.MonkeyPatch,
    *,
    elapsed_ms: int,
    plant_ms: int,
    excused_ms: int | None,
    said: list[str],
) -> None:
    logged: list[str] = []
    bench = VirtualBench(server_config, None, lambda event, *_text, **_more: logged.append(event))
    clock_ns = bench.time._wall_ns
    excused: list[int] = []
    monkeypatch.setattr(bench.drive.axis.machine, "excuse_silence", excused.append)
    monkeypatch.setattr(bench_time.time, "monotonic_ns", lambda: clock_ns + elapsed_ms * MS)
    bench.advance()
    assert bench.plant.now_ns == pytest.approx(plant_ms * MS, abs=50_000)
    assert excused == ([] if excused_ms is None else [excused_ms * MS])
    assert logged == said


def test_a_request_that_comes_after_it_was_given_up_is_answered_at_once(
    server_config: ServerConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A device with one request in hand takes the next one when the first is answered, and the bench waits for that."""
    bench = VirtualBench(server_config, None, lambda *_text, **_more: None)
    monkeypatch.setattr(ModbusServer, "reachable", True)
    server, *others = bench.servers.values()
    answered: list[int] = []
    bench.begin(MS)

    def ended(scan: int) -> ToBench:
        return ToBench(Kind.SCAN_ENDED, scan, 0, 0, (scan + 1, *[0] * len(others)))

    assert bench.missing(ended(0)), "the host holds the request up"
    bench.give_up(ended(0))
    bench.let_scan_pass(ended(0))
    server.requests = 1
    server._waiting.append(lambda: answered.append(0))
    assert bench.missing(ended(1))
    assert answered == [0]
    server.requests = 2
    server._waiting.append(lambda: answered.append(1))
    assert not bench.missing(ended(1))
    assert answered == [0], "a request that comes in time is answered when the scan has ended"
    bench.let_scan_pass(ended(1))
    assert answered == [0, 1]


def test_requests_that_come_late_now_and_then_are_waited_for_however_often(server_config: ServerConfig) -> None:
    bench = VirtualBench(server_config, None, lambda *_text, **_more: None)
    bench.begin(MS)
    place = list(bench.servers).index("amplifier")
    for sent in range(1, LOST_AFTER + 5):
        requests = tuple(sent if at == place else 0 for at in range(len(bench.servers)))
        ended = ToBench(Kind.SCAN_ENDED, sent, 0, 0, requests)
        assert bench.missing(ended), "the host holds the request up"
        bench.give_up(ended)
        assert not bench.missing(ended)
        bench.let_scan_pass(ended)
        bench.servers["amplifier"].requests = sent
        assert not bench.missing(ended), "it has come, and another scan without a request ends"
        bench.let_scan_pass(ended)
