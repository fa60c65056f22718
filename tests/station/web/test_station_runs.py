"""Runs that the station starts: one at a time, its own business, and found again by a server that was just started."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import pytest
from lostmotion_command import here
from served import LONGEST_S, Served, prepared, served, served_by
from station_support import client_of
from stored_runs import metric, store_run

from station.documents.manifest import RunningProcess
from station.records.run_record import RESULT, RunRecord
from station.run.jog.jogs import FOLDER
from station.run.next_run import SUPERVISOR
from station.web import running
from station.web.bench import jogging
from station.web.bench.jogging import Jogging
from station.web.running import ENDED, STARTING, Running
from station.web.station import Station

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


def test_a_run_of_before_with_the_same_process_id_is_not_the_one_that_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = store_run(tmp_path, "SN-1", [metric(0.5)])
    assert before.manifest().desk.pid == os.getpid()
    bench = Running(tmp_path)
    started = SimpleNamespace(pid=os.getpid(), poll=lambda: None)
    monkeypatch.setattr(bench._next, "start", lambda *_, **__: started)
    later = "when the computer had started again"
    monkeypatch.setattr(running, "running_process", lambda pid: RunningProcess(pid=pid, birth=later))
    bench.start([], "SN-2")
    found = bench.now()
    assert (found.stage, found.serial, found.verdict) == (STARTING, "SN-2", None), "and no PASS of the unit before it"
    assert bench.busy()


def test_a_jog_of_before_with_the_same_process_id_is_not_the_one_that_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = store_run(tmp_path / FOLDER, "SN-1", [metric(0.5)])
    assert before.manifest().desk.pid == os.getpid()
    births = ["when the computer had started again", before.manifest().desk.birth]
    reads, writes = os.pipe()
    with os.fdopen(reads), os.fdopen(writes, "w") as stdin:
        started = SimpleNamespace(pid=os.getpid(), poll=lambda: None, stdin=stdin, returncode=None)
        monkeypatch.setattr(jogging.subprocess, "Popen", lambda *_, **__: started)
        monkeypatch.setattr(jogging, "running_process", lambda pid: RunningProcess(pid=pid, birth=births.pop(0)))
        found = Jogging(tmp_path, lambda _: None)
        found.start([], "a session", "Ada")
        assert found.standing().now.stage == STARTING, "the jog of before has ended, and this one begins"
        found.start([], "a session", "Ada")
        assert found.standing().now.stage != STARTING, "its own record is being put away"


def test_a_record_that_was_altered_has_no_verdict_over_rest(station: Station) -> None:
    run = store_run(station.data, "SN-1", [metric(0.5)], failed="lost_motion: 9.9 is above the limit")
    (run.folder / RESULT).write_text((run.folder / RESULT).read_text("utf-8").replace("FAIL", "PASS"), encoding="utf-8")
    now = client_of(station, "operator").http.get("/api/now").json()
    assert (now["stage"], now["run"], now["verdict"], now["reasons"]) == (ENDED, run.id, None, [])
    assert RESULT in now["altered"][0]


@pytest.mark.parametrize(
    ("what", "badges"),
    [({}, []), ({"virtual": "P1"}, ["VIRTUAL BENCH"]), ({"scenario": "cut"}, ["FAULTS INJECTED"])],
)
def test_what_is_no_measurement_of_a_real_unit_says_so_beside_its_verdict(
    station: Station, what: dict[str, str], badges: list[str]
) -> None:
    store_run(station.data, "SN-1", [metric(0.5)], **what)
    now = client_of(station, "operator").http.get("/api/now").json()
    assert (now["verdict"], now["badges"]) == ("PASS", badges)
