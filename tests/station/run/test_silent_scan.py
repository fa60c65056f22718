"""A scan that says nothing any more: its person is told, and ends it by asking again."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import Running, here

from definitions.image import Command
from station.records.process_birth import process_birth
from station.records.ring.ring import ScanState
from station.records.samples.scan_record import RECORD_BYTES
from station.run import silent_scan
from station.run.silent_scan import GIVEN_UP, GIVEN_UP_AFTER_S, SILENT, SILENT_AFTER_S, SilentScan


class Ring:
    """What is looked at of a ring."""

    def __init__(self) -> None:
        self.written, self.lost, self.state = 0, 0, ScanState.RUNNING


class Desk:
    """A silent scan's listener by a clock of the test, with what it says and ends."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s, self.ring = 0.0, Ring()
        self.told: list[str] = []
        self.ends = 0
        monkeypatch.setattr(silent_scan.time, "monotonic", lambda: self.now_s)
        self.scan = SilentScan(self.ring, self.told.append, self._kill)  # type: ignore[arg-type]

    def _kill(self) -> None:
        self.ends += 1

    def look(self, seconds: float, records: int, every_s: float = 0.02) -> None:
        for _ in range(round(seconds / every_s)):
            self.now_s += every_s
            self.ring.written += records
            self.scan.look()


@pytest.fixture
def desk(monkeypatch: pytest.MonkeyPatch) -> Desk:
    return Desk(monkeypatch)


def test_a_scan_is_silent_from_its_last_record_on_and_says_so_once(desk: Desk) -> None:
    desk.ring.state = ScanState.ARMED
    desk.look(2 * SILENT_AFTER_S, 0)
    assert not desk.scan.silent, "it opens the bench"
    desk.ring.state = ScanState.RUNNING
    desk.look(1.0, 20)
    desk.look(2 * SILENT_AFTER_S, 0)
    assert (desk.scan.silent, desk.told) == (True, [SILENT])
    desk.look(0.1, 20)
    assert not desk.scan.silent
    desk.ring.state = ScanState.FINISHED
    desk.look(2 * SILENT_AFTER_S, 0)
    assert (desk.scan.silent, desk.told) == (False, [SILENT])


def test_a_scan_that_hangs_before_its_first_record_is_silent_too(desk: Desk) -> None:
    desk.look(2 * SILENT_AFTER_S, 0)
    assert desk.scan.silent


def test_a_scan_whose_records_find_the_ring_full_is_not_silent_and_may_unload(desk: Desk) -> None:
    """A disk that stalls takes no record for a while: the scan that stops for that was killed while it unloaded."""
    desk.look(1.0, 20)
    assert not desk.scan.end(Command.STOP)
    for _ in range(round(2 * GIVEN_UP_AFTER_S / 0.02)):
        desk.ring.lost += 20
        desk.look(0.02, 0)
    assert (desk.scan.silent, desk.ends, desk.told) == (False, 0, [])


def test_who_was_held_up_itself_has_not_listened(desk: Desk) -> None:
    desk.look(1.0, 20)
    desk.look(10 * SILENT_AFTER_S, 0, every_s=5 * SILENT_AFTER_S)
    assert not desk.scan.silent


def test_only_who_asks_again_while_it_is_silent_ends_it_and_once(desk: Desk) -> None:
    desk.look(1.0, 20)
    assert not desk.scan.end(Command.QUICK_STOP), "it answers, and is left to obey"
    desk.look(2 * SILENT_AFTER_S, 0)
    assert not desk.scan.end(Command.STOP), "it may still come back, and unload"
    assert desk.scan.end(Command.QUICK_STOP)
    assert not desk.scan.end(Command.QUICK_STOP)
    assert (desk.ends, desk.scan.ended, desk.told) == (1, True, [SILENT, GIVEN_UP])


def test_who_asks_once_waits_for_a_silent_scan_so_long_and_no_longer(desk: Desk) -> None:
    desk.look(1.0, 20)
    desk.look(2 * GIVEN_UP_AFTER_S, 0)
    assert desk.ends == 0, "nobody has asked for a stop"
    desk.look(0.1, 20)
    assert not desk.scan.end(Command.STOP)
    desk.look(GIVEN_UP_AFTER_S - 1.0, 0)
    assert desk.ends == 0
    desk.look(2.0, 0)
    assert (desk.ends, desk.scan.ended) == (1, True)


@pytest.fixture
def hung(start: Any, one_ramp: tuple[str, ...], tmp_path: Path) -> Iterator[tuple[Running, int]]:
    """A run in whose middle the scan process stands still."""
    run = start("run", *one_ramp, "--serial", "H", "--json", data=tmp_path / "runs")
    run.wait_for(lambda: any(one.stat().st_size > 500 * RECORD_BYTES for one in tmp_path.glob("runs/*/samples.bin")))
    (report,) = tmp_path.glob("runs/*/scan-report.json")
    scan = json.loads(report.read_bytes())["pid"]
    os.kill(scan, signal.SIGSTOP)
    yield run, scan
    run.end()


@pytest.mark.wires
def test_a_run_whose_scan_hangs_comes_to_an_end_by_ctrl_c(hung: tuple[Running, int], tmp_path: Path) -> None:
    """It took as many Ctrl-C as the ring has room for commands, and an error at the end."""
    run, scan = hung
    asked = 0
    while not run.ended(0.5):
        asked += 1
        assert asked < 40, "nothing ends it"
        run.interrupt()
    ran = run.finish()
    assert ran.exit_code == 4
    assert not process_birth(scan)
    assert (ran.json["state"], ran.json["verdict"]) == ("interrupted", "NOT DECIDABLE")
    assert any("did not answer any more" in reason for reason in ran.json["reasons"])
    assert GIVEN_UP in ran.err
    assert here("list", "--data", str(tmp_path / "runs")).exit_code == 0
