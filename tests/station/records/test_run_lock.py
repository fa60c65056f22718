"""One owner of a run: by a lock, because process ids mean nothing on another computer or in another container."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from station_samples import IMAGE, ORDERS, SETUP

from station.records.data_folder import Store
from station.records.ring.ring import ScanState, create
from station.records.ring.writer import RingWriter
from station.records.run_lock import RunLock
from station.records.run_record import RunRecord
from station.run.way_back.recover import recover, resume

ROOT = Path(__file__).parents[3]
OWNER = """
import sys, time
from pathlib import Path
from station.records.run_lock import RunLock
lock = RunLock(Path(sys.argv[1]))
print(lock.take(), flush=True)
time.sleep(60)
"""


@pytest.fixture
def owner() -> Iterator[Callable[[Path], subprocess.Popen[str]]]:
    """Start a process that owns a run."""
    started: list[subprocess.Popen[str]] = []

    def own(folder: Path) -> subprocess.Popen[str]:
        words = [sys.executable, "-c", OWNER, str(folder)]
        started.append(subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, text=True))
        assert started[-1].stdout is not None
        assert started[-1].stdout.readline() == "True\n"
        return started[-1]

    yield own
    for process in started:
        process.kill()
        process.communicate()


@pytest.fixture
def run(tmp_path: Path) -> Iterator[RunRecord]:
    """A run with three records in its ring, whose supervisor cannot be seen from here."""
    record = Store(tmp_path / "runs").create("SN1", SETUP, {"recipe.yaml": b"no recipe", "bench.yaml": b"no bench"})
    ring = create(tmp_path, 16)
    writer = RingWriter(ring)
    for scan in range(3):
        writer.append(scan, 0, 0, IMAGE, ORDERS)
    writer.set_state(ScanState.RUNNING)
    writer._words[9] = 0  # its process is of another container too
    writer.close()
    record.update(ring=str(ring), desk={"pid": 1, "birth": "0"})
    yield record
    ring.unlink(missing_ok=True)  # shared memory outlives a test


def test_a_run_that_somebody_owns_is_left_alone(run: RunRecord, owner: Callable[[Path], subprocess.Popen[str]]) -> None:
    process = owner(run.folder)
    assert run.deserted()
    assert run.state() == "recording"
    assert recover(run) == 0
    assert resume(run, lambda _ring: None) == 0
    assert run.records() == 0
    process.kill()
    process.wait()
    assert run.state() == "not concluded"
    assert recover(run) == 3
    assert run.records() == 3


def test_of_two_that_take_a_run_over_one_has_it(run: RunRecord) -> None:
    first, second = RunLock(run.folder), RunLock(run.folder)
    assert first.take()
    assert not second.take()
    assert second.taken()
    first.close()
    first.close()
    assert not second.taken()
    assert second.take()
    second.close()


def test_looking_at_a_run_does_not_own_it(run: RunRecord) -> None:
    assert not run.lock.taken()
    assert not RunLock(run.folder).taken()
    assert recover(run) == 3


def test_a_new_run_is_owned_before_it_can_be_seen(tmp_path: Path) -> None:
    record = Store(tmp_path).create("SN1", SETUP, {}, own=True)
    assert RunLock(record.folder).taken()
    record.lock.close()
    assert not RunLock(record.folder).taken()


def test_a_new_supervisor_begins_before_it_loads_what_shows_a_result() -> None:
    """A scan waits 2 s for a new supervisor; on a busy machine loading the analysis alone took longer."""
    heavy = ("numpy", "scipy", "analysis", "matplotlib", "recipes", "pint")
    program = f"import sys, station.cli.measure.resume; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
