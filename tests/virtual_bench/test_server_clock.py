"""The virtual bench in real time: what a computer that holds the process up does to plant and drive."""

from __future__ import annotations

import pytest

from drivers.pace import Kind, ToBench
from virtual_bench import bench_time, pace_port
from virtual_bench.awaited import LOST_AFTER
from virtual_bench.config import ServerConfig
from virtual_bench.devices.modbus_servers import ModbusServer
from virtual_bench.pace_port import QUIET_S, PacePort
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


def test_a_scan_that_was_given_up_has_missed_what_passed_meanwhile(
    server_config: ServerConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = VirtualBench(server_config, None, lambda *_text, **_more: None)
    bench.begin(MS)
    began_ns = bench.time.now_ns
    ended = ToBench(Kind.SCAN_ENDED, 0, 0, 0, ())
    assert bench.let_scan_pass(ended).missed == 0
    bench.go_on()
    clock_ns = bench.time._wall_ns
    monkeypatch.setattr(bench_time.time, "monotonic_ns", lambda: clock_ns + 7 * MS + 1)
    bench.tick()
    bench.wait_again()
    assert bench.let_scan_pass(ended._replace(number=1)).missed == 8, "seven periods, and what was begun of the next"
    assert bench.time.now_ns - began_ns == (2 + 8) * MS, "the record of the scan has the time of the bench"
    assert bench.let_scan_pass(ended._replace(number=10)).missed == 0


def test_a_bench_that_was_held_up_itself_does_not_give_its_scan_up(
    server_config: ServerConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    logged: list[str] = []
    bench = VirtualBench(server_config, None, lambda *_text, **_more: None)
    port = PacePort(bench, lambda event, _text: logged.append(event))
    now_s = [1000.0]
    monkeypatch.setattr(pace_port.time, "monotonic", lambda: now_s[0])
    scan = pace_port._Connection(port)
    monkeypatch.setattr(scan, "answer", lambda _answer: None)

    def looks(every_s: float, duration_s: float) -> None:
        for _ in range(round(duration_s / every_s)):
            now_s[0] += every_s
            port.look()

    port.heard(scan, ToBench(Kind.BEGIN, MS, 0, 0, ()))
    looks(0.01, 1.0)
    looks(3.0, 3.0)
    assert (bench.time.led, logged) == (True, ["pace_begun"]), "nobody could be heard in the three seconds"
    looks(0.01, QUIET_S)
    assert (bench.time.led, logged) == (False, ["pace_begun", "pace_ended"])
