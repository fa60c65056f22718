from __future__ import annotations

import subprocess
import sys

from lostmotion_command import ROOT
from station_samples import IMAGE, ORDERS

from definitions.image import Command, Image, Orders, State
from station.records.scan_times import ScanTimes
from station.scan.scan_loop import START_AT, Stop, run_real, run_virtual, start_once
from station.scan.schedule import RealTimeSchedule


class Line:
    """A bench and a controller that note what they were given; finished after `scans` scans or by STOP."""

    def __init__(self, scans: int) -> None:
        self.left = scans
        self.seen: list[tuple[int, int, int]] = []
        self.recorded: list[int] = []

    @property
    def finished(self) -> bool:
        return self.left <= 0

    def read(self, scan: int, missed_periods: int, command: int) -> Image:
        self.seen.append((scan, missed_periods, command))
        return IMAGE._replace(missed_periods=missed_periods, command=command)

    def step(self, image: Image, scan: int) -> Orders:
        self.left = 0 if image.command == Command.STOP else self.left - 1
        return ORDERS._replace(segment=scan)

    def write(self, orders: Orders, scan: int) -> None:
        assert orders.segment == scan

    def append(self, scan: int, lateness_ns: int, work_ns: int, image: Image, orders: Orders) -> bool:
        assert lateness_ns >= 0
        assert work_ns >= 0
        assert image.command == self.seen[-1][2]
        assert orders.segment == scan
        self.recorded.append(scan)
        return True


def test_virtual_time_runs_every_scan_and_starts_once() -> None:
    line = Line(100)
    assert run_virtual(line, line, line.append, start_once) == 100
    assert line.recorded == list(range(100))
    assert [scan for scan, _, command in line.seen if command == Command.START] == [START_AT]


def test_real_time_numbers_periods_over_the_missed_ones() -> None:
    line = Line(30)
    schedule, started = RealTimeSchedule(200_000), []
    last = run_real(
        line,
        line,
        line.append,
        lambda: 0,
        schedule=schedule,
        stop=Stop(),
        times=ScanTimes(),
        note_start=started.append,
    )
    assert started == [schedule.started_ns]
    assert last == line.recorded[-1] == 29 + sum(missed for _, missed, _ in line.seen)


def test_a_stop_signal_becomes_one_stop_command() -> None:
    line, stop = Line(1000), Stop()
    stop.ask(15, None)
    run_real(line, line, line.append, lambda: 0, schedule=RealTimeSchedule(200_000), stop=stop, times=ScanTimes())
    assert [command for _, _, command in line.seen] == [Command.STOP]


def test_a_lost_record_stops_the_run() -> None:
    line = Line(1000)
    run_real(
        line, line, lambda *_: False, lambda: 0, schedule=RealTimeSchedule(200_000), stop=Stop(), times=ScanTimes()
    )
    assert [command for _, _, command in line.seen] == [0, Command.STOP]


REQUESTS = """
from station.scan import realtime
print("\\n".join(f"{grant.name}:{bool(grant.detail)}" for grant in realtime.request_all()))
"""


def test_every_request_is_answered_with_a_reason() -> None:
    # in a process of its own, and a small one: the requests change the process for good, and lock all its memory
    said = subprocess.run([sys.executable, "-c", REQUESTS], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    names = [line.split(":") for line in said.splitlines()]
    assert [name for name, _ in names] == ["affinity", "timer_slack", "prefault", "mlock", "gc_off", "fifo"]
    assert all(detail == "True" for _, detail in names)


class Trouble:
    """A machine that misses two periods before the fourth scan, and hears where the controller is."""

    def __init__(self) -> None:
        self.told: list[tuple[str, int]] = []

    def take_missed(self) -> int:
        return 2 if len(self.told) == 3 else 0

    def tell(self, state: str, scan: int) -> None:
        self.told.append((state, scan))


def test_faults_in_virtual_time_miss_periods_and_hear_where_the_controller_is() -> None:
    line, trouble = Line(60), Trouble()
    assert run_virtual(line, line, line.append, start_once, trouble) == 60
    assert line.recorded == [0, 1, 2, *range(5, 62)]
    assert [missed for _, missed, _ in line.seen][:5] == [0, 0, 0, 2, 0]
    assert [scan for scan, _, command in line.seen if command == Command.START] == [START_AT + 2]
    assert [scan for _, scan in trouble.told] == line.recorded
    assert {state for state, _ in trouble.told} == {State(ORDERS.state).name.lower()}
