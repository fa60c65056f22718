"""Runs that the station starts: one at a time, its own business, and found again by a server that was just started."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from lostmotion_command import here
from served import LONGEST_S, Served, prepared, served, served_by

from station.records.run_record import RunRecord
from station.run.next_run import SUPERVISOR

pytestmark = pytest.mark.wires


def wait_until(found: Callable[[], object], what: str) -> None:
    until = time.monotonic() + LONGEST_S
    while not found():
        assert time.monotonic() < until, what
        time.sleep(0.05)


def command_of(pid: int) -> str:
    """Return the command line of a process, '' of one that has ended."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    except OSError:
        return ""


def next_supervisor(server: Served) -> int:
    """Wait for the process that waits for the next run."""

    def waiting() -> list[int]:
        children = Path(f"/proc/{server.process.pid}/task").glob("*/children")
        pids = [int(pid) for one in children for pid in one.read_text().split()]
        return [pid for pid in pids if SUPERVISOR in command_of(pid)]

    wait_until(waiting, "no process waits for the next run")
    return waiting()[0]


def test_a_killed_server_takes_nothing_with_it_and_a_bad_unit_is_put_away(tmp_path: Path) -> None:
    data = prepared(tmp_path / "runs")
    with served(data) as first:
        first.log_in("operator")
        waiting = next_supervisor(first)
        with ThreadPoolExecutor(4) as pool:
            answers = list(pool.map(lambda n: first.post("start_run", {"scanned": f"BAD-{n}"}, f"key {n}"), range(4)))
        assert sorted(one.status_code for one in answers) == [200, 409, 409, 409], "one run of four starts"
        refused = next(one for one in answers if one.status_code == 409).json()["refused"]
        assert [one["id"] for one in refused] == ["bench_free"]
        running = first.wait("running")
        assert RunRecord(data / running["run"]).manifest().desk.pid == waiting, "it is the process that waited for it"
        first.kill()
    command = [sys.executable, "-m", "station", "serve", "--port", "0", "--fast", "--data", str(data)]
    with served_by(command, data) as second:
        second.log_in("operator")
        again = second.wait("running", "ended")
        assert again["run"] == running["run"], "a server that was just started shows the newest run, over or not"
        assert second.wait("ended")["verdict"] == "FAIL"
        result = second.http.get(f"/api/runs/{running['run']}").json()
        assert (result["serial"], result["state"], result["verdict"]) == (running["serial"], "complete", "FAIL")
        assert len(here("list", "--data", str(data), "--json").json) == 1
        assert result["operator"] == "the operator"

        refused = second.post("start_run", {"scanned": "SN-5"}, "next").json()["refused"]
        assert [one["id"] for one in refused] == ["bad_unit_put_away"]
        refused = second.post("start_run", {"scanned": running["serial"]}, "the same").json()["refused"]
        assert [one["id"] for one in refused] == ["bad_unit_put_away", "retest_reason"]
        assert second.post("confirm_nok", {"run": "of no unit"}, "another").status_code == 409
        assert second.post("confirm_nok", {"run": running["run"]}, "put away").status_code == 200
        refused = second.post("start_run", {"scanned": running["serial"]}, "once more").json()["refused"]
        assert [one["id"] for one in refused] == ["retest_reason"]
        again = {"scanned": running["serial"], "retest_reason": "seating of the unit"}
        assert second.post("start_run", again, "with a reason").status_code == 200
        ended = second.wait("ended")
        result = second.http.get(f"/api/runs/{ended['run']}").json()
        assert (result["attempt"], result["retest_reason"]) == (2, "seating of the unit")
        (earlier,) = result["before"]
        assert (earlier["attempt"], earlier["verdict"], earlier["run"]) == (1, "FAIL", running["run"])
        (failed,) = earlier["failed"]
        shown = here("show", ended["run"], "--data", str(data)).out
        assert failed in ended["attempt"]
        assert failed in " ".join(shown.split())
        refused = second.post("start_run", again, "a third time").json()["refused"]
        assert [one["id"] for one in refused] == ["bad_unit_put_away", "attempts_left"]
        waiting = next_supervisor(second)
    wait_until(lambda: not command_of(waiting), "it ends with the server")
    assert here("verify", "--data", str(data)).exit_code == 0
    assert here("audit", "verify", "--data", str(data)).exit_code == 0
