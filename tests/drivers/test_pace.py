"""A scan that waits for a virtual bench: how long, and what it does when nothing comes."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from drivers import pace as of_pace
from drivers.pace import BEGUN, TO_BENCH, FromBench, Kind, Pace, PaceConfig, ToBench, from_bench, from_bytes_to_bench
from virtual_bench.pace_port import QUIET_S

HELD_UP_S = 0.5


def next_message(connection: socket.socket) -> ToBench:
    return from_bytes_to_bench(connection.recv(TO_BENCH.size, socket.MSG_WAITALL))


@contextmanager
def bench_that_answers_after(*held_up_s: float) -> Iterator[Pace]:
    """A pace that was begun before a bench which is held up for so long in each of the scans."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            connection, _ = server.accept()
            with connection:
                assert next_message(connection).kind == Kind.HELLO
                connection.sendall(from_bench(FromBench(BEGUN, 0, 0, (), b"P1".ljust(of_pace.UNIT_BYTES, b"\0"))))
                assert next_message(connection).kind == Kind.BEGIN
                connection.sendall(from_bench(FromBench(BEGUN, 0, 0, (), b"")))
                for held_up in held_up_s:
                    scan = next_message(connection).number
                    time.sleep(held_up)
                    connection.sendall(from_bench(FromBench(scan, 0, 0, (), b"")))
                connection.recv(1)

        thread = threading.Thread(target=serve)
        thread.start()
        pace = Pace(PaceConfig("127.0.0.1", server.getsockname()[1]))
        try:
            pace.open(10.0)
            pace.begin(1_000_000)
            yield pace
        finally:
            pace.close()
            thread.join()


def test_a_bench_that_the_host_holds_up_is_waited_for():
    """Longer than any age that a recipe allows: nothing of it may show in the samples."""
    with bench_that_answers_after(0.0, HELD_UP_S, 0.0) as pace:
        for scan in range(3):
            pace.scan_ended(scan, 0, 0, ())
            pace.wait()
            assert (pace.answer.number, pace.unanswered, pace.in_step) == (scan, 0, True)


def test_a_bench_that_does_not_answer_is_waited_for_once_and_counts_again_when_it_does(monkeypatch):
    monkeypatch.setattr(of_pace, "LONGEST_WAIT_S", 0.05)
    with bench_that_answers_after(HELD_UP_S, 0.0) as pace:
        pace.scan_ended(0, 0, 0, ())
        began = time.monotonic()
        pace.wait()
        assert (pace.unanswered, pace.in_step) == (1, False)
        waits = 0
        while not pace.in_step and time.monotonic() < began + 60.0:
            pace.wait()
            waits += 1
        assert waits > 1, "it did not wait any more"
        assert pace.answer.number == 0
        pace.scan_ended(1, 0, 0, ())
        while pace.answer.number != 1 and time.monotonic() < began + 60.0:
            pace.wait()
        assert pace.answer.number == 1


def test_neither_takes_the_other_for_dead_before_it_has_waited():
    assert HELD_UP_S < of_pace.LONGEST_WAIT_S < QUIET_S
