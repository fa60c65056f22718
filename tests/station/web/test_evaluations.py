"""Reports and loops are made beside the server: at a lower priority, again after a kill, and the store is kept up."""

from __future__ import annotations

import os
import signal
import time
from contextlib import suppress
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from benchmarks.many_runs import make_runs
from station.errors import StationError
from station.records.chain.chain_file import Chain
from station.records.run_record import RunRecord
from station.store.table_counts import behind
from station.store.view import opened
from station.web import server
from station.web.evaluations import Evaluations
from station.web.server import Served, serve, start_beside

LONGEST_S = 120.0


@pytest.mark.long
def test_the_process_gives_way_keeps_the_store_up_and_comes_again(quick_run: Any, tmp_path: Path) -> None:
    data, run = tmp_path / "runs", RunRecord(quick_run.record)
    make_runs(data, 5)
    beside = Evaluations()
    beside.fork()
    database = opened(data)
    try:
        beside.start(data)
        until = time.monotonic() + LONGEST_S
        while behind(database, Chain(data)):
            assert time.monotonic() < until
            time.sleep(0.1)
        process = beside._submit(os.getpid).result(LONGEST_S)
        assert process != os.getpid()
        assert os.getpriority(os.PRIO_PROCESS, process) > os.getpriority(os.PRIO_PROCESS, 0)
        os.kill(process, signal.SIGKILL)
        found = None
        while found is None:
            assert time.monotonic() < until + LONGEST_S
            with suppress(StationError):  # of whoever was waiting when it was killed
                found = beside.loop(run)
        assert len(found.loop) >= 2
        assert beside.loop(run) is found, "made once while the files are as they were"
    finally:
        beside.close()
        database.close()
    with pytest.raises(StationError, match="shutting down"):
        beside.loop_csv(run)


def test_what_is_made_beside_the_server_is_in_the_time_zone_of_the_plant(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TZ", "UTC")
    (tmp_path / "station.yaml").write_text("time_zone: Asia/Kolkata\n", encoding="utf-8")
    try:
        beside = start_beside(tmp_path)
        assert beside.figure(time.strftime, "%z") == "+0530"
        beside.close()
    finally:
        monkeypatch.undo()
        time.tzset()


def test_the_heap_is_set_before_the_threads_that_look_after_the_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    order = []

    def begin(_data: Path) -> Evaluations:
        order.append("threads")
        raise StationError

    monkeypatch.setattr(server, "keep_heap_small", lambda: order.append("heap"))
    monkeypatch.setattr(server, "start_beside", begin)
    with pytest.raises(StationError):
        serve(Served(tmp_path, "127.0.0.1", 0))
    assert order == ["heap", "threads"], "a thread that was there before has a heap of its own for good"


def test_a_fork_that_the_system_refuses_keeps_no_server_from_its_start(monkeypatch: pytest.MonkeyPatch) -> None:
    beside = Evaluations()
    with monkeypatch.context() as system:
        system.setattr(os, "fork", Mock(side_effect=BlockingIOError))
        beside.fork()
    assert beside.figure(os.getpid) != os.getpid(), "it is started when it is needed"
    beside.close()


def test_ctrl_c_at_the_terminal_is_for_the_server_and_not_for_the_process_beside_it() -> None:
    beside = Evaluations()
    beside.fork()
    process = beside.figure(os.getpid)
    os.kill(process, signal.SIGINT)
    assert beside.figure(os.getpid) == process
    beside.close()
